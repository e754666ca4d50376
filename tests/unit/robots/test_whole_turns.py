"""Angles that differ by whole turns, against all turns tried one by one."""

from functools import partial
from itertools import product

import numpy as np
import pytest
from support.compiled_problems import arm
from support.made_robots import random_table

import maira_qp as mq
from maira_qp.kernels.kinematics.unwrap import unwind, unwind_free
from maira_qp.robots.model.revolutions import FARTHEST, WholeTurns

PI = np.pi


def turned(robot, turns, q, most=3):
    """All configurations that are q but for up to so many turns a joint, and within the limits: one by one."""
    shifts = [range(-most, most + 1) if revolute else [0] for revolute in turns.revolute]
    every = np.array([q + 2 * PI * np.array(shift) for shift in product(*shifts)])
    return every[((robot.lower <= every) & (every <= robot.upper)).all(axis=1)]


@pytest.fixture
def robot():
    """A joint of more than two turns, one of less than a turn away from zero, a sliding one, a narrow one."""
    limits = [(-7.0, 7.5), (4.0, 9.0), (0.0, 20.0), (-1.0, 1.0)]
    kinds = ["revolute", "revolute", "prismatic", "revolute"]
    links = [
        mq.DHLink(kind=kind, a=0.3, alpha=0.5, lower=lower, upper=upper)
        for kind, (lower, upper) in zip(kinds, limits, strict=True)
    ]
    return mq.Robot.from_dh(links)


def test_all_turns_are_those_that_fit(robot, rng):
    turns = WholeTurns(robot, robot.middle)
    assert turns.revolute.tolist() == [True, True, False, True]
    assert turns.everywhere.tolist() == [True, False, False, False]
    for _ in range(30):
        q = robot.random_configuration(rng)
        wound = q + 2 * PI * np.array([5, -3, 0, 2])
        found, complete = turns.all_within(wound[None], 100)
        np.testing.assert_allclose(np.sort(found, axis=0), np.sort(turned(robot, turns, q), axis=0), atol=1e-12)
        assert complete
        assert turns.apart(q, found).max() < 1e-12
        np.testing.assert_allclose(turns.within(wound[None])[0, 0] % (2 * PI), q[0] % (2 * PI), atol=1e-12)


def test_the_nearest_turns_are_kept_where_there_are_too_many(robot, rng):
    turns = WholeTurns(robot, np.array([6.0, 8.0, 3.0, 0.0]))
    q = np.array([0.5, 8.0, 3.0, 0.2])
    found, complete = turns.all_within(q[None], 1)
    np.testing.assert_allclose(found, [[0.5 + 2 * PI, 8.0, 3.0, 0.2]])
    assert not complete
    np.testing.assert_array_equal(turns.within(q[None]), found)


def test_what_no_turn_brings_within_the_limits_is_left_out(robot):
    turns = WholeTurns(robot, robot.middle)
    inside, outside = np.array([0.0, 5.0, 3.0, 0.0]), np.array([0.0, 5.0, 3.0, 1.2])
    sliding = np.array([0.0, 5.0, 3.0 + 20.0, 0.0])
    np.testing.assert_array_equal(turns.within(np.array([inside, outside, sliding])), [inside])
    assert turns.within(outside[None], slack=0.3).tolist() == [[0.0, 5.0, 3.0, 1.0]]
    assert len(turns.all_within(np.array([outside]), 10)[0]) == 0


def test_a_continuous_joint_comes_nearest_to_the_reference(pr2_arm, rng):
    reference = np.where(np.isinf(pr2_arm.upper), 40.0, pr2_arm.middle)
    turns, q = WholeTurns(pr2_arm, reference), pr2_arm.random_configuration(rng)
    found, complete = turns.all_within(q[None], 100)
    assert complete
    assert np.abs(found - reference)[:, np.isinf(pr2_arm.upper)].max() <= PI + 1e-9
    assert np.abs(turns.unwound(found[0])[np.isinf(pr2_arm.upper)]).max() <= PI


def test_turns_change_no_pose(rng):
    for _ in range(10):
        robot = mq.Robot.from_dh(random_table(rng, 5))
        turns, q = WholeTurns(robot, robot.middle), robot.random_configuration(rng)
        wound = q + 2 * PI * turns.revolute * rng.integers(-2, 3, 5)
        assert np.abs(mq.pose_error(robot.forward(wound), robot.forward(q))).max() < 1e-12
        assert turns.apart(q, turns.within(wound[None])).max() < 1e-12


def test_the_window_is_a_turn_within_the_limits_around_the_reference(robot, pr2_arm):
    for reference, first in ((0.5, 0.5 - PI), (-7.0, -7.0), (20.0, 7.5 - 2 * PI)):
        lower, upper = WholeTurns(robot, np.array([reference, 0.0, 0.0, 0.0])).window
        np.testing.assert_allclose(lower, [first, 4.0, 0.0, -1.0])
        np.testing.assert_allclose(upper, [first + 2 * PI, 9.0, 2 * robot.length, 1.0])  # of a long slide a part
        assert (robot.lower <= lower).all()
        assert (upper <= robot.upper).all()
    far = mq.Robot.from_dh([mq.DHLink(a=1.0, lower=2e4, upper=2e4 + 10)])
    for reference in (0.0, 2e4 + 4, 1e9):
        lower, upper = WholeTurns(far, np.array([reference])).window
        assert far.lower[0] <= lower[0] <= upper[0] - 2 * PI + 1e-9 <= far.upper[0] - 2 * PI + 1e-9
    endless = np.isinf(pr2_arm.lower)
    assert endless.any()
    for reference in (-3.0, 0.0, 100.0, 1e300):
        lower, upper = WholeTurns(pr2_arm, np.full(7, reference)).window
        np.testing.assert_allclose((upper - lower)[endless], 2 * PI)
        np.testing.assert_allclose((0.5 * (lower + upper))[endless], min(reference, FARTHEST))
        np.testing.assert_array_equal(lower[~endless], pr2_arm.lower[~endless])


@pytest.mark.parametrize("name", ["maira", "pr2_arm", "ur5", "xarm7", "tiago"])
def test_the_kernel_unwinds_as_this_does(name, rng):
    robot = arm(name)
    reference = rng.uniform(-9.0, 9.0, robot.n)
    q = np.array([robot.random_configuration(rng) for _ in range(60)])
    q[:, np.isinf(robot.lower)] *= 30.0
    reached = rng.choice([-1.0, 0.0, 1.0], len(q))
    expected = np.where(reached[:, None] > 0, WholeTurns(robot, reference).within(q), q)
    unwind(robot.chain, reference[None], reached, q)
    np.testing.assert_allclose(q, expected, rtol=0, atol=1e-13)


@pytest.mark.parametrize("name", ["maira", "pr2_arm", "ur5", "xarm7", "tiago"])
def test_the_kernel_turns_only_what_costs_a_posture_nothing(name, rng):
    """Joint by joint: at the turn nearest to the reference, or, where that is worse for the posture, as it was."""
    robot = arm(name)
    reference, posture, weights = rng.uniform(-9, 9, robot.n), rng.uniform(-2, 2, robot.n), rng.integers(0, 3, robot.n)
    q = np.array([robot.random_configuration(rng) for _ in range(60)])
    q[:, np.isinf(robot.lower)] *= 30.0
    asked, there = rng.choice([True, False], len(q)), q.copy()
    turned = asked.copy()
    unwind_free(robot.chain, reference[None], posture, weights.astype(float), turned, there)
    nearest = WholeTurns(robot, reference).within(q)
    dearer = weights * np.square(nearest - posture) > weights * np.square(q - posture) + 1e-6
    expected = np.where(asked[:, None] & ~dearer, nearest, q)
    np.testing.assert_allclose(there, expected, rtol=0, atol=1e-13)
    np.testing.assert_array_equal(turned, np.abs(expected - q).max(axis=1) > 1)
    assert turned.any() or name in ("maira", "tiago")


@pytest.mark.parametrize("redundancy", [mq.Strict, partial(mq.Weighted, weight=1e-6)])
@pytest.mark.parametrize("backend", ["compiled", "daqp"])
def test_a_posture_draws_joints_to_the_turn_nearest_to_it_unless_a_start_says_otherwise(backend, redundancy, ur5, rng):
    posture = ur5.random_configuration(rng)
    solver = mq.Solver(ur5, redundancy=redundancy(mq.Posture(posture)), backend=backend)
    turns, others = WholeTurns(ur5, posture), 0
    for _ in range(12):
        q = ur5.random_configuration(rng)
        found, stayed = solver.solve(ur5.forward(q)), solver.solve(ur5.forward(q), q0=q)
        assert found.position_error < 1e-4
        np.testing.assert_allclose(turns.within(found.q[None])[0], found.q, atol=1e-9)
        np.testing.assert_allclose(stayed.q, q, atol=0.1)
        others += np.abs(turns.within(q[None])[0] - q).max() > 6
    assert others > 3


def test_a_posture_beyond_all_angles_costs_no_pose(pr2_arm, rng):
    solver = mq.Solver(pr2_arm, redundancy=mq.Strict(mq.Posture(np.where(np.isinf(pr2_arm.upper), 1e12, 0.0))))
    for _ in range(3):
        s = solver.solve(pr2_arm.forward(pr2_arm.random_configuration(rng)))
        assert s.success
        assert np.abs(s.q).max() < 2 * FARTHEST


def test_no_turn_is_made_that_another_task_or_limit_feels(ur5, rng):
    """A coupling at the second level, and a linear limit, far from the posture."""
    joint = ur5.joint_names[5]
    posture = mq.Strict(mq.Posture(np.zeros(6)))
    coupling = mq.JointCouplingTask(coefficients={joint: 1.0}, value=5.0, priority=2)
    solver = mq.Solver(ur5, task=mq.PositionTask(), tasks=[coupling], redundancy=posture)
    limit = mq.LinearLimit(-np.eye(6)[5:], [-4.0])
    limited = mq.Solver(ur5, limits=[limit], redundancy=posture)
    for _ in range(5):
        q = ur5.random_configuration(rng)
        q[5] = 5.0
        s = solver.solve(ur5.forward(q))
        assert s.success
        assert s.q[5] == pytest.approx(5.0, abs=1e-6)
        s = limited.solve(ur5.forward(q))
        assert s.success
        assert s.q[5] >= 4.0
