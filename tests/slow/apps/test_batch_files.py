"""Poses from files and answers into files: `maira-qp solve --batch`, its formats, its errors, what a crash leaves."""

import codecs
import csv
import importlib.util
import json
import os
import resource
import subprocess
import sys
import tracemalloc
from contextlib import contextmanager

import numpy as np
import pyarrow
import pytest
from pyarrow import parquet
from scipy.spatial.transform import Rotation
from support.command_line import heed_interrupts, misuse, pipe_in

import maira_qp as mq
from maira_qp.apps.cli import main
from maira_qp.io import csv_table, poses
from maira_qp.io.atomic_write import replacing

FORMATS = ("csv", "npz", "parquet")
MATRIX = [f"m{row}{column}" for row in range(4) for column in range(4)]
HEADER = "x,y,z,qw,qx,qy,qz\n"
ROW = "0.4,0.2,0.9,0,1,0,0\n"


@pytest.fixture
def run(capsys):
    """`maira-qp solve --batch` in this process: exit code, stdout, stderr."""

    def call(path, *arguments):
        capsys.readouterr()
        code = main(["solve", "--batch", str(path), *map(str, arguments)])
        return code, *capsys.readouterr()

    return call


@pytest.fixture(scope="session")
def asked(maira):
    """Twelve poses (12, 4, 4) that MAIRA reaches, and where it stands there (12, 7)."""
    rng = np.random.default_rng(11)
    q = rng.uniform(0.9 * maira.lower, 0.9 * maira.upper, (12, maira.n))
    return np.array([maira.forward(each).homogeneous for each in q]), q


def in_columns(T, form="matrix"):
    """The columns of poses (N, 4, 4) in one of the forms that a file can have."""
    if form == "matrix":
        return dict(zip(MATRIX[:12], T[:, :3].reshape(-1, 12).T, strict=True))
    if form == "whole matrix":
        return dict(zip(MATRIX, T.reshape(-1, 16).T, strict=True))
    position = dict(zip("xyz", T[:, :3, 3].T, strict=True))
    turned = Rotation.from_matrix(T[:, :3, :3])
    if form == "quaternion":
        return position | dict(zip(("qx", "qy", "qz", "qw"), turned.as_quat().T, strict=True))
    angles = turned.as_euler("xyz", degrees=form == "rpy in degrees")
    return position | dict(zip(("roll", "pitch", "yaw"), angles.T, strict=True))


def write(path, columns):
    """A file of columns (in NPZ: arrays), by other libraries than those of the program where there are any."""
    columns = {name: np.asarray(column) for name, column in columns.items()}
    if path.suffix == ".npz":
        np.savez(path, **columns)
    elif path.suffix == ".parquet":
        parquet.write_table(pyarrow.table({name: column.tolist() for name, column in columns.items()}), path)
    else:
        with open(path, "w", newline="") as file:
            writer = csv.writer(file)
            writer.writerow(columns)
            writer.writerows(zip(*(column.tolist() for column in columns.values()), strict=True))
    return path


def read(path):
    """The columns of a file (in NPZ: arrays); those of a CSV are numbers if all of their cells are."""
    if path.suffix == ".npz":
        with np.load(path) as archive:
            return dict(archive)
    if path.suffix == ".parquet":
        columns = parquet.read_table(path).to_pydict().items()
        return {name: np.array([np.nan if cell is None else cell for cell in column]) for name, column in columns}
    with open(path, newline="") as file:
        header, *rows = csv.reader(file)
    columns = zip(*rows, strict=True) if rows else [()] * len(header)
    return {name: _typed(column) for name, column in zip(header, columns, strict=True)}


def _typed(column):
    if set(column) <= {"true", "false"}:
        return np.array([cell == "true" for cell in column])
    try:
        return np.array([cell or "nan" for cell in column] if any(column) else column, dtype=float)
    except ValueError:
        return np.array(column)


def joint_values(found):
    """q (N, n) from a file that was read."""
    if "q" in found:
        return found["q"]
    return np.column_stack([column for name, column in found.items() if name.startswith("q_")])


def distances(found):
    """How far (N,) answers of a file that was read are from their starts: NaN where there was none."""
    return np.array([np.nan if cell == "" else float(cell) for cell in found["max_joint_change"]])


def same(found, batch):
    """Whether a file that was read holds a batch of answers, to the bit."""
    np.testing.assert_array_equal(joint_values(found), batch.q)
    np.testing.assert_array_equal(distances(found), batch.max_joint_change)
    numbers = ("position_error", "orientation_error", "iterations", "restarts", "condition_number")
    for name in ("success", *numbers, "left_q0"):
        np.testing.assert_array_equal(found[name], getattr(batch, name), err_msg=name)
    np.testing.assert_array_equal(found["status"], [mq.Status(status).name for status in batch.status.tolist()])
    limits = [";".join(each) for each in batch.active_limits]
    np.testing.assert_array_equal(found["active_limits"], limits if any(limits) else found["active_limits"])


@pytest.mark.parametrize("kind", FORMATS)
def test_the_answers_are_those_of_solve_batch_to_the_bit(run, tmp_path, maira, asked, kind):
    """A file of exact poses is answered as the library answers the array; the poses stand first, untouched."""
    T, _ = asked
    path = write(tmp_path / f"poses.{kind}", {"targets": T} if kind == "npz" else in_columns(T))
    assert run(path, "--seed", 5)[0] == 0
    found = read(tmp_path / f"poses.solved.{kind}")
    same(found, mq.Solver(maira).solve_batch(T, seed=5))
    before = read(path)
    assert list(found)[: len(before)] == list(before)
    for name, column in before.items():
        np.testing.assert_array_equal(found[name], column)
    if kind == "npz":
        assert found["joint_names"].tolist() == list(maira.joint_names)
    else:
        assert [name for name in found if name.startswith("q_")] == [f"q_{joint}" for joint in maira.joint_names]


@pytest.mark.parametrize("form", ["quaternion", "rpy", "rpy in degrees", "matrix", "whole matrix"])
def test_every_form_of_a_pose_is_the_same_pose(run, tmp_path, maira, asked, form):
    """However a pose is written, the joint values put the tool there, judged by Pinocchio; columns in any order."""
    T, _ = asked
    columns = in_columns(T, form)
    shuffled = {name: columns[name] for name in np.random.default_rng(3).permutation(list(columns))}
    path = write(tmp_path / "poses.csv", shuffled)
    degrees = form == "rpy in degrees"
    assert run(path, *(["--deg"] if degrees else []))[0] == 0
    q = joint_values(read(tmp_path / "poses.solved.csv"))
    for each, wanted in zip(np.radians(q) if degrees else q, T, strict=True):
        np.testing.assert_allclose(maira.forward(each).homogeneous, wanted, atol=3e-6)


def test_rows_come_back_to_the_letter(run, tmp_path):
    """A BOM, CRLF, quotes, a line break in a cell, leading zeros, blanks: what stood in a line stands there again."""
    rows = [
        '007, 0.40,0.2,0.9,0,1,0,0,"a ""b"", c",é',
        '008,4e-1,0.2 , 0.9,0,1,0,0,"two\r\nlines",',
        "009,+.4,0.2,0.9,0,1,0,0,, plain ",
    ]
    header = 'id, x,y ,z,qw,qx,qy,qz,"note, long",'
    path = tmp_path / "poses.csv"
    path.write_bytes("\r\n".join(["\ufeff" + header, rows[0], "", *rows[1:], "  ", ""]).encode())
    assert run(path)[0] == 0
    text = (tmp_path / "poses.solved.csv").read_bytes().decode()
    assert text.startswith(f"{header},success,status,")
    for row in rows:
        assert f"\n{row},true,CONVERGED," in text
    assert len(read(tmp_path / "poses.solved.csv")["id"]) == 3


def test_an_array_is_answered_by_one_with_fields(run, asked, maira, tmp_path):
    np.save(tmp_path / "poses.npy", asked[0])
    assert run(tmp_path / "poses.npy")[0] == 0
    found, batch = np.load(tmp_path / "poses.solved.npy"), mq.Solver(maira).solve_batch(asked[0])
    np.testing.assert_array_equal(np.stack([found[f"q_{joint}"] for joint in maira.joint_names], axis=1), batch.q)
    assert found["status"].tolist() == batch.status_names.tolist()
    np.testing.assert_array_equal(found["m03"], asked[0][:, 0, 3])


@pytest.mark.parametrize("target", FORMATS)
@pytest.mark.parametrize("source", FORMATS)
def test_answers_in_another_format(run, tmp_path, maira, asked, source, target):
    """Any format is answered in any other: the same answers, the poses and further columns carried along."""
    T, _ = asked
    further = {"label": [f"pose, {i}" for i in range(len(T))], "number": np.arange(len(T)) / 3}
    columns = {"targets": T} if source == "npz" else in_columns(T, "whole matrix")
    path = write(tmp_path / f"poses.{source}", columns | further)
    answer = tmp_path / "new" / f"answers.{target}"
    assert run(path, "--output", answer)[::2] == (0, "")
    found = read(answer)
    same(found, mq.Solver(maira).solve_batch(T))
    whole = found["targets"] if "targets" in found else np.column_stack([found[name] for name in MATRIX])
    np.testing.assert_array_equal(whole.reshape(T.shape), T)
    assert found["label"].tolist() == further["label"]
    np.testing.assert_array_equal(np.asarray(found["number"], dtype=float), further["number"])


def test_types_of_parquet_are_kept(run, tmp_path, asked):
    """Times, lists and empty cells of further columns come back in Parquet; as text in the formats without them."""
    T, _ = asked
    when = pyarrow.array([1_577_836_800_000_000_001, None], pyarrow.timestamp("ns"))
    further = {"when": when, "path": [[1, 2], [3]], "count": [None, 7], "word": [None, "a,b"], "flag": [True, False]}
    table = pyarrow.table({name: column.tolist() for name, column in in_columns(T[:2]).items()} | further)
    path = tmp_path / "poses.parquet"
    parquet.write_table(table, path)
    assert run(path)[0] == 0
    assert parquet.read_table(tmp_path / "poses.solved.parquet").select(table.column_names).equals(table)
    for kind in ("csv", "npz"):
        assert run(path, "--output", tmp_path / f"answers.{kind}")[0] == 0
    found = read(tmp_path / "answers.csv")
    assert found["when"].tolist() == ["2020-01-01 00:00:00.000000001", ""]
    assert found["path"].tolist() == ["[1, 2]", "[3]"]
    with open(tmp_path / "answers.csv", newline="") as file:
        assert [row["count"] for row in csv.DictReader(file)] == ["", "7"]
    assert found["word"].tolist() == ["", "a,b"]
    assert found["flag"].tolist() == [True, False]
    found = read(tmp_path / "answers.npz")
    np.testing.assert_array_equal(found["count"], [np.nan, 7.0])
    assert found["path"].tolist() == ["[1, 2]", "[3]"]


def test_arrays_that_are_no_columns(run, tmp_path, asked):
    """A further array becomes columns; one without an entry a pose is kept in NPZ, and else told as left out."""
    T, _ = asked
    archive = {"targets": T, "pair": np.arange(24.0).reshape(12, 2), "made": "yesterday"}
    path = write(tmp_path / "poses.npz", archive)
    assert run(path)[::2] == (0, "")
    assert str(read(tmp_path / "poses.solved.npz")["made"]) == "yesterday"
    code, _, err = run(path, "--output", tmp_path / "answers.csv")
    assert code == 0
    assert "left out" in err
    assert "'made'" in err
    found = read(tmp_path / "answers.csv")
    np.testing.assert_array_equal(np.column_stack([found["pair_0"], found["pair_1"]]), archive["pair"])
    assert "made" not in found


@pytest.mark.parametrize("kind", FORMATS)
def test_starts_are_taken(run, tmp_path, maira, asked, kind):
    """Starts at the solutions are solved without a step; those of the file and --q0 are what solve_batch is given."""
    T, q0 = asked
    starts = {f"q0_{name}": q0[:, i] for i, name in enumerate(maira.joint_names)}
    columns = {"targets": T, "q0": q0} if kind == "npz" else starts | in_columns(T)
    path = write(tmp_path / f"poses.{kind}", columns)
    assert run(path)[0] == 0
    found = read(tmp_path / f"poses.solved.{kind}")
    same(found, mq.Solver(maira).solve_batch(T, q0))
    np.testing.assert_allclose(joint_values(found), q0, atol=1e-9)
    assert (found["restarts"] == 0).all()
    assert "--q0" in misuse(run(path, "--q0", *q0[0]))
    path = write(tmp_path / f"bare.{kind}", {"targets": T} if kind == "npz" else in_columns(T))
    assert run(path, "--q0", *q0[0])[0] == 0
    same(read(tmp_path / f"bare.solved.{kind}"), mq.Solver(maira).solve_batch(T, q0[0]))


@pytest.mark.parametrize("kind", FORMATS)
def test_answers_say_how_far_from_their_start_they_are(run, tmp_path, maira, asked, kind):
    """The farthest joint of each, and which left their start; without starts there is no distance."""
    T, _ = asked
    starts = np.resize([maira.lower, maira.upper], (12, maira.n))
    columns = {"targets": T, "q0": starts}
    if kind != "npz":
        columns = in_columns(T) | {f"q0_{name}": starts[:, i] for i, name in enumerate(maira.joint_names)}
    summary = json.loads(run(write(tmp_path / f"poses.{kind}", columns), "--json")[1])
    found = read(tmp_path / f"poses.solved.{kind}")
    np.testing.assert_allclose(distances(found), np.abs(joint_values(found) - starts).max(axis=1), rtol=1e-12)
    assert 0 < summary["starts_left"] == found["left_q0"].sum() < 12
    path = write(tmp_path / f"bare.{kind}", {"targets": T} if kind == "npz" else in_columns(T))
    assert json.loads(run(path, "--json")[1])["starts_left"] == 0
    found = read(tmp_path / f"bare.solved.{kind}")
    assert not found["left_q0"].any()
    assert np.isnan(distances(found)).all()


def test_degrees_in_and_out_metres_for_sliding_joints(run, tmp_path):
    """With --deg starts and answers of turning joints are in degrees, those of sliding joints in metres."""
    crane = tmp_path / "crane.toml"
    crane.write_text(
        'name = "crane"\n[[links]]\nkind = "revolute"\na = 0.5\n'
        '[[links]]\nkind = "prismatic"\nlower = 0.2\nupper = 1.0\n'
    )
    (tmp_path / "poses.csv").write_text(
        "x,y,z,roll,pitch,yaw,q0_joint1,q0_joint2\n0,0.5,0.25,0,0,90,89,0.3\n0,0.5,0.25,0,0,,,\n"
    )
    code, out, _ = run(tmp_path / "poses.csv", "--robot", crane, "--deg", "--json")
    assert code == 5
    found = read(tmp_path / "poses.solved.csv")
    np.testing.assert_allclose([found["q_joint1"][0], found["q_joint2"][0]], [90, 0.25], atol=1e-4)
    assert found["restarts"][0] == 0
    assert json.loads(out)["starts_moved_onto_limits"] == 0  # the row without a start is none that was outside
    (tmp_path / "poses.csv").write_text("x,y,z,roll,pitch,yaw,q0_joint1,q0_joint2\n0,0.5,0.25,0,0,90,89,5\n")
    code, out, _ = run(tmp_path / "poses.csv", "--robot", crane, "--deg", "--json")
    assert code == 0
    assert json.loads(out)["starts_moved_onto_limits"] == 1


def test_millimetres_are_metres(run, tmp_path):
    """With --mm positions, starts and answers of sliding joints are in millimetres; errors stay in metres."""
    crane = tmp_path / "crane.toml"
    crane.write_text(
        'name = "crane"\n[[links]]\nkind = "revolute"\na = 0.5\n'
        '[[links]]\nkind = "prismatic"\nlower = 0.2\nupper = 1.0\n'
    )
    header = "x,y,z,roll,pitch,yaw,q0_joint1,q0_joint2\n"
    (tmp_path / "metres.csv").write_text(header + "0,0.5,0.25,0,0,1.57,1.5,0.3\n0,0.5,0.1,0,0,1.57,1.5,0.3\n")
    (tmp_path / "poses.csv").write_text(header + "0,500,250,0,0,1.57,1.5,300\n0,500,100,0,0,1.57,1.5,300\n")
    assert run(tmp_path / "metres.csv", "--robot", crane)[0] == run(tmp_path / "poses.csv", "--robot", crane, "--mm")[0]
    expected, found = read(tmp_path / "metres.solved.csv"), read(tmp_path / "poses.solved.csv")
    np.testing.assert_allclose(found["q_joint2"], 1000 * expected["q_joint2"])
    for name in ("q_joint1", "position_error"):
        np.testing.assert_allclose(found[name], expected[name], atol=1e-12)
    out = run(tmp_path / "poses.csv", "--robot", crane, "--json")[1]
    assert any("--mm" in hint for hint in json.loads(out)["hints"])


@pytest.mark.parametrize("kind", ["csv", "parquet"])
def test_positions_without_orientations(run, tmp_path, maira, asked, kind):
    """A file of x, y, z alone: the orientation is free, and the summary says so."""
    path, (targets, _) = tmp_path / f"points.{kind}", asked
    write(path, dict(zip("xyz", targets[:, :3, 3].T, strict=True)))
    code, out, _ = run(path, "--json")
    summary = json.loads(out)
    assert code == 0
    assert summary["positions_alone"] == len(targets)
    for q, T in zip(joint_values(read(tmp_path / f"points.solved.{kind}")), targets, strict=True):
        np.testing.assert_allclose(maira.forward(q).translation, T[:3, 3], atol=1e-6)


@pytest.mark.parametrize("kind", FORMATS)
def test_a_row_without_a_pose_spoils_only_itself(run, tmp_path, maira, asked, kind):
    """NaN, infinity or an empty cell: that row is not solved and its errors are NaN; the others are as without it."""
    T, _ = asked
    spoiled = T.copy()
    spoiled[[2, 7, 8], [0, 1, 2], [3, 1, 0]] = np.nan, np.inf, -np.inf
    path = write(tmp_path / f"poses.{kind}", {"targets": spoiled} if kind == "npz" else in_columns(spoiled))
    if kind == "csv":
        path.write_text(path.read_text().replace("nan", ""))
    code, out, _ = run(path, "--json")
    assert code == 5
    summary = json.loads(out)
    assert (summary["solved"], summary["without_pose"], summary["budget_spent"]) == (9, 3, 0)
    found = read(tmp_path / f"poses.solved.{kind}")
    bad = np.isin(np.arange(12), [2, 7, 8])
    np.testing.assert_array_equal(found["success"], ~bad)
    assert np.isnan(found["position_error"][bad]).all()
    assert np.isnan(found["orientation_error"][bad]).all()
    q = joint_values(found)
    assert summary["invalid_target"] == 3
    assert (found["status"][bad] == "INVALID_TARGET").all()
    assert np.isnan(q[bad]).all()
    if kind == "csv":
        assert b",INVALID_TARGET,,,,,,false,,,,,,,,,\n" in (tmp_path / "poses.solved.csv").read_bytes()
    if kind == "parquet":
        table = parquet.read_table(tmp_path / "poses.solved.parquet")
        for name in ("position_error", "iterations", "condition_number", "q_joint1"):
            assert table[name].null_count == 3
    np.testing.assert_array_equal(q[~bad], mq.Solver(maira).solve_batch(T).q[~bad])
    assert ("line 4" if kind == "csv" else "2 (counted from 0)") in summary["first_not_solved"]


def test_exit_codes_and_summary(run, tmp_path, asked):
    """0 if all are solved, 1 if one is not; the summary counts what the file says, as text and as JSON."""
    T, _ = asked
    far = T.copy()
    far[[3, 9], 0, 3] = 9.0
    path = write(tmp_path / "poses.csv", in_columns(far))
    code, out, err = run(path, "--json", "--max-restarts", 2)
    assert (code, err) == (1, "")
    summary = json.loads(out)
    found = read(tmp_path / "poses.solved.csv")
    assert summary["poses"] == 12
    assert summary["solved"] == 10 == found["success"].sum()
    assert summary["nearest"] == (found["status"] == "NEAREST").sum()
    assert summary["budget_spent"] == (found["status"] == "BUDGET_SPENT").sum()
    assert summary["unreachable"] == (found["status"] == "UNREACHABLE").sum()
    assert summary["worst_position_error"] == found["position_error"].max() > 1
    assert summary["output"] == str(tmp_path / "poses.solved.csv")
    assert summary["poses_per_second"] > 0
    code, out, _ = run(path, "--max-restarts", 2)
    assert code == 1
    assert "solved 10 of 12" in out
    assert "line 5" in out
    write(path, in_columns(T))
    assert "solved 12 of 12" in run(path)[1]


@pytest.mark.parametrize("kind", FORMATS)
def test_no_pose_at_all(run, tmp_path, kind):
    """A file of no rows is answered by a file of no rows with all columns, and nothing failed."""
    none = np.empty((0, 4, 4))
    path = write(tmp_path / f"poses.{kind}", {"targets": none} if kind == "npz" else in_columns(none))
    if kind == "parquet":
        empty = pyarrow.table({name: pyarrow.array([], pyarrow.float64()) for name in MATRIX[:12]})
        parquet.write_table(empty, path)
    code, out, _ = run(path, "--json")
    assert code == 0
    assert json.loads(out)["poses"] == 0
    found = read(tmp_path / f"poses.solved.{kind}")
    assert {"success", "status", "active_limits"} <= set(found)
    assert joint_values(found).size == 0
    assert run(path)[0] == 0


def test_answers_depend_on_neither_blocks_nor_threads(run, tmp_path, asked, monkeypatch):
    """The same bytes, whether all at once or in blocks of five, on one thread or three."""
    T, _ = asked
    T = np.concatenate([T, T[::-1]])
    path = write(tmp_path / "poses.csv", in_columns(T))
    texts = []
    for block, threads in ((1000, 1), (5, 1), (7, 3)):
        monkeypatch.setattr(poses, "BLOCK", block)
        monkeypatch.setattr(csv_table, "CHUNK", block + 1)
        assert run(path, "--threads", threads)[0] == 0
        texts.append((tmp_path / "poses.solved.csv").read_bytes())
    assert texts[0] == texts[1] == texts[2]
    assert texts[0].count(b"\n") == 25


def test_redundancy_and_options_arrive(run, tmp_path, maira, asked):
    """Flags of the solver count for every row of the batch."""
    T, _ = asked
    path = write(tmp_path / "poses.npz", {"targets": T[:4]})
    assert run(path, "--redundancy", "strict", "--seed", 3, "--orientation-tolerance", 1e-4)[0] == 0
    options = mq.Options(orientation_tolerance=1e-4)
    strict = mq.Solver(maira, redundancy=mq.Strict(mq.Posture()), options=options)
    same(read(tmp_path / "poses.solved.npz"), strict.solve_batch(T[:4], seed=3))
    assert run(path, "--backend", "daqp", "--seed", 3)[0] == 0
    same(read(tmp_path / "poses.solved.npz"), mq.Solver(maira, backend="daqp").solve_batch(T[:4], seed=3))


def test_rounded_rotations_are_taken_on_purpose(run, tmp_path, maira, asked, monkeypatch):
    """Without --project a rounded row is named; with it the nearest rotation is taken, as `mq.pose` does."""
    monkeypatch.setattr(poses, "BLOCK", 4)
    T, _ = asked
    rounded = T.copy()
    rounded[6, :3, :3] = T[6, :3, :3].round(2)
    wanted = mq.pose(matrix=rounded[6], project=True).homogeneous
    path = write(tmp_path / "matrix.csv", in_columns(rounded))
    message = misuse(run(path))
    assert "line 8" in message
    assert "--project" in message
    assert run(path, "--project")[0] == 0
    q = joint_values(read(tmp_path / "matrix.solved.csv"))
    np.testing.assert_allclose(maira.forward(q[6]).homogeneous, wanted, atol=3e-6)
    np.testing.assert_array_equal(q[:6], mq.Solver(maira).solve_batch(T).q[:6])

    columns = in_columns(T, "quaternion")
    for name in ("qw", "qx", "qy", "qz"):
        columns[name][6] *= 1.01
    path = write(tmp_path / "quaternion.csv", columns)
    message = misuse(run(path))
    assert "line 8" in message
    assert "norm" in message
    assert run(path, "--project")[0] == 0
    q = joint_values(read(tmp_path / "quaternion.solved.csv"))
    quaternion = [columns[name][6] for name in ("qw", "qx", "qy", "qz")]
    wanted = mq.pose(T[6, :3, 3], quaternion=quaternion, project=True).homogeneous
    np.testing.assert_allclose(maira.forward(q[6]).homogeneous, wanted, atol=3e-6)


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "utf-16-be with a mark"])
@pytest.mark.parametrize(("separator", "decimal"), [(";", "."), (";", ","), ("\t", "."), ("\t", ",")])
def test_tables_as_spreadsheets_write_them(run, tmp_path, separator, decimal, encoding):
    """Separators, decimals and encodings of other countries: the same answers, written in the same manner."""
    rows = [[0.4, 0.2, 0.9, 0, 1, 0, 0], [-0.35, 0.25, 0.8125, 1, 0, 0, 0]]
    lines = [HEADER.strip() + ",note", *(",".join(map(str, row)) + f',"é{separator}{i}"' for i, row in enumerate(rows))]
    plain, other = tmp_path / "plain.csv", tmp_path / "other.csv"
    plain.write_text("\n".join(lines) + "\n", encoding="utf-8")
    cells = [[str(value).replace(".", decimal) for value in row] for row in rows]
    text = [separator.join([*HEADER.strip().split(","), "note"])]
    text += [separator.join([*row, f'"é{separator}{i}"']) for i, row in enumerate(cells)]
    content = "\r\n".join(text) + "\r\n"
    marked = codecs.BOM_UTF16_BE + content.encode("utf-16-be")
    other.write_bytes(marked if encoding.startswith("utf-16-be") else content.encode(encoding))
    assert run(plain)[0] == run(other)[0] == 0
    expected = read(tmp_path / "plain.solved.csv")
    with open(tmp_path / "other.solved.csv", newline="", encoding="utf-8") as file:
        header, *found = csv.reader(file, delimiter=separator)
    assert header == list(expected)
    for name, cells in zip(header, zip(*found, strict=True), strict=True):
        if name == "note":
            assert cells == (f"é{separator}0", f"é{separator}1")
        elif expected[name].dtype.kind == "f" and any(cells):
            assert decimal == "." or not any("." in cell for cell in cells)
            assert [float(cell.replace(decimal, ".")) for cell in cells] == expected[name].tolist()


def test_extreme_numbers_of_a_projected_row(run, tmp_path):
    """With --project the size of a quaternion or matrix does not matter, and a hopeless one is named."""
    path = tmp_path / "poses.csv"
    path.write_text(HEADER + "0.4,0.2,0.9,0,1e300,0,0\n0.4,0.2,0.9,0,1e-300,0,0\n")
    assert run(path, "--project")[0] == 0
    q = joint_values(read(tmp_path / "poses.solved.csv"))
    np.testing.assert_array_equal(q[0], q[1])
    header = ",".join(MATRIX[:12]) + "\n"
    path.write_text(header + "1e200,0,0,0.4,0,1e200,0,0.2,0,0,1e200,0.9\n")
    assert run(path, "--project")[0] == 0
    for rotation, word in (("1,0,0,0.4,0,1,0,0.2,0,0,-1,0.9", "reflection"), ("1,0,0,0,0,1,0,0,0,0,0,0", "singular")):
        path.write_text(f"{header}1,0,0,0.4,0,1,0,0.2,0,0,1,0.9\n{rotation}\n")
        message = misuse(run(path, "--project"))
        assert "line 3" in message
        assert word in message


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", ["empty", "header"]),
        ("\n  \n", ["empty", "header"]),
        (ROW + ROW, ["header", "first line holds numbers"]),
        ((HEADER + ROW).replace(",", "|"), ["separated by bars", "commas, semicolons or tabs"]),
        ((HEADER + ROW).replace(",", " "), ["separated by blanks"]),
        ("x,y,z,qw,qx,qy,qz,x\n", ["more than one column is named 'x'"]),
        ("x,y,z,qw,qx,qy,q_z\n" + ROW, ["'qz'", "did you mean", "'q_z'", "roll, pitch, yaw"]),
        ("X,Y,Z,QW,QX,QY,QZ\n" + ROW, ["did you mean 'qw'", "'QW'"]),
        ("x,y,label\n", ["orientation", "'label'", "qw, qx, qy, qz"]),
        ("x,y,z,qW\n", ["orientation", "did you mean 'qw'"]),
        ("px,py,pz,roll,pitch,yaw\n", ["'x', 'y', 'z'", "'px'"]),
        ("x,y,z,qw,qx,qy,qz,roll,pitch,yaw\n", ["one orientation", "'qw'", "'roll'"]),
        ("x," + ",".join(MATRIX) + "\n", ["one position"]),
        (",".join(MATRIX[:11]) + "\n", ["'m23'"]),
        (",".join(MATRIX[:15]) + "\n", ["'m33'"]),
        (HEADER.strip() + ",q0_jont1\n", ["'q0_jont1'", "did you mean 'q0_joint1'"]),
        (HEADER.strip() + ",q0_joint1\n", ["'q0_joint2'"]),
        (HEADER.strip() + ",success\n", ["'success'", "rename"]),
        (HEADER.strip() + ",q_joint3\n", ["'q_joint3'", "rename"]),
        (HEADER + ROW + '"0,4",0.2,0.9,0,1,0,0\n', ["line 3", "'x'", "'0,4'", "point"]),
        (HEADER + "0,4,0.2,0.9,0,1,0,0\n", ["line 2", "8 values for 7", "point"]),
        (HEADER + ROW + "\n1,2,3\n", ["line 4", "3 values for 7"]),
        (HEADER + ROW + "0.4,0.2,0.9,0,1,abc,0\n", ["line 3", "'qy'", "'abc'"]),
        (HEADER + "0.4,NA,0.9,0,1,0,0\n", ["line 2", "'y'", "'NA'", "empty"]),
        (HEADER + "1_0,0.2,0.9,0,1,0,0\n", ["line 2", "'1_0'"]),
        (HEADER + ROW + "0.4,0.2,0.9,0,0,0,0\n", ["line 3", "zero quaternion"]),
        (HEADER + ROW + "0.4,0.2,0.9,0,1e-400,0,0\n", ["line 3", "zero quaternion"]),
        (HEADER + ROW + "1e30,0.2,0.9,0,1,0,0\n", ["line 3", "1e+30 m"]),
        (",".join(MATRIX) + "\n1,0,0,0,0,1,0,0,0,0,1,0,0,0,0,2\n", ["line 2", "last row"]),
        (HEADER.strip() + ',label\n"two\nlines"\n', ["line 2", "1 values for 8"]),
        (HEADER.strip() + f',label\n{ROW.strip()},"open\n{ROW}', ["line 2", "end of data"]),
        ((HEADER.strip() + f",label\n{ROW.strip()},é\n").encode("latin-1"), ["line 2", "UTF-8"]),
        ((HEADER + ROW).encode("utf-16")[:-1], ["UTF-16"]),
        ((HEADER + ROW).replace(",", ";") + "1.000,4;0.2;0.9;0;1;0;0\n", ["line 3", "'x'", "thousands"]),
    ],
)
def test_what_is_wrong_in_a_csv_is_told(run, tmp_path, text, words):
    """One line that says what is wrong, where, and what is valid; nothing is written."""
    path = tmp_path / "poses.csv"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    message = misuse(run(path))
    for word in ("poses.csv", *words):
        assert word in message
    assert os.listdir(tmp_path) == ["poses.csv"]


@pytest.mark.parametrize(
    ("arrays", "words"),
    [
        ({"Targets": np.eye(4)[None], "q0": np.zeros((1, 7))}, ["'targets'", "Targets, q0"]),
        ({}, ["'targets'", "nothing"]),
        ({"targets": np.eye(4)}, ["(N, 4, 4)", "(4, 4)"]),
        ({"targets": np.array(["a"])}, ["'targets'", "numbers"]),
        ({"targets": np.array([None])}, ["Object arrays"]),
        ({"targets": np.eye(4)[None], "q0": np.zeros((2, 7))}, ["'q0'", "(1, 7)", "(2, 7)"]),
        ({"targets": np.eye(4)[None], "joint_names": ["a"]}, ["'joint_names'", "rename"]),
        ({"targets": np.stack([np.eye(4), np.diag([1, 1, -1, 1])])}, ["target 1", "reflection"]),
    ],
)
def test_what_is_wrong_in_an_archive_is_told(run, tmp_path, arrays, words):
    """Missing, misshapen and unreadable arrays are named."""
    np.savez(tmp_path / "poses.npz", **arrays)
    message = misuse(run(tmp_path / "poses.npz"))
    for word in ("poses.npz", *words):
        assert word in message


def test_files_that_are_not_what_their_name_says(run, tmp_path, asked, monkeypatch):
    """Cut off, another format, missing, a folder, an unknown ending: told in one line, as is a missing pyarrow."""
    T, _ = asked
    (tmp_path / "poses.txt").write_text(HEADER)
    assert ".csv, .npy, .npz, .parquet" in misuse(run(tmp_path / "poses.txt"))
    assert "none.csv" in misuse(run(tmp_path / "none.csv"))
    assert "none.npz" in misuse(run(tmp_path / "none.npz"))
    (tmp_path / "folder.csv").mkdir()
    assert "folder.csv" in misuse(run(tmp_path / "folder.csv"))
    for kind in ("npz", "parquet"):
        path = write(tmp_path / f"poses.{kind}", {"targets": T} if kind == "npz" else in_columns(T))
        path.write_bytes(path.read_bytes()[:-30])
        assert path.name in misuse(run(path))
        path.write_bytes(b"x")
        assert path.name in misuse(run(path))
    words = write(tmp_path / "words.parquet", in_columns(T) | {"m00": ["1"] * 12})
    assert "'m00' must hold numbers, not string" in misuse(run(words))
    find = importlib.util.find_spec
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None if name == "pyarrow" else find(name))
    assert "maira-qp[parquet]" in misuse(run(words))
    path = write(tmp_path / "poses.csv", in_columns(T))
    assert "maira-qp[parquet]" in misuse(run(path, "--output", tmp_path / "answers.parquet"))


def test_flags_that_make_no_sense_together(run, tmp_path):
    """A single pose beside a batch, and the batch's own flags without one, are named."""
    path = tmp_path / "poses.csv"
    path.write_text(HEADER + ROW)
    message = misuse(run(path, "--position", 1, 2, 3, "--rpy", 0, 0, 0))
    assert "--position and --rpy" in message
    assert "--matrix" in misuse(run(path, "--matrix", "pose.txt"))
    assert "--quaternion" in misuse(run(path, "--quaternion", 1, 0, 0, 0))
    assert "threads" in misuse(run(path, "--threads", 0))
    assert "give 7 joint values" in misuse(run(path, "--q0", 1, 2))


@pytest.mark.parametrize("flags", [("--threads", "2"), ("--output", "answers.csv")])
def test_flags_of_a_batch_need_one(capsys, flags):
    """--output and --threads without --batch are misuse."""
    assert main(["solve", "--position", "0.4", "0.2", "0.9", *flags]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert f"{flags[0]} only counts with --batch" in err


def test_the_file_of_the_poses_is_never_written(run, tmp_path):
    """An output that is the input, by whatever name, is refused; so are folders, pipes and what is no folder."""
    path = tmp_path / "poses.csv"
    path.write_text(HEADER + ROW)
    (tmp_path / "link.csv").symlink_to(path)
    os.link(path, tmp_path / "hard.csv")
    (tmp_path / "folder.csv").mkdir()
    os.mkfifo(tmp_path / "pipe.csv")
    for name in ("poses.csv", "link.csv", "hard.csv", "folder.csv", "pipe.csv", "poses.csv/answers.csv"):
        assert name in misuse(run(path, "--output", tmp_path / name))
    assert path.read_text() == HEADER + ROW
    assert ".csv, .npy, .npz, .parquet" in misuse(run(path, "--output", "/dev/null"))


@contextmanager
def disk_of(size):
    """No file can grow beyond so many bytes, as on a full disk."""
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, limits[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)


@pytest.mark.parametrize("kind", FORMATS)
def test_a_full_disk_leaves_what_was_there(run, tmp_path, asked, kind):
    """If the answers do not fit, that is an error; the old answers are whole and nothing else is left."""
    T, _ = asked
    path = write(tmp_path / "poses.csv", in_columns(np.concatenate([T] * 4)))
    answer = tmp_path / f"answers.{kind}"
    assert run(path, "--output", answer)[0] == 0
    before = answer.read_bytes()
    with disk_of(len(before) // 2):
        assert "File too large" in misuse(run(path, "--output", answer, "--seed", 1))
    assert answer.read_bytes() == before
    assert sorted(os.listdir(tmp_path)) == sorted([answer.name, "poses.csv"])


def test_a_file_is_on_the_disk_before_it_takes_its_place(tmp_path, monkeypatch):
    """All of it is forced to disk, and only then renamed: a machine that stops leaves no empty file of that name."""
    done = []

    def sync(descriptor):
        done.append(("sync", os.fstat(descriptor).st_ino, os.fstat(descriptor).st_size))

    def rename(old, new):
        done.append(("rename", os.stat(old).st_ino, os.stat(old).st_size))
        replace(old, new)

    replace = os.replace
    monkeypatch.setattr(os, "fsync", sync)
    monkeypatch.setattr(os, "replace", rename)
    with replacing(tmp_path / "answers.csv") as file:
        file.write(b"whole\n")
    number = (tmp_path / "answers.csv").stat().st_ino
    assert done == [("sync", number, 6), ("rename", number, 6)]


def test_a_killed_process_leaves_what_was_there(tmp_path):
    """A process that is killed while it writes leaves the old file whole."""
    path = tmp_path / "answers.csv"
    path.write_text("whole\n")
    code = (
        "import sys, time\nfrom maira_qp.io.atomic_write import replacing\n"
        f"with replacing({str(path)!r}) as file:\n"
        "    file.write(b'half'); file.flush(); print('now', flush=True); time.sleep(60)\n"
    )
    process = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE)
    assert process.stdout.readline() == b"now\n"
    process.kill()
    process.communicate(timeout=60)
    assert path.read_text() == "whole\n"


def test_ctrl_c_in_the_first_block_leaves_nothing(tmp_path):
    """An interrupt in the middle of a batch, when the first targets are done: exit code 130, one line, no answers."""
    T = np.tile(np.eye(4), (20_000, 1, 1))
    T[:, 0, 3] = np.linspace(5, 9, len(T))
    path = write(tmp_path / "poses.npz", {"targets": T})
    code = (
        "import os, signal, sys\nfrom maira_qp.apps.cli import main\nfrom maira_qp.solvers.solver import Solver\n"
        "solve = Solver.solve_batch\n"
        "def interrupt(done, total):\n    assert done < total\n    os.kill(os.getpid(), signal.SIGINT)\n"
        "Solver.solve_batch = lambda *args, progress, **options: solve(*args, progress=interrupt, **options)\n"
        "sys.exit(main(sys.argv[1:]))\n"
    )
    command = [sys.executable, "-c", code, "solve", "--batch", str(path), "--threads", "1"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=600, preexec_fn=heed_interrupts)
    assert done.returncode == 130
    assert done.stderr.splitlines()[-1] == "maira-qp: interrupted"
    assert "Traceback" not in done.stderr
    assert os.listdir(tmp_path) == ["poses.npz"]


@pytest.mark.parametrize("kind", FORMATS)
def test_ctrl_c_leaves_the_rows_that_were_answered(run, tmp_path, maira, asked, kind, monkeypatch):
    """In a file of another name, whole, and the same as when nothing interrupts; the old answers stay."""
    T, solve, calls = np.concatenate([asked[0]] * 2), mq.Solver.solve_batch, []

    def interrupt(solver, *arguments, **options):
        calls.append(1)
        if len(calls) == 3:
            raise KeyboardInterrupt
        return solve(solver, *arguments, **options)

    path = write(tmp_path / f"poses.{kind}", {"targets": T} if kind == "npz" else in_columns(T))
    old, file = tmp_path / f"poses.solved.{kind}", tmp_path / f"poses.solved.partial.{kind}"
    old.write_text("old")
    monkeypatch.setattr(poses, "BLOCK", 10)
    monkeypatch.setattr(mq.Solver, "solve_batch", interrupt)
    code, _, err = run(path)
    assert code == 130
    assert f"the answers to the first 20 poses are in {file}" in err
    assert sorted(os.listdir(tmp_path)) == sorted([path.name, file.name, old.name])
    assert old.read_text() == "old"
    found, before = read(file), read(path)
    monkeypatch.undo()
    same(found, mq.Solver(maira).solve_batch(T[:20]))
    for name, column in before.items():
        np.testing.assert_array_equal(found[name], column[:20])


@pytest.mark.parametrize("kind", FORMATS)
def test_memory_does_not_grow_with_the_file(run, tmp_path, asked, kind, monkeypatch):
    """Eight times as many rows take no more than half as much again, of which nothing is left."""
    monkeypatch.setattr(poses, "BLOCK", 250)
    monkeypatch.setattr(csv_table, "CHUNK", 250)
    monkeypatch.setattr("maira_qp.io.npz_table.ROWS", 250)
    monkeypatch.setattr("maira_qp.io.parquet_table.LEAST", 250)
    peaks = []
    for count in (500, 500, 4000):  # the first is for what is made once
        T = np.resize(asked[0], (count, 4, 4))
        columns = in_columns(T) | {"note": np.array([f"row {i} of many" for i in range(count)])}
        path = tmp_path / f"poses{count}.{kind}"
        if kind == "parquet":
            parquet.write_table(pyarrow.table({k: v.tolist() for k, v in columns.items()}), path, row_group_size=250)
        else:
            write(path, {"targets": T} if kind == "npz" else columns)
        pool = pyarrow.proxy_memory_pool(pyarrow.default_memory_pool())
        before = pyarrow.default_memory_pool()
        pyarrow.set_memory_pool(pool)
        tracemalloc.start()
        try:
            assert run(path, "--threads", 1, "--json")[0] == 0
            peaks.append(tracemalloc.get_traced_memory()[1] + pool.max_memory())
        finally:
            tracemalloc.stop()
            pyarrow.set_memory_pool(before)
        assert len(joint_values(read(tmp_path / f"poses{count}.solved.{kind}"))) == count
    assert peaks[2] < 1.5 * peaks[1], peaks


def test_progress_counts_the_whole_file(run, tmp_path, asked, monkeypatch):
    """The bar is told of rows of the file, not of a block: it grows to their number."""
    seen = []

    @contextmanager
    def bar(label):
        yield lambda done, total: seen.append((done, total))

    monkeypatch.setattr("maira_qp.apps.commands.batch.progress_bar", bar)
    monkeypatch.setattr(poses, "BLOCK", 5)
    T, _ = asked
    assert run(write(tmp_path / "poses.csv", in_columns(T)))[0] == 0
    done = [each for each, _ in seen]
    assert {total for _, total in seen} == {12}
    assert done == sorted(done)
    assert done[-1] == 12


def test_the_help_tells_the_columns(capsys):
    """--help of solve names the columns that a file must and may have, and those of the answers."""
    assert main(["solve", "--help"]) == 0
    text = " ".join(capsys.readouterr().out.replace("│", " ").split())
    for word in ("qw, qx, qy, qz", "roll, pitch, yaw", "m00, m01, ... m23", "q0_<joint>", "targets (N, 4, 4)"):
        assert word in text
    for word in ("position_error [m]", "left_q0", "max_joint_change", "active_limits", "q_<joint>", "joint_names"):
        assert word in text


def test_poses_go_through_a_pipe(run, tmp_path, asked, monkeypatch):
    """What a file would hold goes to standard output, in the dialect of standard input; the summary to stderr."""
    path = write(tmp_path / "poses.csv", in_columns(asked[0]))
    for content in (path.read_bytes(), path.read_text().replace(",", ";").replace(".", ",").encode("utf-16")):
        path.write_bytes(content)
        assert run(path)[0] == 0
        pipe_in(monkeypatch, content)
        code, out, err = run("-", "--output", "-")
        assert code == 0
        assert out == (tmp_path / "poses.solved.csv").read_text()
        assert err.startswith("solved 12 of 12")
    pipe_in(monkeypatch, content)
    told = json.loads(run("-", "--json")[2])
    assert (told["solved"], told["output"]) == (12, "-")
    assert sorted(os.listdir(tmp_path)) == ["poses.csv", "poses.solved.csv"]


def test_a_file_is_answered_on_standard_output_and_a_pipe_in_a_file(run, tmp_path, asked, monkeypatch):
    path = write(tmp_path / "poses.npz", {"targets": asked[0]})
    code, out, err = run(path, "--output", "-")
    assert code == 0
    header, *lines = out.splitlines()
    assert "success" in header
    assert (len(lines), err.startswith("solved 12 of 12")) == (12, True)
    pipe_in(monkeypatch, write(tmp_path / "poses.csv", in_columns(asked[0])).read_bytes())
    code, out, _ = run("-", "--output", tmp_path / "answers.npz")
    assert code == 0
    assert out.startswith("solved 12 of 12")
    assert read(tmp_path / "answers.npz")["success"].all()


@pytest.mark.parametrize(
    ("content", "words"),
    [(b"", "standard input is empty"), (HEADER.encode() + b"0.4,a,0,0,1,0,0\n", "standard input, line 2")],
)
def test_a_pipe_that_holds_no_poses_is_refused(run, content, words, monkeypatch):
    pipe_in(monkeypatch, content)
    assert words in misuse(run("-"))


def test_standard_input_that_is_closed_is_said_so(tmp_path):
    command = f"{sys.executable} -m maira_qp solve --batch - <&-"
    ran = subprocess.run(["sh", "-c", command], capture_output=True, check=False, cwd=tmp_path)
    assert ran.returncode == 2
    assert b"standard input is closed" in ran.stderr


def test_a_reader_that_goes_away_from_the_answers_does_not_change_the_verdict(tmp_path, asked):
    path, (read_end, write_end) = write(tmp_path / "poses.csv", in_columns(asked[0])), os.pipe()
    os.close(read_end)
    command = [sys.executable, "-m", "maira_qp", "solve", "--batch", str(path), "--output", "-"]
    ran = subprocess.run(command, stdout=write_end, stderr=subprocess.PIPE, text=True, check=False)
    os.close(write_end)
    assert ran.returncode == 0
    assert ran.stderr.startswith("solved 12 of 12")
    assert "Traceback" not in ran.stderr
