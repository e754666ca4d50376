"""A log for the Rerun viewer: the arm as its URDF and as a line through its links, curves of its joints and errors."""

from __future__ import annotations

import importlib.util
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from maira_qp.errors import OptionError, RobotError
from maira_qp.robots.collision.urdf_geometry import without_ellipsoids
from maira_qp.robots.model.robot import Robot


def check_rerun() -> None:
    """Whether a log can be written. Raises `OptionError`."""
    if importlib.util.find_spec("rerun") is None:
        raise OptionError("a log for Rerun needs rerun-sdk: pip install 'maira-qp[rerun]'")


def write_rerun(file: BinaryIO, robot: Robot, columns: Mapping[str, np.ndarray]) -> None:
    """Write a motion, over its `time` [s] or else over its `pose`.

    Joints q (N, n) and, if there are any, their velocities and accelerations are curves by name, as is each further
    column of numbers (N,). Raises `OSError`.
    """
    import rerun as rr  # pyright: ignore[reportMissingImports]

    recording = rr.RecordingStream("maira_qp")
    stream = rr.binary_stream(recording=recording)
    if "time" in columns:
        index = rr.TimeColumn("time", duration=columns["time"])
    else:
        index = rr.TimeColumn("pose", sequence=columns["pose"])

    def send(place: str, values: Any) -> None:
        rr.send_columns(place, indexes=[index], columns=values, recording=recording)

    for name, array in columns.items():
        if name in ("time", "pose"):
            continue
        if array.ndim == 1:
            send(name, rr.Scalars.columns(scalars=array.astype(float)))
        else:
            for joint, values in zip(robot.joint_names, array.T, strict=True):
                send(f"{name}/{joint}", rr.Scalars.columns(scalars=np.ascontiguousarray(values)))
    send("arm", rr.LineStrips3D.columns(strips=_lines(robot, columns["q"])))
    _write_urdf(robot, columns["q"], recording, send)
    recording.flush()
    file.write(stream.read() or b"")


def _lines(robot: Robot, q: np.ndarray) -> list[list[list[float]]]:
    """The origins of the links behind each joint, and of the tool [m], for each configuration (N, n)."""
    frames = [*robot.moved_links, robot.tip]
    at = [robot.at(each) for each in q]
    return [[[0.0, 0.0, 0.0], *(each.placement(frame).translation.tolist() for frame in frames)] for each in at]


def _write_urdf(robot: Robot, q: np.ndarray, recording: Any, send: Any) -> None:
    """The description, and where each of its joints is; nothing for a robot of which there is none."""
    from rerun.urdf import UrdfTree  # pyright: ignore[reportMissingImports]

    try:
        text = without_ellipsoids(robot.urdf)
    except RobotError:
        return
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "robot.urdf")
        path.write_text(text, encoding="utf-8")
        tree = UrdfTree.from_file_path(path)
    tree.log_urdf_to_recording(recording)
    for name, values in zip(robot.joint_names, q.T, strict=True):
        joint = tree.get_joint_by_name(name)
        if joint is not None:
            send(f"transforms/{name}", joint.compute_transform_columns(values.tolist(), clamp=False))
