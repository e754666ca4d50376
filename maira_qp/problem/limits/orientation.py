"""Ranges of a frame's pose about a target, and a cone about the direction of one of its axes."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio as pin

from maira_qp.arrays import is_listing, is_number
from maira_qp.errors import OptionError, listed, shown
from maira_qp.problem.aims import along, posed
from maira_qp.problem.limits.placement import Ranges, TargetLimit
from maira_qp.problem.limits.turning import (
    angle,
    angle_derivatives,
    tilt,
    tilt_derivatives,
    turn_about_z,
    turn_derivatives,
)
from maira_qp.problem.naming import DIRECTION, POSE
from maira_qp.problem.pose import as_pose, unit_vector

AXES = "xyz"


@dataclass(frozen=True, eq=False, kw_only=True)
class PoseRange(TargetLimit):
    """The pose of a frame stays within ranges about a target: a tolerance for each axis, one-sided ones too.

    Both ranges are given as a half-width, three half-widths, or (lower, upper) of three each; an infinite end is
    none, None leaves all three free. The deviation of the pose from the target is measured in the target's axes:

    - position: `R_d^T (p - p_d)` [m];
    - orientation [rad]: the frame's turn `about` one axis of the target, and the tilts of that axis about the other
      two, in the places of their axes. So `orientation=[0.1, 0.1, np.pi / 6]` is a yaw within 30 degrees of the
      target's whatever the tilt, and a tilt of up to 0.1 rad about x and about y: the rotation from the target is the
      turn about z followed by the tilt, whose rotation vector the first two are. Of small rotations, and of those about
      one axis, the three are the rotation vector.

    A range of no width, such as a roll of 0, is kept within 1e-6: as exact as a pose that counts as reached. A turn
    counts as the one nearest to the middle of its range, and one-sided ones end at half a turn.
    """

    position: Any = None
    """[m]"""
    orientation: Any = None
    """[rad]"""
    axes: str = "target"
    """Whose axes the deviation is measured in: "target" or "base", about the target in both cases."""
    about: str = "z"
    """Which of the three axes the turn is about: "x", "y" or "z"."""
    _places: Any = None
    _turns: Any = None

    def __post_init__(self) -> None:
        super().__post_init__()
        for name, valid in (("axes", ("target", "base")), ("about", tuple(AXES))):
            value = getattr(self, name)
            if not isinstance(value, str) or value not in valid:
                raise OptionError(f"{name} of a PoseRange; {listed(valid, value)}")
        object.__setattr__(self, "_places", Ranges.build(self.position, "position of a PoseRange"))
        turns = Ranges.build(self.orientation, "orientation of a PoseRange").ends
        k = AXES.index(self.about)
        if np.isfinite(turns[:, k]).any():
            turns[:, k] = np.where(np.isfinite(turns[:, k]), turns[:, k], [-math.pi, math.pi])
        if turns[1, k] - turns[0, k] >= math.tau:
            turns[:, k] = -math.inf, math.inf
        object.__setattr__(self, "_turns", Ranges(turns))
        if not (self._places.bounded.any() or self._turns.bounded.any()):
            raise OptionError("a PoseRange needs a range of the position or of the orientation, such as position=0.01")

    @property
    def datum(self) -> str:
        """Its target."""
        return POSE

    def with_value(self, value: Any) -> PoseRange:
        """With another target. Raises `PoseError`."""
        return self._with(target=as_pose(value, "target of a PoseRange"))

    @property
    def labels(self) -> tuple[str, ...]:
        """A row for each finite end."""
        return (*self._places.labels(AXES), *self._turns.labels([f"about {axis}" for axis in AXES]))

    @property
    def metres(self) -> int:
        """Those of the position."""
        return int(self._places.bounded.sum())

    def room(self, T: pin.SE3) -> np.ndarray:
        """The distance from each finite end (m,) [m, then rad]."""
        h = self._places.room(self._axes.T @ (T.translation - self.aim.translation))
        return np.concatenate([h, self._turns.room(self._deviation(T))]) if self._turns.bounded.any() else h

    def slope(self, T: pin.SE3) -> np.ndarray:
        """Of the position (m, 6), and of the orientation."""
        zero = np.zeros((3, 3))
        rows = self._places.slope(np.hstack([self._axes.T, zero]))
        if not self._turns.bounded.any():
            return rows
        first, _ = self._derivatives(T)
        return np.concatenate([rows, self._turns.slope(np.hstack([zero, first]))])

    def bend(self, T: pin.SE3, y: np.ndarray) -> np.ndarray:
        """Of the orientation's rows alone (6, 6)."""
        S = np.zeros((6, 6))
        if y[self.metres :].any():
            S[3:, 3:] = np.tensordot(self._turns.pull(y[self.metres :]), self._derivatives(T)[1], 1)
        return S

    @property
    def _axes(self) -> np.ndarray:
        """The axes (3, 3) of the deviation, in columns, in the base."""
        return self.aim.rotation if self.axes == "target" else np.eye(3)

    def _turned(self, T: pin.SE3) -> tuple[list[int], np.ndarray, np.ndarray]:
        """The axes in an order in which the turn is about the last one, these (3, 3) in columns, and the turn there."""
        k = AXES.index(self.about)
        order = [(k + 1) % 3, (k + 2) % 3, k]
        E = self._axes[:, order]
        return order, E, E.T @ T.rotation @ self.aim.rotation.T @ E

    def _deviation(self, T: pin.SE3) -> np.ndarray:
        """The tilts and the turn (3,) [rad] in the order of the axes."""
        order, _, Q = self._turned(T)
        x, k = np.empty(3), order[2]
        x[order[:2]], turn = tilt(Q[:, 2]), turn_about_z(Q)
        middle = float(self._turns.ends[:, k].mean()) if self._turns.bounded[0, k] else turn
        x[k] = middle + math.remainder(turn - middle, math.tau)
        return x

    def _derivatives(self, T: pin.SE3) -> tuple[np.ndarray, np.ndarray]:
        """The derivatives (3, 3) and (3, 3, 3) of the deviation."""
        order, E, Q = self._turned(T)
        first, second = np.empty((3, 3)), np.empty((3, 3, 3))
        first[order[:2]], second[order[:2]] = tilt_derivatives(Q[:, 2])
        first[order[2]], second[order[2]] = turn_derivatives(Q)
        return first @ E.T, E @ second @ E.T


@dataclass(frozen=True, eq=False, kw_only=True)
class ConeLimit(TargetLimit):
    """An axis of a frame stays within an angle of a direction, as a cup that is carried upright."""

    axis: Any = (0.0, 0.0, 1.0)
    """The axis (3,) in the frame; any length but 0."""
    direction: Any = None
    """(3,) in the base; any length but 0; None: that of the `axis` in the target. In a call, a value by the limit's
    name takes its place."""
    angle: float = math.nan
    """Half of the cone's opening [rad]; > 0, <= pi"""

    def __post_init__(self) -> None:
        super().__post_init__()
        object.__setattr__(self, "axis", unit_vector(self.axis, "axis of a ConeLimit"))
        if self.direction is not None:
            if self.target is not None:
                raise OptionError("a ConeLimit has a direction or a target, not both")
            object.__setattr__(self, "direction", unit_vector(self.direction, "direction of a ConeLimit"))
        if not (is_number(self.angle) and 0 < self.angle <= math.pi):
            raise OptionError(f"angle of a ConeLimit must be in (0, pi] [rad], got {shown(self.angle)}")

    @property
    def needs_target(self) -> bool:
        """It has neither a direction nor a target."""
        return self.direction is None and self.target is None

    @property
    def datum(self) -> str:
        """Its direction, or a target."""
        return DIRECTION

    def with_value(self, value: Any) -> ConeLimit:
        """With another direction (3,), or that of the axis in a pose. Raises `OptionError`, `PoseError`."""
        if is_listing(value) and not any(map(is_listing, value)):
            return self._with(direction=unit_vector(value, "direction of a ConeLimit"), target=None)
        return self._with(direction=None, target=as_pose(value, "target of a ConeLimit"))

    def target_of(self, value: Any) -> Any:
        """The `value` of a call as a pose: a pose, or the direction (3,) of the axis. Raises `PoseError`."""
        return posed(value, lambda direction: along(direction, self.axis, f"direction of {self.key!r}"))

    @property
    def labels(self) -> tuple[str, ...]:
        """One row."""
        return ("",)

    @property
    def metres(self) -> int:
        """None: an angle."""
        return 0

    def room(self, T: pin.SE3) -> np.ndarray:
        """What is left of the angle (1,)."""
        return np.array([self.angle - angle(*self._directions(T))])

    def slope(self, T: pin.SE3) -> np.ndarray:
        """Of the angle (1, 6) at a pose T."""
        D = np.zeros((1, 6))
        D[0, 3:] = -angle_derivatives(*self._directions(T))[0]
        return D

    def bend(self, T: pin.SE3, y: np.ndarray) -> np.ndarray:
        """Of the angle (6, 6)."""
        S = np.zeros((6, 6))
        S[3:, 3:] = -y[0] * angle_derivatives(*self._directions(T))[1]
        return S

    def _directions(self, T: pin.SE3) -> tuple[np.ndarray, np.ndarray]:
        """That of the axis (3,), and the one that it stays near."""
        direction = self.aim.rotation @ self.axis if self.direction is None else self.direction
        return T.rotation @ self.axis, direction
