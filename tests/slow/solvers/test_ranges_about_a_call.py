"""Limits about what a call gives: its target, a pose or a point by name; hard and soft, in solves and ticks."""

import pickle

import numpy as np
import pytest
from support.placement_limits import tilt_and_yaw

import maira_qp as mq
from maira_qp.errors import FrameError, OptionError, PoseError

NEAR = mq.PoseRange(position=0.02, orientation=[0.1, 0.1, 0.5])
FEW = mq.Options(max_restarts=10)


def outside(robot: mq.Robot, q: np.ndarray, T, offset: float = 0.0) -> float:
    """By how much q (n,) breaks `NEAR` about T [m or rad]."""
    now = robot.forward(q)
    d, Q = T.rotation.T @ (now.translation - T.translation), T.rotation.T @ now.rotation
    tilt, yaw = tilt_and_yaw(Q)
    return float(np.max([*(np.abs(d) - 0.02), *(np.abs(tilt) - 0.1), abs(yaw) - 0.5])) - offset


def targets_of(robot: mq.Robot, rng: np.random.Generator, count: int) -> list:
    return [robot.forward(robot.middle + 0.6 * (robot.random_configuration(rng) - robot.middle)) for _ in range(count)]


def test_a_range_about_the_target_of_the_call_in_the_posture_that_is_preferred(maira, rng):
    """One by one, and in a batch; the posture is better than that of the pose itself."""
    wish = mq.Strict(mq.Posture())
    solver, exact = mq.Solver(maira, task=mq.LimitTask(limit=NEAR), redundancy=wish), mq.Solver(maira, redundancy=wish)
    targets = targets_of(maira, rng, 3)
    batch = solver.solve_batch(targets)
    for i, T in enumerate(targets):
        s = solver.solve(T)
        assert s.status is mq.Status.CONVERGED
        assert outside(maira, s.q, T) <= 0
        pose = exact.solve(T, q0=s.q)
        assert s.cost <= pose.cost + 1e-9 or not pose.success
        assert np.array_equal(batch.q[i], s.q)
    assert outside(maira, s.q, targets[0]) > 0


def test_a_hard_range_about_the_target_of_the_call(maira, rng):
    """A posture as far as the range allows; each answer knows the target that its limits were about."""
    posture = mq.LimitTask(limit=mq.LinearLimit(-np.eye(7)[[1]], [-1.5]))
    solver = mq.Solver(maira, task=posture, limits=[NEAR], options=FEW)
    targets = targets_of(maira, rng, 3)
    batch = solver.solve_batch(np.array([T.homogeneous for T in targets]))
    for i, T in enumerate(targets):
        s = solver.solve(T)
        if s.status is mq.Status.LIMITS_BROKEN:  # out of reach
            assert s.broken_limits
            assert batch.broken_limits[i] == s.broken_limits
            continue
        assert outside(maira, s.q, T) <= 0
        assert s.broken_limits == {}
        assert np.array_equal(batch.q[i], s.q)
        assert batch[i].active_limits == s.active_limits
        assert pickle.loads(pickle.dumps(s)).broken_limits == {}
    assert all(each.status is not None for each in batch)


def test_ticks_follow_a_target_within_a_range(maira, rng):
    """The position exactly, the orientation within the range, which moves with the target."""
    tilted = mq.PoseRange(orientation=[0.2, 0.2, np.pi / 6])
    solver = mq.Solver(maira, task=mq.PositionTask(), limits=[tilted])
    q = np.array([0.2, 0.4, 0.0, 1.0, 0.1, 0.6, 0.0])
    start = maira.forward(q)
    for k in range(40):
        T = start * mq.pose([0.004 * k, 0, 0], rpy=[0, 0, 0.01 * k])
        t = solver.step(q, T, 0.05)
        q = t.q
        tilt, yaw = tilt_and_yaw(T.rotation.T @ maira.forward(q).rotation)
        assert max(*(np.abs(tilt) - 0.2), abs(yaw) - np.pi / 6) <= 1e-9
        assert np.linalg.norm(maira.forward(q).translation - T.translation) < 5e-3


def test_each_limit_takes_a_value_by_its_name(maira):
    """A box, a plane, a cone, a ball, a range and speeds, in place of those that they were built with."""
    q = np.array([0.2, 0.4, 0.0, 1.0, 0.1, 0.6, 0.0])
    T = maira.forward(q)
    p, away = T.translation, maira.forward(q + 0.3)
    limits = [
        mq.BoxLimit(name="box", lower=[-0.05] * 3, upper=[0.05] * 3, pose=mq.pose([9, 9, 9])),
        mq.HalfSpaceLimit(name="floor", point=9.0),
        mq.ConeLimit(name="cup", direction=-T.rotation[:, 2], angle=0.2),
        mq.DistanceLimit(name="ball", point=[9, 9, 9], upper=0.1),
        mq.PoseRange(name="range", target=mq.pose([9, 9, 9]), position=0.05),
    ]
    values = {"box": T, "floor": p[2] - 0.01, "cup": T.rotation[:, 2], "ball": p, "range": T}
    for limit in limits:
        value = values[limit.name]
        solver = mq.Solver(maira, limits=[limit], options=FEW)
        s = solver.solve({"tool0": away, limit.name: value}, q0=q)
        assert s.broken_limits == {}
        assert limit.of(maira).with_value(value).violation(maira.at(s.q)) == 0
        assert limit.of(maira).violation(maira.at(s.q)) > 0.1
        t = solver.step(q, {"tool0": away, limit.name: value}, 0.02)
        assert limit.of(maira).with_value(value).violation(maira.at(t.q)) == 0
    slow = mq.Solver(maira, limits=[mq.ToolSpeedLimit(name="speed")])
    t = slow.step(q, {"tool0": away, "speed": (0.1, 0.2)}, 0.02)
    v, w = (maira.jacobian(q) @ t.velocity).reshape(2, 3)
    assert np.linalg.norm(v) <= 0.1 + 1e-12
    assert np.linalg.norm(w) <= 0.2 + 1e-12


def test_a_limit_of_another_frame_needs_its_target_by_name(maira):
    """Beside that of the tip."""
    q = np.array([0.2, 0.4, 0.0, 1.0, 0.1, 0.6, 0.0])
    elbow = mq.PoseRange(frame="link4", position=0.05, name="elbow")
    solver = mq.Solver(maira, limits=[elbow], options=FEW)
    with pytest.raises(PoseError, match="elbow"):
        solver.solve(maira.forward(q))
    aim = {"tool0": maira.forward(q), "elbow": maira.forward(q, "link4")}
    s = solver.solve(aim, q0=q + 0.05)
    assert s.success
    gone = maira.forward(s.q, "link4").translation - aim["elbow"].translation
    assert np.abs(aim["elbow"].rotation.T @ gone).max() <= 0.05
    t = solver.step(q, aim, 0.02)
    assert t.position_error < 1e-6
    with pytest.raises(FrameError, match="there are"):
        solver.solve({**aim, "knee": np.eye(4)})


def test_a_path_takes_limits_with_targets_of_their_own_alone(maira):
    path = [maira.forward(maira.middle + 0.2 + 0.01 * k) for k in range(3)]
    with pytest.raises(OptionError, match="PoseRange"):
        mq.Solver(maira, limits=[NEAR]).track(path)
    around = mq.PoseRange(target=path[0], position=0.5)
    assert mq.Solver(maira, limits=[around]).track(path).success.all()


def test_the_list_of_solutions_keeps_a_limit_about_the_target_of_the_call(maira):
    """The elbow near where it is when the arm stands as it does."""
    q = np.array([0.2, 0.4, 0.0, 1.0, 0.1, 0.6, 0.0])
    T = maira.forward(q)
    away = np.linalg.norm(maira.forward(q, "link4").translation - T.translation)
    near = mq.DistanceLimit(frame="link4", upper=away + 0.02, name="tool0 to elbow")
    solver = mq.Solver(maira, limits=[mq.DistanceLimit(frame="link4", point=T, upper=away + 0.02)])
    expected = [one.q for one in solver.solutions(T)]
    found = [one.q for one in mq.Solver(maira, limits=[near]).solutions({"tool0": T, "tool0 to elbow": T})]
    assert len(found) == len(expected) > 0
    np.testing.assert_allclose(found, expected, atol=1e-6)
