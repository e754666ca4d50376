"""A limit on the tool's speed, by forward kinematics and Jacobians of what each tick returns."""

import numpy as np
import pytest
from support.robots import load

import maira_qp as mq

OFFSET = np.array([0.0, 0.05, 0.1])


def speeds(robot: mq.Robot, frame: str, t: mq.Step, q: np.ndarray, dt: float) -> tuple[float, float]:
    """The largest speed [m/s] of the point at `OFFSET` and [rad/s] of the frame: at both ends and on the average."""
    T, ahead = robot.forward(q, frame), robot.forward(t.q, frame)
    linear = [np.linalg.norm(ahead.act(OFFSET) - T.act(OFFSET)) / dt]
    angular = [np.linalg.norm(mq.pose_error(T, ahead)[3:]) / dt]
    for at, pose in ((q, T), (t.q, ahead)):
        v, w = (robot.jacobian(at, frame) @ t.velocity).reshape(2, 3)
        linear.append(np.linalg.norm(v + np.cross(w, pose.rotation @ OFFSET)))
        angular.append(np.linalg.norm(w))
    return max(linear), max(angular)


@pytest.mark.parametrize("keep_direction", [False, True])
@pytest.mark.parametrize(
    ("name", "acceleration"), [("maira", None), ("maira", 10.0), ("panda", 5.0), ("baxter_arms", None)]
)
def test_no_tick_is_faster_than_the_tool_may_be(name, acceleration, keep_direction, rng):
    """And both speeds are used: the limit is reached."""
    robot = mq.Robot.maira() if name == "maira" else load(name)
    robot = robot if acceleration is None else robot.limited(acceleration=acceleration)
    tip, reached = robot.tips[0], 0
    limit = mq.ToolSpeedLimit(frame=tip, offset=OFFSET, linear=0.25, angular=0.5)
    solver = mq.Solver(robot, limits=[limit], redundancy=mq.Strict(mq.Posture()))
    for dt in (0.02, 0.05):
        q, v = robot.middle + 0.7 * (robot.random_configuration(rng) - robot.middle), np.zeros(robot.n)
        target = {each: robot.forward(robot.clip(q + 0.5 * rng.normal(size=robot.n)), each) for each in robot.tips}
        for _ in range(25):
            t = solver.step(q, target, dt, velocity=v, keep_direction=keep_direction)
            linear, angular = speeds(robot, tip, t, q, dt)
            assert linear <= 0.25 * (1 + 1e-9)
            assert angular <= 0.5 * (1 + 1e-9)
            reached += linear > 0.249 or angular > 0.499
            q, v = t.q, t.velocity
    assert reached > 15


def test_the_direction_is_kept_where_that_is_asked_for(maira, rng):
    """The twist of the tool is along the task's weighted error, however slow it has to be."""
    solver = mq.Solver(maira, limits=[mq.ToolSpeedLimit(linear=0.1, angular=0.2)])
    W = np.repeat([4 / maira.length, 1.0], 3)
    for _ in range(5):
        q = maira.middle + 0.5 * (maira.random_configuration(rng) - maira.middle)
        target = maira.forward(maira.clip(q + 0.3 * rng.normal(size=7)))
        t = solver.step(q, target, 0.02, keep_direction=True)
        e, twist = W * mq.pose_error(maira.forward(q), target), W * (maira.jacobian(q) @ t.velocity)
        assert np.linalg.norm(twist) > 0.05
        assert np.linalg.norm(twist - e * (e @ twist) / (e @ e)) < 1e-9


def test_a_position_is_approached_along_the_line_at_the_limit(maira, rng):
    """Without being asked for: of all motions that are slow enough the nearest to what a position task asks for."""
    solver = mq.Solver(maira, task=mq.PositionTask(), limits=[mq.ToolSpeedLimit(linear=0.1)])
    for _ in range(5):
        q = maira.middle + 0.5 * (maira.random_configuration(rng) - maira.middle)
        start = maira.forward(q).translation
        way = np.array([0.1, -0.05, 0.04])
        for _ in range(10):
            t = solver.step(q, mq.pose(start + way), 0.02)
            q = t.q
        moved = maira.forward(q).translation - start
        assert np.linalg.norm(moved) == pytest.approx(0.02, rel=0.02)
        assert np.linalg.norm(np.cross(moved, way / np.linalg.norm(way))) < 1e-4


def test_the_arm_arrives_and_the_compiled_engine_runs_where_the_limit_does_not_bind(maira):
    q, solver = maira.middle + 0.3, mq.Solver(maira, limits=[mq.ToolSpeedLimit(linear=0.5)])
    target, backends = maira.forward(q + 0.2), set()
    for _ in range(200):
        t = solver.step(q, target, 0.02)
        q = t.q
        backends.add(t.backend)
        if t.status is mq.StepStatus.ARRIVED:
            break
    assert t.status is mq.StepStatus.ARRIVED
    assert backends == {"compiled", "daqp"}
    assert solver.solve(target, q0=q).success


def test_what_a_joint_must_do_goes_before(maira):
    """At full speed with little acceleration: braking is all that is left, and it is faster than the tool may be."""
    robot = maira.limited(acceleration=1.0)
    solver = mq.Solver(robot, limits=[mq.ToolSpeedLimit(linear=0.01)])
    v = np.array([1.0, 0, 0, 0, 0, 0, 0])
    q = np.array([0.0, 1.0, 0, 0.5, 0, 0, 0])
    t = solver.step(q, robot.forward(q), 0.01, velocity=v)
    assert t.velocity[0] == pytest.approx(0.99)
