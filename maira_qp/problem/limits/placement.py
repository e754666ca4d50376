"""Limits of where a frame is: each row is the room h(T) >= 0 that the pose T of the frame leaves.

With the twist [v; w] of the frame in base axes and the slope `D = dh/d[p; phi]`, phi the rotation vector of a turn,

    G = -D J,      dG weighted by y:  -(pose's second derivative weighted by D^T y) - J^T S J

S being the second derivative of `y . h` by [p; phi]. T is the pose of the frame's offset, where it has one. In a tick
in which joints must brake, what is left of the room is approached as an obstacle is: at no more than `gain` times it
(see `collision`).
"""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import compress
from typing import Any, ClassVar

import numpy as np
import pinocchio as pin

from maira_qp.arrays import is_listing, real_array
from maira_qp.errors import OptionError, shown
from maira_qp.problem.limits.joint import KEPT, Limit, Tick
from maira_qp.problem.pose import as_pose
from maira_qp.robots.model.configuration import Configuration
from maira_qp.robots.model.robot import Robot

EXACT = 1e-6
"""A range narrower than twice this [m or rad] is as wide as that: as exact as a pose that counts as reached."""


@dataclass(frozen=True, eq=False, kw_only=True)
class FrameLimit(Limit):
    """A limit of a frame of the robot, or of a point or pose that is fixed to it."""

    frame: str | None = None
    """The frame's name; None: the robot's tip."""
    offset: Any = None
    """Where in the frame the point is, (3,) [m], or the pose, `pin.SE3` or (4, 4), that the limit is about; None: the
    frame itself."""
    name: str | None = None
    """What messages, `broken_limits` and `active_limits` call it; None: its class."""

    def __post_init__(self) -> None:
        """Raises `OptionError`, `PoseError`."""
        if self.name is not None and not isinstance(self.name, str):
            raise OptionError(f"name of a {self._kind} must be text, got {shown(self.name)}")
        if self.offset is not None:
            object.__setattr__(self, "offset", as_offset(self.offset, f"offset of a {self._kind}"))

    @property
    def _kind(self) -> str:
        return type(self).__name__

    @property
    def key(self) -> str:
        """What a call calls the limit by: its name, else its frame."""
        return str(self.frame) if self.name is None else self.name

    def of(self, robot: Robot) -> FrameLimit:
        """With the frame's name. Raises `FrameError` for a frame that the robot does not have."""
        robot.frame_id(self.frame)
        frame = robot.tip if self.frame is None else self.frame
        return replace(self, frame=frame)

    def actual(self, at: Configuration) -> pin.SE3:
        """Where the frame, with its offset, is."""
        return at.placement(self.frame, self.offset)

    def _with(self, **values: Any) -> Any:
        """The same with some fields, which are not checked again."""
        changed = copy(self)
        for name, value in values.items():
            object.__setattr__(changed, name, value)
        return changed


@dataclass(frozen=True, eq=False, kw_only=True)
class PlacementLimit(FrameLimit):
    """A frame of the robot, or a point or pose that is fixed to it, is to stay somewhere."""

    _gain: float = field(default=math.inf, repr=False)
    knows_curvature: ClassVar[bool] = True

    def of(self, robot: Robot) -> PlacementLimit:
        """With the frame's name. Raises `FrameError` for a frame that the robot does not have."""
        limit = super().of(robot)
        assert isinstance(limit, PlacementLimit)
        return replace(limit, _gain=braking_gain(robot))

    @abstractmethod
    def room(self, T: pin.SE3) -> np.ndarray:
        """What a pose leaves (m,) [m or rad]."""

    @abstractmethod
    def slope(self, T: pin.SE3) -> np.ndarray:
        """How that changes with the twist of the pose, D (m, 6), base axes."""

    def bend(self, T: pin.SE3, y: np.ndarray) -> np.ndarray:
        """Second derivative (6, 6) of `y . room`, y (m,), by [p; phi] of the pose."""
        return np.zeros((6, 6))

    @property
    def metres(self) -> int:
        """How many of the rows, the first ones, are in metres; the others are in rad."""
        return len(self.labels)

    @property
    @abstractmethod
    def labels(self) -> tuple[str, ...]:
        """What each of the m rows is called; "" where there is only one."""

    def rows(self, at: Configuration, tick: Tick | None) -> tuple[np.ndarray, np.ndarray]:
        """G (m, n) and h (m,), h negative where the frame is outside."""
        kept = at.kept.get((id(self), "rows"))
        if kept is None:
            G = -self.slope(self.actual(at)) @ at.jacobian(self.frame, self.offset)
            kept = at.kept[id(self), "rows"] = (self, (G, self.rooms(at)))
        G, h = kept[1]
        if tick is None or self._gain == math.inf:
            return G, h
        share = self._gain * tick.dt / (1 + self._gain * tick.dt)
        return G, np.where(h > 0, share * h, h)

    def rooms(self, at: Configuration) -> np.ndarray:
        """What the configuration leaves of each row (m,) [m or rad]."""
        kept = at.kept.get((id(self), "rooms"))
        if kept is None:
            kept = at.kept[id(self), "rooms"] = (self, self.room(self.actual(at)))
        return kept[1]

    def violation(self, at: Configuration) -> float:
        """By how much the frame is outside [m or rad]; >= 0."""
        return max(0.0, -float(self.rooms(at).min(initial=0.0)))

    def violations(self, at: Configuration) -> np.ndarray:
        """The same of each row (m,)."""
        return np.maximum(-self.rooms(at), 0.0)

    def residual(self, at: Configuration) -> tuple[float, float]:
        """By how much the frame is outside, the norm of the rows in metres and of those in rad."""
        missing, count = self.violations(at), self.metres
        return float(np.linalg.norm(missing[:count])), float(np.linalg.norm(missing[count:]))

    def parts(self, at: Configuration) -> np.ndarray:
        """Each row is a part of its own (m,)."""
        return np.arange(len(self.labels))

    def curvature(self, at: Configuration, multipliers: np.ndarray) -> np.ndarray:
        """`sum_k multipliers_k dG_k/dq` (n, n), exact; multipliers (m,)."""
        if not multipliers.any():
            return np.zeros((at.n, at.n))
        T, J = self.actual(at), at.jacobian(self.frame, self.offset)
        pull, S = multipliers @ self.slope(T), self.bend(T, multipliers)
        return -at.kinematic_hessian_product(self.frame, pull, self.offset) - J.T @ S @ J

    def broken(self, at: Configuration, name: str) -> dict[str, float]:
        """The rows that are broken, such as "BoxLimit x upper", and by how much [m or rad]."""
        h = self.rooms(at)
        return {_joined(name, label): -float(left) for label, left in zip(self.labels, h, strict=True) if left < -KEPT}

    def named_rows(self, count: int) -> list[tuple[str, str]]:
        """By their labels, in metres and in rad."""
        name, metres = self.name or self._kind, self.metres
        return [(_joined(name, label), "m" if i < metres else "rad") for i, label in enumerate(self.labels)]


@dataclass(frozen=True, eq=False, kw_only=True)
class TargetLimit(PlacementLimit):
    """A limit about a target pose: its own, or the one that the solver is called with."""

    target: Any = None
    """Pose in the base: `pin.SE3` or (4, 4) array; None: the target that the solver is called with."""
    _aim: Any = field(default=None, repr=False)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.target is not None:
            object.__setattr__(self, "target", as_pose(self.target, f"target of a {self._kind}"))

    @property
    def needs_target(self) -> bool:
        """Nothing of its own says what the limit is about."""
        return self.target is None

    @property
    def target_key(self) -> str | None:
        """The key of the target that the limit takes from the call; None: it needs none."""
        return self.key if self.needs_target else None

    def toward(self, targets: Mapping[str, pin.SE3]) -> TargetLimit:
        """The same about the target of its key, if it needs one."""
        return self._with(_aim=targets[self.key]) if self.needs_target else self

    @property
    def aim(self) -> pin.SE3:
        """The pose that the limit is about: its own target, or that of the call."""
        return self._aim if self.target is None else self.target


def braking_gain(robot: Robot, gain: float = math.inf) -> float:
    """The largest rate [1/s] up to `gain` at which what is left of a way may be approached so that joints can brake.

    Joints without a limit of their speed do not narrow it.
    """
    acceleration = robot.acceleration_limit
    limited = np.isfinite(acceleration) & np.isfinite(robot.velocity_limit) & (robot.velocity_limit > 0)
    return min(gain, float((acceleration[limited] / robot.velocity_limit[limited]).min(initial=math.inf)))


def as_offset(value: Any, name: str) -> pin.SE3:
    """A point (3,) or a pose in a frame as a pose. Raises `OptionError`, `PoseError`."""
    if not isinstance(value, pin.SE3) and is_listing(value) and not any(map(is_listing, value)):
        return pin.SE3(np.eye(3), real_array(value, (3,), name, OptionError))
    return as_pose(value, name)


@dataclass(frozen=True)
class Ranges:
    """Three quantities, each between two ends, of which any may be infinite: then there is no row."""

    ends: np.ndarray
    """(2, 3) as they are kept: at least `EXACT` to either side of their middle"""

    @staticmethod
    def build(value: Any, name: str) -> Ranges:
        """From one half-width, three of them, or (lower, upper); None: all free. Raises `OptionError`."""
        ends = _ends(value, name)
        with np.errstate(invalid="ignore"):
            middle = 0.5 * (ends[0] + ends[1])
        narrow = ends[1] - ends[0] < 2 * EXACT
        return Ranges(np.where(narrow, [middle - EXACT, middle + EXACT], ends))

    @cached_property
    def bounded(self) -> np.ndarray:
        """Which ends (2, 3) are finite."""
        return np.isfinite(self.ends)

    def labels(self, names: Sequence[str]) -> tuple[str, ...]:
        """A label for each row, from the names of the three quantities."""
        return tuple(
            f"{name} {end}"
            for end, bounded in zip(("lower", "upper"), self.bounded, strict=True)
            for name in compress(names, bounded)
        )

    def room(self, x: np.ndarray) -> np.ndarray:
        """What values x (3,) leave of each finite end (m,)."""
        low, high = self.bounded
        return np.concatenate([(x - self.ends[0])[low], (self.ends[1] - x)[high]])

    def slope(self, D: np.ndarray) -> np.ndarray:
        """How that changes (m, k), from the derivatives of x (3, k)."""
        low, high = self.bounded
        return np.concatenate([D[low], -D[high]])

    def pull(self, y: np.ndarray) -> np.ndarray:
        """Weights y (m,) of the rows as weights of x (3,)."""
        low, high = self.bounded
        u = np.zeros(3)
        u[low] += y[: int(low.sum())]
        u[high] -= y[int(low.sum()) :]
        return u


def _ends(value: Any, name: str) -> np.ndarray:
    """Lower and upper ends (2, 3). Raises `OptionError`."""
    if value is None:
        return np.array([[-np.inf] * 3, [np.inf] * 3])
    wanted = "one half-width, three of them, or (lower, upper) of three each"
    is_table = is_listing(value) and any(map(is_listing, value))
    shape = (2, 3) if is_table else (3,) if is_listing(value) else ()
    ends = real_array(value, shape, name, OptionError, finite=False, wanted=wanted)
    if not is_table:
        if (ends < 0).any():
            raise OptionError(f"half-widths of {name} must not be negative, got {shown(value)}")
        ends = np.stack([-np.broadcast_to(ends, 3), np.broadcast_to(ends, 3)])
    if (ends[0] > ends[1]).any() or (ends[0] == np.inf).any() or (ends[1] == -np.inf).any():
        raise OptionError(f"the lower end of {name} must not be above the upper one, got {shown(value)}")
    return ends


def _joined(name: str, label: str) -> str:
    return f"{name} {label}" if label else name


def point_of(value: Any, name: str) -> np.ndarray:
    """A point (3,) [m], or the origin of a pose. Raises `OptionError`, `PoseError`."""
    return as_offset(value, name).translation.copy()
