"""What a call may give in place of a pose: a point to be at or to look at, a direction to point along."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pinocchio as pin

from maira_qp.arrays import is_listing, real_array
from maira_qp.errors import PoseError
from maira_qp.orientation import rigid_or_point, rotation_between
from maira_qp.problem.pose import unit_vector
from maira_qp.problem.targets import is_pose


def posed(value: Any, pose_of: Callable[[Any], np.ndarray]) -> Any:
    """A pose, or a sequence of them, whose vectors (3,) are made poses (4, 4); what is neither goes through."""
    if isinstance(value, pin.SE3) or not is_listing(value) or not hasattr(value, "__len__") or not len(value):
        return value
    if isinstance(value, np.ndarray) and (value.ndim > 2 or value.shape == (4, 4)):
        return value
    flat = [not (is_listing(each) or isinstance(each, pin.SE3)) for each in value]
    if all(flat):
        return pose_of(value)
    if is_pose(value) and len(value) == 4 and len(value[0]) == 4:
        return value
    return [posed(each, pose_of) for each in value]


def at_point(value: Any, name: str) -> np.ndarray:
    """T (4, 4) whose origin is a point (3,) [m], NaN where that is. Raises `PoseError`."""
    T = np.eye(4)
    T[:3, 3] = real_array(value, (3,), name, PoseError, finite=None, wanted="a pose, or a point (3,)")
    return T


def as_point(value: Any, name: str) -> pin.SE3:
    """A pose, or a point (3,) [m] as the pose there. Raises `PoseError`."""
    return pin.SE3(rigid_or_point(value, name))


def along(value: Any, axis: np.ndarray, name: str) -> np.ndarray:
    """T (4, 4) in which an axis (3,) has a direction (3,), NaN where that is not finite. Raises `PoseError`."""
    d = real_array(value, (3,), name, PoseError, finite=None, wanted="a pose, or a direction (3,)")
    T = np.eye(4)
    if not np.isfinite(d).all():
        T[:3, :3] = np.nan
    elif d.any():
        T[:3, :3] = pin.exp3(rotation_between(axis, unit_vector(d, name)))
    else:
        raise PoseError(f"{name} has no direction: it is zero")
    return T


def is_pose_like(value: Any) -> bool:
    """Whether a value is meant for a pose, and not for a vector (3,)."""
    is_array = isinstance(value, (list, tuple, np.ndarray)) and is_listing(value)
    return isinstance(value, pin.SE3) or (is_array and any(map(is_listing, value)))
