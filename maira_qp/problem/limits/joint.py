"""Limits: what a displacement dq may be at a configuration. Boxes stay boxes; coupled limits are rows `G dq <= h`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np
import pinocchio as pin

from maira_qp.errors import OptionError
from maira_qp.problem.naming import NO_DATUM, POSE, word_for
from maira_qp.robots.model.configuration import Configuration
from maira_qp.robots.model.robot import Robot

FEASIBILITY = 1e-11
"""How far [rad or m] a displacement may overstep a limit before it is shortened; what remains is clipped."""

KEPT = 1e-9
"""A row broken by no more than this, in its own unit, is kept: the rest is rounding."""

ACTIVE_WITHIN = 1e-6
"""A configuration that leaves a row no more than this, in the row's own unit, stands on it."""

RESERVE = 0.7
"""Share of the acceleration with which a joint plans to stop at the end of its way, which the next tick may shorten."""

DIFFERENCE = 1e-5
"""Step [rad or m] of differences of rows."""


@dataclass(frozen=True)
class Tick:
    """One control tick."""

    dt: float
    """Its length [s]"""
    velocity: np.ndarray
    """Velocity (n,) [rad/s or m/s] at its beginning"""


@dataclass(frozen=True)
class Bounds:
    """All limits on a displacement dq (n,) together: `lower <= dq <= upper` and `G dq <= h`."""

    lower: np.ndarray
    """(n,) [rad or m]"""
    upper: np.ndarray
    """(n,) [rad or m]"""
    G: np.ndarray
    """(m, n), m = 0 where the limits are a box alone"""
    h: np.ndarray
    """(m,)"""
    broken: tuple[np.ndarray, np.ndarray] | None = None
    """G (k, n) and h (k,) < 0 of the rows that are broken already: what it would take to keep them"""
    braking: np.ndarray | None = None
    """The displacement (n,) that is `rest` where that is not the one nearest to none"""

    @property
    def rest(self) -> np.ndarray:
        """The displacement (n,) nearest to none that the box allows: none, or to brake, or to come back.

        Where rows let joints that cannot stop at once only slow down together, that.
        """
        return np.clip(0.0, self.lower, self.upper) if self.braking is None else self.braking

    @property
    def held(self) -> np.ndarray:
        """Which joints (n,) stand on a limit, or beyond it."""
        return (self.lower >= 0) | (self.upper <= 0)

    def contain(self, dq: np.ndarray) -> bool:
        """Whether dq (n,) is within the bounds, to rounding."""
        inside = (dq >= self.lower - FEASIBILITY).all() and (dq <= self.upper + FEASIBILITY).all()
        return bool(inside and (len(self.h) == 0 or (self.G @ dq <= self.h + FEASIBILITY).all()))

    def share_inside(self, dq: np.ndarray, part: np.ndarray) -> float:
        """The largest share in [0, 1] of a part (n,) that the box allows after dq (n,), which is inside."""
        room = np.where(part > 0, self.upper - dq, self.lower - dq)
        over = (dq + part > self.upper + FEASIBILITY) | (dq + part < self.lower - FEASIBILITY)
        return max(0.0, float(np.min(room[over] / part[over], initial=1.0)))

    def within(self, radius: float) -> Bounds:
        """The same, and every entry of dq at most `radius` > 0 in size (a trust region)."""
        return Bounds(np.clip(self.lower, -radius, 0), np.clip(self.upper, 0, radius), self.G, self.h)

    def along(self, way: np.ndarray, change: np.ndarray) -> Bounds:
        """The same, and no joint that cannot stop at once goes against its way (n,) or too fast to stop at its end.

        `change` (n,) as in `braking_displacement`. The `rest` stays as it is.
        """
        stop, at_once = stopping_displacement(way, change), np.isinf(change)
        low = np.where(at_once, -np.inf, np.minimum(np.minimum(stop, 0.0), self.rest))
        high = np.where(at_once, np.inf, np.maximum(np.maximum(stop, 0.0), self.rest))
        lower, upper = (np.clip(each, self.lower, self.upper) for each in (low, high))
        return replace(self, lower=lower, upper=upper)


class Limit:
    """One kind of limit. A limit of one's own overrides what it needs of these."""

    name: str | None = None
    """What messages, `broken_limits` and calls call it; None: its class, of which calls take a word, "collision_limit".
    """
    is_linear: ClassVar[bool] = False
    """Whether the rows hold for every displacement, so that one that keeps them keeps the limit; False: to first order
    only, as is safe for any limit."""
    is_off: ClassVar[bool] = False
    """A hard limit counts always."""
    knows_curvature: ClassVar[bool] = False
    """`curvature` is by a formula, and cheap enough for a control tick."""

    @property
    def key(self) -> str:
        """What a call calls the limit by."""
        return word_for(self) if self.name is None else self.name

    @property
    def datum(self) -> str:
        """What it takes from a call that stands in the base, "pose", "point" or "direction"; empty: nothing does."""
        return "" if self.target_key is None else POSE

    def with_value(self, value: Any) -> Limit:
        """The limit, bound to a robot, with another datum. Raises `OptionError`."""
        raise OptionError(f"{self.key!r}, a {type(self).__name__}, {NO_DATUM}")

    def scaled(self, factor: float) -> Limit:
        """A hard limit has no weight. Raises `OptionError`."""
        raise OptionError(f"{self.key!r} is a hard limit, which has no weight; mq.LimitTask(limit=...) has one")

    @property
    def target_key(self) -> str | None:
        """The key of the target that the limit takes from the call; None: it needs none."""
        return None

    def target_of(self, value: Any) -> Any:
        """The `value` that a call gives as target, or as targets, as poses; vectors too where the limit takes some."""
        return value

    def toward(self, targets: Mapping[str, pin.SE3]) -> Limit:
        """The same limit with its target out of these, which are not checked again."""
        return self

    @property
    def obstacle_names(self) -> tuple[str, ...]:
        """The bodies around the robot that a call may move."""
        return ()

    def check_placed(self) -> None:
        """Check that each obstacle has a pose, if there are any. Raises `OptionError`."""

    def with_obstacles(self, poses: Mapping[str, Any]) -> Limit:
        """The limit, bound to a robot, with some of these elsewhere. Raises `OptionError`, `PoseError`."""
        return self

    def of(self, robot: Robot) -> Limit:
        """The limit with everything that depends on the robot filled in and checked. Raises `OptionError`."""
        return self

    def box(self, at: Configuration, tick: Tick | None) -> tuple[np.ndarray, np.ndarray] | None:
        """Lower and upper bound (n,) on dq in a tick (None: no time passes), or None."""
        return None

    def rows(self, at: Configuration, tick: Tick | None) -> tuple[np.ndarray, np.ndarray] | None:
        """G (m, n) and h (m,) of `G dq <= h`, h negative where the configuration breaks the limit; or None."""
        return None

    def pace(self, at: Configuration, dq: np.ndarray, tick: Tick) -> float:
        """How fast a displacement dq (n,) of a tick is, as a share of what the limit allows; >= 0.

        Of limits on speeds that are neither boxes nor rows.
        """
        return 0.0

    def violation(self, at: Configuration) -> float:
        """By how much the configuration breaks the limit; >= 0."""
        rows = self.rows(at, None)
        return 0.0 if rows is None else max(0.0, -float(np.min(rows[1], initial=0.0)))

    def residual(self, at: Configuration) -> tuple[float, float]:
        """What the rows are broken by, the norm of those in metres, and of those in rad or of another unit."""
        rows = self.rows(at, None)
        return 0.0, 0.0 if rows is None else float(np.linalg.norm(np.minimum(rows[1], 0.0)))

    def curvature(self, at: Configuration, multipliers: np.ndarray) -> np.ndarray:
        """Second derivative (n, n) of the rows, weighted: `sum_k multipliers_k dG_k/dq`; multipliers (m,).

        By differences of the rows of no tick; zero where their number changes.
        """
        if self.is_linear:
            return np.zeros((at.n, at.n))
        C = np.zeros((at.n, at.n))
        for j, dq in enumerate(DIFFERENCE * np.eye(at.n)):
            ahead, back = (self.rows(at.moved(way), None) for way in (dq, -dq))
            if ahead is None or back is None or not len(ahead[1]) == len(back[1]) == len(multipliers):
                return np.zeros((at.n, at.n))
            C[:, j] = multipliers @ (ahead[0] - back[0]) / (2 * DIFFERENCE)
        return 0.5 * (C + C.T)

    def broken(self, at: Configuration, name: str) -> dict[str, float]:
        """What of the limit, called `name`, the configuration breaks, and by how much; empty where it is kept."""
        rows = self.rows(at, None)
        h = np.empty(0) if rows is None else rows[1]
        out = np.flatnonzero(h < -KEPT)
        found = {f"{name} row {i + 1}" if len(h) > 1 else name: -float(h[i]) for i in out}
        return found or ({name: violation} if (violation := self.violation(at)) > KEPT else {})

    def violations(self, at: Configuration) -> np.ndarray:
        """The same for each part of the limit (k,), at all configurations as many: a tick lets none grow.

        Of a linear limit without what is rounding, as there no reserve keeps it off.
        """
        return np.array([max(0.0, self.violation(at) - (KEPT if self.is_linear else 0.0))])

    def rooms(self, at: Configuration) -> np.ndarray:
        """What is left of each of these parts (k,), negative where it is broken; inf where no row is about it."""
        missing, parts = self.violations(at), self.parts(at)
        rooms = np.where(missing > 0, -missing, np.inf)
        if (rows := self.rows(at, None)) is not None:
            np.minimum.at(rooms, parts, np.where(missing[parts] > 0, np.inf, rows[1]))
        return rooms

    def parts(self, at: Configuration) -> np.ndarray:
        """Which of `violations` each row (m,) of no tick is about: its `h` is at least minus that."""
        rows = self.rows(at, None)
        return np.zeros(0 if rows is None else len(rows[1]), dtype=int)

    def active(self, at: Configuration) -> list[str]:
        """What of the limit the configuration stands on, by name."""
        return [name for name, _ in self.standing(at)[0]]

    def standing(self, at: Configuration) -> tuple[list[tuple[str, str]], np.ndarray]:
        """Names and units of the k rows that the configuration stands on, and gradients (k, n) of what they leave."""
        rows = self.rows(at, None)
        if rows is None:
            return [], np.empty((0, at.n))
        G, h = rows
        named, on = self.named_rows(len(h)), np.flatnonzero(h <= ACTIVE_WITHIN)
        return [named[i] for i in on], -G[on]

    def named_rows(self, count: int) -> list[tuple[str, str]]:
        """What each of `count` rows of no tick is called, and its unit: "m", "rad" or, where it is neither, ""."""
        name = self.name or type(self).__name__
        return [(f"{name} row {i + 1}" if count > 1 else name, "") for i in range(count)]


@dataclass(frozen=True)
class PositionLimit(Limit):
    """`lower <= q + dq <= upper`, and never so fast toward a limit that the joint could not stop before it.

    After a tick at speed v the room r that is left is to be at least the braking distance `v^2 / (2 acceleration)`. In
    a later tick, of whatever length, a joint that brakes goes less far than one that brakes continuously, so a state
    that keeps this can always be followed by one that does, also where dt varies from tick to tick (viability: Del
    Prete, "Joint position and velocity bounds in discrete-time acceleration/torque control of robot arms", 2018, whose
    bound for a constant dt is wider by half a tick). A joint that comes too fast for that (with a velocity from
    elsewhere, or after limits were narrowed) brakes evenly and harder than `acceleration`, as hard as it takes to stop
    at the limit: position goes before acceleration.
    """

    lower: np.ndarray
    """(n,) [rad or m]"""
    upper: np.ndarray
    """(n,) [rad or m]"""
    acceleration: np.ndarray
    """(n,) [rad/s^2 or m/s^2], inf for a joint that can stop at once"""

    def box(self, at: Configuration, tick: Tick | None) -> tuple[np.ndarray, np.ndarray]:
        """The distance to either limit; in a tick, what may be gone of it, from outside what must be."""
        below, above = self.lower - at.q, self.upper - at.q
        if tick is None:
            return below, above
        low, high = -self._toward(-below, -tick.velocity, tick.dt), self._toward(above, tick.velocity, tick.dt)
        return np.where(above < 0, np.minimum(low, high), low), np.where(below > 0, np.maximum(low, high), high)

    def _toward(self, room: np.ndarray, velocity: np.ndarray, dt: float) -> np.ndarray:
        """The largest displacement (n,) toward a limit `room` (n,) away; where that is negative, the way back."""
        change, ahead = self.acceleration * dt**2, velocity * dt
        return np.where(room < 0, np.maximum(room, ahead - change), braking_displacement(room, change, ahead))


def braking_displacement(room: np.ndarray, change: np.ndarray, ahead: np.ndarray | float = 0.0) -> np.ndarray:
    """The largest displacement (n,) of a tick from which a joint stops within `room` (n,).

    `change` (n,) is `acceleration dt^2`, the most by which a tick's displacement can change from the last, and `ahead`
    (n,) that of a tick at the speed of now. The displacement d solves `d + d^2 / (2 change) = room`; from speeds of
    which no stop is possible, the same with the change that makes one possible, `ahead^2 / (2 room)`.
    """
    free = (room > 0) & (room < np.inf) & (change < np.inf)
    r, c = np.where(free, room, 1.0), np.where(free, change, 1.0)
    too_fast = (ahead > 0) & (np.square(ahead) > 2 * r * c)
    x = np.where(too_fast, np.square(2 * r / np.where(too_fast, ahead, 1.0)), 2 * r / c)
    return np.where(free, np.minimum(2 * r / (1 + np.sqrt(1 + x)), room), room)


def stopping_displacement(way: np.ndarray, change: np.ndarray) -> np.ndarray:
    """The largest displacement (n,) of a tick from which a joint stops at the end of its way (n,), with a `RESERVE`."""
    return np.sign(way) * braking_displacement(np.abs(way), RESERVE * change)


@dataclass(frozen=True)
class AccelerationLimit(Limit):
    """`|dq / dt - velocity| <= acceleration dt`, acceleration (n,) [rad/s^2 or m/s^2], where time passes."""

    acceleration: np.ndarray

    def box(self, at: Configuration, tick: Tick | None) -> tuple[np.ndarray, np.ndarray] | None:
        """What a tick can change."""
        if tick is None:
            return None
        change, ahead = self.acceleration * tick.dt**2, tick.velocity * tick.dt
        return ahead - change, ahead + change


@dataclass(frozen=True)
class VelocityLimit(Limit):
    """`|dq| <= velocity dt`, velocity (n,) [rad/s or m/s]; no limit where no time passes."""

    velocity: np.ndarray

    def box(self, at: Configuration, tick: Tick | None) -> tuple[np.ndarray, np.ndarray] | None:
        """The distance that a tick allows."""
        if tick is None:
            return None
        reach = self.velocity * tick.dt
        return -reach, reach


def merge(limits: Sequence[Limit], at: Configuration, tick: Tick | None = None, reserve: float = 0.0) -> Bounds:
    """The limits at a configuration as one `Bounds`, which always admits its `rest`.

    Of limits that are not linear the rows keep back a `reserve` [in their unit].

    Each box is clipped into the ones that come later in the list, so the merged box is never empty: with position
    between acceleration and velocity, a joint outside its limits comes back at its limit speed, and one that is too
    fast to stop stops nevertheless. A row that is already broken, or that a joint which cannot stop at once is about to
    break, may not be broken further.
    """
    n = at.n
    lower, upper = np.full(n, -np.inf), np.full(n, np.inf)
    G, h = [np.empty((0, n))], [np.empty(0)]
    for limit in limits:
        if (box := limit.box(at, tick)) is not None:
            lower, upper = np.clip(lower, *box), np.clip(upper, *box)
        if (rows := limit.rows(at, tick)) is not None:
            G.append(rows[0])
            h.append(rows[1] if limit.is_linear or not reserve else rows[1] - reserve)
    bounds = Bounds(lower, upper, np.vstack(G), np.concatenate(h))
    if not len(bounds.h):
        return bounds
    out = bounds.h < 0
    broken = (bounds.G[out], bounds.h[out]) if out.any() else None
    kept, braking = np.maximum(bounds.h, 0.0), None
    over = float((bounds.G @ bounds.rest - kept).max())
    if over > 0 and tick is not None:
        together = slowed_together(bounds, tick.velocity * tick.dt)
        if together is not None and float((bounds.G @ together - kept).max()) < over:
            braking = together
    bounds = replace(bounds, broken=broken, braking=braking)
    return replace(bounds, h=np.maximum(kept, bounds.G @ bounds.rest))


def slowed_together(bounds: Bounds, ahead: np.ndarray) -> np.ndarray | None:
    """The smallest share of the displacement `ahead` (n,) at the speed of now that the box allows; None for none."""
    moves = ahead != 0
    if not moves.any() or not ((bounds.lower <= 0) & (bounds.upper >= 0))[~moves].all():
        return None
    ends = np.stack([bounds.lower[moves], bounds.upper[moves]]) / ahead[moves]
    share = max(0.0, float(ends.min(axis=0).max()))
    return np.clip(share * ahead, bounds.lower, bounds.upper) if share <= ends.max(axis=0).min() else None
