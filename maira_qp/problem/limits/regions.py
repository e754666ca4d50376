"""Regions that a point of the tool may not leave: a half-space, a box, a ball or what is outside of one."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio as pin

from maira_qp.arrays import is_number, real_array
from maira_qp.errors import OptionError, shown
from maira_qp.problem.aims import at_point, posed
from maira_qp.problem.limits.placement import EXACT, PlacementLimit, Ranges, TargetLimit, point_of
from maira_qp.problem.naming import POINT, POSE
from maira_qp.problem.pose import as_pose, unit_vector

NEAR = 1e-9
"""A point nearer than this [m] is in no direction."""


@dataclass(frozen=True, eq=False, kw_only=True)
class HalfSpaceLimit(PlacementLimit):
    """A point of the tool stays on one side of a plane: `normal . (p - point) >= 0`."""

    normal: Any = (0.0, 0.0, 1.0)
    """Direction (3,) in the base, out of the plane into the half that is allowed; any length but 0."""
    point: Any = 0.0
    """A point (3,) of the plane in the base [m]; or a number: the plane's distance from the base along the normal [m].
    In a call, a value by the limit's name takes its place."""

    def __post_init__(self) -> None:
        super().__post_init__()
        object.__setattr__(self, "normal", unit_vector(self.normal, "normal of a HalfSpaceLimit"))
        object.__setattr__(self, "point", self._checked(self.point))

    def _checked(self, point: Any) -> np.ndarray:
        if is_number(point):
            return float(real_array(point, (), "point of a HalfSpaceLimit", OptionError)) * self.normal
        return real_array(point, (3,), "point of a HalfSpaceLimit", OptionError)

    @property
    def datum(self) -> str:
        """Its point; a number is a distance from the base."""
        return POINT

    def with_value(self, value: Any) -> HalfSpaceLimit:
        """With another `point`. Raises `OptionError`."""
        return self._with(point=self._checked(value))

    @property
    def labels(self) -> tuple[str, ...]:
        """One row."""
        return ("",)

    def room(self, T: pin.SE3) -> np.ndarray:
        """The distance from the plane (1,)."""
        return np.array([self.normal @ (T.translation - self.point)])

    def slope(self, T: pin.SE3) -> np.ndarray:
        """At a pose T along the normal (1, 6)."""
        return np.concatenate([self.normal, np.zeros(3)])[None]


@dataclass(frozen=True, eq=False, kw_only=True)
class BoxLimit(PlacementLimit):
    """A point of the tool stays in a box: `lower <= p <= upper` in the axes of a pose."""

    lower: Any = None
    """(3,) [m], -inf: open; None: open along all axes."""
    upper: Any = None
    """(3,) [m], inf: open; None: open along all axes."""
    pose: Any = None
    """Pose in the base, `pin.SE3` or (4, 4), from whose origin and along whose axes the ends count; None: the base.
    In a call, a value by the limit's name takes its place."""
    _ranges: Any = None

    def __post_init__(self) -> None:
        super().__post_init__()
        ends = [np.full(3, -math.inf) if self.lower is None else self.lower]
        ends.append(np.full(3, math.inf) if self.upper is None else self.upper)
        for name, end in zip(("lower", "upper"), ends, strict=True):
            object.__setattr__(self, name, real_array(end, (3,), f"{name} of a BoxLimit", OptionError, finite=False))
        object.__setattr__(self, "_ranges", Ranges.build((self.lower, self.upper), "a BoxLimit"))
        pose = pin.SE3.Identity() if self.pose is None else self.pose
        object.__setattr__(self, "pose", as_pose(pose, "pose of a BoxLimit"))

    @property
    def datum(self) -> str:
        """Its pose."""
        return POSE

    def with_value(self, value: Any) -> BoxLimit:
        """With another `pose`. Raises `PoseError`."""
        return self._with(pose=as_pose(value, "pose of a BoxLimit"))

    @property
    def labels(self) -> tuple[str, ...]:
        """A row for each finite end."""
        return self._ranges.labels("xyz")

    def room(self, T: pin.SE3) -> np.ndarray:
        """The distance from each finite end (m,)."""
        return self._ranges.room(self.pose.rotation.T @ (T.translation - self.pose.translation))

    def slope(self, T: pin.SE3) -> np.ndarray:
        """At a pose T along the axes of the box (m, 6)."""
        return self._ranges.slope(np.hstack([self.pose.rotation.T, np.zeros((3, 3))]))


@dataclass(frozen=True, eq=False, kw_only=True)
class DistanceLimit(TargetLimit):
    """The distance of a point of the tool from another point stays within ends: `lower <= |p - point| <= upper`."""

    point: Any = None
    """(3,) in the base [m]; None: the origin of the target. In a call, a value by the limit's name takes its place."""
    lower: float = 0.0
    """[m]; >= 0"""
    upper: float = math.inf
    """[m]; > 0, >= lower"""
    _ends: Any = None

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.point is not None:
            if self.target is not None:
                raise OptionError("a DistanceLimit has a point or a target, not both")
            object.__setattr__(self, "point", point_of(self.point, "point of a DistanceLimit"))
        if not (is_number(self.lower) and is_number(self.upper) and 0 <= self.lower <= self.upper and self.upper > 0):
            raise OptionError(
                f"a DistanceLimit needs 0 <= lower <= upper [m], got {shown(self.lower)} and {shown(self.upper)}"
            )
        if self.lower == math.inf:
            raise OptionError("lower of a DistanceLimit must be finite")
        middle = 0.5 * (self.lower + self.upper)
        lower, upper = min(self.lower, middle - EXACT), max(self.upper, middle + EXACT)
        object.__setattr__(self, "_ends", (lower if self.lower > 0 else 0.0, upper))

    @property
    def needs_target(self) -> bool:
        """It has neither a point nor a target."""
        return self.point is None and self.target is None

    @property
    def datum(self) -> str:
        """Its point, or a target."""
        return POINT

    def with_value(self, value: Any) -> DistanceLimit:
        """With another `point`: (3,), or the origin of a pose. Raises `OptionError`, `PoseError`."""
        return self._with(point=point_of(value, "point of a DistanceLimit"), target=None)

    def target_of(self, value: Any) -> Any:
        """The `value` of a call as a pose: a pose, or the point (3,) itself. Raises `PoseError`."""
        return posed(value, lambda point: at_point(point, f"point of {self.key!r}"))

    @property
    def labels(self) -> tuple[str, ...]:
        """A row for each end that limits anything."""
        low, high = self._ends
        return ("lower",) * int(low > 0) + ("upper",) * int(high < math.inf)

    def room(self, T: pin.SE3) -> np.ndarray:
        """The distance from each end (m,)."""
        ends = np.array([end for end in self._ends if 0 < end < math.inf])
        return self._signs * (self._away(T)[0] - ends)

    def slope(self, T: pin.SE3) -> np.ndarray:
        """At a pose T away from the point, or toward it (m, 6)."""
        return np.outer(self._signs, np.concatenate([self._away(T)[1], np.zeros(3)]))

    def bend(self, T: pin.SE3, y: np.ndarray) -> np.ndarray:
        """`(I - u u^T) / distance`, for each row (6, 6)."""
        distance, away = self._away(T)
        S = np.zeros((6, 6))
        S[:3, :3] = (self._signs @ y) / distance * (np.eye(3) - np.outer(away, away))
        return S

    @property
    def _signs(self) -> np.ndarray:
        """Of each row (m,): room grows with the distance, or shrinks."""
        return np.array([1.0 if label == "lower" else -1.0 for label in self.labels])

    def _away(self, T: pin.SE3) -> tuple[float, np.ndarray]:
        """The distance [m] and the direction (3,) from the point; any direction at the point itself."""
        away = T.translation - (self.aim.translation if self.point is None else self.point)
        distance = math.hypot(*away.tolist())
        return (distance, away / distance) if distance > NEAR else (NEAR, np.array([0.0, 0.0, 1.0]))
