"""`maira-qp track --batch`: many paths of one file, each followed as if it were alone, path by path."""

import csv
import json
import os

import numpy as np
import pyarrow
import pytest
from pyarrow import parquet
from support.command_line import misuse, pipe_in

import maira_qp as mq
from maira_qp.apps.cli import main

COUNTS = {"near": 12, "far": 7, "alone": 1}
"""Poses of each path; "far" goes out of reach."""
ROWS = sum(COUNTS.values())
JOINTS = [f"q_joint{i}" for i in range(1, 8)]


@pytest.fixture
def run(capsys):
    """`maira-qp track` in this process: exit code, stdout, stderr."""

    def call(*arguments):
        capsys.readouterr()
        code = main(["track", *map(str, arguments)])
        return code, *capsys.readouterr()

    return call


def poses_of(name):
    """The poses (N, 4, 4) of a path."""
    x = {"near": 0.5, "far": 2.5, "alone": 0.6}[name]
    return np.array([mq.pose([x, y, 0.6], rpy=[np.pi, 0, 0]).homogeneous for y in np.linspace(-0.1, 0.1, COUNTS[name])])


def columns_of(names=tuple(COUNTS)):
    """The columns of a file: what tells paths apart, poses as matrices, something else."""
    T = np.concatenate([poses_of(name) for name in names])
    labels = [f"m{row}{column}" for row in range(3) for column in range(4)]
    seam = [name for name in names for _ in range(COUNTS[name])]
    return {"seam": seam} | dict(zip(labels, T[:, :3].reshape(-1, 12).T, strict=True)) | {"note": np.arange(len(T))}


def write(path, columns, T=None):
    if path.suffix == ".npy":
        kinds = [(name, np.array(values).dtype) for name, values in columns.items()]
        np.save(path, np.array(list(zip(*columns.values(), strict=True)), dtype=kinds))
    elif path.suffix == ".npz":
        np.savez(path, targets=T, seam=columns["seam"], note=columns["note"])
    elif path.suffix == ".parquet":
        parquet.write_table(pyarrow.table(columns), path)
    else:
        with open(path, "w", newline="") as file:
            writer = csv.writer(file)
            writer.writerow(columns)
            writer.writerows(zip(*columns.values(), strict=True))
    return path


def read(path):
    """What was asked, success and joint values of an answered file."""
    if path.suffix == ".npz":
        with np.load(path) as found:
            return found["seam"].tolist(), found["note"].tolist(), found["success"], found["q"]
    if path.suffix == ".npy":
        table = np.load(path)
        table = {name: table[name].tolist() for name in table.dtype.names}
    elif path.suffix == ".parquet":
        table = parquet.read_table(path).to_pydict()
    else:
        with open(path, newline="") as file:
            rows = list(csv.DictReader(file))
        table = {name: [row[name] for row in rows] for name in rows[0]}
        table["success"] = [text == "true" for text in table["success"]]
    q = np.array([table[name] for name in JOINTS], dtype=float).T
    return table["seam"], [int(each) for each in table["note"]], np.array(table["success"]), q


@pytest.mark.parametrize("kind", ["csv", "npy", "npz", "parquet"])
def test_each_path_is_followed_as_if_it_were_alone(run, maira, tmp_path, kind):
    columns = columns_of()
    T = np.concatenate([poses_of(name) for name in COUNTS])
    file = write(tmp_path / f"paths.{kind}", columns, T)
    code, out, _ = run("--batch", file, "--by", "seam", "--json")
    said = json.loads(out)
    assert (code, said["paths"], said["followed_whole"], said["poses"]) == (1, 3, 2, ROWS)
    assert said["first_not_followed"]["path"] == "far"
    seam, note, success, q = read(tmp_path / f"paths.path.{kind}")
    assert seam == columns["seam"]
    assert note == columns["note"].tolist()
    paths = {name: mq.Solver(maira).track(poses_of(name)) for name in COUNTS}
    np.testing.assert_array_equal(q, np.concatenate([path.q for path in paths.values()]))
    np.testing.assert_array_equal(success, np.concatenate([path.success for path in paths.values()]))
    assert said["reached"] == success.sum() == 13
    if kind == "parquet":
        assert parquet.ParquetFile(tmp_path / "paths.path.parquet").num_row_groups == 1


def test_starts_units_and_standard_streams(run, maira, tmp_path, monkeypatch):
    """The first row of each path may hold its start; angles in degrees are said by the headings."""
    paths = {name: mq.Solver(maira).track(poses_of(name)) for name in ("near", "alone")}
    columns = columns_of(("near", "alone"))
    starts = np.concatenate([np.vstack([path.q[:1], np.full((len(path) - 1, 7), np.nan)]) for path in paths.values()])
    columns |= {
        f"q0_joint{i + 1}": np.where(np.isnan(each), "", np.degrees(each).astype(str))
        for i, each in enumerate(starts.T)
    }
    content = write(tmp_path / "paths.csv", columns).read_bytes()
    pipe_in(monkeypatch, content)
    code, out, err = run("--batch", "-", "--by", "seam", "--deg")
    assert code == 0
    assert "followed whole: 2 of 2 paths" in err
    header, *rows = csv.reader(out.splitlines())
    q = np.array([row[header.index("q_joint1 [deg]") :] for row in rows], dtype=float)
    first = [0, COUNTS["near"]]
    wanted = np.array([path.q[0] for path in paths.values()])
    np.testing.assert_allclose(np.radians(q[first]), wanted, atol=1e-6)
    del columns["q0_joint2"]
    assert "no column" in misuse(run("--batch", write(tmp_path / "paths.csv", columns), "--by", "seam", "--deg"))


def test_mistakes_are_told_before_anything_is_followed(run, tmp_path):
    columns = columns_of(("near", "alone", "near"))
    file = write(tmp_path / "paths.csv", columns)
    assert "line 15: path 'near' begins anew" in misuse(run("--batch", file, "--by", "seam"))
    assert "did you mean 'seam'" in misuse(run("--batch", file, "--by", "seem"))
    columns = columns_of()
    columns["seam"][0] = ""
    assert "line 2: the cell of 'seam'" in misuse(run("--batch", write(file, columns), "--by", "seam"))
    columns = columns_of() | {"success": np.zeros(ROWS)}
    assert "has 'success' already" in misuse(run("--batch", write(file, columns), "--by", "seam"))
    assert "line 13: a loop ends" in misuse(run("--batch", write(file, columns_of()), "--by", "seam", "--loop"))
    assert "--timed is of one path" in misuse(run("--batch", file, "--timed"))
    assert "leave one out" in misuse(run(file, "--batch", file))
    assert "--batch FILE" in misuse(run())
    assert os.listdir(tmp_path) == ["paths.csv"]


@pytest.mark.parametrize("kind", ["csv", "npz", "parquet"])
def test_after_ctrl_c_the_paths_that_were_followed_are_there(run, tmp_path, monkeypatch, kind):
    names, track = ("near", "alone", "far"), mq.Solver.track
    T = np.concatenate([poses_of(name) for name in names])
    file = write(tmp_path / f"paths.{kind}", columns_of(names), T)

    def interrupted(solver, targets, *arguments, **options):
        if len(targets) == COUNTS["far"]:
            raise KeyboardInterrupt
        return track(solver, targets, *arguments, **options)

    monkeypatch.setattr(mq.Solver, "track", interrupted)
    code, _, err = run("--batch", file, "--by", "seam")
    assert code == 130
    assert f"the answers to the first 13 poses are in {tmp_path / f'paths.path.partial.{kind}'}" in err
    seam, note, success, q = read(tmp_path / f"paths.path.partial.{kind}")
    assert seam == ["near"] * COUNTS["near"] + ["alone"]
    assert (len(note), success.all(), q.shape) == (13, True, (13, 7))
    assert sorted(os.listdir(tmp_path)) == [f"paths.{kind}", f"paths.path.partial.{kind}"]
