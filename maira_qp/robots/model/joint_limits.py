"""Limits of joints as a caller sets them: a number for all, an array, or a mapping by name; limits of their sums."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from maira_qp.arrays import is_listing, real_array
from maira_qp.errors import ConfigurationError, OptionError, listed, shown
from maira_qp.robots.model.joint_values import joint_values
from maira_qp.robots.unit_hints import degrees_hint_of_angles

ENDLESS = 1e16
"""Limits beyond it are none: a double steps by more than a radian, or a metre, there. Files write 1.797e308."""

DRAWS = 100
"""So often a configuration is drawn from a box before limits of sums are held to leave little of it."""
STEPS = 20
"""Of a walk, for each joint."""
NEWTON = 50
"""Steps to an analytic centre."""
FLAT = 1e-7
"""Limits that leave no larger ball are flat: some of them hold as equations. What finds the ball is no more exact."""

Limits = Mapping[str, tuple[float, float]]
"""Lower and upper limits by the names of joints, in place of those of a description."""


@dataclass(frozen=True)
class JointLimits:
    """Limits of n joints; position and speed may become tighter only."""

    joint_names: tuple[str, ...]
    lower: np.ndarray
    """(n,) [rad, or m], -inf for a continuous joint"""
    upper: np.ndarray
    """(n,) [rad, or m], inf for a continuous joint"""
    velocity: np.ndarray
    """(n,) [rad/s, or m/s], inf where there is no limit"""
    acceleration: np.ndarray
    """(n,) [rad/s^2, or m/s^2], inf where there is no limit"""

    def limited(self, lower: Any, upper: Any, velocity: Any, acceleration: Any, margin: Any) -> JointLimits:
        """These, replaced by what is given, each None (as it is), a number, an array (n,) or {joint name: value}.

        `margin` [rad, or m] is then taken off both ends of the positions. Raises `OptionError` for what `Robot.limited`
        names.
        """
        ends = self._values(lower, "lower", self.lower), self._values(upper, "upper", self.upper)
        speed = self._values(velocity, "velocity", self.velocity)
        change = self._values(acceleration, "acceleration", self.acceleration)
        room = self._values(margin, "margin", np.zeros(len(self.joint_names)))
        self._refuse(
            ends[0] < self.lower, f"the lower limit {{}} would loosen that of {{}}{_hint(ends[0])}", ends[0], self.lower
        )
        self._refuse(
            ends[1] > self.upper, f"the upper limit {{}} would loosen that of {{}}{_hint(ends[1])}", ends[1], self.upper
        )
        self._refuse(~(speed > 0), "the velocity limit must be positive, got {}", speed)
        self._refuse(speed > self.velocity, "the velocity limit {} would loosen that of {}", speed, self.velocity)
        self._refuse(~(change > 0), "the acceleration limit must be positive, got {}", change)
        self._refuse(~((room >= 0) & (room < np.inf)), "the margin must be finite and not negative, got {}", room)
        made = replace(self, lower=ends[0], upper=ends[1], velocity=speed, acceleration=change)
        made._check_ends()
        return made._within(room)

    def of(self, joint_names: tuple[str, ...]) -> JointLimits:
        """Those of some of the joints, in their order."""
        k = [self.joint_names.index(name) for name in joint_names]
        return JointLimits(joint_names, self.lower[k], self.upper[k], self.velocity[k], self.acceleration[k])

    def _within(self, margin: np.ndarray) -> JointLimits:
        """These, margins (n,) [rad, or m] taken off both ends. Raises `OptionError` that says the largest valid one."""
        lower, upper = self.lower + margin, self.upper - margin
        is_too_large = lower > upper
        if is_too_large.any():
            half = 0.5 * self.upper - 0.5 * self.lower
            half = np.where(self.lower + half > self.upper - half, np.nextafter(half, 0.0), half)
            narrowest = np.where(is_too_large, half, np.inf).argmin()  # what it allows, all allow
            self._refuse(
                np.arange(len(half)) == narrowest,
                "the margin {} leaves nothing of its range of {} to {}; the largest that is valid is {}",
                *(margin, self.lower, self.upper, half),
            )
        return replace(self, lower=lower, upper=upper)

    def released(self, limits: Iterable[str], distance: np.ndarray) -> JointLimits:
        """These, the named ones ("joint4 upper") moved outward by distances (n,) [rad, or m]. Raises `OptionError`."""
        if not is_listing(limits):
            raise OptionError(f"limits must be a list of names such as ['joint4 upper'], got {shown(limits)}")
        known = [f"{joint} {end}" for joint in self.joint_names for end in ("lower", "upper")]
        lower, upper = self.lower.copy(), self.upper.copy()
        for name in limits:
            if not isinstance(name, str) or name not in known:
                raise OptionError(f"{shown(name)} is not the limit of a joint; {listed(known, name)}")
            joint, is_upper = divmod(known.index(name), 2)
            if is_upper:
                upper[joint] += distance[joint]
            else:
                lower[joint] -= distance[joint]
        return replace(self, lower=lower, upper=upper)

    def _values(self, wish: Any, key: str, default: np.ndarray) -> np.ndarray:
        """What is wished for as an array (n,), infinities among it; the default for None, and for joints not named."""
        return default if wish is None else joint_values(self.joint_names, wish, key, default)

    def _check_ends(self) -> None:
        """Raises `OptionError` where lower > upper, and where only one of the two is a number."""
        self._refuse(self.lower > self.upper, "the limits {} > {} are inverted", self.lower, self.upper)
        endless = np.isneginf(self.lower) & np.isposinf(self.upper)
        with np.errstate(over="ignore", invalid="ignore"):  # inf - inf
            finite = np.isfinite(self.upper - self.lower)
        self._refuse(~(endless | finite), "limits of {} and {}: give both, or neither", self.lower, self.upper)

    def _refuse(self, where: np.ndarray, reason: str, *values: np.ndarray) -> None:
        """Raises `OptionError` that names the first joint where (n,) something is wrong, with its values."""
        for i in np.flatnonzero(where):
            raise OptionError(f"joint {self.joint_names[i]!r}: {reason.format(*(float(value[i]) for value in values))}")


@dataclass(frozen=True)
class SumLimit:
    """`lower <= sum of coefficient * q <= upper` over some joints: a hard limit that a robot's description holds.

    Such are the range of a tendon, and that of a joint which follows several others.
    """

    name: str
    """Of the tendon, or of the joint."""
    coefficients: Mapping[str, float]
    """{joint name: coefficient}"""
    lower: float
    """In the unit of the sum; -inf: none"""
    upper: float
    """inf: none"""

    def placed(self, values: Mapping[str, float]) -> SumLimit:
        """The same for the other joints where some of them stand at values {joint name: value} [rad, or m]."""
        still = sum(factor * values[joint] for joint, factor in self.coefficients.items() if joint in values)
        left = {joint: factor for joint, factor in self.coefficients.items() if joint not in values}
        return SumLimit(self.name, left, self.lower - still, self.upper - still)


def sum_rows(sums: Iterable[SumLimit], joint_names: Sequence[str]) -> tuple[np.ndarray, np.ndarray, tuple[str, ...]]:
    """Limits of sums as A (m, n), b (m,) of `A q <= b`, and what each row is called, such as "split upper"."""
    rows, sides, names = list[list[float]](), list[float](), list[str]()
    for limit in sums:
        row = [limit.coefficients.get(name, 0.0) for name in joint_names]
        for sign, end, side in ((1.0, limit.upper, "upper"), (-1.0, limit.lower, "lower")):
            if np.isfinite(end):
                rows.append([sign * factor + 0.0 for factor in row])
                sides.append(sign * end)
                names.append(f"{limit.name} {side}")
    return np.reshape(rows, (-1, len(joint_names))), np.array(sides), tuple(names)


def drawn_within(
    rng: np.random.Generator,
    draw: Callable[[], np.ndarray],
    box: tuple[np.ndarray, np.ndarray],
    sums: Sequence[SumLimit],
    joint_names: Sequence[str],
) -> np.ndarray:
    """A configuration (n,) within a box and limits of sums: the first of some draws that is, else by hit and run.

    That is a walk from the analytic centre in random directions, each as far as a uniform draw from what the limits
    leave of it (Smith, "Efficient Monte Carlo procedures for generating points uniformly distributed over bounded
    regions", 1984): uniform in the limit of many steps. The directions are those of the ellipsoid about the centre.
    Raises `ConfigurationError` if nothing is within.
    """
    A, b, _ = sum_rows(sums, joint_names)
    for _ in range(DRAWS):
        q = draw()
        if (A @ q <= b).all():
            return q
    n = len(joint_names)
    A, b = np.vstack([A, np.eye(n), -np.eye(n)]), np.concatenate([b, box[1], -box[0]])
    ball = _largest_ball(A, b)
    if ball is None:
        names = ", ".join(limit.name for limit in sums)
        raise ConfigurationError(f"no configuration within the joint limits keeps those of the sums {names}")
    q, free, loose = _directions(A, b, *ball)
    if not free.size:
        return np.clip(q, *box)
    A, b = A[loose], b[loose]
    y, axes = _analytic_centre(A @ free, b - A @ q)
    q, stretched = q + free @ y, free @ axes
    for _ in range(STEPS * len(y)):
        way = stretched @ rng.normal(size=len(y))
        rates, left = A @ way, np.maximum(b - A @ q, 0.0)
        ends = np.divide(left, rates, out=np.full(len(left), np.inf), where=rates != 0.0)
        q = q + rng.uniform(ends[rates < 0].max(), ends[rates > 0].min()) * way
    return np.clip(q, *box)


def _largest_ball(A: np.ndarray, b: np.ndarray) -> tuple[np.ndarray, float] | None:
    """Middle (n,) and radius of the largest ball in `A q <= b`; None if nothing is in there."""
    from scipy.optimize import linprog  # heavy

    n, sizes = A.shape[1], np.linalg.norm(A, axis=1, keepdims=True)
    bounds = [(None, None)] * n + [(0, None)]
    found = linprog([*np.zeros(n), -1.0], np.hstack([A, sizes]), b, bounds=bounds)
    return None if found.x is None else (found.x[:-1], float(found.x[-1]))


def _directions(
    A: np.ndarray, b: np.ndarray, q: np.ndarray, radius: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Where `A q <= b` is flat, as sums with equal ends make it: a point (n,) of it, its directions (n, m), and which
    rows (k,) have room.

    Scaled up enough, each row that has room anywhere has 1 of it at one point, in one linear program (Freund, Roundy
    and Todd, "Identifying the set of always-active constraints in a system of linear inequalities", 1985).
    """
    from scipy.linalg import null_space  # heavy
    from scipy.optimize import linprog

    (k, n), sizes = A.shape, np.linalg.norm(A, axis=1)
    if radius > FLAT:
        return q, np.eye(n), np.full(k, True)
    A_scaled, b_scaled = A / sizes[:, None], b / sizes
    rows = np.hstack([A_scaled, -b_scaled[:, None], np.eye(k)])
    bounds = [(None, None)] * n + [(1.0, None)] + [(0.0, 1.0)] * k
    found = linprog([*np.zeros(n + 1), *-np.ones(k)], rows, np.zeros(k), bounds=bounds)
    loose = found.x[n + 1 :] > 0.5
    q, tight = found.x[:n] / found.x[n], A_scaled[~loose]
    q = q + np.linalg.lstsq(tight, b_scaled[~loose] - tight @ q, rcond=None)[0]
    return q, null_space(tight), loose


def _analytic_centre(A: np.ndarray, b: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The point (n,) in `A q <= b`, which has room, with the largest product of distances, and the axes (n, n) of the
    ellipsoid there: by Newton's method from the middle of the largest ball."""
    ball = _largest_ball(A, b)
    q, H = (np.zeros(A.shape[1]) if ball is None else ball[0]), np.eye(A.shape[1])
    for _ in range(NEWTON):
        scaled = A / np.maximum(b - A @ q, np.finfo(float).tiny)[:, None]
        H = scaled.T @ scaled
        step = -np.linalg.lstsq(H, scaled.sum(axis=0), rcond=None)[0]
        q = q + step / (1.0 + np.sqrt(max(float(step @ H @ step), 0.0)))
    values, axes = np.linalg.eigh(H)
    return q, axes / np.sqrt(np.maximum(values, np.finfo(float).tiny))


def given_limits(limits: Limits | None, known: Iterable[str]) -> dict[str, tuple[float, float]]:
    """The limits given at load for some of the joints that are known, checked. Raises `OptionError`."""
    if not isinstance(limits, (Mapping, type(None))):
        raise OptionError(f"limits must be a mapping {{joint name: (lower, upper)}}, got {shown(limits)}")
    known, given = list(known), {}
    for name, pair in (limits or {}).items():
        if name not in known:
            raise OptionError(f"limits: {shown(name)} is not a joint that moves; {listed(known, name)}")
        lower, upper = real_array(pair, (2,), f"the limits of joint {name!r}", OptionError).tolist()
        if not -ENDLESS <= lower <= upper <= ENDLESS:
            raise OptionError(f"the limits of joint {name!r} are inverted or too large: ({lower:g}, {upper:g})")
        given[name] = lower, upper
    return given


def _hint(limits: np.ndarray) -> str:
    """What is behind limits (n,) that look like degrees; those that are infinite aside."""
    hint = degrees_hint_of_angles(limits[np.isfinite(limits)], "the limit")
    return f". {hint}" if hint else ""
