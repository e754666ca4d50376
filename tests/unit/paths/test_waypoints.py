"""Waypoints at even times: limits by finite differences, and where the tool is when."""

import itertools

import numpy as np
import pytest
from support.paths import distances, random_poses, rotation_angles

import maira_qp as mq
from maira_qp import paths
from maira_qp.errors import OptionError

SPEED, ACCELERATION, ANGULAR_SPEED, ANGULAR_ACCELERATION = 0.4, 1.5, 1.2, 5.0
LIMITS = {
    "speed": SPEED,
    "acceleration": ACCELERATION,
    "angular_speed": ANGULAR_SPEED,
    "angular_acceleration": ANGULAR_ACCELERATION,
}


def test_waypoints_keep_speed_and_acceleration_and_stop_at_each(rng):
    dt, poses = 0.01, random_poses(rng, 6, spread=0.3)
    path = paths.waypoints(poses, dt, **LIMITS)
    velocity = np.diff(path[:, :3, 3], axis=0) / dt
    velocity = np.concatenate([np.zeros((1, 3)), velocity, np.zeros((1, 3))])  # it comes from rest and stays at rest
    assert np.linalg.norm(velocity, axis=1).max() <= SPEED * (1 + 1e-9)
    assert np.linalg.norm(np.diff(velocity, axis=0), axis=1).max() / dt <= ACCELERATION * (1 + 1e-6)
    rate = rotation_angles(path) / dt
    assert rate.max() <= ANGULAR_SPEED * (1 + 1e-6)
    off = np.abs(path[:, None] - poses).max(axis=(2, 3))
    assert off.min(axis=0).max() < 1e-12
    stops = off.argmin(axis=0)
    assert (np.diff(stops) > 1).all()
    for begin, end in itertools.pairwise(stops):
        change = np.diff(np.concatenate([[0.0], rate[begin:end], [0.0]])) / dt
        assert np.abs(change).max() <= ANGULAR_ACCELERATION * (1 + 1e-6)


def test_waypoints_waste_no_time(rng):
    """The duration of a move is that of the textbook's trapezoid, to the next whole dt."""
    dt, a, v = 0.001, 1.0, 0.5
    for d in (0.01, 0.249, 0.251, 2.0):
        path = paths.waypoints([mq.pose(), mq.pose([d, 0, 0])], dt, speed=v, acceleration=a)
        expected = d / v + v / a if d >= v * v / a else 2 * np.sqrt(d / a)
        np.testing.assert_allclose((len(path) - 1) * dt, expected, atol=dt)
        x = path[:, 0, 3]
        assert (np.diff(x) > 0).all()
        np.testing.assert_allclose(x + x[::-1], d, atol=1e-12)
        times = np.linspace(0, expected, len(path))
        ramp = min(v / a, np.sqrt(d / a))
        rising = times < ramp
        np.testing.assert_allclose(x[rising], a * times[rising] ** 2 / 2, atol=5 * dt * v)


def test_a_turn_on_the_spot_takes_its_time():
    path = paths.waypoints([mq.pose(), mq.pose(rpy=[0, 0, 1.0])], 0.01, angular_speed=0.5)
    assert len(path) == 201
    np.testing.assert_allclose(rotation_angles(path), 0.005, rtol=1e-9)


def test_without_stops_the_speed_is_kept_through_the_poses(rng):
    dt = 0.01
    corners = random_poses(rng, 5, spread=0.4)
    smooth = paths.polyline(corners, blend=0.05, step=0.002)
    path = paths.waypoints(smooth, dt, stop=False, speed=0.2, acceleration=0.4, angular_speed=100.0)
    np.testing.assert_allclose(path[[0, -1]], corners[[0, -1]], atol=1e-12)
    speed = np.concatenate([[0.0], distances(path), [0.0]]) / dt
    assert speed.max() <= 0.2 * (1 + 1e-9)
    middle = speed[60:-60]
    assert middle.min() > 0.9 * 0.2
    assert np.diff(speed).max() <= 0.4 * dt * (1 + 1e-6) + 0.02 * 0.2  # chords over the facets of the polygon


def test_without_stops_every_leg_keeps_its_own_accelerations():
    """First a line, then a turn on the spot, which may accelerate less: it brakes the end of the path."""
    dt, poses = 0.01, [mq.pose(), mq.pose([0.2, 0, 0]), mq.pose([0.2, 0, 0], rpy=[0, 0, 1.0])]
    limits = {"speed": 0.5, "angular_speed": 2.0, "acceleration": 1.0, "angular_acceleration": 1.0}
    for given in (poses, poses[::-1]):
        path = paths.waypoints(given, dt, stop=False, **limits)
        turning, moving = rotation_angles(path) / dt, distances(path) / dt
        for speed, acceleration in ((turning, 1.0), (moving, 1.0)):
            own = speed[speed > 1e-6]
            assert np.abs(np.diff(own[1:-1])).max() / dt <= acceleration * (1 + 1e-6)


def test_each_pose_is_reached_at_its_time(rng):
    poses, times = random_poses(rng, 5), np.array([1.0, 1.5, 1.75, 3.0, 3.25])
    path = paths.waypoints(poses, 0.25, times=times)
    assert len(path) == 10
    np.testing.assert_allclose(path[np.round((times - 1.0) / 0.25).astype(int)], poses, atol=1e-12)
    steps = np.diff(path[:, :3, 3], axis=0)
    np.testing.assert_allclose(steps[3:8], np.tile((poses[3] - poses[2])[:3, 3] / 5, (5, 1)), atol=1e-12)


def test_the_last_pose_is_held_to_the_end_of_its_dt(rng):
    poses = random_poses(rng, 2)
    path = paths.waypoints(poses, 0.3, times=[0.0, 1.0])
    assert len(path) == 5
    np.testing.assert_allclose(path[[0, -1]], poses, atol=1e-12)
    np.testing.assert_allclose(path[3, :3, 3], 0.1 * poses[0, :3, 3] + 0.9 * poses[1, :3, 3], atol=1e-12)


@pytest.mark.parametrize("options", [{}, {"times": [2.0]}, {"stop": False}, {"acceleration": 1.0}])
def test_one_pose_is_one_pose(options):
    np.testing.assert_allclose(paths.waypoints([mq.pose([1, 2, 3])], 0.1, **options), [mq.pose([1, 2, 3]).homogeneous])


@pytest.mark.parametrize(
    ("dt", "options", "message"),
    [
        (0.1, {"times": [0.0, 2.0, 1.0]}, r"times must increase: times\[2\] = 1 comes after 2"),
        (0.1, {"times": [0.0, 1.0, 1.0]}, "times must increase"),
        (0.1, {"times": [0.0, 1.0]}, "times must be real numbers of shape"),
        (0.1, {"times": [0.0, 1.0, np.nan]}, "times must be finite"),
        (0.1, {"times": [0.0, 1.0, 2.0], "speed": 1.0}, "either times or speed"),
        (1e-9, {"times": [0.0, 1.0, 2.0]}, "choose larger"),
        (0, {}, "dt must be a positive number of seconds"),
        (np.nan, {}, "dt must be a number of seconds"),
        (0.1, {"speed": -1.0}, "speed must be a positive number"),
        (0.1, {"acceleration": 0.0}, "acceleration must be a positive number"),
        (0.1, {"angular_speed": "fast"}, "angular_speed must be a number"),
        (0.1, {"stop": 1}, "stop must be True or False"),
        (1e-9, {}, "choose larger"),
    ],
)
def test_times_and_limits_that_make_no_sense_are_named(dt, options, message):
    with pytest.raises(OptionError, match=message):
        paths.waypoints([mq.pose(), mq.pose([0.1, 0, 0]), mq.pose([0.1, 0.1, 0])], dt, **options)
