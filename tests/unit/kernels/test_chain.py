"""Compiled kinematics against Pinocchio, one configuration at a time and eight; sine and cosine against mpmath."""

import mpmath
import numpy as np
import pytest
from numba import njit
from support.compiled_problems import arm, configurations, few, kinematic_work, nine_robots, row_of
from support.made_robots import random_chain

import maira_qp as mq
from maira_qp.kernels.jit.simd import LANES, load, store
from maira_qp.kernels.jit.simd_trig import sine_cosine
from maira_qp.kernels.kinematics.serial_chain import forward, jacobian, jacobians
from maira_qp.kernels.layout import Joint


def assert_kinematics_of_pinocchio(robot: mq.Robot, rng, blocks: int) -> None:
    """Pose and Jacobian at random configurations, in lanes and one by one."""
    chain, n = robot.chain, robot.n
    within = 5e-15 * max(1, robot.length) * n
    axes, origins, tool, _, J = kinematic_work(n)
    axes8, origins8, tool8, _, J8 = kinematic_work(n, LANES)
    for _ in range(blocks):
        q = configurations(robot, rng, LANES)
        forward(chain, np.ascontiguousarray(q.T), axes8, origins8, tool8)
        jacobian(chain, axes8, origins8, tool8, J8)
        for lane in range(LANES):
            forward(chain, q[lane], axes, origins, tool)
            jacobian(chain, axes, origins, tool, J)
            pose, expected = row_of(robot.forward(q[lane])), robot.jacobian(q[lane])
            assert np.abs(tool - pose).max() < within
            assert np.abs(tool8[:, lane] - pose).max() < within
            assert np.abs(J.T - expected).max() < within
            assert np.abs(J8[..., lane].T - expected).max() < within


@nine_robots
def test_kinematics_are_pinocchios_on_real_robots(name, rng):
    """Axes along x, y, z, against them and skew; prismatic and continuous joints."""
    assert_kinematics_of_pinocchio(arm(name), rng, few(25))


@pytest.mark.parametrize("joints", [1, 2, 7, 30])
def test_kinematics_are_pinocchios_on_random_chains_of_any_axes(joints, rng):
    for _ in range(5):
        assert_kinematics_of_pinocchio(random_chain(joints, rng), rng, few(3))


@nine_robots
def test_all_jacobians_at_once_are_those_of_pinocchio(name, rng):
    robot = arm(name)
    q = configurations(robot, rng, few(40))
    J = np.full((len(q), robot.n, 6), np.nan)
    jacobians(robot.chain, q, J)
    expected = np.array([robot.jacobian(each).T for each in q])
    assert np.abs(J - expected).max() < 5e-15 * max(1, robot.length) * robot.n
    assert np.array_equal(robot.jacobians(q), J.swapaxes(1, 2))


@nine_robots
def test_a_chain_holds_the_limits_and_what_starts_are_drawn_from(name):
    """A continuous joint has no limits, but one turn to draw from."""
    robot = arm(name)
    chain = robot.chain[: robot.n]
    np.testing.assert_array_equal(chain[:, [Joint.LOWER, Joint.UPPER]], np.transpose([robot.lower, robot.upper]))
    drawn = [
        (-np.pi, np.pi) if np.isinf(high) else (low, high) for low, high in zip(robot.lower, robot.upper, strict=True)
    ]
    np.testing.assert_array_equal(chain[:, [Joint.START_LOWER, Joint.START_UPPER]], drawn)
    assert set(chain[:, Joint.PRISMATIC]) <= {0.0, 1.0}


def test_the_pose_of_a_lane_depends_on_that_lane_alone(rng):
    """To the bit, whatever is in the others and in whichever lane it is, NaN among them."""
    robot = arm("talos_arm")
    chain, q = robot.chain, configurations(robot, rng, LANES)
    q[3] = np.nan
    q[5, 2] = np.inf
    first, second = kinematic_work(robot.n, LANES), kinematic_work(robot.n, LANES)
    forward(chain, np.ascontiguousarray(q.T), *first[:3])
    jacobian(chain, *first[:3], first[4])
    for _ in range(10):
        order = rng.integers(0, LANES, LANES)
        forward(chain, np.ascontiguousarray(q[order].T), *second[:3])
        jacobian(chain, *second[:3], second[4])
        for a, b in zip(first, second, strict=True):
            np.testing.assert_array_equal(a[..., order], b)
    assert np.isfinite(first[2][:, [0, 1, 2, 4, 6, 7]]).all()
    assert np.isnan(first[2][0, [3, 5]]).all()


@njit
def sines_in_lanes(angles, sine, cosine):
    for i in range(len(angles)):
        s, c = sine_cosine(load(angles, i))
        store(sine, i, s)
        store(cosine, i, c)


def ulps(found: float, exact: mpmath.mpf) -> float:
    """Distance in units of the last place of the exact value."""
    return float(abs(mpmath.mpf(float(found)) - exact) / np.spacing(abs(float(exact)) or 5e-324))


def test_sine_and_cosine_are_exact_to_the_last_digit_or_two(rng):
    """Over the turns that robots make, next to every multiple of pi/2 and pi/4 up to 1e5 rad, and next to 0."""
    count = few(1000)
    turns = np.concatenate([np.arange(-40, 41), rng.integers(-63_000, 63_000, count)])
    angles = [rng.uniform(-7, 7, count), rng.uniform(-1e5, 1e5, count), turns * np.pi / 2, (turns + 0.5) * np.pi / 2]
    angles += [10.0 ** rng.uniform(-300, 0, count), [0.0, 1e-300, 1e-9, 1e5, -1e5]]
    angles = np.concatenate(angles)
    padded = np.resize(angles, (-(-len(angles) // LANES), LANES))
    sine8, cosine8 = np.empty((2, *padded.shape))
    sines_in_lanes(padded, sine8, cosine8)
    for i, angle in enumerate(angles):
        with mpmath.workprec(160):
            exact = mpmath.sin(mpmath.mpf(float(angle))), mpmath.cos(mpmath.mpf(float(angle)))
        for found in (sine_cosine(angle), (sine8.flat[i], cosine8.flat[i])):
            assert ulps(found[0], exact[0]) < 2.5, angle
            assert ulps(found[1], exact[1]) < 2.5, angle


def test_the_sine_of_what_is_not_finite_is_nan_in_its_lane_alone():
    angles = np.array([[0.3, np.nan, 0.3, np.inf, 0.3, -np.inf, 0.3, 0.3]])
    sine, cosine = np.empty((2, 1, LANES))
    sines_in_lanes(angles, sine, cosine)
    for found, expected in ((sine, np.sin(0.3)), (cosine, np.cos(0.3))):
        assert np.isnan(found[0, [1, 3, 5]]).all()
        np.testing.assert_allclose(found[0, [0, 2, 4, 6, 7]], expected, rtol=3e-16)
    assert np.isnan([sine_cosine(angle) for angle in (np.nan, np.inf, -np.inf)]).all()
