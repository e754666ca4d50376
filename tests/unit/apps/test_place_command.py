"""`maira-qp place`: exit codes, what is printed and written, mistakes; and layers of the viewer."""

import json
import time

import numpy as np
import pytest
from support.command_line import misuse

import maira_qp as mq
from maira_qp.apps.cli import main

POSES = "x,y,z,roll,pitch,yaw\n0.5,0.1,0.4,3.14159265,0,0\n0.4,-0.2,0.5,3.14159265,0,0.3\n"
GRID = ("--x", "-0.4", "0.4", "--y", "0", "--step", "0.4", "--turn", "3.2")


@pytest.fixture
def place(capsys, tmp_path):
    """The command on a file of two poses: its exit code, and what it printed."""
    file = tmp_path / "poses.csv"
    file.write_text(POSES)

    def run(*arguments: str, poses: str = str(file)) -> tuple[int, str, str]:
        code = main(["place", poses, "--robot", "iiwa14", *arguments])
        return code, *capsys.readouterr()

    return run


def test_bases_are_printed_and_written(place, tmp_path, monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    pytest.importorskip("matplotlib")
    files = ("--output", str(tmp_path / "bases.csv"), "--picture", str(tmp_path / "bases.png"))
    code, out, _ = place(*GRID, *files)
    assert code == 0
    assert "all 2 poses are reached from the best base" in out
    assert max(len(line) for line in out.splitlines() if not line.startswith("written")) <= 80
    assert (tmp_path / "bases.csv").read_text().startswith("rank,x,y,z,yaw,poses,reached,unreachable,least,mean")
    assert (tmp_path / "bases.png").read_bytes().startswith(b"\x89PNG")
    assert place("--x", "5", "--y", "0")[0] == 1


def test_units_are_those_of_the_flags(place, tmp_path):
    mm = tmp_path / "mm.csv"
    mm.write_text("x,y,z,roll,pitch,yaw\n500,100,400,180,0,0\n400,-200,500,180,0,17.188733853924695\n")
    flags = ("--x", "-400", "400", "--y", "0", "--step", "400", "--turn", "183.3465", "--mm", "--deg", "--json")
    in_mm = json.loads(place(*flags, poses=str(mm))[1])
    in_m = json.loads(place(*GRID, "--json")[1])
    assert [base["reached"] for base in in_mm["bases"]] == [base["reached"] for base in in_m["bases"]]
    for a, b in zip(in_mm["bases"], in_m["bases"], strict=True):
        assert a["x"] == pytest.approx(b["x"], abs=1e-9)


def test_a_map_in_place_of_a_robot(capsys, tmp_path, place):
    pytest.importorskip("zarr")
    folder = str(tmp_path / "map")
    main(["reach", "--robot", "iiwa14", "--cell", "0.4", "--directions", "6", "--output", folder, "--engine", "here"])
    capsys.readouterr()
    assert main(["place", str(tmp_path / "poses.csv"), "--map", folder, *GRID, "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["bases"][0]["reached"] == 2
    assert "--map has its robot" in misuse(place("--map", folder))


def test_mistakes_are_said_with_their_flags(place, tmp_path):
    assert "--x must be a number or a range" in misuse(place("--x", "1", "0"))
    assert "--step must be a positive number" in misuse(place("--step", "0"))
    assert "--keep must be a positive" in misuse(place("--keep", "0"))
    assert "ends in .csv or .json" in misuse(place("--output", str(tmp_path / "a.txt")))
    assert "a picture's name ends in" in misuse(place("--picture", str(tmp_path / "a.txt")))
    empty = tmp_path / "empty.csv"
    empty.write_text("x,y,z,roll,pitch,yaw\n")
    assert "holds no pose" in misuse(place(poses=str(empty)))
    empty.write_text(POSES + "0.1,,0.2,0,0,0\n")
    assert "line 4: a cell is empty or not finite" in misuse(place(poses=str(empty)))


def test_cells_of_a_map_as_points(tmp_path):
    pytest.importorskip("zarr")
    layers = pytest.importorskip("maira_qp.apps.viewer.drawing.layers", reason="the viewer needs viser")
    robot = mq.Robot.iiwa14()
    mq.scale.run(mq.scale.ReachJob.of(robot, cell=0.3, directions=8), tmp_path / "map", engine="here")
    reach = mq.scale.ReachMap.open(tmp_path / "map")
    share = reach.values("reachable")
    points, values, edge = layers.cells_shown(reach, "reachable", 0.5, "whole", 0.0)
    assert len(points) == (share >= 0.5).sum()
    np.testing.assert_allclose(reach.at(points, "reachable"), values)
    assert edge == 0.3
    half, _, _ = layers.cells_shown(reach, "manipulability", 0.0, "y", 0.1)
    assert 0 < len(half) < (share > 0).sum()
    assert half[:, 1].min() >= 0.1
    colours = layers.colours(np.array([0.0, 0.4, 1.0]))
    assert colours[0].tolist() == [0, 32, 76]
    assert (np.diff(colours.sum(axis=1).astype(int)) > 0).all()
    assert layers.colours(np.empty(0)).shape == (0, 3)
    pytest.importorskip("skimage")
    assert layers.surface_shown(reach, "manipulability", 0.5).faces.shape[1] == 3
    assert layers.surface_shown(reach, "manipulability", 1.0) is None


def test_layers_are_drawn_beside_the_arm():
    pytest.importorskip("viser", reason="the viewer needs viser")
    from maira_qp.apps.arguments.robot_choice import RobotChoice
    from maira_qp.apps.viewer.drawing.layers import seen_from_base
    from maira_qp.apps.viewer.server import Viewer

    robot = mq.Robot.iiwa14()
    poses = [robot.forward(0.3 * k + np.zeros(7)) for k in range(3)]
    found = mq.scale.place(robot, poses, x=(0.0, 0.5), y=0.0, step=0.5, turn=3.0, keep=1)
    viewer = Viewer(RobotChoice(robot="iiwa14"), port=0, layers=[seen_from_base(found)])
    try:
        wanted, end = found[0].base.actInv(poses[0]), time.monotonic() + 30
        while not viewer.current.target.isApprox(wanted, 1e-6):
            assert time.monotonic() < end
            time.sleep(0.02)
    finally:
        viewer.close()
