"""The compiled pose error is the one of `maira_qp.orientation`, on every branch, in every lane."""

import mpmath
import numpy as np
import pytest
from numba import njit
from support.compiled_problems import few, row_of

import maira_qp as mq
from maira_qp.kernels.jit.simd import LANES, load, store
from maira_qp.kernels.spatial.pose_error import arctangent, pose_error
from maira_qp.orientation import matrix_from_quaternion, quaternion_exp

NEAR_PI = ("near pi about x", "near pi about y", "near pi about z", "near pi about any axis")
KINDS = ("any", "near 0", *NEAR_PI, "equal", "between two branches")


def random_pair(kind: str, rng) -> tuple[np.ndarray, np.ndarray]:
    """Two poses (4, 4) whose rotations are `kind` apart."""
    axis = np.eye(3)["xyz".index(kind[-1])] if kind in NEAR_PI[:3] else rng.normal(size=3)
    if kind == "between two branches":  # the components w and x, or x and y, ... of the quaternion are nearly equal
        quaternion = np.zeros(4) + 0.1 * rng.random(4)
        quaternion[rng.choice(4, 2, replace=False)] = 1.0, 1.0 + rng.choice([0.0, 1e-16, 1e-9])
        turn = matrix_from_quaternion(quaternion / np.linalg.norm(quaternion))
    else:
        angle = {"any": rng.uniform(0, np.pi), "near 0": 10 ** rng.uniform(-15, -3), "equal": 0.0}
        near_pi = np.pi - 10 ** rng.uniform(-12, -2)
        turn = matrix_from_quaternion(quaternion_exp(0.5 * angle.get(kind, near_pi) * axis / np.linalg.norm(axis)))
    T, T_d = np.eye(4), np.eye(4)
    T[:3, :3] = mq.pose([0, 0, 0], rpy=rng.uniform(-3, 3, 3)).rotation
    T_d[:3, :3] = T[:3, :3] if kind == "equal" else turn @ T[:3, :3]
    T[:3, 3], T_d[:3, 3] = rng.normal(size=3), rng.normal(size=3)
    return T, T_d


def tolerance(kind: str) -> float:
    return 1e-13 if kind in NEAR_PI else 2e-14


@pytest.mark.parametrize("kind", KINDS)
def test_the_pose_error_is_that_of_the_definition(kind, rng):
    """One at a time, and eight of a kind."""
    e, e8 = np.empty(6), np.empty((6, LANES))
    for _ in range(few(60)):
        pairs = [random_pair(kind, rng) for _ in range(LANES)]
        tools, targets = (np.array([row_of(pair[k]) for pair in pairs]) for k in (0, 1))
        pose_error(np.ascontiguousarray(tools.T), np.ascontiguousarray(targets.T), e8)
        for lane, (T, T_d) in enumerate(pairs):
            pose_error(tools[lane], targets[lane], e)
            expected = mq.pose_error(T, T_d)
            assert np.abs(e - expected).max() <= tolerance(kind)
            assert np.abs(e8[:, lane] - expected).max() <= tolerance(kind)
            if kind == "near 0":
                assert np.abs(e - expected).max() <= 1e-14 * max(1e-2, np.linalg.norm(expected[3:]))


def test_lanes_on_different_branches_do_not_touch_each_other(rng):
    """Each lane another kind, one of them NaN: to the bit what it is in any other company."""
    e8, again = np.empty((2, 6, LANES))
    for _ in range(few(200)):
        kinds = rng.permutation(KINDS)
        pairs = [random_pair(kind, rng) for kind in kinds]
        tools, targets = (np.array([row_of(pair[k]) for pair in pairs]) for k in (0, 1))
        spoilt = rng.integers(LANES)
        targets[spoilt] = np.nan
        pose_error(np.ascontiguousarray(tools.T), np.ascontiguousarray(targets.T), e8)
        assert np.isnan(e8[:, spoilt]).all()
        for lane in set(range(LANES)) - {spoilt}:
            assert np.abs(e8[:, lane] - mq.pose_error(*pairs[lane])).max() <= tolerance(kinds[lane])
            pose_error(*(np.repeat(rows[lane][:, None], LANES, axis=1) for rows in (tools, targets)), again)
            assert (again == e8[:, [lane]]).all()


def test_equal_poses_have_an_error_of_exactly_nothing(rng):
    e = np.empty(6)
    for _ in range(few(100)):
        row = row_of(random_pair("any", rng)[0])
        pose_error(row, row, e)
        assert (e == 0.0).all()


@pytest.mark.parametrize("axis", [[1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 0], [-1, 2, 3]])
def test_half_a_turn_is_pi_about_the_axis_one_way_or_the_other(axis):
    axis = np.array(axis) / np.linalg.norm(axis)
    e, R = np.empty(6), 2 * np.outer(axis, axis) - np.eye(3)
    pose_error(np.r_[np.eye(3).ravel(), 0, 0, 0], np.r_[R.ravel(), 0, 0, 0], e)
    assert min(np.abs(e[3:] - np.pi * axis).max(), np.abs(e[3:] + np.pi * axis).max()) < 1e-14


@njit
def arctangents_in_lanes(t, out):
    for i in range(len(t)):
        store(out, i, arctangent(load(t, i)))


def test_the_arctangent_is_exact_to_the_last_digit_or_two(rng):
    """On [0, 1], both sides of where its two branches meet."""
    middle = 0.41421356237309503
    t = [rng.random(few(4000)), 10.0 ** rng.uniform(-300, 0, few(1000)), [1.0, 5e-324]]
    t = np.concatenate([*t, middle + np.arange(-20, 21) * np.spacing(middle), 1.0 - 10.0 ** rng.uniform(-16, -1, 50)])
    padded = np.resize(t, (-(-len(t) // LANES), LANES))
    found8 = np.empty_like(padded)
    arctangents_in_lanes(padded, found8)
    for i, each in enumerate(t):
        with mpmath.workprec(120):
            exact = mpmath.atan(mpmath.mpf(float(each)))
        for found in (arctangent(each), found8.flat[i]):
            assert abs(mpmath.mpf(float(found)) - exact) <= 2.5 * np.spacing(float(exact)), each
    assert arctangent(0.0) == 0.0
    assert np.isnan(arctangent(np.nan))
