"""One joint element of a URDF, its numbers read and checked."""

from __future__ import annotations

import math
import sys
from collections.abc import Mapping
from dataclasses import dataclass, replace
from xml.etree.ElementTree import Element

import numpy as np

from maira_qp.errors import RobotError, listed
from maira_qp.robots.model.joint_limits import ENDLESS
from maira_qp.robots.urdf.rpy import matrix_from_rpy, rpy_from_matrix

MOVING = ("revolute", "continuous", "prismatic")
KINDS = (*MOVING, "fixed", "floating", "planar")
BALL = "ball"
"""A type that URDF lacks and MJCF has; it is in no list of valid ones."""

LARGEST = 1e9
"""Largest length [m], angle [rad] and mimic multiplier that is read: beyond it a double has no micrometre left."""
MAX_FLOAT = sys.float_info.max


def macro_left(seen: str) -> str:
    """The message where what was seen is to be replaced by xacro."""
    return f"this is xacro (see {seen}), not URDF: run `xacro in.xacro > out.urdf` first"


def is_macro(text: str) -> bool:
    """Whether a text holds what xacro would replace."""
    return "${" in text or "$(" in text


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


def joint_of(element: Element, given: tuple[float, float] | None = None) -> Joint:
    """The joint that an element describes, with position limits that are given in place of its own.

    A revolute joint whose limits are both beyond `ENDLESS` is continuous. Raises `RobotError` where its type is unknown
    or its numbers make no sense.
    """
    name, kind = element.attrib["name"], element.get("type")
    what = f"joint {name!r}"
    if kind not in (*KINDS, BALL):
        told = f"the unknown type {kind!r}" if kind else "no type"
        raise RobotError(f"{what} has {told}; {listed(KINDS, kind)}")
    limit = _child(element, "limit")
    axis = _numbers(_child(element, "axis"), "xyz", f"{what}, axis", 3, "1 0 0")
    lower, upper = -math.inf, math.inf
    if given is not None and kind in MOVING:
        (lower, upper), kind = given, "revolute" if kind == "continuous" else kind
    elif kind in ("revolute", "prismatic") and ("lower" in limit or "upper" in limit):
        lower, upper = (_end(limit, key, what) for key in ("lower", "upper"))
        if lower > upper:
            python, shell = limits_at_load(name)
            raise RobotError(
                f"{what} has inverted limits: lower {lower} > upper {upper}", python=f"or {python}", shell=f"or {shell}"
            )
        if kind == "revolute" and lower == -math.inf and upper == math.inf:
            kind = "continuous"
    xyz, rpy = _origin(element)
    return Joint(
        name=name,
        kind=kind,
        parent=_child(element, "parent")["link"],
        child=_child(element, "child")["link"],
        xyz=xyz,
        rpy=rpy,
        axis=_unit(axis, what) if kind in MOVING else axis,
        lower=lower,
        upper=upper,
        velocity=_bound(limit, "velocity", what),
        effort=_bound(limit, "effort", what),
        acceleration=min(_acceleration(limit, key, what) for key in ("acceleration", "deceleration")),
        mimic=_mimic(element, what) if kind in MOVING else None,
    )


def fixed_of(element: Element) -> Joint:
    """The joint as a fixed one, whatever the element says beside its links and its origin. Raises `RobotError`."""
    xyz, rpy = _origin(element)
    return Joint(
        name=element.attrib["name"],
        kind="fixed",
        parent=_child(element, "parent")["link"],
        child=_child(element, "child")["link"],
        xyz=xyz,
        rpy=rpy,
        axis=np.array([1.0, 0.0, 0.0]),
        lower=-math.inf,
        upper=math.inf,
        velocity=math.inf,
        effort=math.inf,
        acceleration=math.inf,
        mimic=None,
    )


def fixed_at(joint: Joint, value: float) -> Joint:
    """The joint as a fixed one, where it stands at a value [rad, or m]."""
    fixed = replace(joint, kind="fixed", mimic=None)
    if joint.kind not in MOVING or value == 0:
        return fixed
    R = matrix_from_rpy(joint.rpy)
    if joint.kind == "prismatic":
        return replace(fixed, xyz=joint.xyz + R @ (value * joint.axis))
    return replace(fixed, rpy=rpy_from_matrix(R @ _turn(joint.axis, value)))


def turned_round(joint: Joint) -> Joint:
    """A fixed joint from its child link to its parent link."""
    R = matrix_from_rpy(joint.rpy).T
    back = {"xyz": -(R @ joint.xyz) + 0.0, "rpy": rpy_from_matrix(R)}
    return replace(joint, parent=joint.child, child=joint.parent, **back)


def limits_at_load(name: str) -> tuple[str, str]:
    """How the limits of a joint are given when a robot is loaded: in Python, and on the command line."""
    return f"at load, limits={{{name!r}: (lower, upper)}}", f"at load, --limits {name}=LOWER:UPPER"


def ends_of(element: Element) -> tuple[str, str]:
    """The parent link and the child link. Raises `RobotError` if there is none."""
    ends = tuple(_child(element, tag).get("link") for tag in ("parent", "child"))
    for tag, link in zip(("parent", "child"), ends, strict=True):
        if not link:
            raise RobotError(f"joint {element.attrib['name']!r} has no {tag} link")
    return ends  # type: ignore[return-value]


def _origin(element: Element) -> tuple[np.ndarray, np.ndarray]:
    """Position (3,) [m], and roll, pitch and yaw (3,) [rad]."""
    what, origin = f"joint {element.attrib['name']!r}, origin", _child(element, "origin")
    for part in element:
        if part.tag.startswith("xacro:"):
            raise RobotError(macro_left(f"<{part.tag}> in {what}"))
    xyz, rpy = (_numbers(origin, key, what, 3, "0 0 0", LARGEST) for key in ("xyz", "rpy"))
    return xyz, rpy


def _end(limit: Mapping[str, str], key: str, what: str) -> float:
    """A position limit, infinite beyond `ENDLESS`."""
    value = _number(limit, key, f"{what}, limit", "0", math.inf)
    return value if abs(value) <= ENDLESS else math.copysign(math.inf, value)


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
    of_leader = f"{what}, mimic"
    multiplier = _number(mimic, "multiplier", of_leader, "1", LARGEST)
    return leader, multiplier, _number(mimic, "offset", of_leader, "0", LARGEST)


def _bound(limit: Mapping[str, str], key: str, what: str) -> float:
    """A velocity or effort limit: inf where it is missing or not positive, as files write what they do not know."""
    value = _number(limit, key, f"{what}, limit", "0", math.inf)
    return value if 0 < value <= ENDLESS else math.inf


def _acceleration(limit: Mapping[str, str], key: str, what: str) -> float:
    """An attribute of URDF 1.2: inf where it is missing or 0."""
    value = _number(limit, key, f"{what}, limit", "0", math.inf)
    if value < 0:
        raise RobotError(f"{what}, limit: {key}={limit[key][:80]!r} is negative")
    return value if 0 < value <= ENDLESS else math.inf


def _number(attributes: Mapping[str, str], key: str, what: str, default: str, largest: float) -> float:
    return float(_numbers(attributes, key, what, 1, default, largest)[0])


def _numbers(
    attributes: Mapping[str, str], key: str, what: str, count: int, default: str, largest: float = MAX_FLOAT
) -> np.ndarray:
    """`count` numbers (count,) of an attribute.

    Raises `RobotError` for another count, for words, for NaN, and for numbers beyond the largest, which may be inf.
    """
    text = attributes.get(key, default)
    told = f"{what}: {key}={text[:80]!r}"
    try:
        if "_" in text:
            raise ValueError("Python reads 1_0 as 10, XML does not")
        values = np.array([float(word) for word in text.split()], dtype=float)
    except ValueError:
        raise RobotError(macro_left(told) if is_macro(text) else f"{told} is not made of numbers") from None
    if len(values) != count:
        raise RobotError(f"{told} should be {count} number{'s' if count > 1 else ''}")
    if np.isnan(values).any() or (largest < math.inf and not np.isfinite(values).all()):
        raise RobotError(f"{told} is not finite")
    if (np.abs(values) > largest).any():
        raise RobotError(f"{told} is beyond the largest number that makes sense there, {largest:g}")
    return values


def _turn(axis: np.ndarray, angle: float) -> np.ndarray:
    """Rotation matrix (3, 3) about a unit axis (3,) by an angle [rad], by Rodrigues' formula."""
    x, y, z = axis
    K = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + math.sin(angle) * K + 2 * math.sin(angle / 2) ** 2 * (K @ K)
