"""A tracker of a stream of targets: what is followed, what is not and why, and how a hand becomes a target."""

import pickle

import numpy as np
import pinocchio as pin
import pytest
from support.hand_motions import NOT_POSES, Watched, smooth_motion
from support.robots import load

import maira_qp as mq
from maira_qp.errors import ConfigurationError, OptionError

FOLLOWING, LIMITED, HOLDING = mq.TrackerState
DT = 0.01


@pytest.fixture(scope="module")
def solver(maira) -> mq.Solver:
    return mq.Solver(maira.limited(velocity=2.0, acceleration=10.0))


@pytest.fixture
def start(maira) -> np.ndarray:
    """An arm that is bent, with room in all directions."""
    return np.array([0.1, 0.5, 0.1, 1.3, 0.1, 0.9, 0.1])


def shifted(pose: pin.SE3, *way: float) -> pin.SE3:
    """The pose moved by so much [m] in the axes of the base."""
    return pin.SE3(pose.rotation, pose.translation + way)


def rest(watched: Watched, target, ticks: int = 400) -> mq.Command:
    """The command once the target has stood for long."""
    for _ in range(ticks):
        command = watched.update(target)
    return command


def test_a_target_that_moves_gently_is_followed(solver, start, rng):
    watched = Watched(mq.Tracker(solver, start))
    for T in smooth_motion(solver.robot.forward(start), 300, rng, reach=0.1, turn=0.2, slow=200):
        command = watched.update(T)
        assert command.state == FOLLOWING
    assert np.abs(watched.q - start).max() > 0.1


def test_a_target_that_jumps_is_not_followed_until_it_comes_back(solver, start):
    watched, T = Watched(mq.Tracker(solver, start)), solver.robot.forward(start)
    assert watched.update(shifted(T, 0.05, 0, 0)).state == LIMITED  # on the way, at full acceleration
    moving = watched.velocity
    assert moving.any()
    for k in range(60):
        command = watched.update(shifted(T, 0.05, 0, 0.2 + 1e-3 * k))
        assert command.state == HOLDING
        assert "from the last one (max_jump: 100 mm" in command.reason
        assert f"{200 + k}.0 mm" in command.reason
    assert not watched.velocity.any()
    assert rest(watched, shifted(T, 0.06, 0, 0)).state == FOLLOWING


def test_a_turn_is_a_jump_too(solver, start):
    tracker, T = mq.Tracker(solver, start, max_jump=(np.inf, 0.3)), solver.robot.forward(start)
    for angle, state in ((0.29, LIMITED), (0.57, LIMITED), (0.9, HOLDING), (0.6, LIMITED)):
        assert tracker.update(pin.SE3(pin.exp3(np.array([0, angle, 0])) @ T.rotation, T.translation), DT).state == state


def test_after_a_resume_the_next_target_is_followed_wherever_it_is(solver, start):
    watched, T = Watched(mq.Tracker(solver, start)), solver.robot.forward(start)
    far = shifted(T, 0, 0.2, 0)
    command = watched.update(far)
    assert command.state == HOLDING
    assert "from the tool" in command.reason
    watched.tracker.resume()
    assert watched.update(far).state == LIMITED
    assert rest(watched, far).position_error < 1e-9


def test_a_hold_brakes_and_stands_and_a_resume_goes_on(solver, start, rng):
    watched = Watched(mq.Tracker(solver, start))
    hands = smooth_motion(solver.robot.forward(start), 200, rng, reach=0.3)
    for T in hands[:50]:
        watched.update(T)
    watched.tracker.hold("lunch")
    for T in hands[50:120]:
        assert (watched.update(T).state, watched.commands[-1].reason) == (HOLDING, "lunch")
    assert not watched.velocity.any()
    stood = watched.q
    watched.tracker.resume()
    assert not watched.tracker.is_held
    watched.update(hands[120])
    assert np.abs(watched.q - stood).max() <= 10.0 * DT**2 * (1 + 1e-9)  # what one tick from rest can do
    assert rest(watched, hands[120]).state == FOLLOWING


def test_without_targets_the_last_one_holds_for_the_timeout_and_then_the_arm_stops(solver, start):
    watched, T = Watched(mq.Tracker(solver, start, timeout=0.3)), solver.robot.forward(start)
    assert "no target yet" in watched.update(None).reason
    watched.update(shifted(T, 0.09, 0, 0))
    states = [watched.update(None, 0.02).state for _ in range(20)]
    assert HOLDING not in states[:14]
    assert set(states[15:]) == {HOLDING}
    assert "no target for 0.4 s (timeout: 0.3 s)" in watched.commands[-1].reason
    assert watched.update(shifted(T, 0.09, 0.05, 0)).state != HOLDING
    command = watched.update(shifted(T, 0.09, 0.05, 0), 0.31)
    assert (command.state, "tick took 0.31 s" in command.reason) == (HOLDING, True)


@pytest.mark.parametrize("bad", NOT_POSES, ids=[str(np.shape(each)) for each in NOT_POSES])
@pytest.mark.parametrize("clutch", [None, mq.Clutch()], ids=["poses", "clutch"])
def test_what_is_no_pose_is_not_followed_and_says_so(solver, start, bad, clutch):
    watched, T = Watched(mq.Tracker(solver, start, clutch=clutch)), solver.robot.forward(start)
    if clutch:
        watched.tracker.engage()
    watched.update(T)
    for _ in range(30):
        watched.update(shifted(T, 0.05, 0, 0))
    command = watched.update(bad)
    assert command.state == HOLDING
    assert "target" in command.reason or "nobody" in command.reason
    assert watched.update(shifted(T, 0.05, 0, 0)).state != HOLDING


def test_a_target_beyond_all_numbers_is_held(solver, start):
    watched = Watched(mq.Tracker(solver, start, max_jump=(np.inf, np.inf)))
    far = np.eye(4)
    far[0, 3] = 1e300
    assert watched.update(far).state == HOLDING
    assert watched.update(solver.robot.forward(start)).state == FOLLOWING


@pytest.mark.parametrize("dt", [0, -0.01, np.nan, np.inf, None, "0.01", True])
def test_a_tick_without_a_length_changes_nothing(solver, start, dt):
    tracker, T = mq.Tracker(solver, start), solver.robot.forward(start)
    moving = tracker.update(shifted(T, 0.05, 0, 0), DT)
    command = tracker.update(T, dt)
    assert command.state == HOLDING
    assert "length of a tick" in command.reason
    np.testing.assert_array_equal(command.q, moving.q)
    np.testing.assert_array_equal(command.velocity, moving.velocity)


def test_a_robot_that_does_not_come_along_stops_the_tracker(solver, start):
    watched, T = Watched(mq.Tracker(solver, start, max_following_error=0.05)), solver.robot.forward(start)
    states = []
    for k in range(200):
        states.append(watched.update(shifted(T, 2e-3 * min(k, 80), 0, 0), measured=start).state)
        assert np.abs(watched.q - start).max() < 0.05 + 2.0 * DT + 2.0**2 / (2 * 10.0)  # a tick, and braking
    assert states[0] != HOLDING
    assert states[-1] == HOLDING
    assert "away from its command (max_following_error: 0.05 rad)" in watched.commands[-1].reason
    assert watched.update(shifted(T, 0.05, 0, 0), measured=watched.q).state != HOLDING
    assert "measured" in watched.update(T, measured=np.full(7, np.nan)).reason
    assert "measured" in watched.update(T, measured=[1.0]).reason


@pytest.mark.parametrize("name", ["maira", "panda", "ur5"])
def test_engaging_the_clutch_moves_nothing(name, rng):
    """Wherever the hand is; from an arm that moves it comes to rest where braking leads it."""
    robot = (mq.Robot.maira() if name == "maira" else load(name)).limited(acceleration=8.0)
    q = robot.clip(robot.middle + 0.4)
    watched = Watched(mq.Tracker(mq.Solver(robot), q, clutch=mq.Clutch(scale=0.7, rotation_scale=0.5)))
    hand = mq.pose(rng.normal(size=3), rpy=rng.uniform(-3, 3, 3))
    assert "clutch is released" in watched.update(hand).reason
    watched.tracker.engage()
    for _ in range(50):
        assert watched.update(hand).state == FOLLOWING
    assert np.abs(watched.q - q).max() < 1e-9
    for T in smooth_motion(hand, 60, rng, reach=0.4, slow=40):
        watched.update(T)
    assert np.abs(watched.velocity).max() > 0.05
    stop = watched.q + watched.velocity * np.abs(watched.velocity) / 16.0
    watched.tracker.release()
    watched.update(hand)
    watched.tracker.engage()
    rest(watched, mq.pose(rng.normal(size=3)), 200)
    assert np.linalg.norm(mq.pose_error(robot.forward(watched.q), robot.forward(stop))) < 0.02


def test_a_clutch_moves_the_tool_as_the_hand_does_in_its_own_frame(solver, start, rng):
    """Against the formulas from where both were at first: `p + s A dp`, and for whole angles `A dR A^T R`."""
    A = pin.exp3(rng.normal(size=3))
    tracker = mq.Tracker(solver, start, clutch=mq.Clutch(scale=0.3, alignment=A))
    hand = mq.pose(rng.normal(size=3), rpy=rng.uniform(-3, 3, 3))
    tracker.engage()
    first = tracker.update(hand, DT).target
    np.testing.assert_allclose(first, solver.robot.forward(start).homogeneous, atol=1e-12)
    for T in smooth_motion(hand, 500, rng, reach=0.2, turn=3.0):
        target = tracker.update(T, DT).target
        R = A @ T[:3, :3] @ hand.rotation.T @ A.T @ first[:3, :3]
        np.testing.assert_allclose(target[:3, 3], first[:3, 3] + 0.3 * A @ (T[:3, 3] - hand.translation), atol=1e-12)
        np.testing.assert_allclose(target[:3, :3], R, atol=1e-12)


def test_a_scaled_turn_about_an_axis_goes_on_through_whole_turns(solver, start):
    """Three turns of the hand are a tenth of that of the tool, and no step of it is larger than its share."""
    tracker = mq.Tracker(solver, start, clutch=mq.Clutch(rotation_scale=0.1))
    tracker.engage()
    axis = np.array([1.0, 2.0, -2.0]) / 3
    first = tracker.update(mq.pose(), DT).target
    for angle in np.linspace(0, 6 * np.pi, 200):
        target = tracker.update(pin.SE3(pin.exp3(angle * axis), np.zeros(3)), DT).target
        np.testing.assert_allclose(target[:3, :3], pin.exp3(0.1 * angle * axis) @ first[:3, :3], atol=1e-12)


def test_motion_of_the_hand_while_it_is_not_followed_moves_nothing(solver, start):
    """Released, or held: the tool goes on from where it is."""
    watched = Watched(mq.Tracker(solver, start, clutch=mq.Clutch()))
    tracker = watched.tracker
    tracker.engage()
    tracker.engage()  # in every tick, if one likes
    rest(watched, np.eye(4), 5)
    for pause, go_on in ((tracker.release, tracker.engage), (tracker.hold, tracker.resume)):
        stood = watched.q
        pause()
        rest(watched, mq.pose([3.0, 1.0, 2.0]), 5)
        go_on()
        assert rest(watched, mq.pose([-3.0, 1.0, 2.0], rpy=[1, 2, 3]), 50).state == FOLLOWING
        assert np.abs(watched.q - stood).max() < 1e-9
        assert tracker.is_engaged


def test_out_of_reach_is_said_in_millimetres_and_the_arm_rests(solver, start):
    watched, T = Watched(mq.Tracker(solver, start, clutch=mq.Clutch())), np.eye(4)
    watched.tracker.engage()
    for k in range(200):
        T[2, 3] = 0.02 * k
        command = watched.update(T)
    assert command.state == LIMITED
    command = rest(watched, T, 800)
    assert command.state == LIMITED
    assert f"out of reach by {1e3 * command.position_error:.1f} mm" in command.reason
    assert np.abs(command.velocity).max() < 1e-5


def test_the_speed_limit_is_named_and_is_that_of_the_tracker(maira, start):
    tracker = mq.Tracker(mq.Solver(maira), start, velocity=0.1, acceleration={"joint1": 3.0})
    assert (tracker.solver.robot.velocity_limit == 0.1).all()
    assert tracker.solver.robot.acceleration_limit[0] == 3.0
    command = tracker.update(shifted(maira.forward(start), 0.08, 0, 0), DT)
    assert command.state == LIMITED
    assert "speed limit of" in command.reason


def test_a_limited_solver_is_the_one_that_is_made_of_the_limited_robot(maira, start):
    """With all its parts: collisions, lower tasks, redundancy, backend and options."""
    keys = {
        "tasks": [mq.AxisTask(frame="link4", direction=[0, 0, 1], priority=2, gain=0.5)],
        "limits": [mq.CollisionLimit(margin=0.02)],
        "redundancy": mq.Strict(mq.Posture()),
        "backend": "daqp",
        "options": mq.Options(damping=0.2),
    }
    limited = mq.Solver(maira, **keys).limited(velocity=1.0, acceleration=6.0)
    made = mq.Solver(maira.limited(velocity=1.0, acceleration=6.0), **keys)
    q, target = start, shifted(maira.forward(start), 0.1, 0.1, -0.2)
    velocity = np.zeros(7)
    for _ in range(5):
        a, b = (solver.step(q, target, 0.02, velocity=velocity) for solver in (limited, made))
        np.testing.assert_array_equal(a.q, b.q)
        assert a.backend == b.backend == "daqp"
        q, velocity = a.q, a.velocity
    with pytest.raises(OptionError, match="loosen"):
        limited.limited(velocity=2.0)


def test_a_reset_starts_anew(solver, start, maira):
    tracker = mq.Tracker(solver, start, clutch=mq.Clutch())
    tracker.engage()
    tracker.hold()
    tracker.reset(maira.middle, 0.1 * np.ones(7))
    assert not tracker.is_engaged
    assert not tracker.is_held
    np.testing.assert_array_equal(tracker.velocity, 0.1 * np.ones(7))
    assert tracker.update(None, DT).state == HOLDING
    assert (np.abs(tracker.velocity) < 0.1).all()
    for wrong in ([0.0], np.full(7, np.nan), None):
        with pytest.raises(ConfigurationError):
            tracker.reset(wrong)


def test_the_commands_do_not_change_and_are_pickled_without_the_robot(solver, start):
    tracker = mq.Tracker(solver, start)
    command = tracker.update(solver.robot.forward(start), DT)
    for array in (command.q, command.velocity, command.target):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1.0
    with pytest.raises(AttributeError):
        command.state = HOLDING
    again = pickle.loads(pickle.dumps(command))
    assert len(pickle.dumps(command)) < 3000
    assert repr(again) == repr(command)
    assert again.joint_names == solver.robot.joint_names


@pytest.mark.parametrize("clutch", [None, mq.Clutch(scale=0.5)], ids=["poses", "clutch"])
def test_a_pickled_tracker_goes_on_where_the_other_does(solver, start, rng, clutch):
    tracker = mq.Tracker(solver, start, clutch=clutch)
    if clutch:
        tracker.engage()
    hands = smooth_motion(solver.robot.forward(start), 60, rng)
    for T in hands[:30]:
        tracker.update(T, DT)
    other = pickle.loads(pickle.dumps(tracker))
    for T in hands[30:]:
        a, b = tracker.update(T, DT), other.update(T, DT)
        np.testing.assert_array_equal(a.q, b.q)
        assert a.state == b.state


def test_the_targets_of_several_frames_are_guarded_each(rng):
    robot = load("baxter_arms").limited(acceleration=10.0)
    q = robot.clip(robot.middle + 0.3)
    left, right = robot.tips
    watched = Watched(mq.Tracker(mq.Solver(robot), q))
    T = {tip: robot.forward(q, tip) for tip in robot.tips}
    assert watched.update(T).state == FOLLOWING
    near = {left: shifted(T[left], 0.02, 0, 0), right: T[right]}
    assert watched.update(near).state != HOLDING
    command = watched.update({left: near[left], right: shifted(T[right], 0, 0, 0.2)})
    assert command.state == HOLDING
    assert repr(right) in command.reason
    assert right in watched.update({left: near[left]}).reason
    assert watched.update(T[left]).state == HOLDING
    assert set(rest(watched, near, 100).target) == set(robot.tips)
    both = Watched(mq.Tracker(mq.Solver(robot), q, clutch=mq.Clutch()))
    both.tracker.engage()
    both.update({left: np.eye(4), right: mq.pose([1, 2, 3])})
    command = both.update({left: mq.pose([0.01, 0, 0]), right: mq.pose([1, 2, 3])})
    np.testing.assert_allclose(command.target[left][:3, 3], T[left].translation + np.array([0.01, 0, 0]), atol=1e-12)
    np.testing.assert_allclose(command.target[right], T[right].homogeneous, atol=1e-12)


def test_tasks_with_targets_of_their_own_need_none(maira, start):
    goal = shifted(maira.forward(start), 0.02, 0, 0)
    tracker = mq.Tracker(mq.Solver(maira, task=mq.PoseTask(target=goal)), start)
    for _ in range(100):
        command = tracker.update(None, DT)
    assert (command.state, command.target) == (FOLLOWING, None)
    assert command.position_error < 1e-9
    assert "no task takes its target" in tracker.update(goal, DT).reason


def test_mistakes_at_the_construction_are_errors(solver, start):
    for keys in (
        {"clutch": 0.5},
        {"max_jump": 0.1},
        {"max_jump": (0.1, -1)},
        {"timeout": 0},
        {"timeout": np.nan},
        {"max_following_error": None},
        {"tolerance": (1e-3, "x")},
        {"velocity": 1e9},
        {"acceleration": -1},
    ):
        with pytest.raises(OptionError, match=r"max_|timeout|tolerance|clutch|velocity|acceleration"):
            mq.Tracker(solver, start, **keys)
    with pytest.raises(OptionError, match="solver"):
        mq.Tracker(solver.robot, start)
    with pytest.raises(ConfigurationError):
        mq.Tracker(solver, start[:3])
    fixed = mq.Solver(solver.robot, task=mq.PoseTask(target=np.eye(4)))
    with pytest.raises(OptionError, match="clutch"):
        mq.Tracker(fixed, start, clutch=mq.Clutch())
    tracker = mq.Tracker(solver, start)
    for call in (tracker.engage, tracker.release):
        with pytest.raises(OptionError, match="clutch"):
            call()
    with pytest.raises(OptionError, match="reason"):
        tracker.hold("")
    for keys in ({"scale": 0}, {"scale": np.nan}, {"rotation_scale": -1}, {"alignment": np.diag([1, 1, -1])}):
        with pytest.raises(OptionError, match=next(iter(keys))):
            mq.Clutch(**keys)


def test_what_is_shown_fits_a_terminal(solver, start):
    tracker = mq.Tracker(solver, start, clutch=mq.Clutch())
    for each in (tracker, tracker.update(None, DT)):
        assert max(map(len, repr(each).splitlines())) <= 80
        assert all(name in repr(each) for name in solver.robot.joint_names)
        assert "released" in repr(each)
