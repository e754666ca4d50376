"""URDF, as a file or as text, made into a `Chain`: a normalised description without surprises for Pinocchio.

What is done to it: the tree is checked; the part under `base` is kept; only the joints between `base` and the tips (and
the leaders of mimic joints among them) still move, all others are fixed where they stand at zero; mimic chains are
resolved to the joint that leads them, whose limits are narrowed to what its followers allow; axes are normalised.
Meshes are never opened. The format: http://wiki.ros.org/urdf/XML.
"""

from __future__ import annotations

import copy
import logging
import math
import os
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

import numpy as np

from maira_qp.errors import RobotError, listed
from maira_qp.robots.rpy import matrix_from_rpy, rpy_from_matrix
from maira_qp.robots.urdf_joint import MOVING, Joint, check_ends, joint_of
from maira_qp.robots.urdf_tree import Edge, LinkTree
from maira_qp.robots.visiting_order import visiting_order
from maira_qp.robots.xml_text import xml_root

log = logging.getLogger(__name__)

MAX_JOINTS = 100
"""Most joints that may move: Pinocchio's working memory grows with their cube, to 1.4 GB at 300."""


@dataclass(frozen=True)
class Chain:
    """A robot description, normalised: a tree of links in which exactly `joint_names` (and their mimics) move."""

    urdf: str = field(repr=False)
    """URDF of the tree under `base`; a continuous joint keeps its type; a velocity or effort of 0 means no limit."""
    name: str
    base: str
    tips: tuple[str, ...]
    """The links to which the joints that move lead, one or more."""
    joint_names: tuple[str, ...] = field(compare=False)
    """Names of the n independent joints in the order of q: parents before children, leaders before followers, and
    otherwise the way to the first tip first."""
    lower: np.ndarray = field(compare=False)
    """Lower limits (n,) [rad, or m], -inf for a continuous joint; read-only, as are the arrays that follow."""
    upper: np.ndarray = field(compare=False)
    """Upper limits (n,) [rad, or m], inf for a continuous joint."""
    velocity: np.ndarray = field(compare=False)
    """Largest speeds (n,) [rad/s, or m/s], inf where there is no limit."""
    effort: np.ndarray = field(compare=False)
    """Largest torques or forces (n,) [N m, or N], inf where there is no limit."""
    acceleration: np.ndarray = field(compare=False)
    """Largest accelerations (n,) [rad/s^2, or m/s^2], inf where there is no limit."""
    frames: tuple[str, ...] = field(compare=False, repr=False)
    """Names of all links, the base first."""

    @property
    def tip(self) -> str:
        """The first of the tips."""
        return self.tips[0]


def read_urdf(source: str | os.PathLike[str], tip: str | Sequence[str] | None = None, base: str | None = None) -> Chain:
    """The `Chain` from `base` (None: the root) to `tip` (None: the only leaf) of a URDF file, or of URDF text.

    With a list or tuple of tips every joint between the base and any of them moves. Raises `RobotError` if the
    description cannot be used, `FrameError` if `tip` or `base` is not a suitable link, or a tip is named twice.
    """
    root = _robot_element(source)
    links, elements = _named(root, "link"), _named(root, "joint")
    tree = LinkTree(links, [_edge(element) for element in elements.values()])
    base = tree.root if base is None else tree.known(base, "base")
    tips = tree.known_tips(tip, base)
    paths = {tip: [edge.joint for edge in tree.path(base, tip)] for tip in tips}
    path = list(dict.fromkeys(joint for each in paths.values() for joint in each))
    joints = _with_known_leaders({name: joint_of(element) for name, element in elements.items()}, path)
    moving = _moving_joints(joints, path)
    _check_tips(paths, moving)
    order = [edge.joint for edge in tree.below(base, first=visiting_order(tree, moving, path, base))]
    ordered = [moving[name] if name in moving else _at_rest(joints[name], joints) for name in order]
    free = [joint for joint in ordered if joint.name in moving and joint.mimic is None]
    frames = (base, *(joint.child for joint in ordered))
    name = root.get("name") or "robot"
    return Chain(
        urdf=_text(name, [links[link] for link in frames], ordered, root.findall("material")),
        name=name,
        base=base,
        tips=tips,
        joint_names=tuple(joint.name for joint in free),
        lower=_read_only(joint.lower for joint in free),
        upper=_read_only(joint.upper for joint in free),
        velocity=_read_only(joint.velocity for joint in free),
        effort=_read_only(joint.effort for joint in free),
        acceleration=_read_only(joint.acceleration for joint in free),
        frames=frames,
    )


def _read_only(values: Iterable[float]) -> np.ndarray:
    array = np.array(list(values), dtype=float)
    array.flags.writeable = False
    return array


def _robot_element(source: str | os.PathLike[str]) -> Element:
    """The `robot` element, after the check that no macros are left in it."""
    root = xml_root(source)
    if root.tag != "robot":
        raise RobotError(f"not a URDF: the outermost element is <{root.tag}>, not <robot>")
    for element in root.iter():
        if element.tag.startswith("xacro:") or any("${" in text or "$(" in text for text in element.attrib.values()):
            raise RobotError(f"this is xacro (see <{element.tag}>), not URDF: run `xacro in.xacro > out.urdf` first")
    return root


def _named(root: Element, tag: str) -> dict[str, Element]:
    """The children with that tag by name, each of which needs a name of its own."""
    found: dict[str, Element] = {}
    for element in root.findall(tag):
        name = element.get("name")
        if not name:
            raise RobotError(f"a {tag} has no name")
        if name in found:
            raise RobotError(f"two {tag}s have the name {name!r}")
        found[name] = element
    if tag == "link" and not found:
        raise RobotError("the robot has no links")
    return found


def _edge(element: Element) -> Edge:
    check_ends(element)
    parent, child = (element.find(tag).attrib["link"] for tag in ("parent", "child"))  # type: ignore[union-attr]
    return Edge(element.attrib["name"], parent, child)


# What moves


def _with_known_leaders(joints: dict[str, Joint], path: list[str]) -> dict[str, Joint]:
    """The joints, those beside the path without a mimic of a joint that does not exist: a slip that costs nothing."""
    lost = [joint for joint in joints.values() if joint.mimic is not None and joint.mimic[0] not in joints]
    mended = {joint.name: replace(joint, mimic=None) for joint in lost if joint.name not in path}
    if mended:
        log.warning("these joints mimic joints that do not exist, and are fixed at zero: %s", ", ".join(mended))
    return joints | mended


def _moving_joints(joints: dict[str, Joint], path: list[str]) -> dict[str, Joint]:
    """The joints that move, by name: those on the path and the leaders of its mimics, with the limits that hold."""
    moving: dict[str, Joint] = {}
    for joint in (joints[name] for name in path):
        if joint.kind in ("floating", "planar"):
            behind = f"start behind it, base={joint.child!r}"
            raise RobotError(f"joint {joint.name!r} is {joint.kind}, which is not supported: {behind}")
        if joint.kind == "fixed":
            continue
        _need_limits(joint)
        if joint.mimic is None:
            moving.setdefault(joint.name, joint)
            continue
        leader, multiplier, offset = _leader(joint, joints)
        if multiplier != 0:
            _need_limits(leader)
            follower = replace(joint, mimic=(leader.name, multiplier, offset))
            moving[joint.name] = replace(follower, acceleration=math.inf)  # from here on it is the leader's
            moving[leader.name] = _narrowed(moving.get(leader.name, leader), joint, multiplier, offset)
    free = sum(joint.mimic is None for joint in moving.values())
    if free > MAX_JOINTS:
        raise RobotError(f"{free} joints move between base and tip, more than the {MAX_JOINTS} that are supported")
    return moving


def _check_tips(paths: dict[str, list[str]], moving: dict[str, Joint]) -> None:
    """Raises `RobotError` if a tip, of those whose paths (names of joints) are given, cannot move."""
    for tip, path in paths.items():
        if not any(joint in moving for joint in path):
            raise RobotError(f"no joint moves between base and tip {tip!r}")


def _need_limits(joint: Joint) -> None:
    if joint.kind != "continuous" and not math.isfinite(joint.upper - joint.lower):
        unlimited = " (type='continuous' if it turns without end)" if joint.kind == "revolute" else ""
        raise RobotError(f"joint {joint.name!r} is {joint.kind} but has no limits: give it lower and upper{unlimited}")


def _leader(joint: Joint, joints: dict[str, Joint]) -> tuple[Joint, float, float]:
    """The joint at the head of a mimic chain, with multiplier and offset: q = multiplier * q_leader + offset."""
    multiplier, offset = 1.0, 0.0
    seen = [joint.name]
    leader = joint
    while leader.mimic is not None:
        name, m, o = leader.mimic
        multiplier, offset = multiplier * m, multiplier * o + offset
        if name in seen:
            raise RobotError(f"the joints {', '.join(seen)} mimic each other in a circle")
        if name not in joints:
            raise RobotError(f"joint {leader.name!r} mimics {name!r}, which is not a joint; {listed(joints, name)}")
        seen.append(name)
        leader = joints[name]
    if leader.kind not in MOVING:
        raise RobotError(
            f"joint {joint.name!r} mimics {leader.name!r}, which is {leader.kind} and does not turn or slide"
        )
    return leader, multiplier, offset


def _narrowed(leader: Joint, follower: Joint, multiplier: float, offset: float) -> Joint:
    """The leader with limits that keep its follower within its own, in position, speed and acceleration."""
    ends = sorted((limit - offset) / multiplier for limit in (follower.lower, follower.upper))
    lower, upper = max(leader.lower, ends[0]), min(leader.upper, ends[1])
    if lower > upper:
        raise RobotError(
            f"joint {follower.name!r} mimics {leader.name!r}, but no position is within the limits of both"
        )
    kind = "revolute" if leader.kind == "continuous" and math.isfinite(upper - lower) else leader.kind
    velocity = min(leader.velocity, follower.velocity / abs(multiplier))
    acceleration = min(leader.acceleration, follower.acceleration / abs(multiplier))
    return replace(leader, kind=kind, lower=lower, upper=upper, velocity=velocity, acceleration=acceleration)


def _at_rest(joint: Joint, joints: dict[str, Joint]) -> Joint:
    """The joint fixed where it stands when every joint is at zero, or at the limit nearest to zero."""
    xyz, R = joint.xyz, matrix_from_rpy(joint.rpy)
    rest = _rest(joint, joints) if joint.kind in MOVING else 0.0
    if rest == 0:
        return replace(joint, kind="fixed", mimic=None)
    if joint.kind == "prismatic":
        xyz = xyz + R @ (rest * joint.axis)
    else:
        R = R @ _turn(joint.axis, rest)
    return replace(joint, kind="fixed", mimic=None, xyz=xyz, rpy=rpy_from_matrix(R))


def _rest(joint: Joint, joints: dict[str, Joint]) -> float:
    if joint.mimic is None:
        return min(max(0.0, joint.lower), joint.upper)
    leader, multiplier, offset = _leader(joint, joints)
    return multiplier * _rest(leader, joints) + offset


def _turn(axis: np.ndarray, angle: float) -> np.ndarray:
    """Rotation matrix (3, 3) about a unit axis (3,) by an angle [rad], by Rodrigues' formula."""
    x, y, z = axis
    K = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + math.sin(angle) * K + 2 * math.sin(angle / 2) ** 2 * (K @ K)


# The text


def _text(name: str, links: list[Element], joints: list[Joint], materials: list[Element]) -> str:
    """The normalised URDF: links as they are, joints written anew with all digits."""
    robot = Element("robot", name=name)
    robot.extend(copy.deepcopy(materials))
    for link in links:
        kept = SubElement(robot, "link", name=link.attrib["name"])
        kept.extend(copy.deepcopy([part for part in link if part.tag in ("inertial", "visual", "collision")]))
    for joint in joints:
        _write_joint(robot, joint)
    ElementTree.indent(robot)
    return ElementTree.tostring(robot, encoding="unicode") + "\n"


def _write_joint(robot: Element, joint: Joint) -> None:
    element = SubElement(robot, "joint", name=joint.name, type=joint.kind)
    SubElement(element, "parent", link=joint.parent)
    SubElement(element, "child", link=joint.child)
    SubElement(element, "origin", xyz=_words(joint.xyz), rpy=_words(joint.rpy))
    if joint.kind not in MOVING:
        return
    SubElement(element, "axis", xyz=_words(joint.axis))
    bounds = {"lower": joint.lower, "upper": joint.upper} if joint.kind != "continuous" else {}
    known = {"effort": joint.effort, "velocity": joint.velocity}
    known = {key: value if math.isfinite(value) else 0.0 for key, value in known.items()}
    last = {"acceleration": joint.acceleration} if math.isfinite(joint.acceleration) else {}
    SubElement(element, "limit", {key: _words([value]) for key, value in (bounds | known | last).items()})
    if joint.mimic is not None:
        leader, multiplier, offset = joint.mimic
        SubElement(element, "mimic", joint=leader, multiplier=_words([multiplier]), offset=_words([offset]))


def _words(numbers: Iterable[float]) -> str:
    return " ".join(repr(float(number)) for number in numbers)
