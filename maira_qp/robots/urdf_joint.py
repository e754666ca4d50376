"""One joint element of a URDF, its numbers read and checked."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from xml.etree.ElementTree import Element

import numpy as np

from maira_qp.errors import RobotError, listed

MOVING = ("revolute", "continuous", "prismatic")
KINDS = (*MOVING, "fixed", "floating", "planar")


@dataclass(frozen=True)
class Joint:
    """A joint of a URDF: where it stands on its parent link, and how its child link moves."""

    name: str
    kind: str
    parent: str
    child: str
    xyz: np.ndarray
    """Position (3,) of the joint in the parent link [m]."""
    rpy: np.ndarray
    """Roll, pitch and yaw (3,) of the joint in the parent link [rad]."""
    axis: np.ndarray
    """Unit vector (3,) about or along which a moving joint moves."""
    lower: float
    """Lower limit [rad, or m]; -inf for a continuous joint, or if none is given."""
    upper: float
    velocity: float
    """Largest speed [rad/s, or m/s]; inf if none is given."""
    effort: float
    """Largest torque or force [N m, or N]; inf if none is given."""
    acceleration: float
    """Largest acceleration, and deceleration [rad/s^2, or m/s^2]; inf if none is given."""
    mimic: tuple[str, float, float] | None
    """Leader, multiplier and offset of a joint with q = multiplier * q_leader + offset."""


def joint_of(element: Element) -> Joint:
    """The joint that an element describes. Raises `RobotError` where its numbers make no sense."""
    name, kind = element.attrib["name"], element.attrib["type"]
    what = f"joint {name!r}"
    origin, limit = _child(element, "origin"), _child(element, "limit")
    axis = _numbers(_child(element, "axis"), "xyz", f"{what}, axis", 3, "1 0 0")
    lower, upper = -math.inf, math.inf
    if kind in ("revolute", "prismatic") and ("lower" in limit or "upper" in limit):
        lower, upper = (_number(limit, key, f"{what}, limit", "0") for key in ("lower", "upper"))
        if lower > upper:
            raise RobotError(f"{what} has inverted limits: lower {lower} > upper {upper}")
    return Joint(
        name=name,
        kind=kind,
        parent=_child(element, "parent")["link"],
        child=_child(element, "child")["link"],
        xyz=_numbers(origin, "xyz", f"{what}, origin", 3, "0 0 0"),
        rpy=_numbers(origin, "rpy", f"{what}, origin", 3, "0 0 0"),
        axis=_unit(axis, what) if kind in MOVING else axis,
        lower=lower,
        upper=upper,
        velocity=_bound(limit, "velocity", what),
        effort=_bound(limit, "effort", what),
        acceleration=min(_acceleration(limit, key, what) for key in ("acceleration", "deceleration")),
        mimic=_mimic(element, what) if kind in MOVING else None,
    )


def check_ends(element: Element) -> None:
    """Raises `RobotError` if the element lacks a type that exists, a parent link or a child link."""
    name, kind = element.attrib["name"], element.get("type")
    if kind not in KINDS:
        given = f"the unknown type {kind!r}" if kind else "no type"
        raise RobotError(f"joint {name!r} has {given}; {listed(KINDS, kind)}")
    for tag in ("parent", "child"):
        if not _child(element, tag).get("link"):
            raise RobotError(f"joint {name!r} has no {tag} link")


def _child(element: Element, tag: str) -> Mapping[str, str]:
    """The attributes of the first child of that tag, none if there is no such child."""
    found = element.find(tag)
    return {} if found is None else found.attrib


def _unit(axis: np.ndarray, what: str) -> np.ndarray:
    """The axis (3,) at length 1; one that has it to rounding stays as it is."""
    size = float(np.abs(axis).max())
    if size == 0:
        raise RobotError(f"{what} has a zero axis")
    scaled = axis / size if not 1e-9 < size < 1e9 else axis  # squares must neither overflow nor vanish
    norm = float(np.linalg.norm(scaled))
    return (scaled if abs(norm - 1) < 1e-15 else scaled / norm) + 0.0  # no -0.0


def _mimic(element: Element, what: str) -> tuple[str, float, float] | None:
    if element.find("mimic") is None:
        return None
    mimic = _child(element, "mimic")
    leader = mimic.get("joint")
    if not leader:
        raise RobotError(f"{what} mimics a joint that is not named")
    multiplier, offset = (
        _number(mimic, key, f"{what}, mimic", default) for key, default in (("multiplier", "1"), ("offset", "0"))
    )
    return leader, multiplier, offset


def _bound(limit: Mapping[str, str], key: str, what: str) -> float:
    """A velocity or effort limit: inf where it is missing or not positive, as files write what they do not know."""
    value = _number(limit, key, f"{what}, limit", "0", finite=False)
    return value if value > 0 else math.inf


def _acceleration(limit: Mapping[str, str], key: str, what: str) -> float:
    """An attribute of URDF 1.2: inf where it is missing or 0."""
    value = _number(limit, key, f"{what}, limit", "0", finite=False)
    if value < 0:
        raise RobotError(f"{what}, limit: {key}={limit[key][:80]!r} is negative")
    return value or math.inf


def _number(attributes: Mapping[str, str], key: str, what: str, default: str, finite: bool = True) -> float:
    return float(_numbers(attributes, key, what, 1, default, finite)[0])


def _numbers(
    attributes: Mapping[str, str], key: str, what: str, count: int, default: str, finite: bool = True
) -> np.ndarray:
    """`count` numbers (count,) of an attribute. Raises `RobotError` for another count, words, NaN or infinities."""
    text = attributes.get(key, default)
    shown = f"{key}={text[:80]!r}"
    try:
        if "_" in text:
            raise ValueError("Python reads 1_0 as 10, XML does not")
        values = np.array([float(word) for word in text.split()], dtype=float)
    except ValueError:
        raise RobotError(f"{what}: {shown} is not made of numbers") from None
    if len(values) != count:
        raise RobotError(f"{what}: {shown} should be {count} number{'s' if count > 1 else ''}")
    if np.isnan(values).any() or (finite and not np.isfinite(values).all()):
        raise RobotError(f"{what}: {shown} is not finite")
    return values
