"""Data sets: rows that depend on their index alone, labels that are true, files that others read."""

import json

import numpy as np
import pytest
from support.marked_jobs import files_of
from support.robots import load

import maira_qp as mq
from maira_qp.errors import JobError, OptionError
from maira_qp.evaluation.judge import Judge
from maira_qp.io.poses import read_poses
from maira_qp.scale import DatasetJob, resume, run, state_of
from maira_qp.scale.dataset import poses as sources

parquet = pytest.importorskip("pyarrow.parquet")
ROWS = 2500


@pytest.fixture(scope="module")
def job() -> DatasetJob:
    return DatasetJob.of(mq.Robot.maira(), rows=ROWS, seed=3)


@pytest.fixture(scope="module")
def folder(job, tmp_path_factory):
    folder = tmp_path_factory.mktemp("sets") / "maira"
    assert run(job, folder, engine="here").finished
    return folder


def columns_of(folder) -> dict[str, np.ndarray]:
    table = parquet.read_table(folder / "data")
    return {name: table[name].to_numpy() for name in table.column_names}


def q_of(columns: dict[str, np.ndarray], robot: mq.Robot) -> np.ndarray:
    return np.column_stack([columns[f"q_{joint}"] for joint in robot.joint_names])


def test_labels_are_true_and_negatives_are_proved(job, folder, maira):
    columns = columns_of(folder)
    targets = read_poses(folder / "data/chunk-000/file-000.parquet", None).targets(slice(None))
    q, reached = q_of(columns, maira), columns["success"]
    assert (columns["index"] == np.arange(ROWS)).all()
    judged = Judge(maira.urdf, maira.base, maira.tip, maira.joint_names).verdict(q, targets)
    np.testing.assert_array_equal(judged.within(1e-6, 1e-6, 0.0), reached)
    np.testing.assert_array_equal(columns["status"] == "CONVERGED", reached)
    assert 0.1 < reached.mean() < 0.9
    assert (columns["status"][~reached] == "UNREACHABLE").mean() > 0.99
    assert (judged.limit_violation <= 0).all()


def test_poses_fill_the_workspace_evenly(job, folder):
    columns = columns_of(folder)
    away = np.linalg.norm(np.column_stack([columns[axis] for axis in "xyz"]) - job.centre, axis=1) / job.radius
    np.testing.assert_allclose(np.quantile(away**3, [0.25, 0.5, 0.75]), [0.25, 0.5, 0.75], atol=0.05)
    quaternions = np.column_stack([columns[name] for name in ("qw", "qx", "qy", "qz")])
    np.testing.assert_allclose(np.linalg.norm(quaternions, axis=1), 1.0)
    np.testing.assert_allclose(quaternions.T @ quaternions / ROWS, np.eye(4) / 4, atol=0.03)


def test_the_files_are_the_same_for_any_cut(job, folder, tmp_path):
    run(job, tmp_path / "cut", engine="here", part=(2, 3), shard=777)
    resume(tmp_path / "cut", engine="here", shard=100)
    assert files_of(tmp_path / "cut") == files_of(folder)


def test_files_and_folders_stay_small(tmp_path, monkeypatch):
    monkeypatch.setattr("maira_qp.scale.dataset.job.LARGEST", 8 * 21 * 100)
    monkeypatch.setattr("maira_qp.scale.dataset.files.FILES", 3)
    job = DatasetJob.of(mq.Robot.maira(), rows=1050)
    assert job.block == 100
    run(job, tmp_path / "set", engine="here")
    names = sorted(name for name in files_of(tmp_path / "set") if name.startswith("data/"))
    assert len(names) == 11
    assert names[0] == "data/chunk-000/file-000.parquet"
    assert names[-1] == "data/chunk-003/file-001.parquet"
    assert (columns_of(tmp_path / "set")["index"] == np.arange(1050)).all()
    info = json.loads((tmp_path / "set" / "meta" / "info.json").read_text())
    assert (info["total_frames"], info["total_files"], info["codebase_version"]) == (1050, 11, "v3.0")
    assert info["features"]["q_joint1"] == {"dtype": "float64", "shape": [1]}


def test_labels_by_posture_and_poses_of_configurations(maira, tmp_path):
    columns = {}
    for labels in ("any", "posture"):
        job = DatasetJob.of(maira, rows=300, poses="configurations", labels=labels)
        run(job, tmp_path / labels, engine="here")
        columns[labels] = columns_of(tmp_path / labels)
        assert columns[labels]["success"].all()
    np.testing.assert_array_equal(columns["any"]["x"], columns["posture"]["x"])
    cost = {labels: np.square(q_of(each, maira) - maira.middle).sum(axis=1) for labels, each in columns.items()}
    assert (cost["posture"] <= cost["any"] + 1e-6).all()
    assert cost["posture"].mean() < 0.9 * cost["any"].mean()
    assert state_of(tmp_path / "any").kind == "dataset"


def test_poses_along_paths(maira, tmp_path):
    """Of 128 each, without a jump from one to the next, and each can be reached."""
    run(DatasetJob.of(maira, rows=1500, poses="paths"), tmp_path / "set", engine="here")
    columns = columns_of(tmp_path / "set")
    assert columns["success"].all()
    path = columns["path"]
    np.testing.assert_array_equal(path, np.arange(1500) // 128)
    step = np.linalg.norm(np.diff(np.column_stack([columns[axis] for axis in "xyz"]), axis=0), axis=1)
    assert step[np.diff(path) == 0].max() < 0.25
    assert step[np.diff(path) == 1].mean() > 0.3


@pytest.fixture
def asked(maira, rng, tmp_path):
    """A file of 30 poses, of which one is not there."""
    T = np.array([maira.forward(maira.random_configuration(rng)).homogeneous for _ in range(30)])
    T[17] = np.nan
    np.savez(tmp_path / "asked.npz", targets=T)
    np.save(tmp_path / "asked.npy", T)
    return T


def test_poses_of_a_file(maira, asked, tmp_path):
    job = DatasetJob.of(maira, poses=tmp_path / "asked.npz")
    run(job, tmp_path / "set", engine="here", shard=7)
    columns = columns_of(tmp_path / "set")
    assert len(columns["index"]) == 30
    batch = mq.Solver(maira).solve_batch(asked)
    np.testing.assert_array_equal(columns["x"], asked[:, 0, 3])
    assert columns["status"][17] == "INVALID_TARGET"
    known = np.arange(30) != 17
    np.testing.assert_array_equal(q_of(columns, maira)[known], batch.q[known])
    table = parquet.read_table(tmp_path / "set" / "data")
    assert [table[name].null_count for name in ("x", "qw", "manipulability", "q_joint1", "success")] == [1, 1, 1, 1, 0]
    run(DatasetJob.of(maira, poses=tmp_path / "asked.npy"), tmp_path / "same", engine="here")
    assert parquet.read_table(tmp_path / "same" / "data").equals(table)
    with pytest.raises(OptionError, match="rows must be at most 30"):
        DatasetJob.of(maira, poses=tmp_path / "asked.npz", rows=31)


def test_a_file_that_is_another_one_is_refused(maira, asked, tmp_path):
    job = DatasetJob.of(maira, poses=str(tmp_path / "asked.npz"))
    run(job, tmp_path / "set", engine="here", part=(1, 2))
    np.savez(tmp_path / "asked.npz", targets=asked[::-1])
    sources.opened.cache_clear()
    with pytest.raises(JobError, match="is not the file any more that this job was begun with"):
        resume(tmp_path / "set", engine="here")
    (tmp_path / "asked.npz").unlink()
    with pytest.raises(JobError, match="is not there"):
        resume(tmp_path / "set", engine="here")


def test_a_row_for_each_solution(tmp_path, monkeypatch):
    """Those that `solutions` lists, with how many there are; of a pose without one there is one row."""
    monkeypatch.setattr("maira_qp.scale.dataset.job.MOST_SOLUTIONS", 5)
    robot = load("irb140")
    solver = mq.Solver(robot)
    T = np.array([robot.forward(0.1 + 0.2 * np.arange(robot.n) / robot.n).homogeneous, np.eye(4)])
    T[1, 0, 3] = 9.0
    np.savez(tmp_path / "asked.npz", targets=T)
    run(DatasetJob.of(robot, poses=tmp_path / "asked.npz", labels="all"), tmp_path / "set", engine="here")
    columns, wanted = columns_of(tmp_path / "set"), solver.solutions(T[0], rng=0)
    here = columns["index"] == 0
    assert here.sum() == min(5, len(wanted)) > 1
    np.testing.assert_array_equal(q_of(columns, robot)[here], [one.q for one in wanted[:5]])
    np.testing.assert_array_equal(columns["solution"][here], np.arange(here.sum()))
    assert (columns["solutions"][here] == len(wanted)).all()
    assert (columns["success"][~here].tolist(), columns["solutions"][~here].tolist()) == ([False], [0])
    distance = [robot.manipulability(one.q) for one in wanted[:5]]
    np.testing.assert_allclose(columns["manipulability"][here], distance, rtol=1e-9)
    info = json.loads((tmp_path / "set" / "meta" / "info.json").read_text())
    assert info["total_frames"] == here.sum() + 1


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("library", ["pandas", "polars", "datasets"])
def test_others_read_it(folder, library, tmp_path, monkeypatch):
    monkeypatch.setenv("HF_HOME", str(tmp_path))
    monkeypatch.setenv("HF_HUB_OFFLINE", "1")
    module = pytest.importorskip(library)
    files, wanted = str(folder / "data" / "*" / "*.parquet"), columns_of(folder)
    if library == "pandas":
        table = module.read_parquet(folder / "data")
        columns = {name: table[name].to_numpy() for name in table.columns}
    elif library == "polars":
        table = module.read_parquet(files)
        columns = {name: table[name].to_numpy() for name in table.columns}
    else:
        table = module.load_dataset("parquet", data_files=files, split="train", cache_dir=str(tmp_path))
        columns = {name: np.array(table[name][:]) for name in table.column_names}
    assert list(columns) == list(wanted)
    for name, values in wanted.items():
        np.testing.assert_array_equal(columns[name], values)


def test_data_sets_that_make_no_sense_are_refused(maira):
    for options, said in (
        ({"rows": 0}, "rows must be a positive"),
        ({"rows": 5, "poses": "workspaces"}, "did you mean 'workspace'"),
        ({"rows": 5, "labels": "best"}, "labels cannot be 'best'"),
        ({}, "rows must be a positive"),
        ({"rows": 5, "seed": -1}, "seed must be"),
    ):
        with pytest.raises(OptionError, match=said):
            DatasetJob.of(maira, **options)
