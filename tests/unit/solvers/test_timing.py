"""A timed path keeps the limits at all samples, ends at its last pose, and its tool is no farther off than it says."""

import pickle
import sys
from math import pi

import numpy as np
import pytest

import maira_qp as mq
from maira_qp.errors import OptionError
from maira_qp.results.path_solution import PathFailure, PathSolution, Rules

DT = 0.01
ARM = mq.Robot.maira()
RAIL = mq.Robot.from_dh(
    [
        mq.DHLink(kind="prismatic", a=0.0, alpha=-pi / 2, d=0.0, theta=0.0, lower=-2.0, upper=2.0, velocity=1.5),
        mq.DHLink(kind="revolute", a=0.4, alpha=0.0, d=0.0, theta=0.0, lower=-2.5, upper=2.5, velocity=2.0),
        mq.DHLink(kind="revolute", a=0.3, alpha=0.0, d=0.0, theta=0.0, lower=-2.5, upper=2.5, velocity=2.0),
    ],
    name="rail",
)


def followed(robot, q, **changes):
    """A path that is followed whole, by its configurations (N, n)."""
    count, every = len(q), np.full(robot.n, 1e3)
    values = {
        "q": np.array(q, dtype=float),
        "success": np.ones(count, dtype=bool),
        "position_error": np.zeros(count),
        "orientation_error": np.zeros(count),
        "rules": Rules(every, 0, None, False, False),
        "_targets": np.zeros((count, 12)),
        "_origin": mq.Solver(robot).engines,
    }
    values |= changes
    missed = np.flatnonzero(~values["success"])
    steps = np.flatnonzero((np.abs(np.diff(values["q"], axis=0)) > values["rules"].step).any(axis=1)) + 1
    failures = [PathFailure(k, "not reached", is_step=False, is_proved=False) for k in missed.tolist()]
    failures += [PathFailure(k, "too large a step", is_step=True, is_proved=False) for k in steps.tolist()]
    return PathSolution(**values, failures=tuple(sorted(failures, key=lambda each: each.index)))


def wave(robot, count, rng, size=0.8):
    """A smooth random path (N, n) within the limits."""
    s = np.linspace(0.0, 1.0, count)[:, None]
    phases = rng.uniform(0.0, 2 * pi, (2, robot.n))
    share = 0.5 + 0.25 * size * (np.sin(3.0 * s + phases[0]) + np.sin(7.0 * s + phases[1]))
    return robot.lower + share * (robot.upper - robot.lower)


def differences(q, order):
    return np.diff(q, n=order, axis=0) / DT**order


def check(trajectory, q, velocity, acceleration, jerk=None):
    """By finite differences of the samples, which are means of the derivatives and so no larger than these."""
    robot_n = q.shape[1]
    np.testing.assert_allclose(trajectory.times, np.arange(len(trajectory)) * DT, rtol=0, atol=1e-9)
    for order, limit in ((1, velocity), (2, acceleration), (3, jerk)):
        if limit is not None and len(trajectory) > order:
            limit = np.broadcast_to(limit, (robot_n,))
            noise = 1e-13 / DT**order  # of the last digits of q
            assert (np.abs(differences(trajectory.q, order)) <= limit * (1.0 + 1e-6) + noise).all()
    assert (np.abs(trajectory.velocity) <= velocity * (1.0 + 1e-6)).all()
    assert (np.abs(trajectory.acceleration) <= acceleration * (1.0 + 1e-6)).all()
    np.testing.assert_allclose(trajectory.q[[0, -1]], q[[0, -1]], rtol=0, atol=1e-9)
    np.testing.assert_allclose(trajectory.velocity[[0, -1]], 0.0, atol=1e-12)


@pytest.mark.parametrize("robot", [ARM, RAIL], ids=["arm", "rail"])
@pytest.mark.parametrize("jerk", [None, 40.0], ids=["toppra", "ruckig"])
def test_limits_hold_at_all_samples_of_random_paths(robot, jerk):
    rng = np.random.default_rng(3)
    for count in (2, 3, 40, 300):
        q = wave(robot, count, rng)
        velocity, acceleration = rng.uniform(0.5, 1.0, robot.n), rng.uniform(1.0, 8.0, robot.n)
        trajectory = followed(robot, q).timed(velocity, acceleration, jerk, dt=DT)
        check(trajectory, q, velocity, acceleration, jerk)
        assert (trajectory.q >= robot.lower).all()
        assert (trajectory.q <= robot.upper).all()


def test_the_time_is_nearly_optimal_where_the_optimum_is_known():
    """One joint from rest to rest over 1 rad: L / v + v / a; with jerk, an S-curve in closed form."""
    q = ARM.middle + np.linspace(0.0, 1.0, 50)[:, None] * np.eye(7)[3]
    path, (v, a, j) = followed(ARM, q), (0.5, 2.0, 20.0)
    assert path.timed(v, a, dt=0.001).duration == pytest.approx(1.0 / v + v / a, rel=5e-3)
    assert path.timed(v, a, j, dt=0.001).duration < 1.3 * (1.0 / v + v / a + a / j)


def test_velocity_and_acceleration_are_the_derivatives_of_q():
    q = wave(ARM, 200, np.random.default_rng(0))
    t = followed(ARM, q).timed(acceleration=2.0, jerk=20.0, dt=DT)
    central = (t.q[2:] - t.q[:-2]) / (2 * DT)
    assert np.abs(central - t.velocity[1:-1]).max() <= 20.0 * DT**2 / 6 + 1e-9  # jerk h^2 / 6
    central = (t.velocity[2:] - t.velocity[:-2]) / (2 * DT)
    assert np.abs(central - t.acceleration[1:-1]).max() <= 20.0 * DT + 1e-9
    J = np.array([ARM.jacobian(each)[:3] for each in t.q])
    np.testing.assert_allclose(t.tool_speed, np.linalg.norm((J @ t.velocity[:, :, None])[..., 0], axis=1), atol=1e-12)


def test_the_tool_keeps_its_speed_between_ramps():
    """On a line with room, and it is never exceeded."""
    line = [mq.pose([0.5, y, 0.6], rpy=[pi, 0, 0]) for y in np.linspace(-0.3, 0.3, 100)]
    path = mq.Solver(ARM).track(line)
    t = path.timed(acceleration=10.0, tool_speed=0.1)
    assert t.tool_speed.max() <= 0.1 * (1.0 + 1e-6)
    middle = t.tool_speed[len(t) // 10 : -len(t) // 10]
    assert middle.min() >= 0.098
    assert path.timed(acceleration=10.0, jerk=200.0, tool_speed=0.1).tool_speed.max() <= 0.1 * (1.0 + 1e-6)


@pytest.mark.parametrize("jerk", [None, 50.0], ids=["toppra", "ruckig"])
def test_the_tool_is_nowhere_farther_from_the_path_than_reported(jerk):
    """Against a dense search by forward kinematics, at places that the report did not look at."""
    angles = np.linspace(0.0, 2 * pi, 25)
    circle = [mq.pose([0.5, 0.2 * np.cos(a), 0.6 + 0.2 * np.sin(a)], rpy=[pi, 0.3 * np.sin(a), 0]) for a in angles]
    path = mq.Solver(ARM).track(circle)
    t = path.timed(acceleration=4.0, jerk=jerk, dt=0.01)
    points = np.array([pose.translation for pose in circle])
    worst = 0.0
    for q, time in zip(t.q, t.times, strict=True):
        k = min(max(np.searchsorted(t.pose_times, time, "right") - 1, 0), len(points) - 2)
        ends = points[k : k + 2]
        share = np.linspace(0.0, 1.0, 101)[:, None]
        segment = (1 - share) * ends[0] + share * ends[1]
        worst = max(worst, np.linalg.norm(ARM.forward(q).translation - segment, axis=1).min())
    assert t.position_deviation.value == pytest.approx(worst, rel=0.1)
    assert 1e-4 < worst < 1e-2  # the chord of a circle: the check can fail
    k = t.position_deviation.pose
    assert t.pose_times[k] <= t.position_deviation.time <= t.pose_times[k + 1]
    assert 0.0 < t.orientation_deviation.value < 0.1


def test_poses_are_passed_at_their_times():
    q = wave(ARM, 120, np.random.default_rng(5))
    for limits in ({}, {"jerk": 30.0}):
        t = followed(ARM, q).timed(acceleration=3.0, dt=0.002, **limits)
        assert (np.diff(t.pose_times) > 0).all()
        np.testing.assert_allclose(t.at(np.minimum(t.pose_times, t.duration)), q, atol=1e-5)


def test_limits_hold_where_a_spline_would_pass_them():
    """A joint that runs into its limit and stays: a plain cubic spline swings beyond it."""
    q = np.tile(ARM.middle, (12, 1))
    q[:, 1] = np.minimum(ARM.upper[1], ARM.upper[1] - 0.8 + 0.2 * np.arange(12))
    q[:, 0] += 0.1 * np.arange(12)
    t = followed(ARM, q).timed(acceleration=3.0, dt=DT)
    check(t, q, ARM.velocity_limit, 3.0)
    assert (t.q <= ARM.upper).all()
    assert (t.at(np.linspace(0.0, t.duration, 5_000)) <= ARM.upper).all()


def test_a_path_that_stands_still_takes_no_time():
    for count in (1, 4):
        t = followed(ARM, np.tile(ARM.middle, (count, 1))).timed(acceleration=1.0)
        assert (len(t), t.duration, len(t.pose_times)) == (1, 0.0, count)
        np.testing.assert_array_equal(t.at(0.0), ARM.middle)
        assert t.at([0.0, 0.0]).shape == (2, 7)
        assert t.position_deviation.value == 0.0


def test_poses_that_are_repeated_or_nearly_do_not_stop_the_arm():
    q = wave(ARM, 60, np.random.default_rng(8))
    noise = 1e-7 * np.random.default_rng(1).standard_normal((60, 7))
    twice = np.stack([q, q + noise], axis=1).reshape(-1, 7)
    once, again = (followed(ARM, each).timed(acceleration=3.0, dt=DT) for each in (q, twice))
    assert again.duration == pytest.approx(once.duration, abs=3 * DT)
    assert len(again.pose_times) == 120
    assert (np.diff(again.pose_times) >= 0).all()


@pytest.mark.parametrize("size", [1e-12, 1e-9, 1e-4])
def test_short_paths_take_as_long_as_the_closed_form_says(size):
    """From rest to rest over L, limited by the acceleration: 2 sqrt(L / a); by the jerk: cbrt(32 L / j)."""
    q = ARM.middle + size * np.linspace(0.0, 1.0, 20)[:, None] * np.ones(7)
    for limits, duration in (({}, 2.0 * np.sqrt(size / 1e-3)), ({"jerk": 1e-3}, np.cbrt(32.0 * size / 1e-3))):
        t = followed(ARM, q).timed(acceleration=1e-3, dt=duration / 64.0, **limits)
        assert duration * (1.0 - 1e-3) <= t.duration <= duration * (1.0 + 2.0 / 64.0)
        np.testing.assert_allclose(t.q[-1], q[-1], atol=1e-15)


def test_a_path_with_corners_and_noise_keeps_its_limits():
    """Whatever a path looks like, it is timed; what its curve costs the tool is reported."""
    rng = np.random.default_rng(4)
    there = ARM.middle + 0.5 * np.linspace(0.0, 1.0, 40)[:, None] * np.ones(7)
    for q in (ARM.middle + rng.uniform(-0.3, 0.3, (30, 7)), np.concatenate([there, there[::-1]])):
        for jerk in (None, 40.0):
            t = followed(ARM, q).timed(acceleration=4.0, jerk=jerk, dt=DT)
            check(t, q, ARM.velocity_limit, 4.0, jerk)
            assert t.position_deviation.value > 0.0


def test_a_path_with_a_gap_is_refused_or_its_longest_part_is_timed():
    q = wave(ARM, 50, np.random.default_rng(2))
    success = np.ones(50, dtype=bool)
    success[[10, 40]] = False
    path = followed(ARM, q, success=success)
    with pytest.raises(OptionError, match=r"not followed beyond pose 10.*longest_part=True"):
        path.timed(acceleration=1.0)
    t = path.timed(acceleration=1.0, longest_part=True)
    assert (t.first_pose, len(t.pose_times)) == (11, 29)
    np.testing.assert_allclose(t.q[[0, -1]], q[[11, 39]], atol=1e-9)
    assert 11 <= t.position_deviation.pose < 40


def test_a_reconfiguration_is_refused_or_left_out():
    q = wave(ARM, 50, np.random.default_rng(2), size=0.4)
    q[20:] += 0.3
    path = followed(ARM, q, rules=Rules(np.full(7, 0.3), 1, None, False, False))
    assert (bool(path), path.reconfigurations) == (True, 1)
    with pytest.raises(OptionError, match="a reconfiguration before pose 20"):
        path.timed(acceleration=1.0)
    assert path.timed(acceleration=1.0, longest_part=True).first_pose == 20


def test_a_path_of_which_nothing_is_reached_is_refused():
    path = followed(ARM, np.tile(ARM.middle, (3, 1)), success=np.zeros(3, dtype=bool))
    with pytest.raises(OptionError, match="no pose that is reached"):
        path.timed(acceleration=1.0, longest_part=True)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({}, "no limit of the acceleration of 'joint1'; give timed"),
        ({"acceleration": -1.0}, "acceleration limit must be positive"),
        ({"acceleration": np.nan}, "acceleration must not be NaN"),
        ({"acceleration": [1.0, 2.0]}, "acceleration must be real numbers of shape"),
        ({"acceleration": 1.0, "velocity": 99.0}, "would loosen"),
        ({"acceleration": 1.0, "jerk": 0.0}, "jerk must be positive"),
        ({"acceleration": 1.0, "jerk": "fast"}, "jerk must be a real number"),
        ({"acceleration": 1.0, "jerk": {"elbow": 1.0}}, "'elbow' is not a joint"),
        ({"acceleration": 1.0, "velocity": 1e-300}, "samples, more than are made"),
        ({"acceleration": 1e-300}, "samples, more than are made"),
        ({"acceleration": 1.0, "dt": 0.0}, "dt must be a positive number"),
        ({"acceleration": 1.0, "dt": 1e-9}, "more than are made"),
        ({"acceleration": 1.0, "tool_speed": -1.0}, "tool_speed must be a positive number"),
    ],
)
def test_bad_options_say_what_is_valid(options, message):
    with pytest.raises(OptionError, match=message):
        followed(ARM, wave(ARM, 20, np.random.default_rng(2))).timed(**options)


def test_the_robots_own_accelerations_count():
    robot = ARM.limited(acceleration=2.0)
    q = wave(robot, 20, np.random.default_rng(2))
    check(followed(robot, q).timed(dt=DT), q, robot.velocity_limit, 2.0)


@pytest.mark.parametrize("library", ["toppra", "ruckig"])
def test_without_the_extra_it_is_named(library, monkeypatch):
    monkeypatch.setitem(sys.modules, library, None)
    with pytest.raises(OptionError, match=rf"needs {library}: pip install 'maira-qp\[time\]'"):
        followed(ARM, wave(ARM, 20, np.random.default_rng(2))).timed(acceleration=1.0, jerk=10.0)


def test_times_beyond_the_trajectory_are_refused():
    t = followed(ARM, wave(ARM, 20, np.random.default_rng(2))).timed(acceleration=1.0)
    for time in (-0.1, t.duration + 1.0, [0.0, 1e9]):
        with pytest.raises(OptionError, match="t must be from 0 to"):
            t.at(time)
    with pytest.raises(OptionError, match="t must"):
        t.at(np.nan)


def test_a_pickle_keeps_everything_but_the_robot():
    path = followed(ARM, wave(ARM, 20, np.random.default_rng(2)))
    t = path.timed(acceleration=1.0)
    again = pickle.loads(pickle.dumps(t))
    assert again.joint_names == ARM.joint_names
    np.testing.assert_array_equal(again.at(t.times), t.at(t.times))
    assert again.as_dict() == t.as_dict()
    assert "tool off the path" in repr(again)
    assert max(map(len, repr(t).splitlines())) <= 80
    with pytest.raises(OptionError, match="pickled path"):
        pickle.loads(pickle.dumps(path)).timed(acceleration=1.0)


def test_a_jerk_of_some_joints_is_kept_and_limits_without_end_are_none(rng):
    """Joints that are not named are free; a limit of 1e300, and a jerk of inf, are as good as none."""
    q = wave(ARM, 30, rng)
    t = followed(ARM, q).timed(acceleration=4.0, jerk={"joint1": 1.0}, dt=DT)
    assert np.abs(differences(t.q[:, 0], 3)).max() <= 1.0 + 1e-6
    assert np.abs(differences(t.q, 3)).max() > 1.5
    free = followed(ARM, q).timed(acceleration=4.0, dt=DT)
    assert followed(ARM, q).timed(acceleration=4.0, jerk=np.inf, dt=DT).duration == free.duration
    assert t.duration > free.duration
    quick = followed(ARM, q).timed(acceleration=1e300, dt=DT).duration
    assert np.abs(np.diff(q, axis=0)).sum(axis=0).max() / ARM.velocity_limit.max() <= quick < free.duration
