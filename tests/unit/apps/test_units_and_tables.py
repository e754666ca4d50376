"""What commands print and write: in the units that were asked for, in 80 columns, with names that are whole."""

import csv
import json

import numpy as np
import pytest
from support.robots import load, urdf_file

import maira_qp as mq
from maira_qp.apps.arguments.output import folded
from maira_qp.apps.cli import main
from maira_qp.orientation import quaternion_from_matrix

DEG, MM = np.pi / 180.0, 1e-3


@pytest.fixture
def run(capsys, monkeypatch):
    """Exit code, stdout, stderr of a call, at 80 columns."""
    monkeypatch.setenv("COLUMNS", "80")

    def call(*arguments):
        capsys.readouterr()
        code = main(list(map(str, arguments)))
        return code, *capsys.readouterr()

    return call


@pytest.fixture(scope="module")
def crane() -> mq.Robot:
    """A joint that turns, one that slides, two that turn: of very long names."""
    names = ("left_arm_shoulder_yaw_joint_of_the_upper_carriage", "boom", "boom_wrist_yaw_joint", "j4")
    links = [
        mq.DHLink(a=0.5, lower=-3, upper=3, name=names[0]),
        mq.DHLink(kind="prismatic", a=0.2, alpha=np.pi / 2, lower=0, upper=1.5, name=names[1]),
        mq.DHLink(a=0.4, lower=-2, upper=2, name=names[2]),
        mq.DHLink(a=0.3, lower=-2, upper=2, name=names[3]),
    ]
    return mq.Robot.from_dh(links, name="crane")


def path_file(folder, robot, q) -> str:
    """A file with the poses of configurations (N, n), in mm, with quaternions."""
    rows = []
    for each in q:
        T = robot.forward(each)
        rows.append([*(T.translation / MM), *quaternion_from_matrix(T.rotation)])
    file = folder / "poses.csv"
    np.savetxt(file, rows, delimiter=",", header="x,y,z,qw,qx,qy,qz", comments="", fmt="%.12g")
    return str(file)


def read(file) -> dict[str, np.ndarray]:
    """The columns of a CSV file of numbers and truth values."""
    with open(file, newline="") as opened:
        header, *rows = csv.reader(opened)
    numbers = [
        [{"true": 1.0, "false": 0.0}.get(cell) if cell in ("true", "false") else float(cell) for cell in row]
        for row in rows
    ]
    return dict(zip(header, np.array(numbers).T, strict=True))


def test_a_path_is_written_in_the_units_asked_for_and_says_so(run, tmp_path):
    robot, name = load("tiago"), "tiago"
    q = robot.middle + np.linspace(0.2, 0.4, 6)[:, None] * np.ones(robot.n)
    poses, out = path_file(tmp_path, robot, q), tmp_path / "out.csv"
    code, told, _ = run(
        "track", poses, "--robot", urdf_file(name), "--tip", robot.tip, "--mm", "--deg", "--output", out
    )
    assert code == 0
    assert "worst position error [mm]" in told
    assert "worst orientation error [deg]" in told
    assert max(len(line) for line in told.splitlines() if not line.startswith("written")) <= 80
    found = read(out)
    units = {joint: "mm" if slides else "deg" for joint, slides in zip(robot.joint_names, robot.slides, strict=True)}
    assert set(found) >= {f"q_{joint} [{unit}]" for joint, unit in units.items()}
    assert {"position_error [mm]", "orientation_error [deg]"} <= set(found)
    for k, each in enumerate(q):
        values = [found[f"q_{joint} [{unit}]"][k] * (MM if unit == "mm" else DEG) for joint, unit in units.items()]
        assert np.abs(mq.pose_error(robot.forward(np.array(values)), robot.forward(each))).max() < 1e-5


def test_saved_paths_have_the_same_values_in_either_units(tmp_path):
    robot = load("irb140")
    path = mq.Solver(robot).track([robot.forward(robot.middle + 0.2 + 0.01 * k) for k in range(5)])
    plain, other = read(mq.save(path, tmp_path / "si.csv")), mq.save(path, tmp_path / "x.csv", degrees=True)
    for name, column in read(other).items():
        bare = name.removesuffix(" [deg]")
        assert column == pytest.approx(plain[bare] * (1.0 if bare == name else 1 / DEG), rel=1e-12)
    mq.save(path, tmp_path / "x.npz", degrees=True)
    with np.load(tmp_path / "x.npz") as archive:
        assert archive["q"] == pytest.approx(path.q / DEG)
        assert archive["q_units"].tolist() == ["deg"] * 6
    mq.save(path, tmp_path / "x.json", degrees=True, millimetres=True)
    assert np.array_equal(json.loads((tmp_path / "x.json").read_text())["q"], path.q)


def test_errors_of_a_solve_are_shown_in_the_units_asked_for(run):
    _, out, _ = run("solve", "--position", 3000, 0, 1000, "--rpy", 0, 90, 0, "--deg", "--mm")
    si = json.loads(run("solve", "--position", 3, 0, 1, "--rpy", 0, np.pi / 2, 0, "--json")[1])
    cells = " ".join(out.split())
    assert f"position error [mm] │ {si['position_error'] / MM:.3g}" in cells
    assert f"orientation error [deg] │ {si['orientation_error'] / DEG:.3g}" in cells


def test_what_a_command_says_is_in_the_units_asked_for(run, tmp_path):
    """The reason for which a pose, or a path, ends as it does."""
    _, out, _ = run("solve", "--position", 3000, 0, 1000, "--mm", "--deg")
    told = " ".join(out.split())
    assert "would be 3033 mm from the shoulder, where the arm spans at most 1400 mm" in told
    assert " m " not in told
    assert "degrees" not in told
    (tmp_path / "poses.csv").write_text("x,y,z,roll,pitch,yaw\n0.6,0,0.6,0,0,0\n-0.6,0,0.6,0,0,0\n")
    for units, allowed in (((), "0.5 rad is allowed"), (("--deg",), "28.65 deg is allowed")):
        _, out, _ = run("track", tmp_path / "poses.csv", *units, "--output", tmp_path / "out.csv")
        assert allowed in " ".join(out.split())


@pytest.mark.parametrize("units", [(), ("--mm", "--deg")])
def test_a_tool_is_given_by_its_place_with_or_without_an_orientation(run, maira, units):
    metre, radian = (1.0, 1.0) if not units else (1 / MM, 1 / DEG)
    q = maira.middle + 0.3
    place, rpy = np.array([0.05, -0.02, 0.1]), np.array([0.3, -0.4, 0.5])
    turned = mq.pose(place, rpy=rpy)
    tools = [
        (place * metre, mq.pose(place)),
        ([*place * metre, *rpy * radian], turned),
        ([*place * metre, *quaternion_from_matrix(turned.rotation)], turned),
    ]
    for numbers, tool in tools:
        flags = ["--tool", *numbers, *units, "--json"]
        found = json.loads(run("fk", *(q * radian), *flags)[1])
        expected = maira.forward(q) * tool
        assert found["matrix"] == pytest.approx(expected.homogeneous, abs=1e-9)
        goal = expected.translation * metre
        solved = json.loads(run("solve", "--position", *goal, "--position-only", *flags)[1])
        reached = maira.forward(np.array(solved["q"]) / radian) * tool
        assert np.linalg.norm(reached.translation - expected.translation) < 1e-5


def test_a_tool_of_another_form_is_refused(run):
    code, _, err = run("fk", "--tool", 1, 2)
    assert code == 2
    assert "X Y Z" in err
    assert run("fk", "--tool", 0, 0, 0, 1, 1, 1, 1)[0] == 2  # no unit quaternion


@pytest.mark.parametrize("picture", ["convergence", "trade-off", "self-motion", "reach", "path"])
def test_pictures_of_robots_with_several_tips_ask_for_one(run, tmp_path, picture):
    pytest.importorskip("matplotlib")
    code, out, err = run("plot", picture, "--robot", "tiago_dual", "--output", tmp_path / "x.png")
    assert code == 2
    assert not out
    assert "--tip arm_left_tool_link or --tip arm_right_tool_link" in err


def test_names_are_folded_without_loss():
    for name in (
        "shoulder_pan_joint",
        "left_arm_shoulder_yaw_joint_of_the_upper_carriage",
        "x" * 61,
        "",
        "a_" * 40,
        "é—_" * 9,
    ):
        for width in (8, 24):
            lines = folded(name, width).split("\n")
            assert "".join(lines) == name
            assert max(map(len, lines)) <= width
    assert folded("left_shoulder_pan_joint", 16) == "left_shoulder_\npan_joint"


def test_tables_of_long_names_fit(run, tmp_path, crane):
    file = tmp_path / "crane.urdf"
    file.write_text(crane.urdf)
    q = [0.3, 0.5, 0.4, 0.2]
    goal = crane.forward(np.array(q)).translation
    calls = [
        ("fk", *q, "--robot", file),
        ("solve", "--position", *goal, "--position-only", "--robot", file),
        ("solve", "--position", *goal, "--position-only", "--robot", file, "--all"),
    ]
    for call in calls:
        code, out, _ = run(*call)
        assert code == 0
        assert max(map(len, out.splitlines())) <= 80
        if "--all" not in call:
            assert "…" not in out
            assert "left_arm_shoulder_yaw_" in out
