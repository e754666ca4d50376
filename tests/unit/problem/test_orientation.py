"""Quaternions and the pose error against mpmath in 60 digits."""

import mpmath as mp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from maira_qp import orientation as ori

mp.mp.dps = 60


def exact_rotation(vector) -> mp.matrix:
    """exp of a rotation vector, in high precision (Rodrigues)."""
    x, y, z = (mp.mpf(float(v)) for v in vector)
    angle = mp.sqrt(x * x + y * y + z * z)
    K = mp.matrix([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    if angle == 0:
        return mp.eye(3)
    return mp.eye(3) + (mp.sin(angle) / angle) * K + ((1 - mp.cos(angle)) / angle**2) * (K * K)


def exact_log(M: mp.matrix) -> list:
    """Rotation vector of a rotation matrix in high precision; for angles away from pi."""
    v = [M[2, 1] - M[1, 2], M[0, 2] - M[2, 0], M[1, 0] - M[0, 1]]
    norm = mp.sqrt(sum(c * c for c in v))
    angle = mp.atan2(norm, M[0, 0] + M[1, 1] + M[2, 2] - 1)
    return [c * angle / norm for c in v] if norm != 0 else [mp.mpf(0)] * 3


def as_float(M: mp.matrix) -> np.ndarray:
    return np.array([[float(M[i, j]) for j in range(3)] for i in range(3)])


def random_axis(rng) -> np.ndarray:
    axis = rng.normal(size=3)
    return axis / np.linalg.norm(axis)


@pytest.mark.parametrize(
    ("axis", "angle"),
    [([1, 0, 0], 0.3), ([1, 0, 0], np.pi), ([0, 1, 0], np.pi), ([0, 0, 1], np.pi), ([0, 0, 1], -np.pi / 2)],
)
def test_each_branch_of_the_matrix_conversion_gives_the_quaternion_of_that_rotation(axis, angle):
    expected = np.array([np.cos(angle / 2), *(np.sin(angle / 2) * np.array(axis))])
    found = ori.quaternion_from_matrix(as_float(exact_rotation(np.array(axis) * angle)))
    assert min(np.abs(found - expected).max(), np.abs(found + expected).max()) < 1e-15


def test_quaternions_of_random_rotations_give_the_matrix_back(rng):
    """2,000 rotations, a third of them within 1e-6 of pi, where three of the four branches are needed."""
    pivots = set()
    for k in range(2000):
        angle = rng.uniform(0, np.pi) if k % 3 else np.pi - rng.uniform(0, 1e-6)
        R = ori.matrix_from_quaternion(ori.quaternion_exp(0.5 * angle * random_axis(rng)))
        q = ori.quaternion_from_matrix(R)
        pivots.add(int(np.abs(q).argmax()))
        assert q[0] >= 0
        assert abs(np.linalg.norm(q) - 1) < 4e-16
        assert np.abs(ori.matrix_from_quaternion(q) - R).max() < 2e-15
    assert pivots == {0, 1, 2, 3}


def test_the_product_composes_rotations(rng):
    for _ in range(200):
        a, b = (ori.quaternion_exp(rng.normal(size=3)) for _ in range(2))
        R = ori.matrix_from_quaternion(ori.quaternion_product(a, b))
        assert np.abs(R - ori.matrix_from_quaternion(a) @ ori.matrix_from_quaternion(b)).max() < 1e-15


@settings(deadline=None, max_examples=300)
@given(st.floats(1e-300, np.pi / 2 - 1e-12), st.integers(0, 2**32 - 1))
def test_log_inverts_exp_from_the_smallest_rotation_to_half_a_turn(size, seed):
    u = size * random_axis(np.random.default_rng(seed))
    back = ori.quaternion_log(ori.quaternion_exp(u))
    assert np.linalg.norm(back - u) <= 1e-14 * np.linalg.norm(u)


def test_log_takes_the_short_way_round():
    q = ori.quaternion_exp(np.array([0.0, 0.0, 0.4]))
    assert np.array_equal(ori.quaternion_log(-q), ori.quaternion_log(q))
    assert np.array_equal(ori.quaternion_log(np.array([1.0, 0, 0, 0])), np.zeros(3))


@pytest.mark.parametrize("w", [-1e-300, -1e-12, -1e-6, -1e-4, -5e-4, -1e-3, -0.1, -0.9])
def test_log_takes_the_short_way_round_however_little_shorter_it_is(w, rng):
    """A scalar part below zero by ever so little: half of a rotation vector of at most half a turn, against mpmath."""
    for _ in range(20):
        q = np.array([w, *(np.sqrt(1.0 - w * w) * random_axis(rng))])
        norm = mp.sqrt(sum(mp.mpf(float(c)) ** 2 for c in q[1:]))
        exact = [float(-mp.atan2(norm, -mp.mpf(w)) * mp.mpf(float(c)) / norm) for c in q[1:]]
        assert np.abs(ori.quaternion_log(q) - exact).max() < 1e-15


@pytest.mark.parametrize("size", [1e-15, 1e-12, 1e-9, 1e-6, 1e-3])
def test_the_error_of_near_poses_is_exact_to_the_last_digits_of_the_matrices(size, rng):
    """Relative error below 1e-14 against mpmath on the very same matrices, at any attitude: no cancellation near 0."""
    for _ in range(20):
        R = as_float(exact_rotation(rng.normal(size=3)))
        R_d = as_float(exact_rotation(size * random_axis(rng)) * mp.matrix(R.tolist()))
        p, p_d = rng.normal(size=3), rng.normal(size=3)
        found = ori.pose_error(homogeneous(R, p), homogeneous(R_d, p_d))
        # log of the product by its skew part: for floats the product is a rotation only to 1e-16
        M = mp.matrix(R_d.tolist()) * mp.matrix(R.tolist()).T
        skew = [(M[2, 1] - M[1, 2]) / 2, (M[0, 2] - M[2, 0]) / 2, (M[1, 0] - M[0, 1]) / 2]
        sine = mp.sqrt(sum(c * c for c in skew))
        exact = np.array([float(c * mp.asin(sine) / sine) for c in skew]) if sine else np.zeros(3)
        assert np.linalg.norm(found[3:] - exact) <= 1e-14 * np.linalg.norm(exact)
        assert np.array_equal(found[:3], p_d - p)


@pytest.mark.parametrize("gap", [1e-3, 4e-3, 1e-6, 1e-9, 3e-11])
def test_the_error_near_half_a_turn_is_exact_to_1e_12(gap, rng):
    for _ in range(50):
        R = as_float(exact_rotation(rng.normal(size=3)))
        phi = (np.pi - gap) * random_axis(rng)
        R_d = as_float(exact_rotation(phi) * mp.matrix(R.tolist()))
        assert np.linalg.norm(ori.orientation_error(R, R_d) - phi) < 1e-12


def test_the_error_at_moderate_angles_agrees_with_mpmath(rng):
    for _ in range(100):
        R, R_d = (as_float(exact_rotation(rng.normal(size=3))) for _ in range(2))
        exact = exact_log(mp.matrix(R_d.tolist()) * mp.matrix(R.tolist()).T)
        assert np.abs(ori.orientation_error(R, R_d) - [float(c) for c in exact]).max() < 1e-14


def test_the_error_of_equal_poses_is_exactly_zero(rng):
    R = as_float(exact_rotation(rng.normal(size=3)))
    assert np.array_equal(ori.orientation_error(R, R.copy()), np.zeros(3))


def test_the_nearest_rotation_is_nearer_than_any_other(rng):
    """The polar factor against 200 rotations in its neighbourhood and Newton's iteration for it."""
    for _ in range(20):
        M = as_float(exact_rotation(rng.normal(size=3))) + 0.05 * rng.normal(size=(3, 3))
        R = ori.nearest_rotation(M)
        assert ori.orthonormality_deviation(R) < 4e-15
        X = M
        for _ in range(30):
            X = 0.5 * (X + np.linalg.inv(X).T)
        assert np.abs(R - X).max() < 1e-14
        distance = np.linalg.norm(R - M)
        for _ in range(10):
            other = ori.matrix_from_quaternion(ori.quaternion_exp(0.1 * rng.normal(size=3))) @ R
            assert np.linalg.norm(other - M) > distance


def homogeneous(R: np.ndarray, p: np.ndarray) -> np.ndarray:
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = R, p
    return T
