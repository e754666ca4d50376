"""Messages of ROS 2 to and from a robot: `JointState`, `JointTrajectory`, `PoseStamped`. ROS itself is not needed.

What is made is plain mappings {field: value}, which JSON holds and `rosidl_runtime_py.set_message_fields` makes message
objects of. What is read may be such a mapping or a message object with the same attributes. Joints are found by their
names, in whatever order; those that are not the robot's are skipped. Quaternions of messages are (x, y, z, w). What is
read may lack the fields that a message may leave empty: the header, velocities, accelerations and efforts.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin

from maira_qp.arrays import real_array
from maira_qp.errors import ConfigurationError, FrameError, OptionError, PoseError, listed, shown
from maira_qp.io.ros_messages import NANOSECONDS, Message, header, joint_trajectory, stamp_of
from maira_qp.io.save import Motion, columns
from maira_qp.problem.pose import as_pose, pose
from maira_qp.results.path_solution import PathSolution
from maira_qp.results.trajectory import Trajectory
from maira_qp.robots.model.robot import Robot


class JointReadings(NamedTuple):
    """What a `JointState` says of a robot, joints in the robot's order."""

    q: np.ndarray
    """Configuration (n,) [rad, or m]"""
    velocity: np.ndarray | None
    """(n,) [rad/s, or m/s]; None: the message has none."""
    effort: np.ndarray | None
    """(n,) [N m, or N]; None: the message has none."""
    stamp: dict[str, int]
    """When it was, {"sec", "nanosec"}"""


class JointSamples(NamedTuple):
    """What a `JointTrajectory` asks of a robot, joints in the robot's order."""

    times: np.ndarray
    """(M,) [s] from the start"""
    q: np.ndarray
    """Configurations (M, n) [rad, or m]"""
    velocity: np.ndarray | None
    """(M, n) [rad/s, or m/s]; None: the message has none."""
    acceleration: np.ndarray | None
    """(M, n) [rad/s^2, or m/s^2]; None: the message has none."""
    stamp: dict[str, int]
    """When it starts, {"sec", "nanosec"}; zero: at once."""


def to_joint_state(
    robot: Robot, q: Any, velocity: Any = None, effort: Any = None, *, stamp: Any = 0.0, frame_id: str = ""
) -> Message:
    """Make a `sensor_msgs/JointState`.

    Args:
        robot: gives the names.
        q: configuration (n,) [rad, or m].
        velocity, effort: (n,); None: left out.
        stamp: seconds, or a stamp of another message, which is kept to the nanosecond.
        frame_id: of the header.

    Raises `ConfigurationError`, `OptionError`.
    """
    values = {"position": q, "velocity": velocity, "effort": effort}
    rows = {
        name: [] if value is None else real_array(value, (robot.n,), name, ConfigurationError).tolist()
        for name, value in values.items()
    }
    return {"header": header(stamp, frame_id), "name": list(robot.joint_names), **rows}


def from_joint_state(robot: Robot, message: Any) -> JointReadings:
    """Read a `sensor_msgs/JointState`.

    Raises `OptionError` where a joint of the robot is missing or named twice, and for what is no such message;
    `ConfigurationError` where the arrays have other lengths than the names.
    """
    names = _names(message, "name")
    places = robot.order(names)
    q = _row(message, "position", names, places)
    if q is None:
        raise ConfigurationError("a JointState without positions says nothing of where the robot is")
    velocity, effort = (_row(message, key, names, places) for key in ("velocity", "effort"))
    return JointReadings(q, velocity, effort, _stamp(message))


def to_joint_trajectory(motion: Motion, *, stamp: Any = 0.0, frame_id: str = "") -> Message:
    """Make a `trajectory_msgs/JointTrajectory` of a trajectory, or of a path that was tracked with `dt`.

    `stamp`: when it is to start, seconds or a stamp; zero: at once. What `mq.save(motion, "name.ros.json")` writes.
    Raises `OptionError` for a path without times.
    """
    if not isinstance(motion, (PathSolution, Trajectory)):
        raise OptionError(f"a JointTrajectory is made of a PathSolution or a Trajectory, not of {shown(motion)}")
    return joint_trajectory(motion.joint_names, columns(motion), stamp, frame_id)


def from_joint_trajectory(robot: Robot, message: Any) -> JointSamples:
    """Read a `trajectory_msgs/JointTrajectory`.

    Raises `OptionError` where a joint of the robot is missing or named twice, and for what is no such message;
    `ConfigurationError` where a point has other lengths than the names.
    """
    names = _names(message, "joint_names")
    places = robot.order(names)
    points = list(_field(message, "points"))
    times = np.array([_seconds(_field(point, "time_from_start")) for point in points])
    arrays = []
    for key in ("positions", "velocities", "accelerations"):
        rows = [_row(point, key, names, places, f"point {i}: ") for i, point in enumerate(points)]
        is_there = [row is not None for row in rows]
        if any(is_there) and not all(is_there):
            raise ConfigurationError(f"point {is_there.index(False)} has no {key}, others have")
        arrays.append(np.array(rows).reshape(-1, robot.n) if all(is_there) else None)
    q, velocity, acceleration = arrays
    if q is None:
        raise ConfigurationError("a JointTrajectory without positions says nothing of where the robot goes")
    return JointSamples(times, q, velocity, acceleration, _stamp(message))


def to_pose_stamped(
    robot: Robot, target: Any, *, frame_id: str | None = None, q: Any = None, stamp: Any = 0.0
) -> Message:
    """Make a `geometry_msgs/PoseStamped`.

    Args:
        robot: gives the frames.
        target: pose in the robot's base, `pin.SE3` or (4, 4) [m].
        frame_id: frame of the robot in which the message has it; None: the base.
        q: configuration (n,) at which that frame is, if it moves.
        stamp: seconds, or a stamp of another message.

    Raises `PoseError`, `FrameError`, `ConfigurationError`, `OptionError`.
    """
    name = robot.base if frame_id is None else frame_id
    T = _placement(robot, name, q).inverse() * as_pose(target)
    x, y, z, w = pin.Quaternion(T.rotation).normalized().coeffs().tolist()
    position = dict(zip("xyz", T.translation.tolist(), strict=True))
    body = {"position": position, "orientation": {"x": x, "y": y, "z": z, "w": w}}
    return {"header": header(stamp, name), "pose": body}


def from_pose_stamped(robot: Robot, message: Any, q: Any = None) -> pin.SE3:
    """Read a `geometry_msgs/PoseStamped` as a pose in the robot's base [m], which every verb takes.

    `q` (n,): where the robot stands, for a `frame_id` that moves. An empty or missing `frame_id` is the base.
    Raises `PoseError` for what is no pose; `FrameError` for a frame that is none of the robot's; `ConfigurationError`
    for one that moves, without q; `OptionError` for what is no such message.
    """
    frame = _field(_field(message, "header", {}), "frame_id", "")
    body = _field(message, "pose")
    position = [_field(_field(body, "position"), key) for key in "xyz"]
    quaternion = [_field(_field(body, "orientation"), key) for key in "wxyz"]
    if not any(quaternion):
        raise PoseError("the orientation of the message is all zeros, as that of one that was not filled in")
    return _placement(robot, frame, q) * pose(position, quaternion=quaternion)


def _placement(robot: Robot, frame: Any, q: Any) -> pin.SE3:
    """Where a frame is in the base. Raises `FrameError`, `ConfigurationError`."""
    name = frame.removeprefix("/") if isinstance(frame, str) else frame
    if name in ("", robot.base):
        return pin.SE3.Identity()
    if name not in robot.frames:
        raise FrameError(f"frame_id {shown(frame)} is not a frame of {robot.name}; {listed(robot.frames, name)}")
    if q is None:
        if robot.model.frames[robot.frame_id(name)].parentJoint != 0:
            raise ConfigurationError(f"the frame {name!r} moves with the robot: say where it stands, q=...")
        q = robot.middle
    return robot.forward(q, name)


def _field(message: Any, key: str, empty: Any = None) -> Any:
    """A field of a mapping or of a message object; where there is none, `empty`, or, if None, `OptionError`."""
    if isinstance(message, Mapping):
        if key in message:
            return message[key]
    elif hasattr(message, key):
        return getattr(message, key)
    if empty is not None:
        return empty
    raise OptionError(f"a message of another type: no field {key!r} in {shown(message)}")


def _names(message: Any, key: str) -> list[str]:
    names = list(_field(message, key))
    if not all(isinstance(name, str) for name in names):
        raise OptionError(f"the field {key!r} must hold names of joints, got {shown(names)}")
    return names


def _row(message: Any, key: str, names: list[str], places: np.ndarray, where: str = "") -> np.ndarray | None:
    """The values (n,) of the robot's joints, None where the field is empty. Raises `ConfigurationError`."""
    values = _field(message, key, ())
    if len(values) == 0:
        return None
    if len(values) != len(names):
        raise ConfigurationError(f"{where}{len(names)} names, but {len(values)} values of {key}")
    return real_array([values[place] for place in places], (len(places),), f"{where}{key}", ConfigurationError)


def _stamp(message: Any) -> dict[str, int]:
    return stamp_of(_field(_field(message, "header", {}), "stamp", 0.0))


def _seconds(duration: Any) -> float:
    stamp = stamp_of(duration)
    return stamp["sec"] + stamp["nanosec"] / NANOSECONDS
