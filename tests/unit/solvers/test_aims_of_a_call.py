"""Points to look at and directions to point along, given by a call: as a solver that has them itself."""

import dataclasses

import numpy as np
import pinocchio as pin
import pytest

import maira_qp as mq
from maira_qp.errors import OptionError, PoseError

DT = 0.01
POINT, UP = np.array([1.0, 0.2, 0.4]), np.array([0.1, 0.3, 0.9])


def aiming(robot, point=None, direction=None):
    return mq.Solver(
        robot,
        tasks=[
            mq.LookAtTask(frame="link6", point=point, priority=2, name="gaze"),
            mq.AxisTask(frame="link4", axis=[1, 1, 0], direction=direction, priority=3, name="up"),
        ],
        redundancy=mq.Strict(mq.Posture()),
    )


@pytest.fixture
def q(maira):
    return maira.random_configuration(np.random.default_rng(5))


@pytest.fixture
def T(maira, q):
    return maira.forward(maira.clip(q + 0.05))


def test_aims_of_a_call_are_those_of_a_solver_that_has_them(maira, q, T):
    solver, built = aiming(maira), aiming(maira, POINT, UP)
    target = {"tool0": T, "gaze": POINT, "up": list(UP)}
    np.testing.assert_allclose(solver.solve(target, q).q, built.solve(T, q).q, rtol=0, atol=1e-6)
    called, asked = solver.step(q, target, DT), built.step(q, T, DT)
    assert called.backend == asked.backend == "compiled"
    np.testing.assert_allclose(called.q, asked.q, rtol=0, atol=1e-12)
    as_poses = {"tool0": T, "gaze": mq.pose(POINT), "up": target["up"]}
    np.testing.assert_allclose(solver.step(q, as_poses, DT).q, called.q, rtol=0, atol=1e-12)


def test_a_single_task_takes_a_bare_point(maira, q):
    solver = mq.Solver(maira, task=mq.LookAtTask(frame="link6"))
    s = solver.solve(POINT, q)
    camera = maira.forward(s.q, "link6")
    away = camera.rotation.T @ (POINT - camera.translation)
    assert s.success
    assert np.hypot(*away[:2]) / away[2] < 1e-5
    np.testing.assert_array_equal(solver.solve_batch([POINT, list(POINT)], q).q, [s.q, s.q])
    ahead = solver.solve([0.0, 0.0, 0.5], q, in_frame="link5")
    there = maira.forward(q, "link5").act(np.array([0.0, 0.0, 0.5]))
    np.testing.assert_allclose(ahead.q, solver.solve(there, q).q, rtol=0, atol=1e-9)


def test_aims_of_a_batch_are_one_for_all_or_one_each(maira, q, T):
    solver = aiming(maira)
    poses = [T, maira.forward(maira.clip(q - 0.05)), maira.forward(q)]
    points = POINT + 0.1 * np.arange(3)[:, None]
    for gaze, each in ((POINT, [POINT] * 3), (points, points), (mq.pose(POINT), [POINT] * 3)):
        batch = solver.solve_batch({"tool0": poses, "gaze": gaze, "up": UP}, q)
        calls = [{"tool0": pose, "gaze": point, "up": UP} for pose, point in zip(poses, each, strict=True)]
        np.testing.assert_array_equal(batch.q, solver.solve_batch(calls, q).q)
        np.testing.assert_allclose(batch.q, [solver.solve(call, q).q for call in calls], rtol=0, atol=1e-12)
    postures = {"tool0": T, "gaze": POINT, "up": UP, "posture": [q, maira.middle]}
    assert len(solver.solve_batch(postures, q)) == 2
    points[1, 2] = np.nan
    assert solver.solve_batch({"tool0": poses, "gaze": points, "up": UP}, q).status[1] == mq.Status.INVALID_TARGET


@pytest.mark.parametrize(
    ("aim", "words"),
    [
        ({"gaze": [1.0, 2.0]}, r"point of 'gaze' must be a pose, or a point \(3,\)"),
        ({"gaze": [1.0, 2.0, np.nan]}, "'gaze' must be finite"),
        ({"up": [0, 0, 0]}, "direction of 'up' has no direction"),
        ({"up": "up"}, "target of 'up' must be a pose"),
    ],
)
def test_what_is_no_aim_is_said(maira, q, T, aim, words):
    target = {"tool0": T, "gaze": POINT, "up": UP, **aim}
    for call in (lambda: aiming(maira).solve(target, q), lambda: aiming(maira).step(q, target, DT)):
        with pytest.raises(PoseError, match=words):
            call()


@pytest.mark.parametrize(
    ("limit", "own", "value"),
    [
        (mq.DistanceLimit(lower=0.1, upper=0.3, name="near"), {"point": POINT}, POINT),
        (mq.ConeLimit(angle=0.5, name="near"), {"direction": UP}, UP),
    ],
)
def test_limits_about_an_aim_of_the_call(maira, q, T, limit, own, value):
    there = dataclasses.replace(limit, **own)
    for called, asked in (
        ({"limits": [limit]}, {"limits": [there]}),
        ({"tasks": [mq.LimitTask(limit=limit, priority=2)]}, {"tasks": [mq.LimitTask(limit=there, priority=2)]}),
    ):
        one = mq.Solver(maira, **called).step(q, {"tool0": T, "near": value}, DT)
        np.testing.assert_allclose(one.q, mq.Solver(maira, **asked).step(q, T, DT).q, rtol=0, atol=1e-9)


@pytest.mark.parametrize("clutch", [None, mq.Clutch(scale=0.5)])
def test_a_tracker_takes_an_aim_wherever_it_is(maira, q, clutch):
    robot = maira.limited(acceleration=10.0)
    solver, built = aiming(robot), aiming(robot, POINT, UP)
    trackers = [mq.Tracker(each, q, clutch=clutch) for each in (solver, built)]
    hand, v = robot.forward(q), pin.SE3(np.eye(3), np.array([0.001, 0.0, 0.0]))
    for tracker in trackers:
        if clutch is not None:
            tracker.engage()
    assert "'gaze', 'up' is missing" in trackers[0].update({"tool0": hand}, DT).reason
    for k in range(20):
        hand = v * hand
        aims = {"gaze": POINT, "up": UP} if k == 0 else {}
        one, other = trackers[0].update({"tool0": hand, **aims}, DT), trackers[1].update(hand, DT)
        assert one.state != mq.TrackerState.HOLDING, one.reason
        np.testing.assert_allclose(one.q, other.q, rtol=0, atol=1e-9)
    assert trackers[0].update({"gaze": POINT * np.nan}, DT).state == mq.TrackerState.HOLDING


def test_a_tracker_of_an_axis_alone_turns_it(maira, q):
    tracker = mq.Tracker(mq.Solver(maira, task=mq.LookAtTask(frame="link6")), q)
    for _ in range(200):
        command = tracker.update(POINT, DT)
    assert command.orientation_error < 1e-6


def test_an_answer_with_aims_that_a_limit_stops_is_explained(maira, q):
    cell = mq.BoxLimit(upper=maira.forward(q).translation + 0.1, name="cell")
    gaze = mq.LookAtTask(frame="link6", priority=2, name="gaze")
    beyond = mq.pose([0.4, 0.0, 0.0]) * maira.forward(q)
    s = mq.Solver(maira, tasks=[gaze], limits=[cell]).solve({"tool0": beyond, "gaze": POINT}, q)
    assert not s.success
    assert "cell x upper" in s.active_limits
    assert "away from the target" in str(s.explain())


def test_a_path_keeps_a_limit_about_an_aim_that_is_one_for_all_poses(maira, q):
    path = [mq.pose([0.01 * k, 0.0, 0.0]) * maira.forward(q) for k in range(5)]
    elbow = {"frame": "link4", "lower": 0.5, "name": "apart"}
    there = maira.forward(q, "link4").translation + np.array([0.2, 0.2, 0.0])
    solver, built = (mq.Solver(maira, limits=[mq.DistanceLimit(**elbow, **own)]) for own in ({}, {"point": there}))
    followed = solver.track({"tool0": path, "apart": there})
    assert followed.success.all()
    np.testing.assert_array_equal(followed.q, built.track(path).q)
    far = [np.linalg.norm(maira.forward(each, "link4").translation - there) for each in followed.q]
    assert min(far) >= 0.5 - 1e-9
    with pytest.raises(OptionError, match="needs one for all poses"):
        solver.track({"tool0": path, "apart": [there] * 5})


def test_a_path_says_how_to_give_a_limit_what_it_is_about(maira, q):
    """The call that the message shows is one that is followed."""
    path = [mq.pose([0.01 * k, 0.0, 0.0]) * maira.forward(q) for k in range(4)]
    with pytest.raises(OptionError, match=r"PoseRange\(..., name='range'\).*'tool0': poses, 'range': pose"):
        mq.Solver(maira, limits=[mq.PoseRange(position=0.2)]).track(path)
    named = mq.Solver(maira, limits=[mq.PoseRange(position=0.2, name="range")])
    assert named.track({"tool0": path, "range": path[0]})
    with pytest.raises(OptionError, match="'tool0': poses, 'range': pose"):
        named.track({"tool0": path, "range": path})
