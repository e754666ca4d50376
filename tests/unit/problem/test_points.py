"""A point (3,) where a pose of which the origin counts is asked for: targets of positions, tools, bodies."""

import numpy as np
import pinocchio as pin
import pytest

import maira_qp as mq
from maira_qp.errors import PoseError

POINT = [0.4, 0.2, 0.9]


@pytest.fixture(scope="module")
def solver(maira) -> mq.Solver:
    return mq.Solver(maira, task=mq.PositionTask())


@pytest.mark.parametrize("point", [POINT, tuple(POINT), np.array(POINT), {"tool0": POINT}])
def test_a_point_is_solved_as_the_pose_there_is(solver, point):
    given, posed = solver.solve(point), solver.solve(mq.pose(POINT))
    assert given.success
    assert (given.q == posed.q).all()
    assert np.linalg.norm(solver.robot.forward(given.q).translation - POINT) <= 1e-6


def test_points_are_a_batch_of_poses(solver, rng):
    points = np.array([solver.robot.forward(solver.robot.random_configuration(rng)).translation for _ in range(5)])
    poses = [mq.pose(point) for point in points]
    for given in (points, points.tolist(), list(points), {"tool0": points}):
        assert (solver.solve_batch(given).q == solver.solve_batch(poses).q).all()
    assert solver.solve_batch([*points[:2], [np.nan, 0, 0]]).status_names.tolist()[2] == "INVALID_TARGET"


def test_ticks_solutions_and_own_targets_take_points(solver, maira):
    q = maira.middle + 0.3
    assert (solver.step(q, POINT, 0.01).q == solver.step(q, mq.pose(POINT), 0.01).q).all()
    own = mq.Solver(maira, task=mq.PositionTask(target=POINT))
    assert own.solve(q0=q).q == pytest.approx(solver.solve(POINT, q0=q).q, abs=1e-5)  # by the other engine
    moved = solver.solve(np.add(POINT, [1, 2, 3]), q0=q, base=mq.pose([1, 2, 3]))
    assert moved.q == pytest.approx(solver.solve(POINT, q0=q).q, abs=1e-9)


def test_a_tracker_still_watches_for_jumps_of_a_position(solver, maira):
    tracker = mq.Tracker(solver, maira.middle + 0.3)
    here = maira.forward(maira.middle + 0.3).translation
    for turned in (here, mq.pose(here, rpy=[3, 0, 0]), here):
        assert tracker.update(turned, 0.01).state == mq.TrackerState.FOLLOWING
    command = tracker.update(np.add(here, [0.5, 0, 0]), 0.01)
    assert command.state == mq.TrackerState.HOLDING
    assert "500.0 mm" in command.reason


def test_bodies_and_tools_stand_at_points(maira, rng):
    q, point = maira.random_configuration(rng), rng.uniform(-0.2, 0.2, 3)
    assert np.array_equal(mq.Sphere(0.1, point).pose.homogeneous, mq.pose(point).homogeneous)
    tool = pin.SE3(np.eye(3), point)
    assert maira.with_tool(point).forward(q).isApprox(maira.forward(q) * tool)
    target, solver = maira.with_tool(point).forward(q), mq.Solver(maira)
    assert (solver.solve(target, q0=q, tool=point).q == solver.solve(target, q0=q, tool=tool).q).all()
    limit = mq.CollisionLimit(obstacles={"ball": mq.Sphere(0.05)}, self_collision=False).of(maira)
    at, points = maira.at(q), rng.uniform(-1, 1, (5, 3))
    for each in points:
        here, there = (limit.with_obstacles({"ball": where}).distance(at) for where in (each, mq.pose(each)))
        assert here == there


@pytest.mark.parametrize("value", [[1.0, 2.0], [1, 2, 3, 4], "abc", [np.nan, 0, 0], [[1, 2, 3]], object(), []])
def test_what_is_neither_point_nor_pose_is_refused(solver, maira, value):
    for call in (
        lambda: solver.solve(value),
        lambda: mq.PositionTask(target=value),
        lambda: mq.Sphere(0.1, value),
        lambda: maira.with_tool(value),
    ):
        with pytest.raises(PoseError):
            call()


def test_a_point_is_no_pose_where_an_orientation_counts(maira):
    with pytest.raises(PoseError, match="must be a pose"):
        mq.Solver(maira).solve(POINT)
