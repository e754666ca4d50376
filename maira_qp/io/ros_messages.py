"""Messages of ROS 2 as plain mappings, fields as `rosidl` names them; nothing of ROS is needed.

`rosidl_runtime_py.set_message_fields(message, fields)` makes message objects of them. Stamps are mappings
{"sec", "nanosec"}, as `builtin_interfaces/Time` and `Duration`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from maira_qp.arrays import is_number
from maira_qp.errors import OptionError, shown

NANOSECONDS = 10**9
"""Per second."""
Message = dict[str, Any]
"""A message as a mapping {field: value}."""


def stamp_of(seconds: Any) -> dict[str, int]:
    """A stamp of seconds, or the same stamp where it is one, a mapping or a message object. Raises `OptionError`."""
    if is_number(seconds) and np.isfinite(seconds):
        whole, rest = divmod(round(float(seconds) * NANOSECONDS), NANOSECONDS)
        return {"sec": whole, "nanosec": rest}
    sec, nanosec = (
        seconds.get(key) if isinstance(seconds, Mapping) else getattr(seconds, key, None) for key in ("sec", "nanosec")
    )
    if not (_is_integer(sec) and _is_integer(nanosec)):
        raise OptionError(f"stamp must be a number of seconds, or have sec and nanosec, got {shown(seconds)}")
    return {"sec": int(sec), "nanosec": int(nanosec)}  # type: ignore[arg-type]


def _is_integer(value: Any) -> bool:
    """Whether a value is a whole number of Python's or NumPy's."""
    return isinstance(value, (int, np.integer)) and not isinstance(value, bool)


def header(stamp: Any = 0.0, frame_id: str = "") -> Message:
    """A `std_msgs/Header`. Raises `OptionError`."""
    if not isinstance(frame_id, str):
        raise OptionError(f"frame_id must be the name of a frame, got {shown(frame_id)}")
    return {"stamp": stamp_of(stamp), "frame_id": frame_id}


def joint_trajectory(
    joint_names: Sequence[str], columns: Mapping[str, np.ndarray], stamp: Any = 0.0, frame_id: str = ""
) -> Message:
    """A `trajectory_msgs/JointTrajectory`.

    `columns`: "time" (M,) [s], "q" (M, n) [rad, or m] and, where they are known, "velocity" and "acceleration".
    Raises `OptionError` without times.
    """
    if "time" not in columns:
        raise OptionError(
            "a JointTrajectory needs times, which this path has not: save path.timed(...), or track with dt"
        )
    none = np.empty((len(columns["q"]), 0))
    arrays = [columns.get(name, none).tolist() for name in ("q", "velocity", "acceleration")]
    points = [
        {
            "positions": q,
            "velocities": velocity,
            "accelerations": acceleration,
            "effort": [],
            "time_from_start": stamp_of(time),
        }
        for q, velocity, acceleration, time in zip(*arrays, columns["time"].tolist(), strict=True)
    ]
    return {"header": header(stamp, frame_id), "joint_names": list(joint_names), "points": points}
