"""Targets that are given in another frame than the robot's base: in one of its frames, or in the room it stands in."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pinocchio as pin

from maira_qp.arrays import is_listing
from maira_qp.errors import ConfigurationError, OptionError, PoseError, shown
from maira_qp.orientation import A_POSE
from maira_qp.problem.naming import POINT, POSE
from maira_qp.problem.pose import as_pose
from maira_qp.problem.problem import Problem
from maira_qp.problem.targets import poses_of_batch, rows_of
from maira_qp.robots.model.robot import Robot


def in_base(target: Any, problem: Problem, q: np.ndarray | None, in_frame: str | None, base: Any) -> Any:
    """A target, or targets, that are relative to a frame or to the room, relative to the base.

    Args:
        target: as a verb takes it. The poses, points and directions that stand in the base by what the problem's parts
            say of their data are moved, what else it holds stays, and what is no target goes through, for others to
            refuse.
        problem: whose parts its keys are.
        q: configuration (n,) at which the frame is looked at, or (N, n); None: not known.
        in_frame: name of a frame of the robot; None: the target is given in a room.
        base: T_room_base, (4, 4) or (N, 4, 4): where the base stands in the room that the target is given in.

    Raises `FrameError`, `ConfigurationError`, `PoseError`, `OptionError`.
    """
    if in_frame is not None and base is not None:
        raise OptionError("give in_frame, a frame of the robot, or base, where it stands in a room, not both")
    T = _base_from_room(base) if in_frame is None else _base_from_frame(in_frame, problem.robot, q)
    keys = problem.target_keys
    bare = problem.data.get(keys[0], "") if len(keys) == 1 else POSE
    return _moved(target, T, problem.data, bare)


def _base_from_frame(frame: str, robot: Robot, q: np.ndarray | None) -> np.ndarray:
    """T_base_frame (4, 4) or (N, 4, 4)."""
    if robot.model.frames[robot.frame_id(frame)].parentJoint == 0:
        q = robot.middle  # any will do
    if q is None:
        raise ConfigurationError(f"the frame {frame!r} moves with the joints, so that in_frame needs q0: where is it?")
    poses = [robot.at(each).placement(frame).homogeneous for each in np.atleast_2d(q)]
    return poses[0] if q.ndim == 1 else np.array(poses).reshape(-1, 4, 4)


def _base_from_room(base: Any) -> np.ndarray:
    """T_base_room (4, 4) or (N, 4, 4), NaN where a base holds NaN or inf."""
    if isinstance(base, pin.SE3) or np.ndim(base) == 2:
        return as_pose(base, "base").inverse().homogeneous
    if not is_listing(base):
        raise PoseError(f"base must be {A_POSE}, or a list of those, got {shown(base)}")
    rows, _ = rows_of(poses_of_batch(base, "base"), "base")
    R, p = rows[:, :9].reshape(-1, 3, 3).swapaxes(1, 2), rows[:, 9:, None]
    T = np.tile(np.eye(4), (len(rows), 1, 1))
    T[:, :3, :3], T[:, :3, 3] = R, -(R @ p)[..., 0]
    return T


def _moved(target: Any, T: np.ndarray, data: Mapping[str, str], datum: str = POSE) -> Any:
    """A target, or a batch of them, by T (4, 4), or each by its own (N, 4, 4); of a mapping each value as its datum."""
    if isinstance(target, Mapping):
        kinds = ((name, value, data.get(name) if isinstance(name, str) else None) for name, value in target.items())
        return {name: _moved(value, T, {}, kind) if kind else value for name, value, kind in kinds}
    if isinstance(target, pin.SE3):
        target = target.homogeneous
    elif isinstance(target, (list, tuple)):
        if any(isinstance(each, Mapping) for each in target):
            return [_moved(each, own, data) for each, own in zip(target, _one_each(T, len(target)), strict=True)]
        target = [each.homogeneous if isinstance(each, pin.SE3) else each for each in target]
    if not datum:
        return target
    try:
        values = np.asarray(target, dtype=np.float64)
    except (TypeError, ValueError):
        return target
    shape = (4, 4) if values.shape[-2:] == (4, 4) or datum == POSE else (3,)
    one = len(shape)
    if values.shape[-one:] != shape or values.ndim > one + 1 or not len(values):
        return target
    if values.ndim > one and T.ndim == 3:
        T = _one_each(T, len(values))
    if one == 2:
        return np.ascontiguousarray(T @ values)
    moved = (T[..., :3, :3] @ values[..., None])[..., 0]
    return moved + T[..., :3, 3] if datum == POINT else moved


def _one_each(T: np.ndarray, count: int) -> np.ndarray:
    """T (4, 4) for all, or (N, 4, 4) where N is the count. Raises `PoseError`."""
    if T.ndim == 2:
        return np.broadcast_to(T, (count, 4, 4))
    if len(T) != count:
        raise PoseError(f"there are {len(T)} bases, or configurations of the frame, for {count} targets")
    return T


def renamed(target: Any, names: Mapping[str, str]) -> Any:
    """A target in which frames are called by other names."""
    if isinstance(target, Mapping):
        return {names.get(name, name): value for name, value in target.items()}
    if isinstance(target, (list, tuple)) and any(isinstance(each, Mapping) for each in target):
        return [renamed(each, names) for each in target]
    return target
