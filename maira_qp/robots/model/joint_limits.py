"""Limits of joints as a caller sets them: a number for all, an array, or a mapping by name; checked, and written."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Any
from xml.etree import ElementTree

import numpy as np

from maira_qp.arrays import is_listing, real_array
from maira_qp.errors import OptionError, listed, shown
from maira_qp.robots.dh.table import DHTable
from maira_qp.robots.unit_hints import degrees_hint_of_angles

FOLLOWING = 1e-9
"""Share by which the limits of a mimic joint become wider than its leader's, and differ at least for that."""


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
        made = replace(self, lower=ends[0] + room, upper=ends[1] - room, velocity=speed, acceleration=change)
        made._check_ends()
        return made

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
        if wish is None:
            return default
        if isinstance(wish, Mapping):
            values = default.copy()
            for joint, value in wish.items():
                if joint not in self.joint_names:
                    known = listed(self.joint_names, joint)
                    raise OptionError(f"{key}: {shown(joint)} is not a joint that moves on its own; {known}")
                name = f"{key} of joint {joint!r}"
                values[self.joint_names.index(joint)] = real_array(value, (), name, OptionError, finite=False)
            return values
        shape = () if np.isscalar(wish) or (isinstance(wish, np.ndarray) and not wish.ndim) else default.shape
        return np.broadcast_to(real_array(wish, shape, key, OptionError, finite=False), default.shape)

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


def limited_table(table: DHTable, limits: JointLimits) -> DHTable:
    """The DH table with other limits; a continuous joint that has been given some is revolute."""
    joints = iter(zip(limits.lower, limits.upper, limits.velocity, limits.acceleration, strict=True))
    links = []
    for link in table.links:
        if link.kind != "fixed":
            lower, upper, velocity, acceleration = map(float, next(joints))
            limited = {"velocity": velocity, "acceleration": acceleration if acceleration < math.inf else None}
            limited |= {"lower": lower, "upper": upper} if upper < math.inf else {"lower": None, "upper": None}
            kind = "revolute" if link.kind == "continuous" and upper < math.inf else link.kind
            link = replace(link, kind=kind, **limited)
        links.append(link)
    return DHTable(links, name=table.name)


def limited_urdf(urdf: str, limits: JointLimits) -> str:
    """The text of a normalised URDF, see `urdf_reader.Chain`, with other limits of its independent joints.

    Those of mimic joints become as wide as these need them.
    """
    root = ElementTree.fromstring(urdf)
    joints = {joint.attrib["name"]: joint for joint in root.findall("joint")}
    for i, name in enumerate(limits.joint_names):
        joint = joints[name]
        keys = {"velocity": limits.velocity[i], "acceleration": limits.acceleration[i]}
        if limits.upper[i] < math.inf:
            keys |= {"lower": limits.lower[i], "upper": limits.upper[i]}
            if joint.get("type") == "continuous":
                joint.set("type", "revolute")
        for limit in joint.findall("limit"):
            limit.attrib |= {key: repr(float(value)) if math.isfinite(value) else "0" for key, value in keys.items()}
        if limits.upper[i] < math.inf:
            _let_follow(root, name, float(limits.lower[i]), float(limits.upper[i]))
    return ElementTree.tostring(root, encoding="unicode")


def _let_follow(root: ElementTree.Element, leader: str, lower: float, upper: float) -> None:
    """Widen the limits of a leader's mimic joints to what its own, [rad, or m], lead them to."""
    for joint in root.findall("joint"):
        mimic, limit = joint.find("mimic"), joint.find("limit")
        if mimic is not None and limit is not None and mimic.get("joint") == leader:
            multiplier, offset = float(mimic.attrib["multiplier"]), float(mimic.attrib["offset"])
            ends = sorted(multiplier * end + offset for end in (lower, upper))
            slack = FOLLOWING * max(1.0, abs(ends[0]), abs(ends[1]))
            if ends[0] < float(limit.get("lower", -math.inf)) - slack:
                limit.set("lower", repr(ends[0] - slack))
            if ends[1] > float(limit.get("upper", math.inf)) + slack:
                limit.set("upper", repr(ends[1] + slack))


def _hint(limits: np.ndarray) -> str:
    """What is behind limits (n,) that look like degrees; those that are infinite aside."""
    hint = degrees_hint_of_angles(limits[np.isfinite(limits)], "the limit")
    return f". {hint}" if hint else ""
