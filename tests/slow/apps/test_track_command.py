"""`maira-qp track`: a file of poses is followed; verdict, files and pictures, and files that are not what they seem."""

import json
import os
import subprocess
import sys
from contextlib import contextmanager

import numpy as np
import pytest
from PIL import Image
from support.command_line import heed_interrupts, misuse, pipe_in
from support.robots import load, urdf_file

import maira_qp as mq
from maira_qp.apps.cli import main

HEADER = "x,y,z,roll,pitch,yaw\n"
N = 25


@pytest.fixture
def run(capsys):
    """`maira-qp track` in this process: exit code, stdout, stderr."""

    def call(*arguments):
        capsys.readouterr()
        code = main(["track", *map(str, arguments)])
        return code, *capsys.readouterr()

    return call


@pytest.fixture
def line(tmp_path):
    """A file with a line that MAIRA follows."""
    path = tmp_path / "line.csv"
    path.write_text(HEADER + rows())
    return path


def rows(count=N, **changes):
    """Rows of a line, some of them replaced: `_3="..."`."""
    given = [f"0.5,{y:.6f},0.6,{np.pi},0,0" for y in np.linspace(-0.1, 0.1, count)]
    for name, text in changes.items():
        given[int(name[1:])] = text
    return "".join(f"{row}\n" for row in given)


def test_a_path_is_followed_and_written_beside_its_poses(run, line):
    code, out, _ = run(line)
    assert code == 0
    assert out.startswith(f"followed whole: {N} poses")
    assert "line.path.csv" in out
    header, *written = line.with_suffix(".path.csv").read_text().splitlines()
    columns = dict(zip(header.split(","), zip(*(row.split(",") for row in written), strict=True), strict=True))
    robot = mq.Robot.maira()
    for k in (0, N - 1):
        q = [float(columns[f"q_{joint}"][k]) for joint in robot.joint_names]
        goal = mq.pose([0.5, np.linspace(-0.1, 0.1, N)[k], 0.6], rpy=[np.pi, 0, 0])
        assert np.abs(mq.pose_error(robot.forward(q), goal)).max() < 1e-5


def test_the_table_fits_80_columns(run, line, monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    _, out, _ = run(line, "--timed", "--acceleration", 5)
    tables = [text for text in out.splitlines() if not text.startswith("written")]
    assert max(map(len, tables)) <= 80
    assert "…" not in out
    assert "tool off the path" in out


def test_a_timed_path_goes_to_ros(run, line, tmp_path):
    output = tmp_path / "out" / "line.ros.json"
    code, out, _ = run(line, "--timed", "--acceleration", 5, "--jerk", 50, "--json", "--output", output)
    told = json.loads(out)
    assert code == 0
    assert told["followed_whole"] is True
    assert 0 <= told["position_deviation"]["value"] < 1e-3
    assert told["files"] == [str(output)]
    message = json.loads(output.read_text())
    end = message["points"][-1]["time_from_start"]
    assert end["sec"] + 1e-9 * end["nanosec"] == pytest.approx(told["duration"])


def test_degrees_are_those_of_the_file_and_the_flags(run, line, tmp_path):
    """The same path in degrees, timed within the same limits, has the same answer."""
    acceleration = 5.0
    run(line, "--timed", "--acceleration", acceleration, "--output", tmp_path / "rad.npz")
    line.write_text(line.read_text().replace(str(np.pi), "180"))
    limit = np.degrees(acceleration)
    code, _, _ = run(line, "--timed", "--acceleration", limit, "--deg", "--output", tmp_path / "deg.npz")
    assert code == 0
    with np.load(tmp_path / "rad.npz") as one, np.load(tmp_path / "deg.npz") as two:
        np.testing.assert_allclose(one["q"], np.radians(two["q"]), atol=1e-5)
        assert set(two["q_units"]) == {"deg"}
        assert np.abs(two["acceleration"]).max() <= limit * (1.0 + 1e-6)


@pytest.mark.parametrize("name", ["maira", "ur5"])
def test_pictures_are_drawn(run, tmp_path, name):
    """With the swivel angle of an S-R-S arm, and without one."""
    file, robot = (name, mq.Robot.maira()) if name == "maira" else (urdf_file(name), load(name))
    q = robot.middle + np.linspace(0.3, 0.6, 8)[:, None] * np.ones(robot.n)
    targets = np.array([robot.forward(each).homogeneous for each in q])
    np.savez(tmp_path / "poses.npz", targets=targets)
    picture, film = tmp_path / "path.png", tmp_path / "path.gif"
    arguments = ["--robot", file, "--tip", robot.tip, "--picture", picture, "--animation", film]
    assert run(tmp_path / "poses.npz", *arguments)[0] == 0
    with Image.open(picture) as drawn:
        assert drawn.size[0] > 500
        heights = drawn.size[1]
    assert (heights > 1700) is (name == "maira")
    with Image.open(film) as drawn:
        assert 2 <= drawn.n_frames <= 150
    assert not list(tmp_path.glob("*.part"))


def test_a_path_with_a_pose_out_of_reach_says_where_and_why(run, line):
    line.write_text(HEADER + rows(_10=f"5.0,0,0.6,{np.pi},0,0"))
    code, out, _ = run(line)
    assert code == 3
    assert out.startswith(f"followed up to pose 10 of {N}, {line}, line 12")
    code, out, _ = run(line, "--timed", "--acceleration", 5)
    assert code == 3
    assert "not timed" in out
    assert "written" not in out.replace("are written", "")


def test_a_part_of_a_single_pose_is_said_so(run, line):
    line.write_text(HEADER + rows(_1=f"5.0,0,0.6,{np.pi},0,0", _3=f"5.0,0,0.6,{np.pi},0,0"))
    out = run(line)[1]
    assert f"followed: pose 0 alone, pose 2 alone, poses 4 to {N - 1}" in out


def circle(count=60, turns=1.0, spin=0.0):
    """Rows of a circle; the tool turns about its axis by `spin` on the way."""
    angles = np.linspace(0.0, 2 * np.pi * turns, count)
    places = zip(0.1 * np.cos(angles), 0.1 * np.sin(angles), spin * np.linspace(0.0, 1.0, count), strict=True)
    return HEADER + "".join(f"0.5,{y:.9f},{0.5 + z:.9f},{np.pi:.12f},0,{yaw:.9f}\n" for y, z, yaw in places)


def test_a_loop_ends_as_it_begins(run, tmp_path):
    file = tmp_path / "loop.csv"
    file.write_text(circle())
    code, out, _ = run(file, "--loop", "--json", "--output", tmp_path / "q.npz")
    assert code == 0
    assert json.loads(out)["followed_whole"]
    with np.load(tmp_path / "q.npz") as table:
        q = table["q"]
    np.testing.assert_allclose(q[0], q[-1], atol=1e-6)
    file.write_text(circle(turns=0.6))
    assert "repeat the first pose at the end" in misuse(run(file, "--loop"))


def test_a_tool_that_turns_too_far_is_free_to_turn(run, tmp_path):
    """Four turns of the tool are beyond the limits of its joint, unless they are of no account."""
    file = tmp_path / "spin.csv"
    file.write_text(circle(spin=8 * np.pi, count=200))
    assert run(file)[0] == 1
    assert run(file, "--free-axis", "z")[0] == 0


def test_too_small_a_step_is_no_misuse(run, line):
    code, out, _ = run(line, "--max-step", 1e-5, "--json")
    told = json.loads(out)
    assert code == 1
    assert told["followed_whole"] is False
    assert "is allowed" in told["reason"]


def test_the_start_is_that_of_the_flag_or_of_the_first_row(run, line, tmp_path):
    robot = mq.Robot.maira()
    q = mq.Solver(robot).solve(mq.pose([0.5, -0.1, 0.6], rpy=[np.pi, 0, 0]), rng=5).q
    first = {}
    assert run(line, "--q0", *q, "--output", tmp_path / "flag.npz")[0] == 0
    names = ",".join(f"q0_{joint}" for joint in robot.joint_names)
    own = ",".join(map(repr, q.tolist()))
    body = rows().splitlines()
    text = [f"{HEADER.strip()},{names}", f"{body[0]},{own}", *(f"{row}{',' * robot.n}" for row in body[1:])]
    line.write_text("\n".join(text) + "\n")
    assert run(line, "--output", tmp_path / "file.npz")[0] == 0
    for name in ("flag", "file"):
        with np.load(tmp_path / f"{name}.npz") as archive:
            first[name] = archive["q"]
    np.testing.assert_allclose(first["flag"][0], q, atol=1e-5)
    np.testing.assert_array_equal(first["flag"], first["file"])
    assert "both give a start" in misuse(run(line, "--q0", *q))


def test_one_pose_is_a_path(run, line, tmp_path):
    line.write_text(HEADER + rows(1))
    code, out, _ = run(
        line, "--timed", "--acceleration", 5, "--picture", tmp_path / "one.png", "--animation", tmp_path / "one.gif"
    )
    assert code == 0
    assert "0 s, 1 samples" in out


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ("", ["empty"]),
        (HEADER, ["holds no pose"]),
        ("x,y,z\n0.5,0,0.6\n", ["no column of an orientation"]),
        (HEADER + rows(_4="0.5,,0.6,0,0,0"), ["line 6", "empty or not finite"]),
        (HEADER + rows(_4="0.5,nan,0.6,0,0,0"), ["line 6", "empty or not finite"]),
        (HEADER + rows(_4="0.5,far,0.6,0,0,0"), ["line 6", "is not a number"]),
    ],
)
def test_a_file_that_is_no_path_is_refused_with_its_line(run, line, content, words):
    line.write_text(content)
    told = misuse(run(line))
    for word in words:
        assert word in told
    assert [file.name for file in line.parent.iterdir()] == ["line.csv"]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--acceleration", 5], "--acceleration only counts with --timed"),
        (["--timed"], "no limit of the acceleration of 'joint1'; give --acceleration"),
        (["--timed", "--acceleration", 5, "--sample-time", 0], "--sample-time must be a positive number"),
        (["--timed", "--acceleration", 1, 2], "--acceleration: give 7 joint values"),
        (["--timed", "--acceleration", 5, "--jerk", 0], "jerk must be positive"),
        (["--dt", 0], "--dt must be a positive number"),
        (["--max-step", 0], "--max-step must be positive"),
        (["--max-reconfigurations", -1], "--max-reconfigurations must be a whole number"),
        (["--seed", -1], "--seed must be 0 or more"),
        (["--output", "path.txt"], "ends in"),
        (["--output", "path.ros.json"], "give --timed, or --dt"),
        (["--picture", "path.gif"], "a picture's name ends in"),
        (["--animation", "path.avi"], "ends in .gif or .mp4"),
    ],
)
def test_bad_flags_say_what_is_valid(run, line, arguments, words):
    assert words in misuse(run(line, *arguments))
    assert [file.name for file in line.parent.iterdir()] == ["line.csv"]


def test_the_poses_are_not_written_over(run, line):
    assert "is the file of the poses" in misuse(run(line, "--output", line))


def test_a_file_that_is_not_there_is_named(run, tmp_path):
    assert "absent.csv" in misuse(run(tmp_path / "absent.csv"))


def test_a_reader_that_goes_away_does_not_change_the_verdict(line):
    read, write = os.pipe()
    os.close(read)
    command = [sys.executable, "-m", "maira_qp", "track", str(line)]
    ran = subprocess.run(command, stdout=write, stderr=subprocess.PIPE, text=True, check=False)
    os.close(write)
    assert (ran.returncode, ran.stderr) == (0, "")
    assert line.with_suffix(".path.csv").exists()


@pytest.mark.parametrize("closed", [">&-", "2>&-", ">&- 2>&-"])
def test_streams_that_are_closed_are_not_written_to(line, closed):
    command = f"{sys.executable} -m maira_qp track {line} {closed}"
    ran = subprocess.run(["sh", "-c", command], capture_output=True, text=True, check=False)
    assert ran.returncode == 0
    assert "Traceback" not in ran.stderr
    missing = subprocess.run(
        ["sh", "-c", f"{command.replace(str(line), 'absent.csv')}"], capture_output=True, check=False
    )
    assert missing.returncode == 2


def test_ctrl_c_while_a_path_is_followed_leaves_nothing(line):
    code = (
        "import os, signal, sys\nfrom maira_qp.apps.cli import main\nfrom maira_qp.solvers.solver import Solver\n"
        "track = Solver.track\n"
        "def interrupt(done, total):\n    os.kill(os.getpid(), signal.SIGINT)\n"
        "Solver.track = lambda *args, progress, **options: track(*args, progress=interrupt, **options)\n"
        "sys.exit(main(sys.argv[1:]))\n"
    )
    command = [sys.executable, "-c", code, "track", str(line)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=600, preexec_fn=heed_interrupts, check=False)
    assert done.returncode == 130
    assert done.stderr.splitlines()[-1] == "maira-qp: interrupted"
    assert "Traceback" not in done.stderr
    assert os.listdir(line.parent) == [line.name]


def test_the_bar_grows_to_the_number_of_poses(run, line, monkeypatch):
    seen = []

    @contextmanager
    def bar(label):
        yield lambda done, total: seen.append((done, total))

    monkeypatch.setattr("maira_qp.apps.arguments.output.progress_bar", bar)
    assert run(line)[0] == 0
    assert seen[-1] == (N, N)


@pytest.mark.parametrize("arguments", [[], ["--timed", "--acceleration", "5"]], ids=["path", "timed"])
def test_a_path_goes_through_a_pipe(run, line, arguments, tmp_path, monkeypatch):
    """What a file would hold goes to standard output, the summary to stderr, also as JSON."""
    assert run(line, *arguments, "--output", tmp_path / "whole.csv")[0] == 0
    for further in ([], ["--json", "--output", "-"]):
        pipe_in(monkeypatch, line.read_bytes())
        code, out, err = run("-", *arguments, *further)
        assert code == 0
        assert out == (tmp_path / "whole.csv").read_text()
    told = json.loads(err)
    assert told["followed_whole"]
    assert told["files"] == []
    assert sorted(os.listdir(tmp_path)) == ["line.csv", "whole.csv"]


def test_a_pipe_that_cannot_be_followed_is_told_with_its_line(run, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    pipe_in(monkeypatch, (HEADER + rows(_10=f"5.0,0,0.6,{np.pi},0,0")).encode())
    code, out, err = run("-")
    assert code == 3
    assert f"followed up to pose 10 of {N}, standard input, line 12" in err
    assert len(out.splitlines()) == N + 1
    pipe_in(monkeypatch, b"x,y\n1,2\n")
    assert "standard input" in misuse(run("-"))
    assert os.listdir(tmp_path) == []


def test_a_reader_of_the_joint_values_that_goes_away_does_not_change_the_verdict(line):
    read, write = os.pipe()
    os.close(read)
    command = [sys.executable, "-m", "maira_qp", "track", str(line), "--output", "-"]
    ran = subprocess.run(command, stdout=write, stderr=subprocess.PIPE, text=True, check=False)
    os.close(write)
    assert ran.returncode == 0
    assert ran.stderr.startswith("followed whole")
    assert "Traceback" not in ran.stderr
