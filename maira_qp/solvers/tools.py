"""A tool that is given with a call: what it is told apart by, and what is asked of the tip asked of the tool."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields, is_dataclass, replace
from typing import Any

import pinocchio as pin

from maira_qp.arrays import is_native
from maira_qp.problem.redundancy import Strict
from maira_qp.robots.model.edits import placement, unused
from maira_qp.robots.model.robot import Robot

MOST_TOOLS = 16
"""So many solvers for tools are kept, those that were made last."""

NAMES, PARTS = ("frame", "reference"), ("limit", "objective")
"""Fields of tasks, limits and objectives that hold the name of a frame, and those that hold such things."""


def key_of(tool: Any) -> tuple[tuple[str, bytes], ...]:
    """What a tool is told apart by, one pose or {tip: pose}. Raises `PoseError` for what cannot be one."""
    poses = tool if isinstance(tool, Mapping) else {"": tool}
    return tuple((str(tip), _bytes_of(pose)) for tip, pose in poses.items())


def _bytes_of(pose: Any) -> bytes:
    """Of an array as it is: whether it is a pose is checked when a solver is made for it."""
    if isinstance(pose, pin.SE3):
        return pose.homogeneous.tobytes()
    return pose.tobytes() if is_native(pose, (4, 4)) else placement(pose, "tool").homogeneous.tobytes()


def names_for(tool: Any, robot: Robot) -> Any:
    """Names that no frame of the robot has, as `Robot.with_tool` takes them."""
    if isinstance(tool, Mapping):
        return {tip: unused(f"{tip}_tool", robot.frames) for tip in tool}
    return unused("tool", robot.frames)


def on_frames(value: Any, names: Mapping[str, str]) -> Any:
    """Tasks, limits and objectives, in lists, tuples and mappings, on frames of other names {old: new}."""
    if isinstance(value, dict):
        return {key: on_frames(each, names) for key, each in value.items()}
    if isinstance(value, (list, tuple)):
        return type(value)(on_frames(each, names) for each in value)
    if isinstance(value, Strict):
        return Strict(*on_frames(value.objectives, names))
    if not is_dataclass(value) or isinstance(value, type):
        return value
    changes = dict[str, Any]()
    for key in (each.name for each in fields(value) if each.init):
        old = getattr(value, key)
        if key in NAMES and isinstance(old, str):
            changes[key] = names.get(old, old)
        elif key in PARTS:
            changes[key] = on_frames(old, names)
    changed = {key: new for key, new in changes.items() if new is not getattr(value, key)}
    return replace(value, **changed) if changed else value
