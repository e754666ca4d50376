"""Paths and trajectories in files: each format reads back, in whole files only."""

import importlib.util
import json
import pickle
from pathlib import Path

import numpy as np
import pytest

import maira_qp as mq
from maira_qp.errors import OptionError
from maira_qp.io.save import ENDINGS

EXAMPLE = Path(__file__).parents[3] / "examples" / "ros2" / "publish_trajectory.py"
N = 30


@pytest.fixture(scope="module")
def path():
    """A short line of MAIRA."""
    line = [mq.pose([0.5, y, 0.6], rpy=[np.pi, 0, 0]) for y in np.linspace(-0.1, 0.1, N)]
    return mq.Solver(mq.Robot.maira()).track(line, dt=0.1)


@pytest.fixture(scope="module")
def trajectory(path):
    """The same with times."""
    return path.timed(acceleration=4.0)


def rows_of(file):
    """The cells of a CSV file by the names of its columns."""
    header, *rows = [line.split(",") for line in file.read_text().splitlines()]
    return dict(zip(header, zip(*rows, strict=True), strict=True))


def test_csv_reads_back_exactly(path, trajectory, tmp_path):
    told = rows_of(mq.save(path, tmp_path / "new" / "path.csv"))
    q = np.array([told[f"q_{joint}"] for joint in path.joint_names], dtype=float).T
    np.testing.assert_array_equal(q, path.q)
    assert set(told["success"]) == {"true"}
    assert set(told["reconfiguration"]) == {"false"}
    np.testing.assert_allclose(np.array(told["time"], dtype=float), 0.1 * np.arange(N))
    told = rows_of(mq.save(trajectory, tmp_path / "trajectory.csv"))
    for name, values in (
        ("q", trajectory.q),
        ("velocity", trajectory.velocity),
        ("acceleration", trajectory.acceleration),
    ):
        read = np.array([told[f"{name}_{joint}"] for joint in path.joint_names], dtype=float).T
        np.testing.assert_array_equal(read, values)
    np.testing.assert_array_equal(np.array(told["time"], dtype=float), trajectory.times)


def test_npz_holds_whole_arrays(path, trajectory, tmp_path):
    with np.load(mq.save(path, tmp_path / "path.npz")) as archive:
        np.testing.assert_array_equal(archive["q"], path.q)
        np.testing.assert_array_equal(archive["position_error"], path.position_error)
        assert tuple(archive["joint_names"]) == path.joint_names
    with np.load(mq.save(trajectory, tmp_path / "trajectory.npz")) as archive:
        np.testing.assert_array_equal(archive["velocity"], trajectory.velocity)
        np.testing.assert_array_equal(archive["tool_speed"], trajectory.tool_speed)


def test_parquet_keeps_types(path, trajectory, tmp_path):
    parquet = pytest.importorskip("pyarrow.parquet")
    table = parquet.read_table(mq.save(path, tmp_path / "path.parquet"))
    assert str(table.schema.field("success").type) == "bool"
    np.testing.assert_array_equal(table.column("q_joint3").to_numpy(), path.q[:, 2])
    table = parquet.read_table(mq.save(trajectory, tmp_path / "trajectory.parquet"))
    assert table.num_rows == len(trajectory)


def test_json_is_the_dictionary(path, trajectory, tmp_path):
    for result in (path, trajectory):
        file = mq.save(result, tmp_path / "result.json")
        assert json.loads(file.read_text()) == json.loads(json.dumps(result.as_dict()))


def test_ros_has_the_fields_of_a_joint_trajectory(path, trajectory, tmp_path):
    """The names are those of the message's definition; times increase strictly, as controllers demand."""
    for result, count in ((trajectory, 7), (path, 0)):
        told = json.loads(mq.save(result, tmp_path / "path.ros.json").read_text())
        assert set(told) == {"header", "joint_names", "points"}
        assert told["joint_names"] == list(result.joint_names)
        assert told["header"] == {"stamp": {"sec": 0, "nanosec": 0}, "frame_id": ""}
        np.testing.assert_array_equal([point["positions"] for point in told["points"]], result.q)
        fields = {"positions", "velocities", "accelerations", "effort", "time_from_start"}
        assert all(set(point) == fields for point in told["points"])
        assert {len(point["velocities"]) for point in told["points"]} == {count}
        times = [
            point["time_from_start"]["sec"] + 1e-9 * point["time_from_start"]["nanosec"] for point in told["points"]
        ]
        assert all(0 <= point["time_from_start"]["nanosec"] < 10**9 for point in told["points"])
        assert (np.diff(times) > 0).all()
    assert times == pytest.approx(0.1 * np.arange(N), abs=1e-9)
    assert json.loads(mq.save(trajectory, tmp_path / "any.txt", "ros").read_text())["points"]


def test_a_path_without_times_is_no_joint_trajectory(path, tmp_path):
    untimed = mq.Solver(mq.Robot.maira()).track([mq.pose([0.5, 0.0, 0.6], rpy=[np.pi, 0, 0])])
    with pytest.raises(OptionError, match="needs times"):
        mq.save(untimed, tmp_path / "path.ros.json")
    assert list(tmp_path.iterdir()) == []


def test_a_rerun_log_is_written(path, trajectory, tmp_path):
    pytest.importorskip("rerun")
    for result in (path, trajectory):
        file = mq.save(result, tmp_path / "log.rrd")
        assert file.read_bytes()[:4] in (b"RRF2", b"RRF3")
        assert file.stat().st_size > 10_000
    with pytest.raises(OptionError, match="no longer knows its robot"):
        mq.save(pickle.loads(pickle.dumps(path)), tmp_path / "pickled.rrd")
    assert [file.name for file in tmp_path.iterdir()] == ["log.rrd"]


def test_pickled_results_are_saved_too(path, trajectory, tmp_path):
    for result in (path, trajectory):
        again = pickle.loads(pickle.dumps(result))
        for ending in (".csv", ".npz", ".json"):
            one, two = mq.save(result, tmp_path / f"a{ending}"), mq.save(again, tmp_path / f"b{ending}")
            assert one.read_bytes() == two.read_bytes() or ending == ".npz"


def test_one_pose_is_a_row(tmp_path):
    one = mq.Solver(mq.Robot.maira()).track([mq.pose([0.5, 0.0, 0.6], rpy=[np.pi, 0, 0])])
    assert len(rows_of(mq.save(one, tmp_path / "one.csv"))["q_joint1"]) == 1
    told = json.loads(mq.save(one.timed(acceleration=1.0), tmp_path / "one.ros.json").read_text())
    assert len(told["points"]) == 1


@pytest.mark.parametrize(
    ("name", "format", "message"),
    [
        ("path.txt", None, r"ends in .*\.csv.*\.rrd, not 'path.txt'"),
        ("path", None, "ends in"),
        ("path.csv", "xml", "no format 'xml'; .*valid names: csv"),
        ("path.csv", 3, "no format 3"),
    ],
)
def test_other_formats_are_refused_with_those_that_there_are(path, tmp_path, name, format, message):
    with pytest.raises(OptionError, match=message):
        mq.save(path, tmp_path / name, format)
    assert list(tmp_path.iterdir()) == []


def test_other_results_are_refused(tmp_path):
    with pytest.raises(OptionError, match="PathSolution or a Trajectory"):
        mq.save({"q": [0.0]}, tmp_path / "path.csv")  # type: ignore[arg-type]


@pytest.mark.parametrize(("library", "ending"), [("pyarrow", ".parquet"), ("rerun", ".rrd")])
def test_without_the_extra_it_is_named(path, tmp_path, monkeypatch, library, ending):
    found = importlib.util.find_spec
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None if name == library else found(name))
    with pytest.raises(OptionError, match=r"maira-qp\[(parquet|rerun)\]"):
        mq.save(path, tmp_path / f"path{ending}")


def test_a_write_that_fails_leaves_the_file_as_it_was(path, tmp_path, monkeypatch):
    file = mq.save(path, tmp_path / "path.csv")
    before = file.read_bytes()

    def fail(*_):
        raise OSError("no space left")

    monkeypatch.setattr("maira_qp.io.save.write_csv", fail)
    with pytest.raises(OSError, match="no space"):
        mq.save(path, file)
    assert file.read_bytes() == before
    assert list(tmp_path.iterdir()) == [file]


def test_every_ending_has_a_writer(path, tmp_path):
    pytest.importorskip("rerun")
    for ending in ENDINGS:
        assert mq.save(path, str(tmp_path / f"path{ending.upper()}")).stat().st_size > 0


def test_the_ros_example_is_python():
    compile(EXAMPLE.read_text(encoding="utf-8"), str(EXAMPLE), "exec")
