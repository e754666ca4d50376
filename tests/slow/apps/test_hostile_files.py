"""Files and pipes that are not what they seem: an answer in words and in time, and exit codes that stay the verdict."""

import json
import os
import signal
import subprocess
import sys
import zipfile

import numpy as np
import pytest
from support.command_line import misuse, run_without_reader

import maira_qp as mq
from maira_qp.apps.arguments.pose_choice import read_matrix
from maira_qp.apps.cli import main
from maira_qp.errors import MairaError, PoseError, RobotError
from maira_qp.io.poses import read_poses
from maira_qp.regular_files import read_regular

READERS = {
    ".urdf": lambda path: mq.Robot.from_urdf(path),
    ".yaml": lambda path: mq.DHTable.from_file(path),
    ".toml": lambda path: mq.DHTable.from_file(path),
    ".csv": lambda path: read_poses(path, ["a"]),
    ".npz": lambda path: read_poses(path, ["a"]),
    ".parquet": lambda path: read_poses(path, ["a"]),
    ".txt": read_matrix,
    ".json": read_matrix,
    ".npy": read_matrix,
}


@pytest.mark.parametrize("kind", READERS)
def test_no_pipe_device_or_endless_file_is_waited_for(tmp_path, kind):
    """Nor is a directory, or nothing at all, a file; each is named in the message."""
    pipe, zero, sparse, folder = (tmp_path / f"{name}{kind}" for name in ("pipe", "zero", "sparse", "folder"))
    os.mkfifo(pipe)
    zero.symlink_to("/dev/zero")
    folder.mkdir()
    with sparse.open("wb") as file:
        file.truncate(2**40)
    for path in (pipe, zero, sparse, folder, tmp_path / f"none{kind}"):
        with pytest.raises(MairaError, match=path.name):
            READERS[kind](path)


@pytest.mark.parametrize("kind", READERS)
def test_bytes_that_mean_nothing_are_refused_in_words(tmp_path, kind, rng):
    path = tmp_path / f"a{kind}"
    deep = b"[" * 100_000
    for content in (b"", b"\0" * 100, b"\xff\xfe", deep, b"{" * 1000, bytes(rng.integers(0, 256, 300, dtype=np.uint8))):
        path.write_bytes(content)
        with pytest.raises(MairaError) as reason:
            READERS[kind](path)
        assert len(str(reason.value)) < 2000


def bomb(levels, width=10):
    """YAML in a few hundred bytes that stands for width^levels values."""
    lines = ["a0: &a0 [" + ",".join("1" * width) + "]"]
    for i in range(1, levels):
        lines.append(f"a{i}: &a{i} [" + ",".join([f"*a{i - 1}"] * width) + "]")
    return "\n".join(lines)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (bomb(12), "more than 10000 values"),
        (bomb(12).replace("a11:", "links:"), "more than 10000 values"),
        ("links: &a [{a: 1}, *a]", "within what it stands for"),
        ("links:\n- {a: 1, d: 2, a: 3}", "the key 'a' is given twice"),
        ("name: x\nname: y\nlinks: [{a: 1}]", "the key 'name' is given twice"),
        ("links: [{d: 2020-01-02}]", "DH parameter d must be a finite number, got '2020-01-02'"),
        ("links: [{d: 2020-13-45}]", "DH parameter d must be a finite number"),
        ("links: [{2020-01-02: 1}]", "unknown field '2020-01-02'"),
        ("links: [{a: [1, 2]}]", "DH parameter a must be a finite number"),
        ("links: [{a: 1:30}]", "DH parameter a must be a finite number, got '1:30'"),
        ("links: [{? [a] : 1}]", "cannot be parsed"),
        ("links: [{a: " + "9" * 5000 + "}]", "cannot be parsed"),
        ("links: [{d: 1e300}]", "beyond the largest that makes sense"),
        ("links: [{a: 1}]\n? {x: 1}\n: 2", "cannot be parsed"),
    ],
)
def test_yaml_that_surprises_is_refused(tmp_path, text, message):
    path = tmp_path / "a.yaml"
    path.write_text(text)
    with pytest.raises(RobotError, match=message) as reason:
        mq.DHTable.from_file(path)
    assert len(str(reason.value)) < 1000


def test_yaml_reads_numbers_as_people_do_and_aliases_that_are_few(tmp_path):
    path = tmp_path / "a.yaml"
    path.write_text("links:\n- &first {a: 1e-3, d: 010, alpha: -.5}\n- *first\n- {<<: *first, d: +2.5E1}\n")
    table = mq.DHTable.from_file(path)
    assert [(link.a, link.d, link.alpha) for link in table.links] == [(1e-3, 10, -0.5)] * 2 + [(1e-3, 25, -0.5)]


def test_packed_files_are_measured_unpacked(tmp_path, monkeypatch):
    path = tmp_path / "a.npz"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive, archive.open("targets.npy", "w") as file:
        np.lib.format.write_array(file, np.zeros((1000, 4, 4)))
    monkeypatch.setattr("maira_qp.io.npz_table.LARGEST_TABLE", 100_000)
    with pytest.raises(PoseError, match="unpacks to 128128 bytes"):
        read_poses(path, ["a"])
    pyarrow = pytest.importorskip("pyarrow")
    from pyarrow import parquet

    names = ["x", "y", "z", "qw", "qx", "qy", "qz"]
    parquet.write_table(pyarrow.table({name: np.ones(10_000) for name in names}), tmp_path / "a.parquet")
    monkeypatch.setattr("maira_qp.io.parquet_table.LARGEST_TABLE", 500_000)
    with pytest.raises(PoseError, match="unpacks to 560000 bytes"):
        read_poses(tmp_path / "a.parquet", ["a"])


def test_a_file_that_hides_its_size_is_not_read_without_end():
    with pytest.raises(RobotError, match=r"larger than 0 kB"):
        read_regular("/proc/self/maps", "the file", RobotError, 10)


# Pipes and signals


def piped(*arguments):
    """Exit code and stderr of the command line whose reader goes away at once."""
    code, error = run_without_reader(*arguments)
    return code, [line for line in error.splitlines() if "compiling" not in line]


def test_the_verdict_outlives_the_reader():
    assert piped("solve", "--position", "0.4", "0", "0.5") == (0, [])
    assert piped("solve", "--position", "9", "0", "0", "--json") == (3, [])


def test_sigterm_in_the_middle_of_a_file_leaves_the_old_one(tmp_path):
    """Exit code 143, one line, no part of a file; as often as files are written."""
    path = tmp_path / "robot.urdf"
    path.write_text("old")
    code = (
        "import os, signal, sys\nfrom maira_qp.apps.cli import main\n"
        "os.fsync = lambda _: os.kill(os.getpid(), signal.SIGTERM)\n"
        "sys.exit(main(sys.argv[1:]))\n"
    )
    command = [sys.executable, "-c", code, "urdf", "--output", str(path)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300)
    assert done.returncode == 128 + signal.SIGTERM
    assert done.stderr == "maira-qp: terminated\n"
    assert os.listdir(tmp_path) == ["robot.urdf"]
    assert path.read_text() == "old"


# Rounded poses, and limits, as flags


@pytest.fixture
def run(capsys):
    def call(*arguments):
        capsys.readouterr()
        code = main([str(argument) for argument in arguments])
        out, err = capsys.readouterr()
        return code, out, "".join(line for line in err.splitlines(keepends=True) if "compiling" not in line)

    return call


def test_rounded_flags_and_files_are_taken_and_the_answer_says_so(run, tmp_path):
    at = ("solve", "--position", 0.4, 0, 0.5)
    code, out, _ = run(*at, "--quaternion", 0, 0.707, 0.707, 0, "--json")
    assert code == 0
    assert json.loads(out)["target_deviation"] == pytest.approx(abs(0.707 * 2**0.5 - 1))
    assert "the orientation was rounded" in run(*at, "--quaternion", 0, 0.707, 0.707, 0)[1]
    assert json.loads(run(*at, "--quaternion", 0, 1, 0, 0, "--json")[1])["target_deviation"] == 0
    told = misuse(run(*at, "--quaternion", 0, 0.72, 0.72, 0))
    assert "norm" in told
    assert told.endswith("--project\n")
    (tmp_path / "p.csv").write_text("x,y,z,qw,qx,qy,qz\n0.4,0,0.5,0,0.707,0.707,0\n0.4,0,0.5,0,1,0,0\n,,,,,,\n")
    code, out, _ = run("solve", "--batch", tmp_path / "p.csv", "--json")
    summary = json.loads(out)
    assert (code, summary["solved"], summary["invalid_target"], summary["targets_rounded"]) == (5, 2, 1, 1)
    assert 1e-4 < summary["worst_target_deviation"] < 2e-3
    (tmp_path / "p.csv").write_text("x,y,z,qw,qx,qy,qz\n0.4,0,0.5,0,0.72,0.72,0\n")
    assert misuse(run("solve", "--batch", tmp_path / "p.csv")).endswith("--project\n")


def test_limits_are_given_as_flags(run, tmp_path):
    path = tmp_path / "r.urdf"
    ends = '<parent link="a"/><child link="b"/>'
    path.write_text(
        f'<robot name="r"><link name="a"/><link name="b"/><joint name="j" type="revolute">{ends}</joint></robot>'
    )
    assert misuse(run("fk", "--robot", path)).endswith("or at load, --limits j=LOWER:UPPER\n")
    code, out, _ = run("fk", 1.5, "--robot", path, "--limits", "j=-1:2", "--json")
    assert (code, json.loads(out)["inside_limits"]) == (0, True)
    for wrong in ("j", "j=1", "j=a:b", "k=0:1", "j=2:1", "j=0:inf"):
        misuse(run("fk", 1.5, "--robot", path, "--limits", wrong))
