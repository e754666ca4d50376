"""Messages of ROS 2 as mappings and as objects: what is written is read back, and names decide the order."""

import array
import json
from types import SimpleNamespace

import numpy as np
import pinocchio as pin
import pytest

import maira_qp as mq
from maira_qp.errors import ConfigurationError, FrameError, OptionError, PoseError
from maira_qp.integrations import ros

STAMP = {"sec": 1_790_000_000, "nanosec": 123_456_789}


@pytest.fixture(scope="module")
def trajectory(maira):
    start = np.radians([0.0, 30.0, 0.0, 70.0, 0.0, 60.0, 0.0])
    poses = [maira.forward(start + 0.02 * k) for k in range(6)]
    return mq.Solver(maira).track(poses, start, dt=0.1)


def as_object(message):
    """A message object: fields as attributes, numbers in typed arrays, as `rosidl` has them."""
    if isinstance(message, dict):
        return SimpleNamespace(**{key: as_object(value) for key, value in message.items()})
    if isinstance(message, list):
        if message and all(isinstance(value, float) for value in message):
            return array.array("d", message)
        return [as_object(value) for value in message]
    return message


@pytest.mark.parametrize("form", [dict, as_object, lambda message: json.loads(json.dumps(message))])
def test_a_joint_state_comes_back(maira, rng, form):
    q, v, effort = maira.random_configuration(rng), rng.normal(size=7), rng.normal(size=7)
    message = ros.to_joint_state(maira, q, v, effort, stamp=STAMP, frame_id="base")
    assert set(message) == {"header", "name", "position", "velocity", "effort"}
    assert message["header"] == {"stamp": STAMP, "frame_id": "base"}
    read = ros.from_joint_state(maira, form(message))
    for value, expected in zip(read[:3], (q, v, effort), strict=True):
        np.testing.assert_array_equal(value, expected)
    assert read.stamp == STAMP
    again = ros.to_joint_state(maira, read.q, stamp=read.stamp)
    assert (again["header"]["stamp"], again["velocity"], again["effort"]) == (STAMP, [], [])
    assert ros.from_joint_state(maira, form(again)).velocity is None


def test_names_decide_the_order_and_others_are_skipped(maira, rng):
    """As a controller sends them: by the alphabet, a gripper among them."""
    q = maira.random_configuration(rng)
    message = ros.to_joint_state(maira, q, 2 * q)
    values = dict(zip(message["name"], q, strict=True)) | {"a_gripper": 9.0, "joint10": 8.0}
    names = sorted(values, reverse=True)
    shuffled = {
        **message,
        "name": names,
        "position": [values[n] for n in names],
        "velocity": [2 * values[n] for n in names],
    }
    read = ros.from_joint_state(maira, shuffled)
    np.testing.assert_array_equal(read.q, q)
    np.testing.assert_array_equal(read.velocity, 2 * q)


@pytest.mark.parametrize("form", [dict, as_object])
def test_a_joint_trajectory_comes_back_and_is_what_save_writes(maira, trajectory, tmp_path, form):
    message = ros.to_joint_trajectory(trajectory)
    assert json.loads(mq.save(trajectory, tmp_path / "path.ros.json").read_text()) == message
    read = ros.from_joint_trajectory(maira, form(message))
    np.testing.assert_array_equal(read.q, trajectory.q)
    np.testing.assert_allclose(read.times, 0.1 * np.arange(6), rtol=0, atol=1e-9)
    assert (read.velocity, read.acceleration) == (None, None)
    assert ros.to_joint_trajectory(trajectory, stamp=2.5)["header"]["stamp"] == {"sec": 2, "nanosec": 500_000_000}


def test_points_are_read_by_name_with_their_velocities(maira, trajectory):
    message = ros.to_joint_trajectory(trajectory)
    turned = {**message, "joint_names": message["joint_names"][::-1]}
    turned["points"] = [
        {**point, "positions": point["positions"][::-1], "velocities": [0.1 * k for k in range(7)]}
        for point in message["points"]
    ]
    read = ros.from_joint_trajectory(maira, turned)
    np.testing.assert_array_equal(read.q, trajectory.q)
    np.testing.assert_allclose(read.velocity, np.tile(0.1 * np.arange(7)[::-1], (6, 1)))


@pytest.mark.parametrize("form", [dict, as_object])
def test_a_pose_comes_back_in_the_base_whatever_frame_it_was_in(maira, rng, form):
    for frame in (None, "", "/" + maira.base, *maira.frames):
        q, target = maira.random_configuration(rng), maira.forward(maira.random_configuration(rng))
        message = ros.to_pose_stamped(maira, target, frame_id=frame, q=q, stamp=STAMP)
        assert message["header"]["stamp"] == STAMP
        read = ros.from_pose_stamped(maira, form(message), q)
        np.testing.assert_allclose(read.homogeneous, target.homogeneous, rtol=0, atol=1e-14)


def test_a_pose_in_the_hand_is_where_the_hand_is(maira, rng):
    """1 cm along the tool's z axis, quaternion with the scalar last, a quarter turn about it."""
    q = maira.random_configuration(rng)
    message = {
        "header": {"stamp": STAMP, "frame_id": maira.tip},
        "pose": {
            "position": {"x": 0.0, "y": 0.0, "z": 0.01},
            "orientation": {"x": 0.0, "y": 0.0, "z": np.sqrt(0.5), "w": np.sqrt(0.5)},
        },
    }
    expected = maira.forward(q) * pin.SE3(pin.rpy.rpyToMatrix(0.0, 0.0, np.pi / 2), np.array([0.0, 0.0, 0.01]))
    read = ros.from_pose_stamped(maira, message, q)
    np.testing.assert_allclose(read.homogeneous, expected.homogeneous, rtol=0, atol=1e-14)
    with pytest.raises(ConfigurationError, match="moves with the robot"):
        ros.from_pose_stamped(maira, message)
    assert mq.Solver(maira).solve(read, q).success


@pytest.mark.parametrize("form", [dict, as_object])
def test_the_fields_that_a_message_may_leave_empty_may_be_missing(maira, rng, form):
    """They are as those that are empty."""
    q, zero, names = maira.random_configuration(rng), {"sec": 0, "nanosec": 0}, list(maira.joint_names)
    read = ros.from_joint_state(maira, form({"name": names, "position": q.tolist()}))
    np.testing.assert_array_equal(read.q, q)
    assert (read.velocity, read.effort, read.stamp) == (None, None, zero)
    points = [{"positions": q.tolist(), "time_from_start": {"sec": k, "nanosec": 0}} for k in range(2)]
    samples = ros.from_joint_trajectory(maira, form({"joint_names": names, "points": points}))
    np.testing.assert_array_equal(samples.q, [q, q])
    assert (samples.velocity, samples.acceleration, samples.stamp) == (None, None, zero)
    place = ros.to_pose_stamped(maira, maira.forward(q))
    read = ros.from_pose_stamped(maira, form({"pose": place["pose"]}))
    np.testing.assert_allclose(read.homogeneous, maira.forward(q).homogeneous, rtol=0, atol=1e-14)
    hand = {"header": {"frame_id": maira.tip}, "pose": place["pose"]}
    T = ros.from_pose_stamped(maira, form(hand), q)
    np.testing.assert_allclose(T.homogeneous, (maira.forward(q) * maira.forward(q)).homogeneous, rtol=0, atol=1e-14)
    for read, message in ((ros.from_joint_state, {"name": names}), (ros.from_pose_stamped, {"header": {}})):
        with pytest.raises((ConfigurationError, OptionError), match=r"without positions|no field 'pose'"):
            read(maira, form(message))


def test_mistakes_name_what_is_valid(maira, trajectory):
    state, plan = ros.to_joint_state(maira, maira.middle), ros.to_joint_trajectory(trajectory)
    place = ros.to_pose_stamped(maira, pin.SE3.Identity())
    zero = {"position": dict.fromkeys("xyz", 0.0), "orientation": dict.fromkeys("xyzw", 0.0)}
    short = {**plan, "points": [*plan["points"][:2], {**plan["points"][2], "positions": [1.0]}]}
    some = {**plan, "points": [{**plan["points"][0], "velocities": [0.0] * 7}, *plan["points"][1:]]}
    untimed = mq.Solver(maira).track([maira.forward(maira.middle)], maira.middle)
    calls = [
        (
            lambda: ros.from_joint_state(maira, {**state, "name": state["name"][1:]}),
            OptionError,
            "the names lack 'joint1'; given: joint2, ",
        ),
        (
            lambda: ros.from_joint_state(maira, {**state, "name": ["joint1", *state["name"]]}),
            OptionError,
            "twice",
        ),
        (
            lambda: ros.from_joint_state(maira, {**state, "position": [1.0]}),
            ConfigurationError,
            "7 names, but 1 values",
        ),
        (lambda: ros.from_joint_state(maira, {**state, "position": []}), ConfigurationError, "without positions"),
        (lambda: ros.from_joint_state(maira, {**state, "position": [np.nan] * 7}), ConfigurationError, "position"),
        (lambda: ros.from_joint_state(maira, place), OptionError, "no field 'name'"),
        (lambda: ros.from_joint_state(maira, None), OptionError, "no field 'name'"),
        (lambda: ros.from_joint_state(maira, {**state, "name": [1]}), OptionError, "names of joints"),
        (lambda: ros.to_joint_state(maira, [0.0]), ConfigurationError, "position"),
        (lambda: ros.to_joint_state(maira, maira.middle, stamp="now"), OptionError, "sec and nanosec"),
        (lambda: ros.to_joint_state(maira, maira.middle, frame_id=3), OptionError, "frame_id"),
        (lambda: ros.from_joint_trajectory(maira, short), ConfigurationError, "point 2: 7 names, but 1 values"),
        (lambda: ros.from_joint_trajectory(maira, some), ConfigurationError, "point 1 has no velocities"),
        (lambda: ros.to_joint_trajectory(untimed), OptionError, "needs times"),
        (lambda: ros.to_joint_trajectory([1]), OptionError, "PathSolution or a Trajectory"),
        (lambda: ros.from_pose_stamped(maira, {**place, "pose": zero}), PoseError, "all zeros"),
        (lambda: ros.to_pose_stamped(maira, np.eye(4), frame_id="map"), FrameError, "'map' is not a frame of maira"),
        (lambda: ros.to_pose_stamped(maira, np.zeros((4, 4))), PoseError, "target"),
    ]
    for call, error, message in calls:
        with pytest.raises(error, match=message):
            call()
