"""NumPy's single arrays as tables: poses (N, 4, 4), and structured arrays whose fields are columns."""

import numpy as np
import pytest

import maira_qp as mq
from maira_qp.errors import OptionError, PoseError
from maira_qp.io.answers import WRITERS
from maira_qp.io.poses import read_poses
from maira_qp.io.table import ColumnTable

COUNT = 30


@pytest.fixture
def T(maira, rng):
    return np.array([maira.forward(maira.random_configuration(rng)).homogeneous for _ in range(COUNT)])


def test_poses_are_read_in_both_orders_of_memory(T, tmp_path):
    for k, array in enumerate((T, np.asfortranarray(T), T.astype(">f8"), T.astype(np.float32))):
        np.save(tmp_path / f"{k}.npy", array)
        found = read_poses(tmp_path / f"{k}.npy", None)
        assert len(found) == COUNT
        np.testing.assert_allclose(found.targets(slice(5, 20)), T[5:20], atol=1e-6)


def test_what_is_written_is_read_as_columns(T, maira, tmp_path, monkeypatch):
    """In blocks: texts become longer, and a column of whole numbers has an empty cell in the second."""
    monkeypatch.setattr("maira_qp.io.npy_table.ROWS", 7)
    labels = [f"m{row}{column}" for row in range(3) for column in range(4)]
    asked = ColumnTable(dict(zip(labels, T[:, :3].reshape(-1, 12).T, strict=True)))
    whole = np.ma.masked_array(np.arange(COUNT), mask=np.arange(COUNT) == 21)
    text = np.array(["a" * (1 + i // 10) for i in range(COUNT)], dtype=object)
    with open(tmp_path / "out.npy", "wb") as file:
        writer = WRITERS[".npy"](file, asked, ["count", "text"])
        for rows in (slice(0, 10), slice(10, 20), slice(20, COUNT)):
            count = whole[rows] if whole[rows].mask.any() else whole[rows].data
            writer.write(rows, {"count": count, "text": text[rows]})
        writer.close()
    found = np.load(tmp_path / "out.npy")
    assert found.dtype.names == (*labels, "count", "text")
    np.testing.assert_array_equal(found["count"], whole.astype(float).filled(np.nan))
    assert found["text"].tolist() == text.tolist()
    again = read_poses(tmp_path / "out.npy", maira.joint_names)
    np.testing.assert_allclose(again.targets(slice(None)), T, atol=1e-12)
    assert again.table.columns(slice(3, 5))["text"].tolist() == ["a", "a"]


def test_starts_are_fields(T, maira, tmp_path):
    names = ["x", "y", "z", "qw", "qx", "qy", "qz", *(f"q0_{joint}" for joint in maira.joint_names)]
    table = np.zeros(3, dtype=[(name, float) for name in names])
    table["qx"], table["q0_joint2"] = 1.0, 0.25
    np.save(tmp_path / "starts.npy", table)
    found = read_poses(tmp_path / "starts.npy", maira.joint_names)
    np.testing.assert_array_equal(found.starts(slice(None)), np.tile([0, 0.25, 0, 0, 0, 0, 0], (3, 1)))


def test_a_path_is_saved(maira, T, tmp_path):
    path = mq.Solver(maira).track([maira.forward(maira.middle)] * 2)
    found = np.load(mq.save(path, tmp_path / "path.npy", degrees=True))
    np.testing.assert_array_equal(found["q_joint1 [deg]"], np.degrees(path.q[:, 0]))
    assert found["success"].tolist() == path.success.tolist()


@pytest.mark.parametrize(
    ("array", "said"),
    [
        (np.zeros((3, 4, 5)), r"must hold numbers \(N, 4, 4\)"),
        (np.zeros((3, 4, 4), dtype=complex), "must hold numbers"),
        (np.float64(3.0), "of its shape"),
        (np.zeros(3, dtype=[("x", float)]), "no column of an orientation"),
        (np.zeros((3, 1), dtype=[("x", float)]), r"must be \(N,\)"),
        (np.array([None, 3]), "Python's objects"),
    ],
)
def test_what_is_no_array_of_poses_is_told(array, said, tmp_path):
    np.save(tmp_path / "wrong.npy", array, allow_pickle=True)
    with pytest.raises(PoseError, match=said):
        read_poses(tmp_path / "wrong.npy", None)


def test_damage_is_told(T, tmp_path):
    np.save(tmp_path / "cut.npy", T)
    content = (tmp_path / "cut.npy").read_bytes()
    for damaged in (content[:-1], content[:40], b"", b"PK" + content):
        (tmp_path / "cut.npy").write_bytes(damaged)
        with pytest.raises(PoseError, match="cannot be read as an array"):
            read_poses(tmp_path / "cut.npy", None)
    with pytest.raises(OptionError, match="ASCII letters alone"), open(tmp_path / "out.npy", "wb") as file:
        WRITERS[".npy"](file, ColumnTable({"naïve": np.zeros(3)}), [])
