"""The command line: exit codes, units, JSON, misuse, and what a shell does to it."""

import json
import math
import signal
import subprocess
import sys
import time

import numpy as np
import pytest
from PIL import Image
from support.command_line import heed_interrupts, misuse, run_without_reader
from support.robots import urdf_file

import maira_qp as mq
from maira_qp.apps.cli import main


def command(*arguments, **options):
    """The command line in a process of its own."""
    return subprocess.run(
        [sys.executable, "-m", "maira_qp", *arguments], capture_output=True, text=True, timeout=60, **options
    )


@pytest.fixture
def run(capsys):
    """The command line in this process: exit code, stdout, stderr without what a cold cache adds to it."""

    def call(*arguments):
        capsys.readouterr()
        code = main([str(argument) for argument in arguments])
        out, err = capsys.readouterr()
        told = [line for line in err.splitlines(keepends=True) if not line.startswith("compiling the engine")]
        return code, out, "".join(told)

    return call


def strict_json(text):
    """A JSON value by the letter: no NaN, no Infinity."""

    def refuse(constant):
        raise AssertionError(f"{constant} is not JSON")

    return json.loads(text, parse_constant=refuse)


def test_solved_is_0_and_the_json_is_the_solution(run, maira):
    """A solved pose exits with 0; the JSON's joint values put the tool there, judged afresh; negative numbers work."""
    code, out, err = run("solve", "--position", -0.4, 0, 0.5, "--quaternion", 0, -1, 0, 0, "--json")
    s = strict_json(out)
    assert (code, err) == (0, "")
    assert (s["status"], s["success"]) == ("CONVERGED", True)
    q = np.array(s["q"])
    error = mq.pose_error(maira.forward(q).homogeneous, mq.pose([-0.4, 0, 0.5], quaternion=[0, -1, 0, 0]).homogeneous)
    assert np.linalg.norm(error[:3]) <= 1e-6
    assert np.linalg.norm(error[3:]) <= 1e-6
    assert s["joint_names"] == list(maira.joint_names)
    assert s["cost"] is None  # NaN without redundancy


def test_the_exit_code_is_the_verdict_and_the_reason_is_said(run, maira):
    """A pose far outside exits with 3; table and JSON name the status, and the nearest q is inside the limits."""
    far = ("solve", "--position", 9, 0, 0, "--max-restarts", 2)
    code, out, _ = run(*far)
    assert code == 3
    assert "position error [m]" in out
    assert "UNREACHABLE" in out
    assert "proved to be out of reach" in out
    code, out, _ = run(*far, "--json")
    s = strict_json(out)
    assert code == 3
    assert "proved to be out of reach" in s["explanation"]["text"]
    assert s["success"] is False
    assert s["status"] in out
    assert (maira.lower <= s["q"]).all()
    assert (s["q"] <= maira.upper).all()


def test_all_lists_every_solution(run, maira):
    """In JSON and as a table, the best first; 1 where there is none; with neither a file of poses nor a start."""
    at = ("solve", "--position", 0.4, 0.2, 0.9, "--all")
    code, out, _ = run(*at, "--json")
    listed = strict_json(out)
    expected = mq.Solver(maira).solutions(mq.pose([0.4, 0.2, 0.9]))
    assert code == 0
    assert [one["q"] for one in listed["solutions"]] == [one.q.tolist() for one in expected]
    assert listed["is_complete"] is True
    code, out, _ = run(*at, "--deg")
    assert code == 0
    assert f"{len(expected)} solutions, closed form (S-R-S), complete" in out
    assert f"{math.degrees(expected[0].q[0]):.5f}" in out
    assert run("solve", "--position", 9, 0, 0, "--all")[0] == 1
    for other in (["--q0", *[0] * 7], ["--batch", "poses.csv"]):
        assert "--all" in misuse(run("solve", "--all", *other))


def test_misuse_is_2_with_one_line(run, tmp_path):
    """Whatever a caller gets wrong: exit code 2, one line on stderr that says what, nothing on stdout."""
    at = ("solve", "--position", 0.4, 0, 0.5)
    (tmp_path / "words.txt").write_text("not numbers")
    (tmp_path / "stretched.txt").write_text("2 0 0 0.4\n0 1 0 0\n0 0 1 0.5\n0 0 0 1\n")
    (tmp_path / "broken.urdf").write_text("<robot><link")
    for arguments, message in (
        (("solve",), "--position"),
        ((*at, "--quaternion", 0, 0, 0, 0), "quaternion is zero"),
        ((*at, "--quaternion", 1, 1, 0, 0), "norm"),
        ((*at, "--quaternion", 1, 0, 0, 0, "--rpy", 0, 0, 0), "quaternion and rpy"),
        (("solve", "--position", "nan", 0, 0), "finite"),
        ((*at, "--q0", 1, 2, 3), "give 7 joint values"),
        ((*at, "--q0"), "give 7 joint values"),
        ((*at, "--backend", "nope"), "daqp"),
        ((*at, "--weight", 1e-3), "--redundancy weighted"),
        ((*at, "--redundancy", "weighted", "--weight", -1), ">= 0"),
        ((*at, "--seed", -1), "--seed"),
        ((*at, "--position-tolerance", -1), "--position-tolerance must be"),
        ((*at, "--tip", "toool0"), "did you mean 'tool0'"),
        ((*at, "--robot", "pandaa"), "did you mean 'panda'"),
        ((*at, "--robot", tmp_path / "none.urdf"), "none.urdf"),
        ((*at, "--robot", tmp_path / "none.toml"), "none.toml"),
        ((*at, "--robot", tmp_path / "broken.urdf"), "XML"),
        (("solve", "--matrix", tmp_path / "none.txt"), "none.txt"),
        (("solve", "--matrix", tmp_path / "words.txt"), "words.txt"),
        (("solve", "--matrix", tmp_path / "stretched.txt"), "not orthonormal"),
        ((*at, "--matrix", tmp_path / "stretched.txt"), "--position"),
        (("fk", 1, 2), "give 7 joint values"),
        (("fk", "inf", 0, 0, 0, 0, 0, 0), "finite"),
        (("urdf", "--output", tmp_path / "words.txt" / "x"), "words.txt"),
        (("bench", "--targets", 0), "targets"),
        (("compare", "--targets", 0), "targets"),
        (("compare", "--picture", "comparison.xyz"), ".png"),
        (("solv",), "did you mean 'solve'"),
        (("plot", "reech"), "did you mean 'reach'"),
        (("compare", "--backend", "nope"), "daqp"),
    ):
        assert message in misuse(run(*arguments)), arguments


@pytest.mark.parametrize(
    "arguments", [(), ("plot",), ("nope",), ("solve", "--bogus"), ("solve", "--position", "1", "2"), ("fk", "x")]
)
def test_what_cannot_be_parsed_is_2(run, arguments):
    """Unknown verbs and flags and missing values: exit code 2, told on stderr, no traceback."""
    code, out, err = run(*arguments)
    assert code == 2
    assert out == ""
    assert err
    assert "Traceback" not in err


@pytest.mark.parametrize(("arguments", "names"), [((), ("solve", "view", "doctor")), (("plot",), ("reach", "path"))])
def test_without_a_name_all_are_shown(run, arguments, names):
    code, out, err = run(*arguments)
    assert (code, out) == (2, "")
    assert err.startswith("usage: maira-qp")
    assert all(name in err for name in names)


def test_degrees_in_and_out(run, iiwa14):
    """With --deg the same start and orientation in degrees give the same solution, in degrees."""
    q0 = iiwa14.clip(np.array([0.3, -0.5, 0.2, 1.0, -0.1, 0.7, 0.4]))
    rpy = (0.1, -3.0, 0.4)
    at = ("solve", "--robot", "iiwa14", "--position", 0.4, 0.1, 0.6, "--json")
    _, out, _ = run(*at, "--rpy", *rpy, "--q0", *q0)
    radians = strict_json(out)
    _, out, _ = run(*at, "--rpy", *np.degrees(rpy), "--q0", *np.degrees(q0), "--deg")
    degrees = strict_json(out)
    np.testing.assert_allclose(np.radians(degrees["q"]), radians["q"], atol=1e-6)
    assert set(degrees["q_units"]) == {"deg"}
    assert set(radians["q_units"]) == {"rad"}
    np.testing.assert_allclose(iiwa14.forward(radians["q"]).rotation, mq.pose([0, 0, 0], rpy=rpy).rotation, atol=1e-5)


def test_millimetres_in_and_out(run, tmp_path, maira):
    flags = ("--quaternion", 0, 1, 0, 0, "--json")
    _, metres, _ = run("solve", "--position", 0.4, 0.2, 0.9, *flags)
    _, millimetres, _ = run("solve", "--position", 400, 200, 900, *flags, "--mm")
    assert json.loads(millimetres)["q"] == pytest.approx(json.loads(metres)["q"])
    matrix = np.diag([1.0, -1, -1, 1])
    matrix[:3, 3] = 400, 200, 900
    np.save(tmp_path / "pose.npy", matrix)
    _, out, _ = run("solve", "--matrix", tmp_path / "pose.npy", "--mm", "--json")
    assert json.loads(out)["q"] == pytest.approx(json.loads(metres)["q"])
    _, out, _ = run("fk", *json.loads(metres)["q"], "--mm", "--json")
    assert json.loads(out)["position"] == pytest.approx([400, 200, 900], abs=1e-2)
    assert json.loads(out)["position_unit"] == "mm"


def test_a_position_alone(run, maira):
    _, out, _ = run("solve", "--position", 0.4, 0.2, 0.9, "--position-only", "--json")
    assert maira.forward(json.loads(out)["q"]).translation == pytest.approx([0.4, 0.2, 0.9], abs=1e-6)
    assert json.loads(out)["orientation_error"] is None
    assert "orientation error [rad] │ free" in " ".join(
        run("solve", "--position", 0.4, 0.2, 0.9, "--position-only")[1].split()
    )
    code, _, err = run("solve", "--position", 0.4, 0.2, 0.9, "--position-only", "--rpy", 0, 0, 0)
    assert code == 2
    assert "leave --rpy out" in err


def test_sliding_joints_stay_in_metres(run, tmp_path):
    """With --deg a turning joint is in degrees and a sliding one still in metres, in and out."""
    (tmp_path / "crane.toml").write_text(
        'name = "crane"\n[[links]]\nkind = "revolute"\na = 0.5\n'
        '[[links]]\nkind = "prismatic"\nlower = 0.0\nupper = 1.0\n'
    )
    code, out, _ = run("fk", 90, 0.25, "--robot", tmp_path / "crane.toml", "--deg", "--json")
    found = strict_json(out)
    assert code == 0
    assert found["q_units"] == ["deg", "m"]
    np.testing.assert_allclose(found["q"], [90, 0.25])
    np.testing.assert_allclose(found["position"], [0, 0.5, 0.25], atol=1e-12)
    np.testing.assert_allclose(found["rpy"], [0, 0, 90], atol=1e-9)


@pytest.mark.parametrize("kind", ["txt", "csv", "json", "npy"])
def test_matrix_files(run, tmp_path, maira, rng, kind):
    """A pose from a file of any kind is solved; three decimals are taken, one is refused, and taken with --project."""
    q = maira.random_configuration(rng)
    for T, project, code in (
        (maira.forward(q).homogeneous, (), 0),
        (maira.forward(q).homogeneous.round(3), (), 0),
        (maira.forward(q).homogeneous.round(1), (), 2),
        (maira.forward(q).homogeneous.round(1), ("--project",), 0),
    ):
        path = tmp_path / f"pose.{kind}"
        if kind == "npy":
            np.save(path, T)
        elif kind == "json":
            path.write_text(json.dumps(T.tolist()))
        else:
            np.savetxt(path, T, delimiter="," if kind == "csv" else " ", fmt="%.17g")
        assert run("solve", "--matrix", path, *project)[0] == code


def test_an_orientation_file_with_a_position(run, tmp_path):
    """A 3x3 file is the orientation alone and goes with --position."""
    path = tmp_path / "R.txt"
    path.write_text("0 -1 0\n1 0 0\n0 0 1\n")
    code, out, _ = run("solve", "--matrix", path, "--position", 0.4, 0.2, 0.9, "--json")
    assert code == 0
    T = mq.Robot.maira().forward(strict_json(out)["q"])
    np.testing.assert_allclose(T.rotation, [[0, -1, 0], [1, 0, 0], [0, 0, 1]], atol=1e-5)


def test_redundancy_flags(run):
    """Strict reaches the pose at a lower posture cost than no wish does; weighted trades the pose away, ending in 1."""
    at = ("solve", "--position", -0.4, 0, 0.5, "--q0", *[0.5] * 7, "--json")
    q = {}
    for redundancy, code in (("none", 0), ("strict", 0), ("weighted", 1)):
        answer = run(*at, "--redundancy", redundancy)
        assert answer[0] == code
        q[redundancy] = np.array(strict_json(answer[1])["q"])
    assert np.sum(q["strict"] ** 2) < np.sum(q["none"] ** 2)
    assert np.sum(q["weighted"] ** 2) < np.sum(q["strict"] ** 2)


def test_a_start_outside_the_limits_is_told(run, maira):
    """A start beyond a limit is moved onto it, and table and JSON say so."""
    at = ("solve", "--position", -0.4, 0, 0.5, "--q0", 9, 0, 0, 0, 0, 0, 0)
    code, out, _ = run(*at)
    assert code == 0
    assert "was outside the joint limits" in out
    assert strict_json(run(*at, "--json")[1])["start_projected"] is True


def test_an_answer_that_left_its_start_is_told(run, maira):
    """Table and JSON say whether the answer left its start, and how far the farthest joint went."""
    near = ("solve", "--position", 0.4, 0.2, 0.9, "--quaternion", 0, 1, 0, 0, "--q0")
    start = strict_json(run(*near[:-1], "--json")[1])["q"]
    out = run(*near, *start)[1]
    assert "left the start" not in out
    assert "farthest joint from --q0" in out
    far = (*near, *maira.upper)
    left = strict_json(run(*far, "--json")[1])
    assert left["left_q0"] is True
    assert left["max_joint_change"] == pytest.approx(np.abs(maira.upper - left["q"]).max())
    assert "left the start --q0" in run(*far)[1]


def test_without_matplotlib_there_are_results_and_no_picture(run, monkeypatch, tmp_path):
    """One line says what to install; `plot`, which is nothing but a picture, is refused before the work."""
    for name in [name for name in sys.modules if name.split(".")[0] == "matplotlib"]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    for name in [name for name in sys.modules if name.startswith("maira_qp.apps.plots")]:
        monkeypatch.delitem(sys.modules, name)
    picture = tmp_path / "compared.png"
    code, out, _ = run("compare", "--targets", 2, "--picture", picture)
    assert code == 0
    assert "solved" in out
    assert "pip install 'maira-qp[plot]'" in out
    assert not picture.exists()
    few = ("--targets", 2, "--methods", "strict", "--strata", "uniform", "--backends", "compiled")
    code, out, _ = run("bench", *few, "--output", tmp_path / "new", "--json")
    assert code == 0
    assert strict_json(out)["summaries"]
    assert "pip install 'maira-qp[plot]'" in run("bench", *few, "--output", tmp_path / "new")[1]
    assert sorted(path.name for path in (tmp_path / "new").iterdir()) == ["rows.csv", "rows.jsonl", "summary.csv"]
    assert "maira-qp[plot]" in misuse(run("plot", "reach", "--output", picture))


@pytest.mark.parametrize("robot", ["maira", "panda"])
def test_all_solutions_can_be_read_at_80_columns(run, monkeypatch, robot):
    """No name and no number is cut, and no line is longer."""
    monkeypatch.setenv("COLUMNS", "80")
    where = () if robot == "maira" else ("--robot", urdf_file(robot), "--tip", "panda_hand_tcp")
    code, out, _ = run("solve", *where, "--position", 0.4, 0.2, 0.5, "--quaternion", 0, 1, 0, 0, "--all")
    assert code == 0
    assert all(len(line) <= 80 for line in out.splitlines() if not line.startswith("picture"))
    assert "…" not in out
    assert f"{'joint' if robot == 'maira' else 'panda_joint'}7 " in out


def test_what_looks_like_degrees_or_millimetres_is_hinted_at(run, tmp_path, caplog):
    at = ("solve", "--position", 0.4, 0.2, 0.9)
    for arguments, words in (
        ((*at, "--rpy", 0, 90, 0), "--rpy holds 90 rad"),
        ((*at, "--q0", 0, 90, 0, 20, 0, 30, 0), "joint2 at 90 rad"),
        (("solve", "--position", 400, 200, 900), "is it in millimetres? (--mm)"),
        (("fk", 0, 45, 0, 90, 0, 30, 0), "joint4 at 90 rad"),
    ):
        assert words in " ".join(run(*arguments)[1].split("hint: ")[1].split())
        assert words in strict_json(run(*arguments, "--json")[1])["hints"][0]
    run(*at, "--rpy", 0, 370, 0, "--deg")
    assert "is it in degrees?" not in caplog.text  # nor twice, in the answer and in the log
    run(*at, "--rpy", 0, 90, 0, "--all")
    assert "--rpy holds 90 rad" in caplog.text
    for arguments in (
        (*at, "--rpy", 0, 90, 0, "--deg"),
        ("solve", "--position", 40000, 0, 0, "--mm"),
        at,
        ("fk", 0, 1, 0, 1, 0, 1, 0),
    ):
        assert "hint" not in run(*arguments)[1]
    file = tmp_path / "poses.csv"
    file.write_text("x,y,z,roll,pitch,yaw\n400,200,900,0,90,0\n0.4,0.2,0.9,0,0,0\n")
    hints = " ".join(strict_json(run("solve", "--batch", file, "--json")[1])["hints"])
    assert "is it in millimetres? (--mm)" in hints
    assert "roll, pitch, yaw holds 90 rad" in hints
    hints = " ".join(strict_json(run("solve", "--batch", file, "--mm", "--deg", "--json")[1])["hints"])
    assert not hints


@pytest.mark.parametrize("arguments", [("fk", 0, 10), ("solve", "--position", 0.4, 0.2, 0.9, "--q0", 0, 10)])
def test_joint_values_that_are_missing_are_counted_and_named(run, arguments):
    code, _, err = run(*arguments)
    assert code == 2
    assert "give 7 joint values, not 2: those of joint1, joint2, joint3," in err


POSE = ("--position", 0.5, 0.2, 0.6, "--rpy", 10, 140, 20, "--deg")


@pytest.mark.parametrize(
    "arguments",
    [
        ("convergence", *POSE, "--redundancy", "strict", "--q0", *[20] * 7),
        ("trade-off", *POSE, "--weights", 1e-4, 1e-2),
        ("self-motion", *POSE),
        ("reach", "--rpy", 180, 0, 0, "--deg", "--plane", "xy", "--at", 0.3, "--cells", 5),
        ("path", *POSE, "--seconds", 0.5),
    ],
    ids=lambda arguments: arguments[0],
)
def test_plot_draws_a_picture(run, tmp_path, arguments):
    """Each kind, by its name, in the format that the file's name asks for, in as many dots as asked for."""
    path = tmp_path / "new" / "picture.png"
    code, out, err = run("plot", *arguments, "--robot", "iiwa14", "--output", path, "--dpi", 50)
    assert (code, out, err) == (0, f"picture: {path}\n", "")
    with Image.open(path) as picture:
        assert 300 <= picture.size[0] <= 400
        assert len(picture.convert("RGB").getcolors(1 << 16)) > 20


def test_plot_writes_nothing_on_bad_input(run, tmp_path, monkeypatch):
    """Whatever is wrong is told before anything is drawn: no file, no folder."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "scara.toml").write_text('name = "scara"\nlinks = [{ kind = "revolute", a = 0.4 }]\n')
    for arguments, message in (
        (("convergence",), "--position"),
        (("convergence", *POSE, "--q0", 1), "7 joint values, not 1"),
        (("convergence", *POSE, "--weight", 1), "--redundancy weighted"),
        (("convergence", *POSE, "--seed", -1), "--seed"),
        (("convergence", *POSE, "--output", "a.gif"), ".png, .svg, .pdf"),
        (("convergence", *POSE, "--dpi", 0), "--dpi"),
        (("trade-off", *POSE, "--weights", -1), ">= 0"),
        (("trade-off", *POSE, "--weights"), "--weights"),
        (("self-motion", "--position", 9, 0, 0), "no configuration"),
        (("self-motion", *POSE, "--robot", "scara.toml"), "S-R-S"),
        (("reach", "--cells", 1), "cells"),
        (("reach", "--at", "nan"), "--at must be within"),
        (("path", *POSE, "--dt", 0), "--dt"),
        (("path", *POSE, "--dt", 2, "--seconds", 1), "--dt"),
    ):
        assert message in misuse(run("plot", *arguments)), arguments
    assert [file.name for file in tmp_path.iterdir()] == ["scara.toml"]


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_shell_completion(run, shell):
    """A script for each shell, that knows verbs, pictures and flags."""
    code, out, _ = run("--tyro-print-completion", shell)
    assert code == 0
    for word in ("maira-qp", "solve", "doctor", "self-motion", "quaternion"):
        assert word in out


def test_the_seed_decides(run):
    """The same seed gives the same answer, another seed another."""
    at = ("solve", "--position", -0.4, 0, 0.5, "--json")
    answers = [strict_json(run(*at, "--seed", seed)[1])["q"] for seed in (3, 3, 4)]
    assert answers[0] == answers[1] != answers[2]


def test_every_option_is_a_flag(run):
    """Each field of Options is a flag of solve, with its docstring as help; its value arrives."""
    from dataclasses import fields

    code, out, _ = run("solve", "--help")
    assert code == 0
    for field in fields(mq.Options):
        assert f"--{field.name.replace('_', '-')}" in out
    assert "[rad]" in out
    assert "[m]" in out
    # one iteration, no restart: not enough
    at = ("solve", "--position", -0.4, 0, 0.5, "--q0", *[0.5] * 7, "--json")
    assert run(*at)[0] == 0
    code, out, _ = run(*at, "--max-iterations", 1, "--max-restarts", 0, "--max-settling", 0)
    assert code == 4
    assert strict_json(out)["restarts"] == 0


def test_help_tells_the_exit_codes(run):
    """The exit codes and the units are told by --help; --version prints the version; both exit with 0."""
    code, out, _ = run("--help")
    assert code == 0
    for text in (
        "exit codes",
        "1        not solved",
        "3        proved",
        "2        wrong use",
        "Lengths are in metres",
        "solve",
        "fk",
        "urdf",
        "compare",
        "bench",
    ):
        assert text in out
    assert run("--version")[:2] == (0, f"maira-qp {mq.__version__}\n")


def test_fk_is_the_forward_kinematics(run, maira, rng):
    """The printed pose is the robot's; the table shows it too, and says when a joint is outside its limits."""
    q = maira.random_configuration(rng)
    code, out, _ = run("fk", *q, "--json")
    found = strict_json(out)
    assert code == 0
    np.testing.assert_allclose(found["matrix"], maira.forward(q).homogeneous, atol=1e-15)
    np.testing.assert_allclose(
        mq.pose(found["position"], quaternion=found["quaternion"]).homogeneous, found["matrix"], atol=1e-12
    )
    np.testing.assert_allclose(mq.pose(found["position"], rpy=found["rpy"]).homogeneous, found["matrix"], atol=1e-12)
    assert found["inside_limits"] is True
    assert strict_json(run("fk", 0, 3, 0, 0, 0, 0, 0, "--json")[1])["inside_limits"] is False
    assert strict_json(run("fk", "--json")[1])["condition_number"] is None  # stretched out: infinite
    code, out, _ = run("fk", *q)
    assert code == 0
    assert f"{found['position'][0]:.6f}" in out


def test_urdf_round_trip(run, tmp_path, maira):
    """The written URDF loads as the same robot, from stdout and from a file; other tips can be asked for."""
    code, out, _ = run("urdf")
    assert code == 0
    assert mq.Robot.from_urdf(out).forward(np.ones(7)).isApprox(maira.forward(np.ones(7)), 1e-12)
    path = tmp_path / "arm.urdf"
    assert run("urdf", "--robot", "maira", "--output", path)[:2] == (0, "")
    assert path.read_text() == out
    code, out, _ = run("fk", *[0.1] * 4, "--robot", path, "--tip", "link4", "--json")
    assert code == 0
    np.testing.assert_allclose(strict_json(out)["matrix"], maira.forward([0.1] * 7, "link4").homogeneous, atol=1e-12)


def test_compare_prints_a_table_and_saves_a_picture(run, tmp_path):
    """The comparison names every method, judges them, and its picture is a PNG."""
    path = tmp_path / "comparison.png"
    code, out, err = run("compare", "--targets", 3, "--picture", path)
    assert (code, err) == (0, "")
    for text in ("dh-clamped", "weighted", "0.001", "fading", "strict", "posture", "out of", "condition number"):
        assert text in out
    assert all(len(line) <= 80 for line in out.splitlines() if not line.startswith("picture"))
    assert path.read_bytes().startswith(b"\x89PNG")
    code, out, _ = run("compare", "--targets", 2, "--picture", path, "--json")
    methods = {row["method"]: row for row in strict_json(out)["methods"]}
    assert methods["strict"]["strict"] == methods["fading 0.001"]["strict"] == 2
    assert all(row["violations"] == 0 for row in methods.values())


def test_compare_without_a_dh_table(run, tmp_path, maira):
    """For a robot from a URDF the reference is left out, and a note says why."""
    (tmp_path / "arm.urdf").write_text(maira.urdf)
    code, out, _ = run(
        "compare", "--robot", tmp_path / "arm.urdf", "--targets", 1, "--picture", tmp_path / "deep" / "c.svg"
    )
    assert code == 0
    assert "dh-clamped is left out" in out
    assert "strict" in out
    assert (tmp_path / "deep" / "c.svg").exists()


def test_another_tip_of_a_catalog_robot(run, maira):
    """A part of a robot of the catalog can be asked for by its links."""
    code, out, _ = run("fk", 0.3, 0.4, "--base", "link1", "--tip", "link3", "--json")
    T = strict_json(out)["matrix"]
    assert code == 0
    q = np.array([0.0, 0.3, 0.4, 0.0, 0.0, 0.0, 0.0])
    expected = maira.forward(q, "link1").inverse() * maira.forward(q, "link3")
    np.testing.assert_allclose(T, expected.homogeneous, atol=1e-12)


def test_bench_writes_its_files_and_goes_on(run, tmp_path):
    """Rows, tables and picture are written; a second run with the same flags adds nothing; other flags are refused."""
    flags = ("bench", "--methods", "dh-clamped", "pose", "--strata", "uniform", "--targets", 3, "--output", tmp_path)
    code, out, _ = run(*flags)
    assert code == 0
    assert "uniform (3 targets)" in out
    before = (tmp_path / "rows.jsonl").read_bytes()
    assert before.count(b"\n") == 1 + 6
    assert (tmp_path / "success.png").read_bytes().startswith(b"\x89PNG")
    assert (tmp_path / "summary.csv").read_text().count("\n") == 1 + 2
    code, out, _ = run(*flags, "--json")
    assert code == 0
    assert [s["count"] for s in strict_json(out)["summaries"]] == [3, 3]
    assert (tmp_path / "rows.jsonl").read_bytes() == before
    assert "seed" in misuse(run(*flags, "--seed", 1))


def test_as_a_process():
    """`python -m maira_qp` ends with the same exit codes."""
    for arguments, code in (
        (("--version",), 0),
        (("solve", "--position", "-0.4", "0", "0.5"), 0),
        (("solve", "--position", "9", "0", "0", "--max-restarts", "0"), 3),
        (("solve",), 2),
    ):
        done = command(*arguments)
        assert done.returncode == code, done.stderr
        assert "Traceback" not in done.stderr


@pytest.mark.parametrize("is_buffered", [False, True])
def test_a_reader_that_goes_away(is_buffered):
    """No traceback, exit code 141, whether it is the command that finds out or the last flush."""
    assert run_without_reader("urdf", is_buffered=is_buffered) == (141, "")


def test_ctrl_c(tmp_path):
    """An interrupt in the middle of a benchmark: exit code 130, one line, and the rows that were measured are kept."""
    rows = tmp_path / "rows.jsonl"
    flags = ["bench", "--targets", "100000", "--strata", "uniform", "--methods", "pose", "--output", str(tmp_path)]
    command = [sys.executable, "-m", "maira_qp", *flags]
    process = subprocess.Popen(command, stderr=subprocess.PIPE, text=True, preexec_fn=heed_interrupts)
    limit = time.monotonic() + 600  # a machine may have to compile first
    while not (rows.exists() and rows.read_bytes().count(b"\n") > 3) and time.monotonic() < limit:
        time.sleep(0.05)
    process.send_signal(signal.SIGINT)
    _, error = process.communicate(timeout=600)
    assert process.returncode == 130
    assert error.splitlines()[-1] == "maira-qp: interrupted"
    assert "Traceback" not in error
    lines = rows.read_text().splitlines()
    assert len(lines) > 3
    assert all(math.isfinite(strict_json(line)["time"]) for line in lines[1:])


def test_the_command_line_stays_light():
    """Importing it loads neither Matplotlib nor SciPy's statistics nor the benchmark's runner."""
    code = "import sys, maira_qp.apps.cli; print(*sys.modules)"
    loaded = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.split()
    assert "maira_qp.apps.cli" in loaded
    for module in (
        "matplotlib",
        "scipy.stats",
        "maira_qp.evaluation.runner",
        "maira_qp.apps.plots",
        "maira_qp.apps.plots.style",
        "rich.progress",
    ):
        assert module not in loaded
