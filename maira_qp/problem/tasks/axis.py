"""Directions: an axis of a frame is to point along a direction, or at a point; the turn about it is free.

The error is the rotation vector that takes the axis a to the desired direction d the short way, `theta u`, with
`u = a x d / |a x d|`. It falls by `u . w` for a turn w of the frame, so that with the geometric Jacobian `-J^T e` is
the exact gradient of `1/2 theta^2`. The turn about a is taken out of the rows: it changes nothing, and is left to
others.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio as pin

from maira_qp.arrays import real_array
from maira_qp.errors import OptionError
from maira_qp.orientation import rotation_between, skew
from maira_qp.problem.aims import along, at_point, is_pose_like, posed
from maira_qp.problem.naming import DIRECTION, POINT
from maira_qp.problem.pose import unit_vector
from maira_qp.problem.tasks.frame import TargetTask
from maira_qp.problem.tasks.task import checked_weights
from maira_qp.robots.model.configuration import Configuration


@dataclass(frozen=True, kw_only=True)
class _DirectionTask(TargetTask):
    """An axis of a frame has a direction to point along."""

    axis: Any = (0.0, 0.0, 1.0)
    """The axis (3,) in the frame; any length but 0."""
    weight: float = 1.0
    """What an error of 1 rad counts; > 0."""

    def __post_init__(self) -> None:
        super().__post_init__()
        checked_weights(self.weight, "weight", 1)
        object.__setattr__(self, "axis", unit_vector(self.axis, "axis"))

    @property
    def aim(self) -> np.ndarray | None:
        """What the axis is to point along or at (3,), if it is given apart from a target."""
        raise NotImplementedError

    @property
    def target_key(self) -> str | None:
        """The key, unless the task has an aim or a target of its own."""
        return super().target_key if self.aim is None else None

    def toward(self, targets: Mapping[str, pin.SE3]) -> TargetTask:
        """With its target, unless it has an aim."""
        return super().toward(targets) if self.aim is None else self

    @property
    def weights(self) -> float:
        """One for all rows."""
        return float(self.weight)

    def error(self, at: Configuration) -> np.ndarray:
        """Rotation vector (3,) [rad] in base axes that takes the axis to the desired direction."""
        return rotation_between(*self._axis_and_direction(at))

    def change(self, at: Configuration, before: Configuration, after: Configuration) -> np.ndarray:
        """The turn (3,) [rad] that takes the axis back to where it was, as seen from the desired direction."""
        (a, d), (axis, direction) = self._axis_and_direction(after), self._axis_and_direction(before)
        back = rotation_between(a, axis) - rotation_between(d, direction)
        return across(self._axis_and_direction(at)[0]) @ back

    def _axis_and_direction(self, at: Configuration) -> tuple[np.ndarray, np.ndarray]:
        placement = at.placement(self.frame, self.offset)
        return placement.rotation @ self.axis, self._direction(placement.translation)[0]

    def jacobian(self, at: Configuration) -> np.ndarray:
        """Jacobian (3, n) [rad/rad] of rank 2."""
        placement, J = at.placement(self.frame, self.offset), at.jacobian(self.frame, self.offset)
        d, distance = self._direction(placement.translation)
        turn = J[3:] if distance is None else J[3:] + skew(d) @ J[:3] / distance
        return across(placement.rotation @ self.axis) @ turn

    def _direction(self, origin: np.ndarray) -> tuple[np.ndarray, float | None]:
        """The desired direction (3,) from a frame's origin (3,), and the distance [m] of what is looked at."""
        raise NotImplementedError


def across(a: np.ndarray) -> np.ndarray:
    """The projection (3, 3) that takes out of a vector what is along the unit vector a (3,)."""
    return np.eye(3) - np.outer(a, a)


@dataclass(frozen=True, kw_only=True)
class AxisTask(_DirectionTask):
    """An axis of a frame is to point along a direction of the base, or along the same axis of a target pose."""

    direction: Any = None
    """(3,) in the base; any length but 0; None: that of the `axis` in the target, or what a call gives by the task's
    key, a direction or a pose."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.direction is not None:
            if self.target is not None:
                raise OptionError("an AxisTask has a direction or a target, not both")
            object.__setattr__(self, "direction", unit_vector(self.direction, "direction"))

    @property
    def aim(self) -> np.ndarray | None:
        """The direction, if it is given."""
        return self.direction

    @property
    def datum(self) -> str:
        """Its direction, or a target."""
        return DIRECTION

    def with_value(self, value: Any) -> TargetTask:
        """The same task with another direction (3,), or with a target pose. Raises `OptionError`, `PoseError`."""
        if is_pose_like(value):
            task = super().with_value(value)
            return self._aimed(target=task.target, direction=None)
        return self._aimed(target=None, direction=unit_vector(value, f"direction of {self.key!r}"))

    def target_of(self, value: Any) -> Any:
        """The `value` of a call as a pose: a pose, or the direction (3,) of the axis. Raises `PoseError`."""
        return posed(value, lambda direction: along(direction, self.axis, f"direction of {self.key!r}"))

    def _direction(self, origin: np.ndarray) -> tuple[np.ndarray, None]:
        return (self.target.rotation @ self.axis if self.direction is None else self.direction), None


@dataclass(frozen=True, kw_only=True)
class LookAtTask(_DirectionTask):
    """An axis of a frame, such as a camera's, is to point at a point, or at the origin of a target pose.

    At the point itself no direction is right: where a level below may draw the frame there, a `DistanceLimit` keeps it
    away.
    """

    point: Any = None
    """(3,) in the base [m]; None: the origin of the target, or what a call gives by the task's key, a point or a
    pose."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.point is not None:
            if self.target is not None:
                raise OptionError("a LookAtTask has a point or a target, not both")
            object.__setattr__(self, "point", real_array(self.point, (3,), "point of LookAtTask", OptionError))

    @property
    def aim(self) -> np.ndarray | None:
        """The point, if it is given."""
        return self.point

    @property
    def datum(self) -> str:
        """Its point, or a target."""
        return POINT

    def with_value(self, value: Any) -> TargetTask:
        """The same task with another point (3,), or with a target pose. Raises `OptionError`, `PoseError`."""
        if is_pose_like(value):
            task = super().with_value(value)
            return self._aimed(target=task.target, point=None)
        return self._aimed(target=None, point=real_array(value, (3,), f"point of {self.key!r}", OptionError))

    def target_of(self, value: Any) -> Any:
        """The `value` of a call as a pose: a pose, or the point (3,) that is looked at. Raises `PoseError`."""
        return posed(value, lambda point: at_point(point, f"point of {self.key!r}"))

    def _direction(self, origin: np.ndarray) -> tuple[np.ndarray, float]:
        away = (self.target.translation if self.point is None else self.point) - origin
        distance = max(math.hypot(*away.tolist()), NEAR)
        return (away / distance if distance > NEAR else np.array([0.0, 0.0, 1.0])), distance


NEAR = 1e-9
"""A point nearer than this [m] to the frame is in no direction."""
