"""Compiled kinematics of trees against Pinocchio; the bounds of a tick against the limits."""

from functools import cache

import numpy as np
import pytest
from support.compiled_problems import arm, configurations, few, row_of
from support.robots import TREES

import maira_qp as mq
from maira_qp.kernels.control.displacement_bounds import (
    bounds_of_position,
    bounds_of_tick,
    keep_along,
    rest_of,
    share_to_stop,
)
from maira_qp.kernels.kinematics.kinematic_tree import forward, path_jacobian, path_to, place
from maira_qp.kernels.layout import Joint
from maira_qp.problem.limits.joint import (
    AccelerationLimit,
    PositionLimit,
    Tick,
    VelocityLimit,
    merge,
    stopping_displacement,
)
from maira_qp.robots.model.arrays import KinematicTree

CHAINS = ["maira", "panda", "tiago", "pr2_arm", "irb140"]


@cache
def tree_of(name: str) -> KinematicTree:
    return arm(name).tree


@pytest.mark.parametrize("name", [name for name in (*TREES, *CHAINS) if not arm(name).kinematics.has_mimic])
def test_kinematics_of_every_frame_are_pinocchios(name, rng):
    """Poses and Jacobians of all links, the base too, whose Jacobian is zero."""
    robot, tree = arm(name), tree_of(name)
    n, within = robot.n, 5e-15 * max(1, robot.length) * robot.n
    poses, pose, path = np.full((n, 12), np.nan), np.full(12, np.nan), np.full(n, -(2**62))
    for q in configurations(robot, rng, few(10)):
        forward(tree.joints, tree.parents, q, poses)
        for frame in robot.frames:
            joint, placement = tree.frame(frame)
            place(poses, joint, placement, pose)
            count = path_to(tree.parents, joint, path)
            J, whole = np.full((count, 6), np.nan), np.zeros((n, 6))
            path_jacobian(tree.joints, poses, path, pose, J)
            whole[path[:count]] = J
            assert np.abs(pose - row_of(robot.forward(q, frame))).max() < within
            assert np.abs(whole.T - robot.jacobian(q, frame)).max() < within
            assert (np.diff(path[:count]) > 0).all()


@pytest.mark.parametrize("name", ["tiago_arms", "pr2_arms", "tiago"])
def test_a_tree_holds_the_limits(name):
    robot = arm(name).limited(acceleration=3.0)
    joints = robot.tree.joints
    np.testing.assert_array_equal(joints[:, [Joint.LOWER, Joint.UPPER]].T, [robot.lower, robot.upper])
    np.testing.assert_array_equal(joints[:, Joint.VELOCITY], robot.velocity_limit)
    np.testing.assert_array_equal(joints[:, Joint.ACCELERATION], robot.acceleration_limit)
    assert set(joints[:, Joint.PRISMATIC]) == {0.0, 1.0}.intersection(joints[:, Joint.PRISMATIC])


@pytest.mark.parametrize("acceleration", [None, 2.0, {"torso_lift_joint": 0.5}])
def test_bounds_are_those_of_the_limits(acceleration, rng):
    """Inside, at and outside the limits, at any speed, to the last digits."""
    robot = arm("tiago_arms")
    robot = robot if acceleration is None else robot.limited(acceleration=acceleration)
    tree, n = robot.tree.joints, robot.n
    limits = (
        AccelerationLimit(robot.acceleration_limit),
        PositionLimit(robot.lower, robot.upper, robot.acceleration_limit),
        VelocityLimit(robot.velocity_limit),
    )
    lower, upper, rest = np.full((3, n), np.nan)
    for case in range(few(300)):
        q = robot.random_configuration(rng)
        away = 10 ** rng.uniform(-9, 0, n) * rng.choice([-1, 0, 1], n)
        q = np.where(rng.random(n) < 0.6, q, rng.choice([robot.lower, robot.upper]) + away)
        v, dt = rng.normal(size=n) * rng.choice([0, 0.1, 10]), (1e-9, 1e-3, 0.01, 0.3)[case % 4]
        bounds_of_tick(tree, q, v, dt, lower, upper)
        now = expected = merge(limits, robot.at(q), Tick(dt, v))
        np.testing.assert_allclose(lower, expected.lower, rtol=1e-14, atol=0)
        np.testing.assert_allclose(upper, expected.upper, rtol=1e-14, atol=0)
        assert rest_of(lower, upper, rest) == (not expected.rest.any())
        np.testing.assert_allclose(rest, expected.rest, rtol=1e-14, atol=0)
        way = 10 ** rng.uniform(-6, 1, n) * rng.choice([-1, 0, 1], n)
        change = robot.acceleration_limit * dt**2
        keep_along(tree, way, dt, lower, upper)
        expected = now.along(way, change)
        np.testing.assert_allclose(lower, expected.lower, rtol=1e-13, atol=0)
        np.testing.assert_allclose(upper, expected.upper, rtol=1e-13, atol=0)
        share = np.min(stopping_displacement(way, change)[way != 0] / way[way != 0], initial=1.0)
        assert share_to_stop(tree, way, dt) == pytest.approx(share, rel=1e-14)
        bounds_of_position(tree, q, lower, upper)
        expected = merge(limits, robot.at(q))
        np.testing.assert_array_equal([lower, upper], [expected.lower, expected.upper])


def test_a_robot_is_read_as_the_chain_that_it_is():
    """The first placement on the base, each joint the parent of the next."""
    robot = mq.Robot.maira()
    assert robot.tree.parents.tolist() == list(range(-1, robot.n - 1))
