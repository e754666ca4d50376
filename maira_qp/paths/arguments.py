"""What makers of paths are called with, checked."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pinocchio as pin

from maira_qp.arrays import is_listing, is_number
from maira_qp.errors import OptionError, PoseError, shown
from maira_qp.orientation import A_POSE
from maira_qp.problem.pose import as_pose
from maira_qp.problem.targets import poses_of_batch, rows_of

SMALLEST, LARGEST = 1e-12, 1e9
"""Lengths, angles and times beyond these, in m, rad and s, are a mistake."""


def checked_pose(value: Any, name: str) -> np.ndarray:
    """A pose (4, 4). Raises `PoseError`."""
    T = as_pose(value, name).homogeneous
    _check_near(T[None], name)
    return T


def checked_poses(poses: Any, least: int = 1) -> np.ndarray:
    """A path (N, 4, 4), N >= `least`, its rotations made exact. Raises `PoseError`, which names the first bad pose."""
    if isinstance(poses, pin.SE3) or not is_listing(poses) or getattr(poses, "ndim", 3) == 2:
        raise PoseError(f"a path must be a sequence of poses, (N, 4, 4), each {A_POSE}; got {shown(poses)}")
    T = poses_of_batch(poses, "pose")
    if len(T) < least:
        raise PoseError(f"at least {least} pose{'s' if least > 1 else ''} needed, got {len(T)}")
    rows, _ = rows_of(T, "pose")
    for i in np.flatnonzero(np.isnan(rows[:, 0]))[:1]:
        raise PoseError(f"pose {i} holds NaN or inf")
    path = with_rotations(rows[:, 9:], rows[:, :9].reshape(-1, 3, 3))
    _check_near(path, "pose")
    return path


def with_rotations(p: np.ndarray, R: np.ndarray) -> np.ndarray:
    """Poses (N, 4, 4) of positions (N, 3) with rotations (N, 3, 3), or one (3, 3) for all."""
    T = np.zeros((len(p), 4, 4))
    T[:, :3, :3], T[:, :3, 3], T[:, 3, 3] = R, p, 1.0
    return T


def positive(value: Any, name: str, unit: str) -> float:
    """A number from `SMALLEST` to `LARGEST`, or inf. Raises `OptionError`."""
    if not is_number(value) or not (SMALLEST <= value <= LARGEST or value == math.inf):
        raise OptionError(f"{name} must be a positive number of {unit}{_bounds(SMALLEST)}, got {shown(value)}")
    return float(value)


def finite_positive(value: Any, name: str, unit: str) -> float:
    """A number from `SMALLEST` to `LARGEST`. Raises `OptionError`."""
    return positive(finite(value, name, unit), name, unit)


def finite(value: Any, name: str, unit: str, *, least: float = -LARGEST) -> float:
    """A number from `least` to `LARGEST`. Raises `OptionError`."""
    if not is_number(value) or not least <= value <= LARGEST:
        raise OptionError(f"{name} must be a number of {unit}{_bounds(least)}, got {shown(value)}")
    return float(value)


def flag(value: Any, name: str) -> bool:
    """True or False. Raises `OptionError`."""
    if not isinstance(value, (bool, np.bool_)):
        raise OptionError(f"{name} must be True or False, got {shown(value)}")
    return bool(value)


def _bounds(least: float) -> str:
    return f" from {least:g} to {LARGEST:g}"


def _check_near(path: np.ndarray, name: str) -> None:
    """Raises `PoseError` for a position that cannot be meant."""
    for i in np.flatnonzero(np.abs(path[:, :3, 3]).max(axis=1) > LARGEST)[:1]:
        which = f"{name} {i}" if len(path) > 1 else name
        raise PoseError(f"the {which} is {np.abs(path[i, :3, 3]).max():.3g} m away; {LARGEST:g} m are allowed")
