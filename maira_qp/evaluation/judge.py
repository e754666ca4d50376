"""The judge: a second opinion on every answer, sharing no code with the solvers.

The tool pose comes from a plain walk over the URDF text, joint by joint: `T <- T origin(xyz, rpy) motion(axis, value)`
(URDF specification of `joint`). No Pinocchio, no DH table, no quaternions, no limits but those in the text. Whoever
claims success is believed only if the walk agrees. One answer (n,), a batch of them (N, n) and the ticks of a control
run are judged alike: leading axes are kept.
"""

from __future__ import annotations

import math
import xml.etree.ElementTree as ElementTree
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from maira_qp.errors import RobotError

ROUNDING = 1e-12
"""What a mimic joint may exceed its limit by: it is computed as multiplier * q + offset."""


@dataclass(frozen=True)
class Verdict:
    """What is true of configurations (..., n) and their targets; each figure has the shape (...)."""

    position_error: Any
    """Distance of the tool from the target [m], of the worst tool; inf where the configuration is not finite."""
    orientation_error: Any
    """Angle between the tool and the target [rad], 0 to pi, of the worst tool; inf likewise."""
    limit_violation: Any
    """How far the worst joint is outside of its limits [rad or m]; 0 when all are inside, inf likewise."""
    speed_excess: Any = 0.0
    """Of a control run: by how much the worst joint is faster than its limit [rad/s or m/s]; 0 when none is."""
    distance: Any = math.inf
    """Of a control run among links or obstacles: the smallest distance between two of them [m]."""

    def within(self, position_tolerance: float, orientation_tolerance: float, slack: float = 0.0) -> Any:
        """Whether the pose is reached to tolerances in m and rad, no joint more than `slack` [rad or m] outside."""
        reached = (self.position_error <= position_tolerance) & (self.orientation_error <= orientation_tolerance)
        return reached & (self.limit_violation <= slack)


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
    speed: float = math.inf
    """Largest speed of its own [rad/s or m/s]."""

    @property
    def mimics(self) -> bool:
        """Whether the value is computed, and not one of q itself."""
        return (self.multiplier, self.offset) != (1.0, 0.0)

    def value(self, q: np.ndarray) -> Any:
        """The joint's own values (...) [rad or m] at configurations q (..., n)."""
        return 0.0 if self.driver is None else self.multiplier * q[..., self.driver] + self.offset


class Judge:
    """Forward kinematics and verdicts from the text of a URDF."""

    def __init__(self, urdf: str, base: str, tip: str | Sequence[str], joint_names: Sequence[str]) -> None:
        """URDF text, the links between which to walk, and the names of the n joints in the order of q.

        With several tips the first is the one that is meant where none is named. Raises `RobotError` if there is no
        chain of revolute, continuous, prismatic and fixed joints from the base to a tip.
        """
        joints = {element.get("name"): element for element in ElementTree.fromstring(urdf).findall("joint")}
        into = {_link(element, "child"): element for element in joints.values()}
        index = {name: i for i, name in enumerate(joint_names)}
        self.n = len(joint_names)
        self.tips = (tip,) if isinstance(tip, str) else tuple(tip)
        made: dict[str, PathJoint] = {}
        self.paths: dict[str, tuple[PathJoint, ...]] = {}
        for end in self.tips:
            names = _path(into, base, end)
            made |= {name: _path_joint(joints[name], joints, index) for name in names if name not in made}
            self.paths[end] = tuple(made[name] for name in names)
        self.joints = tuple(made.values())
        self.lower, self.upper, self.speed = np.full(self.n, -np.inf), np.full(self.n, np.inf), np.full(self.n, np.inf)
        for joint in self.joints:
            if joint.driver is not None and not joint.mimics:
                i = joint.driver
                self.lower[i], self.upper[i], self.speed[i] = joint.lower, joint.upper, joint.speed

    @property
    def path(self) -> tuple[PathJoint, ...]:
        """The joints from the base to the first tip."""
        return self.paths[self.tips[0]]

    def frames(self, q: np.ndarray, tip: str | None = None) -> tuple[np.ndarray, np.ndarray]:
        """Poses of a path's joints (m, ..., 4, 4) in the base, each before its own motion; the tool's (..., 4, 4)."""
        path = self.paths[tip or self.tips[0]]
        T = np.broadcast_to(np.eye(4), (*q.shape[:-1], 4, 4))
        before = np.empty((len(path), *T.shape))
        for k, joint in enumerate(path):
            before[k] = T @ joint.origin
            T = before[k] @ _motion(joint, q)
        return before, T

    def forward(self, q: np.ndarray, tip: str | None = None) -> np.ndarray:
        """Tool poses (..., 4, 4) in the base at q (..., n)."""
        return self.frames(q, tip)[1]

    def limit_violation(self, q: np.ndarray) -> Any:
        """How far the worst joint of q (..., n) is outside of its limits [rad or m]; 0 when all are inside."""
        worst = np.zeros(q.shape[:-1])
        for joint in self.joints:
            if joint.driver is not None:
                value = joint.value(q)
                excess = np.maximum(joint.lower - value, value - joint.upper)
                worst = np.maximum(worst, np.where(excess > (ROUNDING if joint.mimics else 0.0), excess, 0.0))
        return np.where(np.isfinite(q).all(axis=-1), worst, np.inf)[()]

    def speed_excess(self, v: np.ndarray) -> Any:
        """By how much the worst joint of velocities v (..., n) is faster than its limit [rad/s or m/s]; 0: none is."""
        excess = np.maximum((np.abs(v) - self.speed).max(axis=-1), 0.0)
        return np.where(np.isfinite(v).all(axis=-1), excess, np.inf)[()]

    def verdict(self, q: np.ndarray, target: Any, dt: float | None = None) -> Verdict:
        """What is true of q (..., n) and targets: poses (..., 4, 4), or, by tip, a dictionary of them.

        With `dt` [s], q (N + 1, n) are the configurations before, between and after the N ticks of a control run, and
        each tick is judged by the one that it ends at.
        """
        speed_excess = 0.0
        if dt is not None:
            q, speed_excess = q[1:], self.speed_excess(np.diff(q, axis=0) / dt)
        targets = target if isinstance(target, dict) else {self.tips[0]: target}
        if q.shape[-1:] != (self.n,):
            return Verdict(math.inf, math.inf, math.inf)
        finite = np.asarray(np.isfinite(q).all(axis=-1))
        position = orientation = np.where(finite, 0.0, np.inf)
        for tip, wanted in targets.items():
            T = self.forward(np.where(finite[..., None], q, 0.0), tip)
            position = np.maximum(position, np.linalg.norm(T[..., :3, 3] - wanted[..., :3, 3], axis=-1))
            orientation = np.maximum(orientation, angle_between(T[..., :3, :3], wanted[..., :3, :3]))
        return Verdict(position[()], orientation[()], self.limit_violation(q), speed_excess)


def angle_between(A: np.ndarray, B: np.ndarray) -> Any:
    """Angles (...) [rad] between rotations (..., 3, 3), by the chord |A - B| = 2 sqrt(2) sin(angle / 2), exact at 0."""
    return 2.0 * np.arcsin(np.minimum(1.0, np.linalg.norm(A - B, axis=(-2, -1)) / math.sqrt(8.0)))


def turn(axis: np.ndarray, angle: Any) -> np.ndarray:
    """Rotations (..., 3, 3) by angles (...) [rad] about a unit axis (3,): Rodrigues' formula."""
    x, y, z = axis
    K = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    angle = np.asarray(angle)[..., None, None]
    return np.eye(3) + np.sin(angle) * K + (1.0 - np.cos(angle)) * (K @ K)


def _motion(joint: PathJoint, q: np.ndarray) -> np.ndarray:
    """The joint's own motion (..., 4, 4) at q (..., n)."""
    T = np.zeros((*q.shape[:-1], 4, 4))
    T[..., range(4), range(4)] = 1.0
    if joint.driver is not None and joint.sliding:
        T[..., :3, 3] = joint.axis * np.asarray(joint.value(q))[..., None]
    elif joint.driver is not None:
        T[..., :3, :3] = turn(joint.axis, joint.value(q))
    return T


def _path(into: dict[str, ElementTree.Element], base: str, tip: str) -> list[str]:
    """The names of the joints from a link to another; `into` is each link's own joint."""
    names: list[str] = []
    link = tip
    while link != base:
        if link not in into or len(names) > len(into):
            raise RobotError(f"there is no chain from {base!r} to {tip!r}")
        names.append(into[link].get("name", ""))
        link = _link(into[link], "parent")
    return names[::-1]


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
    limit = element.find("limit")
    bounds = limit if kind != "continuous" else None
    return PathJoint(
        origin,
        axis / np.linalg.norm(axis),
        kind == "prismatic",
        driver,
        multiplier,
        offset,
        -math.inf if bounds is None else float(bounds.get("lower", 0.0)),
        math.inf if bounds is None else float(bounds.get("upper", 0.0)),
        math.inf if limit is None else float(limit.get("velocity", math.inf)),
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
