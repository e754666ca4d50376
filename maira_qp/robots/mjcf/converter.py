"""A compiled MJCF model as URDF: the same tree of bodies, with a joint value that is MuJoCo's own `qpos`.

A body of MuJoCo stands in its parent at a pose that its joints then change one after the other: a hinge turns it about
an axis through an anchor point p of the body, `T(p) R(axis, q - q0) T(-p)`, a slide moves it by `(q - q0) axis`, where
q0 is the joint's reference. In URDF each joint has a link of its own, which stands in the anchor; the last one's is the
body, where the anchor is the body's origin, or carries it. The reference is taken into the origins.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

import numpy as np

from maira_qp.orientation import matrix_from_quaternion
from maira_qp.robots.mjcf.compiled import Compiled, package
from maira_qp.robots.mjcf.couplings import Couplings, Range
from maira_qp.robots.mjcf.shapes import add_origin, add_shapes, words
from maira_qp.robots.model.joint_limits import SumLimit
from maira_qp.robots.urdf.sum_limits import sum_element

FOLLOWING = 1e-9
"""Share by which the range of a part of a follower is wider than its leader's makes it."""


class Names:
    """Names of what a model holds, no two alike: as both become links, a site with a body's name is `<name>_site`."""

    def __init__(self, model: Any) -> None:
        self.joints = _distinct((model.joint(k).name or f"joint{k}" for k in range(model.njnt)), set())
        taken = set[str]()
        self.bodies = _distinct((model.body(k).name or f"body{k}" for k in range(model.nbody)), taken)
        self.sites = dict[int, str]()
        """Those that have a name, by their index."""
        for k, name in ((k, model.site(k).name) for k in range(model.nsite)):
            if name:
                self.sites[k] = _distinct([f"{name}_site" if name in taken else name], taken)[0]
        self._links, self._joints = taken, set(self.joints)

    def link(self, name: str) -> str:
        """A new name of a link."""
        return _distinct([name], self._links)[0]

    def joint(self, name: str) -> str:
        """A new name of a joint."""
        return _distinct([name], self._joints)[0]


def _distinct(names: Iterable[str], taken: set[str]) -> list[str]:
    """The names, with underscores where one is taken; all are taken from now on."""
    made = list[str]()
    for name in names:
        while name in taken:
            name += "_"
        taken.add(name)
        made.append(name)
    return made


def urdf_of(compiled: Compiled, names: Names, couplings: Couplings) -> str:
    """URDF of all bodies and sites of a compiled model, the root of which is the world."""
    model, robot = compiled.model, Element("robot", name=compiled.name)
    for body in range(model.nbody):
        link = SubElement(robot, "link", name=names.bodies[body])
        if body and compiled.weighed[body]:
            _add_mass(link, model, body)
        add_shapes(link, compiled, body)
    for body in range(1, model.nbody):
        _add_body(robot, model, body, names, couplings)
    for site, name in names.sites.items():
        SubElement(robot, "link", name=name)
        T = _pose(model.site_pos[site], model.site_quat[site])
        _add_joint(robot, names.joint(f"{name}_fixed"), "fixed", names.bodies[model.site_bodyid[site]], name, T)
    for name, (factors, ends) in couplings.sums.items():
        robot.append(sum_element(SumLimit(name, {names.joints[k]: factor for k, factor in factors.items()}, *ends)))
    return ElementTree.tostring(robot, encoding="unicode")


def _add_body(robot: Element, model: Any, body: int, names: Names, couplings: Couplings) -> None:
    """Add the joints that lead from a body's parent to the body.

    A follower of several leaders is as many joints about or along one axis, each of which follows one of them.
    """
    parent, T = names.bodies[model.body_parentid[body]], _pose(model.body_pos[body], model.body_quat[body])
    first, count = int(model.body_jntadr[body]), int(model.body_jntnum[body])
    for joint in range(first, first + count):
        kind = _kind(model, joint, couplings.ranges)
        anchor, back = _anchor(model, joint, kind)
        coupling = couplings.followers.get(joint)
        if coupling is not None and not coupling.leaders:
            T = T @ anchor @ _motion(model, joint, kind, coupling.offset) @ back
            continue
        T, offset = T @ anchor, 0.0 if coupling is None else coupling.offset
        parts = [None] if coupling is None else list(coupling.leaders.items())
        for k, part in enumerate(parts):
            is_last = k == len(parts) - 1
            child, name = (
                names.bodies[body],
                names.joint(f"{names.joints[joint]}_{k + 1}") if k else names.joints[joint],
            )
            if not is_last or joint < first + count - 1 or (back != np.eye(4)).any():
                child = names.link(f"{name}_link")
                SubElement(robot, "link", name=child)
            ends = couplings.ranges.get(joint)
            if part is not None and len(parts) > 1:
                kind, ends = _part(kind, couplings.ranges[part[0]], part[1], offset)
            element = _add_joint(robot, name, kind, parent, child, T)
            if ends is not None:
                _add_limits(element, model, joint, kind, ends)
            if part is not None:
                numbers = {"multiplier": words([part[1]]), "offset": words([offset])}
                SubElement(element, "mimic", {"joint": names.joints[part[0]], **numbers})
            parent, T, offset = child, np.eye(4), 0.0
        T = back
    if parent != names.bodies[body]:
        _add_joint(robot, names.joint(f"{names.bodies[body]}_fixed"), "fixed", parent, names.bodies[body], T)


def _part(kind: str, leader: Range, multiplier: float, offset: float) -> tuple[str, Range]:
    """Type and range of a joint that follows one of several leaders: whatever that one's range leads it to."""
    if kind != "prismatic":
        return "continuous", (-np.inf, np.inf)
    low, high = sorted(multiplier * end + offset for end in leader)
    room = FOLLOWING * max(1.0, abs(low), abs(high))
    return kind, (low - room, high + room)


def _kind(model: Any, joint: int, ranges: dict[int, Range]) -> str:
    """The type of a joint, of URDF but for a ball."""
    kinds = package().mjtJoint
    kind = int(model.jnt_type[joint])
    if kind in (kinds.mjJNT_FREE, kinds.mjJNT_BALL):
        return "floating" if kind == kinds.mjJNT_FREE else "ball"
    if kind == kinds.mjJNT_SLIDE:
        return "prismatic"
    return "revolute" if np.isfinite(ranges[joint]).any() else "continuous"


def _anchor(model: Any, joint: int, kind: str) -> tuple[np.ndarray, np.ndarray]:
    """Poses (4, 4) of a joint at q = 0 in the body as the joints before have it, and of the body behind the joint."""
    anchor, back = np.eye(4), np.eye(4)
    if kind in ("revolute", "continuous", "ball"):
        anchor[:3, 3], back[:3, 3] = model.jnt_pos[joint], -model.jnt_pos[joint]
    if kind in ("revolute", "continuous", "prismatic"):
        reference = float(model.qpos0[model.jnt_qposadr[joint]])
        anchor = anchor @ _motion(model, joint, kind, -reference)
    return anchor, back + 0.0  # no -0.0


def _motion(model: Any, joint: int, kind: str, q: float) -> np.ndarray:
    """The motion (4, 4) of a hinge or slide by q [rad, or m]."""
    T, axis = np.eye(4), np.array(model.jnt_axis[joint])
    if kind == "prismatic":
        T[:3, 3] = q * axis
    elif q:
        T[:3, :3] = matrix_from_quaternion(np.array([np.cos(q / 2), *(np.sin(q / 2) * axis)]))
    return T


def _add_joint(robot: Element, name: str, kind: str, parent: str, child: str, T: np.ndarray) -> Element:
    joint = SubElement(robot, "joint", name=name, type=kind)
    SubElement(joint, "parent", link=parent)
    SubElement(joint, "child", link=child)
    add_origin(joint, T[:3, 3], T[:3, :3])
    return joint


def _add_limits(element: Element, model: Any, joint: int, kind: str, ends: Range) -> None:
    """Add the axis and the limits of a hinge or slide; MJCF has none of speed."""
    SubElement(element, "axis", xyz=words(model.jnt_axis[joint]))
    limits = {"effort": "0", "velocity": "0"}
    if model.jnt_actfrclimited[joint]:
        limits["effort"] = words([np.abs(model.jnt_actfrcrange[joint]).max()])
    if kind != "continuous" and np.isfinite(ends).any():
        limits |= {key: words([end]) for key, end in zip(("lower", "upper"), ends, strict=True)}
    SubElement(element, "limit", limits)


def _add_mass(link: Element, model: Any, body: int) -> None:
    inertial = SubElement(link, "inertial")
    add_origin(inertial, model.body_ipos[body], matrix_from_quaternion(model.body_iquat[body]))
    SubElement(inertial, "mass", value=words([model.body_mass[body]]))
    moments = dict(zip(("ixx", "iyy", "izz"), (words([each]) for each in model.body_inertia[body]), strict=True))
    SubElement(inertial, "inertia", {**moments, "ixy": "0", "ixz": "0", "iyz": "0"})


def _pose(position: np.ndarray, quaternion: np.ndarray) -> np.ndarray:
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = matrix_from_quaternion(quaternion), position
    return T
