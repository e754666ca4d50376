"""`keep_direction`: a motion that limits do not allow is scaled, not bent."""

import numpy as np
import pytest
from support.robots import load

import maira_qp as mq

POSTURE = mq.Strict(mq.Posture())


def robot_of(name: str) -> mq.Robot:
    return mq.Robot.maira() if name == "maira" else load(name)


def ask(robot: mq.Robot, rng: np.random.Generator) -> tuple[np.ndarray, dict, np.ndarray]:
    """A configuration, targets of the tips far away, and the displacements (6 K,) that lead straight to them."""
    q = robot.random_configuration(rng)
    goal = robot.clip(q + 0.5 * rng.normal(size=robot.n))
    targets = {tip: robot.forward(goal, tip) for tip in robot.tips}
    return q, targets, np.concatenate([mq.pose_error(robot.forward(q, tip), targets[tip]) for tip in robot.tips])


def angle(a: np.ndarray, b: np.ndarray) -> float:
    """Between two vectors [rad], exact where it is small."""
    u, v = a / np.linalg.norm(a), b / np.linalg.norm(b)
    return float(2 * np.arcsin(min(1.0, np.linalg.norm(u - v) / 2)))


@pytest.mark.parametrize("name", ["maira", "panda", "ur5", "tiago", "kr210", "baxter_arms"])
def test_the_motion_is_scaled_and_as_long_as_the_speeds_allow(name, rng):
    """To first order parallel to what was asked for, all tips by one factor, at least one joint at its speed.

    And a posture below leaves it so, but for what a level may lose.
    """
    robot = robot_of(name)
    solver, below, bent = mq.Solver(robot, redundancy=None), mq.Solver(robot, redundancy=POSTURE), 0.0
    for _ in range(15):
        q, targets, e = ask(robot, rng)
        J = np.vstack([robot.jacobian(q, tip) for tip in robot.tips])
        t = solver.step(q, targets, 0.01, keep_direction=True)
        moved = J @ (t.q - q)
        assert angle(moved, e) < 1e-6
        assert 0 < np.linalg.norm(moved) <= np.linalg.norm(e)
        room = np.minimum(
            robot.velocity_limit - np.abs(t.velocity), 1e3 * np.minimum(t.q - robot.lower, robot.upper - t.q)
        )
        assert room.min() < 1e-6
        bent = max(bent, angle(J @ (solver.step(q, targets, 0.01).q - q), e))
        with_posture = below.step(q, targets, 0.01, keep_direction=True).q
        for tip in robot.tips:
            off = mq.pose_error(robot.forward(t.q, tip), robot.forward(with_posture, tip))
            assert np.abs(off).max() <= 10 * below.options.level_position_tolerance
    assert bent > 0.3


def test_no_scale_is_larger(maira, rng):
    """Against a linear program in all joints and the scale: a vertex enumeration by bisection and feasibility."""
    from scipy.optimize import linprog

    solver, dt = mq.Solver(maira), 0.01
    for _ in range(10):
        q, targets, e = ask(maira, rng)
        J, reach = maira.jacobian(q), maira.velocity_limit * dt
        lower, upper = np.maximum(-reach, maira.lower - q), np.minimum(reach, maira.upper - q)
        best = linprog(
            [*np.zeros(7), -1.0],
            A_eq=np.column_stack([J, -e]),
            b_eq=np.zeros(6),
            bounds=[*zip(lower, upper, strict=True), (0, 1)],
        ).x[-1]
        t = solver.step(q, targets, dt, keep_direction=True)
        scale = np.linalg.norm(J @ (t.q - q)) / np.linalg.norm(e)
        assert scale == pytest.approx(best, rel=1e-4)


@pytest.mark.parametrize("acceleration", [None, 3.0])
@pytest.mark.parametrize("name", ["maira", "panda"])
def test_the_tool_goes_straight_to_its_target(name, acceleration, rng):
    """A translation of some decimetres, faster than the joints: the tool stays on the line, and arrives."""
    robot = robot_of(name)
    robot = robot if acceleration is None else robot.limited(acceleration=acceleration)
    solver = mq.Solver(robot, redundancy=POSTURE)
    q = np.array([0.3, 0.5, 0.2, -1.5, 0.3, 1.6, 0.4])
    start = robot.forward(q)
    target, v, off = start.copy(), np.zeros(7), 0.0
    target.translation = start.translation + np.array([-0.15, 0.25, -0.1])
    line = target.translation - start.translation
    for _ in range(400):
        t = solver.step(q, target, 0.005, velocity=v, keep_direction=True)
        q, v = t.q, t.velocity
        way = robot.forward(q).translation - start.translation
        off = max(off, float(np.linalg.norm(way - line * (way @ line) / (line @ line))))
        assert (np.abs(v) <= robot.velocity_limit).all()
    assert t.position_error < 1e-6
    assert off < (2e-3 if acceleration is None else 5e-3)


def test_a_joint_at_its_limit_stops_the_motion_rather_than_bend_it(ur5):
    """Six joints have no other way: the scale is zero; without the option the arm slides along the limit."""
    robot = ur5.limited(lower={ur5.joint_names[0]: -1.0}, upper={ur5.joint_names[0]: 0.5})
    q = np.array([0.5, -1.0, 1.2, 0.3, 1.0, 0.2])
    ahead = q.copy()
    ahead[0] += 0.3
    target, solver = ur5.forward(ahead), mq.Solver(robot)
    assert np.abs(solver.step(q, target, 0.01, keep_direction=True).velocity).max() < 1e-6
    assert np.abs(solver.step(q, target, 0.01).velocity).max() > 0.1


def test_levels_below_move_in_the_null_space(maira, rng):
    """The pose is scaled as without them, and the posture comes nearer."""
    q, targets, _ = ask(maira, rng)
    J, alone, posture = maira.jacobian(q), mq.Solver(maira), mq.Posture(np.full(7, 0.3))
    below = mq.Solver(maira, redundancy=mq.Strict(posture))
    a, b = (solver.step(q, targets, 0.01, keep_direction=True) for solver in (alone, below))
    np.testing.assert_allclose(J @ (a.q - q), J @ (b.q - q), rtol=0, atol=1e-9)
    assert (a.backend, b.backend) == ("daqp", "daqp")


def test_it_is_yes_or_no(maira):
    with pytest.raises(mq.errors.OptionError, match="keep_direction"):
        mq.Solver(maira).step(maira.middle, maira.forward(maira.middle), 0.01, keep_direction="yes")
