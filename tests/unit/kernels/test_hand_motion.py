"""From hands to targets in compiled code, against rotations by SciPy and by the exponential of Pinocchio."""

import numpy as np
import pinocchio as pin
from scipy.spatial.transform import Rotation
from support.compiled_problems import few, row_of

import maira_qp as mq
from maira_qp.kernels.control.hand_motion import JUMPED, follow_hands
from maira_qp.kernels.spatial.pose_validation import FINE, NOT_FINITE, NOT_RIGID
from maira_qp.orientation import ORTHONORMAL_WITHIN

ANYWHERE = np.full(2, np.inf)


def random_poses(count: int, rng) -> np.ndarray:
    """Transformations (count, 4, 4)."""
    return np.array([mq.pose(rng.normal(size=3), rpy=rng.uniform(-3, 3, 3)).homogeneous for _ in range(count)])


def followed(T, hands, targets, largest=ANYWHERE, A=None, scale=1.0, turn=1.0, is_relative=True):
    """Fault, hands (K, 12), targets (K, 4, 4) and jump."""
    rows, A = np.array([row_of(each) for each in hands]), np.eye(3) if A is None else A
    seen, goals, out = np.full((len(T), 12), np.nan), np.full(T.shape, np.nan), np.full(9, np.nan)
    given = T.copy(), targets.copy()
    fault = follow_hands(T, ORTHONORMAL_WITHIN, largest, rows, A, scale, turn, is_relative, targets, seen, goals, out)
    np.testing.assert_array_equal(T, given[0])
    np.testing.assert_array_equal(targets, given[1])
    return fault, seen, goals, out


def test_without_a_clutch_the_hands_are_the_targets(rng):
    for _ in range(few(100)):
        T, last, targets = (random_poses(2, rng) for _ in range(3))
        fault, seen, goals, _ = followed(T, last, targets, is_relative=False)
        assert fault == FINE
        np.testing.assert_array_equal(goals, T)
        np.testing.assert_array_equal(seen, [row_of(each) for each in T])


def test_with_it_the_targets_move_by_the_scaled_motion(rng):
    """Turns from 1e-9 to near a half turn."""
    for _ in range(few(200)):
        last, targets, A = random_poses(2, rng), random_poses(2, rng), random_poses(1, rng)[0, :3, :3].copy()
        angle, (scale, turn) = 10.0 ** rng.uniform(-9, 0.49), rng.uniform(0, 2, 2)
        T = last.copy()
        for each in T:
            axis = rng.normal(size=3)
            each[:3, :3] = pin.exp3(angle * axis / np.linalg.norm(axis)) @ each[:3, :3]
            each[:3, 3] += rng.normal(size=3)
        fault, _, goals, _ = followed(T, last, targets, A=A, scale=scale, turn=turn)
        assert fault == FINE
        for k in range(2):
            phi = Rotation.from_matrix(T[k, :3, :3] @ last[k, :3, :3].T).as_rotvec()
            R = Rotation.from_rotvec(turn * A @ phi).as_matrix() @ targets[k, :3, :3]
            p = targets[k, :3, 3] + scale * A @ (T[k, :3, 3] - last[k, :3, 3])
            np.testing.assert_allclose(goals[k, :3, :3], R, atol=1e-11)
            np.testing.assert_allclose(goals[k, :3, 3], p, atol=1e-14)
            np.testing.assert_array_equal(goals[k, 3], [0, 0, 0, 1])


def test_without_last_hands_the_targets_stay(rng):
    T, targets = random_poses(2, rng), random_poses(2, rng)
    nowhere = np.full((2, 4, 4), np.nan)
    fault, seen, goals, _ = followed(T, nowhere, targets, largest=np.full(2, 1e-9))
    assert fault == FINE
    np.testing.assert_array_equal(goals, targets)
    np.testing.assert_array_equal(seen, [row_of(each) for each in T])


def test_a_jump_is_found_with_the_hand_that_made_it_and_its_size(rng):
    last = random_poses(3, rng)
    for k in range(3):
        T = last.copy()
        T[k, :3, 3] += [0.3, 0.0, 0.4]
        T[k, :3, :3] = pin.exp3(np.array([0.0, 0.2, 0.0])) @ T[k, :3, :3]
        for largest, is_far in (((0.51, 0.21), False), ((0.49, 0.21), True), ((0.51, 0.19), True)):
            fault, _, _, out = followed(T, last, last, largest=np.array(largest))
            assert fault == (JUMPED if is_far else FINE)
            if is_far:
                np.testing.assert_allclose(out[:3], [k, 0.5, 0.2], atol=1e-12)


def test_what_is_no_pose_is_found_with_its_index(rng):
    last = random_poses(3, rng)
    for value, expected in ((np.nan, NOT_FINITE), (np.inf, NOT_FINITE), (7.0, NOT_RIGID)):
        for k in range(3):
            T = last.copy()
            T[k, 0, 0] = value
            fault, _, _, out = followed(T, last, last)
            assert (fault, out[0]) == (expected, k)
