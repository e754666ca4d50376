"""Poses from callers, checked in compiled code: the verdict and the rotation of `maira_qp.orientation.rigid`."""

import numpy as np
import pytest
from support.compiled_problems import row_of

import maira_qp as mq
from maira_qp.kernels.spatial.pose_validation import FINE, NOT_FINITE, NOT_RIGID, pose_row, pose_rows
from maira_qp.orientation import ORTHONORMAL_WITHIN, nearest_rotation, orthonormality_deviation, rigid


def random_pose(rng) -> np.ndarray:
    """A transformation (4, 4)."""
    return mq.pose(rng.normal(size=3), rpy=rng.uniform(-3, 3, 3)).homogeneous


def checked(T: np.ndarray) -> tuple[int, np.ndarray]:
    row, before = np.full(12, np.nan), T.copy()
    fault = pose_row(T, ORTHONORMAL_WITHIN, row)
    np.testing.assert_array_equal(T, before)
    return fault, row


def test_an_exact_pose_is_taken_as_it_is(rng):
    for T in [np.eye(4), *(random_pose(rng) for _ in range(200))]:
        fault, row = checked(T)
        assert fault == FINE
        np.testing.assert_array_equal(row, row_of(T))


@pytest.mark.parametrize("error", [1e-13, 1e-9, 1e-6, 4e-6])
def test_a_rounded_rotation_becomes_the_nearest_one(error, rng):
    """To rounding the one that the singular value decomposition finds."""
    for _ in range(200):
        T = random_pose(rng)
        exact = T[:3, :3].copy()
        T[:3, :3] += rng.uniform(-1, 1, (3, 3)) * error
        if orthonormality_deviation(T[:3, :3]) > ORTHONORMAL_WITHIN:
            continue
        fault, row = checked(T)
        R = row[:9].reshape(3, 3)
        assert fault == FINE
        assert np.abs(R - nearest_rotation(T[:3, :3])).max() < 1e-14  # what the decomposition itself is off by
        assert np.abs(row - row_of(rigid(T, "target"))).max() < 1e-14
        assert orthonormality_deviation(R) < 1e-15
        assert np.abs(R - exact).max() < 2 * error
        np.testing.assert_array_equal(row[9:], T[:3, 3])


def test_single_precision_is_rounded_and_not_refused(rng):
    for _ in range(100):
        T = random_pose(rng).astype(np.float32).astype(float)
        fault, row = checked(T)
        assert fault == FINE
        assert orthonormality_deviation(row[:9].reshape(3, 3)) < 1e-15


@pytest.mark.parametrize("scale", [1 + 0.49e-5, 1 - 0.49e-5, 1 + 0.51e-5, 1 - 0.51e-5, 2.0, 0.5, 0.0, 1e200, -1.0])
def test_what_is_left_to_the_definition_is_what_its_tolerance_says(scale, rng):
    """Scaled rotations on both sides of the tolerance, by -1 a reflection; what is rounded more is no matter for it."""
    for _ in range(20):
        T = random_pose(rng)
        T[:3, :3] *= scale
        assert (checked(T)[0] == FINE) == accepts(T)


def accepts(T: np.ndarray) -> bool:
    try:
        rigid(T, "target")
    except mq.errors.PoseError:
        return False
    return orthonormality_deviation(T[:3, :3]) <= ORTHONORMAL_WITHIN


@pytest.mark.parametrize("axis", range(3))
def test_a_reflection_is_not_rigid(axis, rng):
    T = random_pose(rng)
    T[:3, axis] *= -1.0
    assert checked(T)[0] == NOT_RIGID
    assert not accepts(T)


@pytest.mark.parametrize("row", [[0, 0, 0, 2], [0, 0, 0, 0], [1e-9, 0, 0, 1], [0, -1e-9, 0, 1], [0, 0, 1, 1]])
def test_another_last_row_is_not_rigid(row, rng):
    T = random_pose(rng)
    T[3] = row
    assert checked(T)[0] == NOT_RIGID
    assert not accepts(T)


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_what_is_not_finite_is_told_wherever_it_stands(value, rng):
    """Alone, and with another of the other sign."""
    for i in range(16):
        T = random_pose(rng)
        T.flat[i] = value
        assert checked(T)[0] == NOT_FINITE
        T.flat[(i + 5) % 16] = -value
        assert checked(T)[0] == NOT_FINITE


def test_many_at_once_are_each_checked_alone(rng):
    T = np.array([random_pose(rng) for _ in range(12)])
    T[3, 0, 0] = np.nan
    T[5, :3, :3] *= 2.0
    T[7, :3, :3] += 1e-7
    rows, faults = np.full((12, 12), np.nan), np.full(12, -9)
    pose_rows(T, ORTHONORMAL_WITHIN, rows, faults)
    expected = [checked(each) for each in T]
    assert faults.tolist() == [fault for fault, _ in expected]
    assert sorted(faults) == [FINE] * 10 + [NOT_FINITE, NOT_RIGID]
    fine = faults == FINE
    np.testing.assert_array_equal(rows[fine], np.array([row for _, row in expected])[fine])
