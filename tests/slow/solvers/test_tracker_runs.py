"""Long streams of disturbed targets: gaps, jumps, flights out of reach, what is no pose, the clutch in and out.

In every tick: no exception, every limit kept, and a state that is true.
"""

import pickle
from collections import Counter

import numpy as np
import pytest
from support.hand_motions import Watched, disturbed, smooth_motion
from support.robots import load

import maira_qp as mq


def robot_of(name: str, acceleration: float | None) -> mq.Robot:
    robot = mq.Robot.maira() if name == "maira" else load(name)
    return robot if acceleration is None else robot.limited(acceleration=acceleration)


def bent(robot: mq.Robot, rng: np.random.Generator) -> np.ndarray:
    """A configuration away from the limits."""
    return 0.5 * robot.random_configuration(rng) + 0.5 * robot.middle


@pytest.mark.parametrize("clutch", [None, mq.Clutch(scale=0.8, rotation_scale=0.5)], ids=["poses", "clutch"])
@pytest.mark.parametrize("acceleration", [None, 10.0])
@pytest.mark.parametrize("name", ["maira", "panda", "ur5"])
def test_no_command_breaks_a_limit_whatever_comes(name, acceleration, clutch, rng):
    robot, states = robot_of(name, acceleration), Counter()
    q = bent(robot, rng)
    watched = Watched(mq.Tracker(mq.Solver(robot), q, clutch=clutch))
    tracker = watched.tracker
    hands = smooth_motion(robot.forward(q), 3000, rng, reach=0.25, turn=0.8, slow=400)
    for target in disturbed(hands, rng):
        event = rng.integers(60)
        if event < 4:
            tracker.resume()
        elif event == 5:
            tracker.hold()
        elif clutch is not None and event < 10:
            tracker.engage()
        elif clutch is not None and event == 10:
            tracker.release()
        elif event == 11:
            tracker.reset(tracker.q, tracker.velocity)
        measured = tracker.q + 0.08 * rng.normal(size=robot.n) if event < 20 else None
        states[watched.update(target, 0.01 * np.exp(rng.uniform(-1.5, 1.5)), measured=measured).state] += 1
    assert min(states[state] for state in mq.TrackerState) > 30, states


@pytest.mark.parametrize("backend", [None, "daqp"])
def test_a_tracker_holds_and_follows_beside_obstacles(maira, backend, rng):
    """No pair comes nearer than the margin, while it follows, brakes and stands."""
    ball = mq.Sphere(0.15, mq.pose([0.45, 0.0, 0.7]), name="ball")
    limit = mq.CollisionLimit(obstacles=[ball], margin=0.02)
    robot = maira.limited(acceleration=8.0)
    watch, q = limit.of(robot), np.array([2.0, 0.6, 0.0, 1.2, 0.1, 0.6, 0.0])
    solver = mq.Solver(robot, limits=[limit], backend=backend)
    watched, reasons = Watched(mq.Tracker(solver, q, max_jump=(np.inf, np.inf))), ""
    near = robot.forward(q)
    for k in range(150):
        if k % 40 == 20:
            watched.tracker.hold()
        if k % 40 == 32:
            watched.tracker.resume()
        share = min(1.0, k / 100)
        near.translation = (1 - share) * robot.forward(q).translation + share * np.array([0.45, 0.0, 0.7])
        reasons += watched.update(near, 0.02).reason
        assert watch.distance(robot.at(watched.q)) >= 0.02 - 1e-9
    assert "CollisionLimit (link" in reasons


def test_obstacles_that_move_are_kept_clear_of(maira):
    """A ball comes near, from tick to tick, and stays where it was said to be; a hold does not forget it."""
    ball = mq.Sphere(0.1, mq.pose([5.0, 0.0, 0.7]), name="ball")
    robot, q = maira.limited(acceleration=20.0), np.array([0.1, 0.5, 0.1, 1.3, 0.1, 0.9, 0.1])
    tool = robot.forward(q)
    goal = tool.copy()
    goal.translation = tool.translation + np.array([0.0, 0.25, 0.0])
    near = mq.pose(tool.translation + np.array([0.0, 0.35, 0.0]))
    limit = mq.CollisionLimit(obstacles=[ball], margin=0.02)
    watch = mq.CollisionLimit(obstacles=[mq.Sphere(0.1, near, name="ball")], margin=0.02).of(robot)
    solver = mq.Solver(robot, limits=[limit])
    watched = Watched(mq.Tracker(solver, q, max_jump=(np.inf, np.inf)))
    reasons = ""
    for k in range(200):
        command = watched.update(goal, 0.02, obstacles={"ball": near} if k % 50 == 0 else None)
        reasons += command.reason
        if k == 100:
            watched.tracker.hold()
        elif k == 110:
            watched.tracker.resume()
        assert watch.distance(robot.at(watched.q)) >= 0.02 - 1e-9
    assert "CollisionLimit (" in reasons
    assert command.position_error > 0.01
    tracker = pickle.loads(pickle.dumps(watched.tracker))
    np.testing.assert_array_equal(tracker.update(goal, 0.02).q, watched.update(goal, 0.02).q)
    command = watched.update(goal, 0.02, obstacles={"boll": near})
    assert command.state == mq.TrackerState.HOLDING
    assert "'ball'" in command.reason
    watched.tracker.reset(watched.q)
    watched.velocity = np.zeros(robot.n)
    for _ in range(200):
        command = watched.update(goal, 0.02)
    assert command.position_error < 1e-6


def test_the_speed_of_the_tool_is_that_of_the_solver(maira, rng):
    """The tool of a tracker whose solver has a ToolSpeedLimit goes no faster from tick to tick, and arrives."""
    robot, q = maira.limited(acceleration=20.0), np.array([0.1, 0.5, 0.1, 1.3, 0.1, 0.9, 0.1])
    solver = mq.Solver(robot, limits=[mq.ToolSpeedLimit(linear=0.1, angular=0.4)])
    watched = Watched(mq.Tracker(solver, q, max_jump=(np.inf, np.inf)))
    before, reasons = robot.forward(q), ""
    goal = before.copy()
    goal.translation = goal.translation + np.array([0.0, 0.1, 0.05])
    fastest = 0.0
    for _ in range(250):
        command = watched.update(goal, 0.01)
        reasons += command.reason
        now = robot.forward(command.q)
        fastest = max(fastest, np.linalg.norm(now.translation - before.translation) / 0.01)
        before = now
    assert 0.09 < fastest <= 0.1 * (1 + 1e-6)
    assert "ToolSpeedLimit" in reasons
    assert command.position_error < 1e-6


@pytest.mark.parametrize("name", ["maira", "panda", "ur5", "baxter_arms"])
def test_after_a_hold_the_arm_rests_with_a_still_target(name, rng):
    robot = robot_of(name, 10.0)
    for _ in range(3):
        q = bent(robot, rng)
        watched = Watched(mq.Tracker(mq.Solver(robot), q))
        hands = {tip: smooth_motion(robot.forward(q, tip), 100, rng) for tip in robot.tips}
        streams = [{tip: each[k] for tip, each in hands.items()} for k in range(100)]
        for k, targets in enumerate(streams):
            if k == 60:
                watched.tracker.hold()
            watched.update(targets)
        for _ in range(100):
            watched.update(streams[-1])
        assert not watched.velocity.any()
        watched.tracker.resume()
        for _ in range(1500):
            command = watched.update(streams[-1])
        assert np.abs(command.velocity).max() < 1e-4
        assert command.state == mq.TrackerState.FOLLOWING or "out of reach by" in command.reason


def test_two_trackers_of_one_solver_do_not_know_of_each_other(maira, rng):
    """The same stream gives the same commands to the bit, alone or beside another."""
    solver, q = mq.Solver(maira.limited(acceleration=10.0)), bent(maira, rng)
    hands = list(disturbed(smooth_motion(maira.forward(q), 600, rng), rng))
    one, alone = mq.Tracker(solver, q), mq.Tracker(solver, q)
    other = mq.Tracker(solver, maira.middle, clutch=mq.Clutch())
    expected = [alone.update(T, 0.01) for T in hands]
    for T, command in zip(hands, expected, strict=True):
        other.update(T, 0.02)
        other.engage()
        again = one.update(T, 0.01)
        np.testing.assert_array_equal(again.q, command.q)
        assert (again.state, again.reason) == (command.state, command.reason)
