"""The judge: a second opinion on every answer, sharing no code with the solvers.

The tool pose comes from a plain walk over the URDF text, joint by joint: `T <- T origin(xyz, rpy) motion(axis, value)`
(URDF specification of `joint`). No Pinocchio, no DH table, no quaternions, no limits but those in the text. Whoever
claims success is believed only if the walk agrees.
"""

from __future__ import annotations

import math
import xml.etree.ElementTree as ElementTree
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from maira_qp.errors import RobotError

ROUNDING = 1e-12
"""What a mimic joint may exceed its limit by: it is computed as multiplier * q + offset."""


@dataclass(frozen=True)
class Verdict:
    """What is true of a configuration and a target."""

    position_error: float
    """Distance of the tool from the target [m]; inf where the configuration is not finite."""
    orientation_error: float
    """Angle between the tool and the target [rad], 0 to pi; inf where the configuration is not finite."""
    limit_violation: float
    """How far the worst joint is outside of its limits [rad or m]; 0 when all are inside."""

    def within(self, position_tolerance: float, orientation_tolerance: float) -> bool:
        """Whether the pose is reached to tolerances in m and rad, inside the limits."""
        reached = self.position_error <= position_tolerance and self.orientation_error <= orientation_tolerance
        return reached and self.limit_violation == 0


@dataclass(frozen=True)
class PathJoint:
    """One joint between base and tip: where it sits, how it moves, and which q moves it."""

    origin: np.ndarray
    """Pose (4, 4) of the joint in its parent link at zero."""
    axis: np.ndarray
    """Unit axis (3,) in the joint's frame; zero for a fixed joint."""
    sliding: bool
    """Whether the joint slides along its axis instead of turning about it."""
    driver: int | None
    """Index into q of the joint that moves it (its own or that of the joint it mimics); None: fixed."""
    multiplier: float = 1.0
    """Its value is multiplier * q[driver] + offset."""
    offset: float = 0.0
    """Its value at q[driver] = 0 [rad or m]."""
    lower: float = -math.inf
    """Lower limit of its own value [rad or m]."""
    upper: float = math.inf
    """Upper limit of its own value [rad or m]."""

    @property
    def mimics(self) -> bool:
        """Whether the value is computed, and not one of q itself."""
        return (self.multiplier, self.offset) != (1.0, 0.0)

    def value(self, q: np.ndarray) -> float:
        """The joint's own value [rad or m] at the configuration q (n,)."""
        return 0.0 if self.driver is None else self.multiplier * float(q[self.driver]) + self.offset


class Judge:
    """Forward kinematics and verdicts from the text of a URDF."""

    def __init__(self, urdf: str, base: str, tip: str, joint_names: Sequence[str]) -> None:
        """URDF text, the links between which to walk, and the names of the n joints in the order of q.

        Raises `RobotError` if there is no chain of revolute, continuous, prismatic and fixed joints between them.
        """
        joints = {element.get("name"): element for element in ElementTree.fromstring(urdf).findall("joint")}
        into = {_link(element, "child"): element for element in joints.values()}
        index = {name: i for i, name in enumerate(joint_names)}
        path: list[PathJoint] = []
        link = tip
        while link != base:
            if link not in into or len(path) > len(into):
                raise RobotError(f"there is no chain from {base!r} to {tip!r}")
            path.append(_path_joint(into[link], joints, index))
            link = _link(into[link], "parent")
        self.path = tuple(reversed(path))
        self.n = len(joint_names)

    def frames(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Poses of the path's joints (m, 4, 4) in the base, each before its own motion, and the tool's (4, 4)."""
        T = np.eye(4)
        before = np.empty((len(self.path), 4, 4))
        for k, joint in enumerate(self.path):
            before[k] = T @ joint.origin
            T = before[k] @ _motion(joint, joint.value(q))
        return before, T

    def forward(self, q: np.ndarray) -> np.ndarray:
        """Tool pose (4, 4) in the base at q (n,)."""
        return self.frames(q)[1]

    def limit_violation(self, q: np.ndarray) -> float:
        """How far the worst joint of q (n,) is outside of its limits [rad or m]; 0 when all are inside."""
        worst = 0.0
        for joint in self.path:
            if joint.driver is not None:
                value = joint.value(q)
                excess = max(joint.lower - value, value - joint.upper)
                worst = max(worst, excess if excess > (ROUNDING if joint.mimics else 0.0) else 0.0)
        return worst

    def verdict(self, q: np.ndarray, target: np.ndarray) -> Verdict:
        """What is true of q (n,) and a target (4, 4)."""
        if q.shape != (self.n,) or not np.isfinite(q).all():
            return Verdict(math.inf, math.inf, math.inf)
        T = self.forward(q)
        return Verdict(
            float(np.linalg.norm(T[:3, 3] - target[:3, 3])),
            angle_between(T[:3, :3], target[:3, :3]),
            self.limit_violation(q),
        )


def angle_between(A: np.ndarray, B: np.ndarray) -> float:
    """Angle [rad] between two rotations (3, 3), from the chord: |A - B| = 2 sqrt(2) sin(angle / 2), exact near 0."""
    return 2.0 * math.asin(min(1.0, float(np.linalg.norm(A - B)) / math.sqrt(8.0)))


def turn(axis: np.ndarray, angle: float) -> np.ndarray:
    """Rotation (3, 3) by an angle [rad] about a unit axis (3,): Rodrigues' formula."""
    x, y, z = axis
    K = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + math.sin(angle) * K + (1.0 - math.cos(angle)) * (K @ K)


def _motion(joint: PathJoint, value: float) -> np.ndarray:
    T = np.eye(4)
    if joint.driver is None:
        return T
    if joint.sliding:
        T[:3, 3] = joint.axis * value
    else:
        T[:3, :3] = turn(joint.axis, value)
    return T


def _path_joint(element: ElementTree.Element, joints: dict, index: dict[str, int]) -> PathJoint:
    """A joint as the URDF tells it."""
    kind = element.get("type")
    origin = _origin(element.find("origin"))
    if kind == "fixed":
        return PathJoint(origin, np.zeros(3), sliding=False, driver=None)
    if kind not in ("revolute", "continuous", "prismatic"):
        raise RobotError(f"joint {element.get('name')!r} is of type {kind!r}, which the judge cannot walk")
    axis = _numbers(element.find("axis"), "xyz", (1.0, 0.0, 0.0))
    driver, multiplier, offset = _driver(element, joints, index)
    limit = element.find("limit") if kind != "continuous" else None
    return PathJoint(
        origin,
        axis / np.linalg.norm(axis),
        kind == "prismatic",
        driver,
        multiplier,
        offset,
        -math.inf if limit is None else float(limit.get("lower", 0.0)),
        math.inf if limit is None else float(limit.get("upper", 0.0)),
    )


def _driver(element: ElementTree.Element, joints: dict, index: dict[str, int]) -> tuple[int, float, float]:
    """The index into q that moves a joint, and the multiplier and offset of its value, mimic joints followed."""
    multiplier, offset = 1.0, 0.0
    for _ in range(len(joints) + 1):
        mimic = element.find("mimic")
        if mimic is None:
            break
        offset += multiplier * float(mimic.get("offset", 0.0))
        multiplier *= float(mimic.get("multiplier", 1.0))
        element = joints[mimic.get("joint")]
    name = element.get("name", "")
    if name not in index:
        raise RobotError(f"joint {name!r} moves the tool, but it is not one of {', '.join(index)}")
    return index[name], multiplier, offset


def _origin(element: ElementTree.Element | None) -> np.ndarray:
    """Pose (4, 4) of an `origin`: rotation about the fixed x, then y, then z axis."""
    roll, pitch, yaw = _numbers(element, "rpy", (0.0, 0.0, 0.0))
    ex, ey, ez = np.eye(3)
    T = np.eye(4)
    T[:3, :3] = turn(ez, yaw) @ turn(ey, pitch) @ turn(ex, roll)
    T[:3, 3] = _numbers(element, "xyz", (0.0, 0.0, 0.0))
    return T


def _numbers(element: ElementTree.Element | None, key: str, default: tuple[float, ...]) -> np.ndarray:
    text = None if element is None else element.get(key)
    return np.array(default if text is None else [float(word) for word in text.split()], dtype=float)


def _link(joint: ElementTree.Element, end: str) -> str:
    element = joint.find(end)
    return "" if element is None else element.get("link", "")
