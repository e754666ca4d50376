"""Limits of joints as a caller sets them: a number for all, an array, or a mapping by name; checked, and written."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from maira_qp.arrays import is_listing, real_array
from maira_qp.errors import OptionError, listed, shown
from maira_qp.robots.model.joint_values import joint_values
from maira_qp.robots.unit_hints import degrees_hint_of_angles

ENDLESS = 1e16
"""Limits beyond it are none: a double steps by more than a radian, or a metre, there. Files write 1.797e308."""

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
