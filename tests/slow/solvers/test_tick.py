"""One control tick: velocity and position limits to the bit, the hierarchy in every tick, convergence over many."""

import pickle

import numpy as np
import pytest
from support.robots import load

import maira_qp as mq

REDUNDANCIES = [None, mq.Strict(mq.Posture()), mq.Weighted(mq.Posture(), 1e-3), mq.Strict(mq.Manipulability())]


@pytest.mark.parametrize("redundancy", REDUNDANCIES, ids=["none", "strict", "weighted", "manipulability"])
@pytest.mark.parametrize("arm", ["iiwa14", "panda", "tiago"])
def test_velocity_and_position_limits_hold_in_every_tick(arm, redundancy, rng):
    robot = mq.Robot.iiwa14() if arm == "iiwa14" else load(arm)
    solver, dt = mq.Solver(robot, redundancy=redundancy), 0.01
    q = robot.random_configuration(rng)
    for k in range(150):
        if k % 50 == 0:
            target = robot.forward(robot.random_configuration(rng))
            if k == 100:
                target.translation *= 3  # out of reach
        t = solver.step(q, target, dt)
        assert (np.abs(t.velocity) <= robot.velocity_limit).all()
        assert (t.q >= robot.lower).all()
        assert (t.q <= robot.upper).all()
        assert np.abs(t.q - (q + dt * t.velocity)).max() <= 1e-12
        q = t.q


@pytest.mark.parametrize("redundancy", REDUNDANCIES[:2], ids=["none", "strict"])
def test_ticks_converge_to_a_near_target_and_stay(iiwa14, redundancy, rng):
    solver = mq.Solver(iiwa14, redundancy=redundancy)
    q = 0.5 * iiwa14.random_configuration(rng)
    target = iiwa14.forward(q + 0.1 * rng.normal(size=7))
    for _ in range(200):
        t = solver.step(q, target, 0.01)
        q = t.q
    assert t.position_error < 1e-9
    assert t.orientation_error < 1e-9
    assert np.abs(solver.step(q, target, 0.01).velocity).max() < 1e-6


def test_strict_does_not_slow_the_pose_down(iiwa14, rng):
    """The pose after a tick is that of the pose task alone: what the posture's motion bends is given back."""
    alone, strict = mq.Solver(iiwa14), mq.Solver(iiwa14, redundancy=mq.Strict(mq.Posture()))
    for _ in range(50):
        q = iiwa14.random_configuration(rng)
        target = iiwa14.forward(iiwa14.clip(q + 0.01 * rng.normal(size=7)))
        a, b = alone.step(q, target, 0.005), strict.step(q, target, 0.005)
        off = mq.pose_error(iiwa14.forward(a.q), iiwa14.forward(b.q))
        assert np.abs(off).max() <= 3 * strict.options.level_position_tolerance


@pytest.mark.parametrize("backend", [None, "daqp"])
def test_the_posture_moves_at_full_speed_and_the_tool_stays(backend, rng):
    """Were nothing given back, a tenth of it would bend the pose by the tolerance, in ticks of 10 ms."""
    robot = mq.Robot.iiwa14()
    solver, fast = mq.Solver(robot, redundancy=mq.Strict(mq.Posture()), backend=backend), 0
    for _ in range(20):
        q = robot.random_configuration(rng)
        target = robot.forward(q)
        t = solver.step(q, target, 0.01)
        fast += (np.abs(t.velocity) > 0.7 * robot.velocity_limit).any()
        assert t.position_error <= solver.options.level_position_tolerance
        assert t.orientation_error <= solver.options.level_orientation_tolerance
    assert fast >= 10


def test_a_joint_outside_its_limits_comes_back_at_its_limit_speed(iiwa14):
    q = np.zeros(7)
    q[1] = iiwa14.upper[1] + 0.1
    q[3] = iiwa14.lower[3] - 1e-9
    solver, target = mq.Solver(iiwa14), iiwa14.forward(np.full(7, 0.3))
    t = solver.step(q, target, 0.01)
    assert t.velocity[1] == -iiwa14.velocity_limit[1]
    assert t.q[3] >= iiwa14.lower[3]
    for _ in range(20):
        q = solver.step(q, target, 0.01).q
    assert (q >= iiwa14.lower).all()
    assert (q <= iiwa14.upper).all()


def test_a_tick_of_any_length_is_finite(maira, rng):
    solver = mq.Solver(maira, redundancy=mq.Strict(mq.Posture()))
    for dt in (1e-9, 1e-3, 1.0, 1e3):
        t = solver.step(maira.random_configuration(rng), maira.forward(maira.random_configuration(rng)), dt)
        assert np.isfinite(t.velocity).all()
        assert (np.abs(t.velocity) <= maira.velocity_limit).all()


@pytest.mark.parametrize("redundancy", REDUNDANCIES, ids=["none", "strict", "weighted", "manipulability"])
@pytest.mark.parametrize("arm", ["maira", "ur5"])
def test_the_arm_comes_to_rest_whether_the_target_can_be_reached_or_not(arm, redundancy, rng):
    """Within reach, a little and far out of it, half a turn away: after 20 s, without kernels 10, the joints stand."""
    robot = mq.Robot.maira() if arm == "maira" else load(arm)
    solver = mq.Solver(robot, redundancy=redundancy)
    ticks = 200 if solver.engines.compiled_tick is None else 400
    start = robot.clip(robot.middle + 0.3)
    near = robot.forward(robot.clip(start + 0.2 * rng.normal(size=robot.n)))
    far, beyond, turned = near.copy(), near.copy(), near.copy()
    far.translation *= 1.2 * robot.length / np.linalg.norm(far.translation)
    beyond.translation *= 4 * robot.length / np.linalg.norm(beyond.translation)
    turned.rotation = turned.rotation @ np.diag([1.0, -1.0, -1.0])
    for target in (near, far, beyond, turned):
        q = start
        for _ in range(ticks):
            t = solver.step(q, target, 0.05)
            q = t.q
        assert np.abs(t.velocity).max() < 1e-3


@pytest.mark.parametrize(
    "redundancy", [*REDUNDANCIES[:3], mq.Strict(mq.LimitDistance())], ids=lambda r: type(r).__name__
)
@pytest.mark.parametrize("arm", ["maira", "panda", "ur5", "pr2_arm", "tiago"])
def test_the_compiled_tick_is_that_of_the_general_engine(arm, redundancy, rng):
    """Near and far targets, out of reach, from inside, from a limit and from beyond it; ticks short and long."""
    robot = mq.Robot.maira() if arm == "maira" else load(arm)
    compiled, general = (mq.Solver(robot, redundancy=redundancy, backend=b) for b in ("compiled", "daqp"))
    differ, lower, upper = 0, np.maximum(robot.lower, -7), np.minimum(robot.upper, 7)
    for k in range(60):
        q = robot.random_configuration(rng)
        if k % 4 == 1:
            q = np.where(rng.random(robot.n) < 0.5, upper, lower)
        if k % 4 == 2:
            q = q + 0.3 * rng.normal(size=robot.n)
        target = robot.forward(robot.clip(q + rng.normal(size=robot.n) * (0.001, 0.1, 1.0)[k % 3]))
        if k % 5 == 0:
            target.translation *= 1.5
        dt = (0.001, 0.01, 0.1, 1.0)[k % 4]
        a, b = compiled.step(q, target, dt), general.step(q, target, dt)
        same = max(np.abs(a.q - b.q).max(), np.abs(a.velocity - b.velocity).max() * dt) <= 1e-7
        same = same and a.position_error == pytest.approx(b.position_error, abs=1e-7)
        differ += not same
    assert differ <= 1  # where two eigenvalues of the Hessian are the same size up to sign, or a share is on the edge


def test_a_step_pickles_without_its_robot(maira):
    t = mq.Solver(maira).step(maira.upper, maira.forward(maira.upper), 0.01)
    copy = pickle.loads(pickle.dumps(t))
    assert copy.active_limits == t.active_limits
    assert len(copy.active_limits) == 7


@pytest.mark.parametrize("backend", [None, "daqp"])
def test_full_speed_is_the_limit_and_not_a_digit_more(maira, backend, rng):
    """With lengths of a tick by which a speed cannot be multiplied and divided without rounding up."""
    speed = 1.3
    lengths = [dt for dt in rng.uniform(0.001, 0.01, 500) if speed * dt / dt > speed][:5]
    assert len(lengths) == 5
    robot = maira.limited(velocity=speed)
    solver, q = mq.Solver(robot, backend=backend), robot.middle + 0.4
    target = robot.forward(robot.middle - 0.8)
    for dt in lengths:
        t = solver.step(q, target, dt)
        assert speed * (1 - 1e-12) < np.abs(t.velocity).max() <= speed
