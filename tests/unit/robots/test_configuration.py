"""Configuration: never a stale value, and the second derivative against finite differences."""

import gc
import weakref

import numpy as np
import pytest
from support.made_robots import random_table
from support.robots import load

import maira_qp as mq
from maira_qp.errors import FrameError
from maira_qp.orientation import orientation_error


def test_values_belong_to_their_own_configuration_in_any_order(maira, rng):
    """Many configurations read the same working memory by turns; each still says what a fresh one would."""
    configurations = [maira.at(maira.random_configuration(rng)) for _ in range(5)]
    reads = [(at, frame, kind) for at in configurations for frame in maira.frames for kind in ("placement", "jacobian")]
    for i in rng.permutation(2 * len(reads)):
        at, frame, kind = reads[i % len(reads)]
        fresh = mq.Robot.forward(maira, at.q, frame) if kind == "placement" else maira.jacobian(at.q, frame)
        value = getattr(at, kind)(frame)
        if kind == "placement":
            value, fresh = value.homogeneous, fresh.homogeneous
        assert (value == fresh).all()
        if frame == "tool0" and kind == "placement":
            assert np.abs(value - maira.dh.forward(at.q)).max() < 1e-12


def test_the_tip_is_the_frame_unless_another_is_named(maira, rng):
    at = maira.at(maira.random_configuration(rng))
    assert (at.placement().homogeneous == at.placement("tool0").homogeneous).all()
    assert at.jacobian() is at.jacobian("tool0")
    assert not np.allclose(at.jacobian(), at.jacobian("link3"))


def test_nothing_can_be_changed_from_outside(maira):
    """q is a copy and read-only, so is the Jacobian; a placement is a copy."""
    q = np.full(7, 0.2)
    at = maira.at(q)
    q[:] = 9.0
    expected = maira.dh.forward(np.full(7, 0.2))
    T = at.placement()
    T.translation *= 0.0
    assert np.abs(at.placement().homogeneous - expected).max() < 1e-12
    for array in (at.q, at.jacobian()):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1.0


def test_unknown_frames_are_refused(maira):
    at = maira.at(np.zeros(7))
    for ask in (at.placement, at.jacobian, lambda frame: at.kinematic_hessian_product(frame, np.ones(6))):
        with pytest.raises(FrameError, match="tool0"):
            ask("tool")


def test_a_failed_computation_leaves_no_trace(maira, rng):
    """A wrong length raises in Pinocchio; the configurations around it stay right."""
    q = maira.random_configuration(rng)
    at = maira.at(q)
    at.placement("link2")
    with pytest.raises(ValueError, match="size"):
        maira.at(np.zeros(5)).placement()
    assert np.abs(at.placement().homogeneous - maira.dh.forward(q)).max() < 1e-12


def test_a_robot_is_freed_when_it_is_no_longer_used():
    """The working memory, which can be large, keeps neither robot nor configuration alive."""
    robot = mq.Robot.from_dh([{"a": 1.0}])
    robot.at(np.zeros(1)).placement()
    gone = weakref.ref(robot)
    gc.disable()
    try:
        del robot
        assert gone() is None
    finally:
        gc.enable()


def second_differences(robot, q, frame, weights, h=1e-3):
    """sum_k weights[k] d2 pose_k, by fourth-order differences of `forward` alone, about R(q)."""
    R = robot.forward(q, frame).rotation

    def f(dq):
        T = robot.forward(q + dq, frame)
        return weights[:3] @ T.translation + weights[3:] @ orientation_error(R, T.rotation)

    def second(a):
        return (16 * (f(h * a) + f(-h * a)) - f(2 * h * a) - f(-2 * h * a) - 30 * f(0 * a)) / (12 * h * h)

    eye = np.eye(robot.n)
    return np.array([[(second(a + b) - second(a - b)) / 4 for a in eye] for b in eye])


@pytest.mark.parametrize("name", ["maira", "panda", "pr2_arm", "tiago", "panda_finger", "talos_finger", "irb140"])
def test_kinematic_hessian_equals_second_differences(name, rng):
    """Revolute, continuous, prismatic and mimic joints, the tip and a frame in the middle."""
    robot = mq.Robot.maira() if name == "maira" else load(name)
    for frame in (None, robot.frames[len(robot.frames) // 2]):
        q, weights = robot.random_configuration(rng), rng.normal(size=6)
        C = robot.at(q).kinematic_hessian_product(frame, weights)
        assert C.shape == (robot.n, robot.n)
        assert (C == C.T).all()
        assert np.abs(C - second_differences(robot, q, frame, weights)).max() < 1e-7


def test_kinematic_hessian_of_random_tables(rng):
    for _ in range(10):
        robot = mq.Robot.from_dh(random_table(rng, int(rng.integers(1, 8))))
        q, weights = robot.random_configuration(rng), rng.normal(size=6)
        C = robot.at(q).kinematic_hessian_product(None, weights)
        assert np.abs(C - second_differences(robot, q, None, weights)).max() < 1e-7


@pytest.mark.parametrize("name", ["maira", "pr2_arm", "tiago", "panda_finger", "talos_finger"])
def test_jacobian_derivative_equals_differences_of_the_jacobian(name, rng):
    robot = mq.Robot.maira() if name == "maira" else load(name)
    for frame in (None, robot.frames[len(robot.frames) // 2]):
        q = robot.random_configuration(rng)
        derivative = robot.at(q).jacobian_derivative(frame)
        assert derivative.shape == (robot.n, 6, robot.n)
        for i, dq in enumerate(1e-6 * np.eye(robot.n)):
            difference = (robot.jacobian(q + dq, frame) - robot.jacobian(q - dq, frame)) / 2e-6
            assert np.abs(derivative[i] - difference).max() < 1e-8


def test_jacobian_derivative_of_random_tables(rng):
    for _ in range(10):
        robot = mq.Robot.from_dh(random_table(rng, int(rng.integers(1, 8))))
        q = robot.random_configuration(rng)
        derivative = robot.at(q).jacobian_derivative()
        for i, dq in enumerate(1e-6 * np.eye(robot.n)):
            difference = (robot.dh.jacobian(q + dq) - robot.dh.jacobian(q - dq)) / 2e-6
            assert np.abs(derivative[i] - difference).max() < 1e-8
