"""URDF, as a file or as text, made into a `Chain`: a normalised description without surprises for Pinocchio.

What is done to it: the tree is checked; the part under `base` is kept, or the whole tree turned round so that `base` is
its root, where that does not carry the tips; only the joints between `base` and the tips (and
the leaders of mimic joints among them) still move, all others are fixed where they stand at zero; mimic chains are
resolved to the joint that leads them, whose limits are narrowed to what its followers allow; axes are normalised.
Meshes are never opened. The format: http://wiki.ros.org/urdf/XML.
"""

from __future__ import annotations

import contextlib
import logging
import math
import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from xml.etree.ElementTree import Element

import numpy as np

from maira_qp.errors import RobotError, listed
from maira_qp.robots.model.joint_limits import Limits, SumLimit, given_limits
from maira_qp.robots.model.kinematics import MAX_JOINTS
from maira_qp.robots.urdf.joint import (
    BALL,
    MOVING,
    Joint,
    ends_of,
    fixed_at,
    fixed_of,
    is_macro,
    joint_of,
    limits_at_load,
    macro_left,
    turned_round,
)
from maira_qp.robots.urdf.joint_order import visiting_order
from maira_qp.robots.urdf.link_tree import Edge, LinkTree
from maira_qp.robots.urdf.normalized import normalised
from maira_qp.robots.urdf.safe_xml import xml_root
from maira_qp.robots.urdf.sum_limits import Place, sums_of

log = logging.getLogger(__name__)

ROUNDING = 1e-9
"""A follower that takes less than this [rad, or m] off the limits of its leader has limits that were rounded."""


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
    resting: Mapping[str, Joint] = field(compare=False, repr=False)
    """The joints that are fixed here, but move in the description, as they are there; followers with the joint at the
    head as their leader, and without those of joints that move here."""
    sums: tuple[SumLimit, ...] = field(compare=False, repr=False)
    """Limits of sums of the independent joints."""

    @property
    def tip(self) -> str:
        """The first of the tips."""
        return self.tips[0]


def read_urdf(
    source: str | os.PathLike[str],
    tip: str | Sequence[str] | None = None,
    base: str | None = None,
    limits: Limits | None = None,
) -> Chain:
    """The `Chain` from `base` (None: the root) to `tip` (None: the only leaf) of a URDF file, or of URDF text.

    With a list or tuple of tips every joint between the base and any of them moves. A base that does not carry all tips
    becomes the root of the tree. `limits` {joint name: (lower, upper)} take the place of those in the text.

    Raises `RobotError` if the description cannot be used, `FrameError` if `tip` or `base` is not a suitable link, or a
    tip is named twice, `OptionError` for limits that make no sense. What the joints that move do not need is not
    looked at: what is wrong with it is logged.
    """
    root = _robot_element(source)
    links, elements = _named(root, "link"), _named(root, "joint")
    tree = _tree(links, elements)
    base = tree.root if base is None else tree.known(base, "base")
    tips = tree.known_tips(tip, base)
    turned: set[str] = set()
    if not all(tree.carries(base, each) for each in tips):
        tree, turned = tree.rerooted(base)
    paths = {tip: [edge.joint for edge in tree.path(base, tip)] for tip in tips}
    path = list(dict.fromkeys(joint for each in paths.values() for joint in each))
    _check_names([base, *tips, *path])
    given = given_limits(limits, [name for name, element in elements.items() if element.get("type") in MOVING])
    joints = _Joints(elements, given)
    moving = _moving_joints(joints, path)
    _check_tips(paths, moving)
    order = [edge.joint for edge in tree.below(base, first=visiting_order(tree, moving, path, base))]
    placed = _placed(order, moving, joints, tree, turned)
    free = [joint for joint in placed if joint.name in moving and joint.mimic is None]
    frames = (base, *(joint.child for joint in placed))
    name = root.get("name") or "robot"
    sums = sums_of(root, lambda joint, at: _place(joint, at, moving, joints), elements)
    shapes = [links.get(link, Element("link", name=link)) for link in frames]
    return Chain(
        urdf=normalised(name, shapes, placed, sums, root, source),
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
        resting=_resting(placed, moving, joints),
        sums=tuple(each.moving for each in sums),
    )


def _read_only(values: Iterable[float]) -> np.ndarray:
    array = np.array(list(values), dtype=float)
    array.flags.writeable = False
    return array


DEFINITIONS = ("xacro:property", "xacro:arg", "xacro:macro")
"""What of xacro makes nothing by itself: dead lines in what it has made."""


def _robot_element(source: str | os.PathLike[str]) -> Element:
    """The `robot` element, after the check that no macros are left that would make links and joints."""
    root = xml_root(source)
    if root.tag != "robot":
        raise RobotError(f"not a URDF: the outermost element is <{root.tag}>, not <robot>")
    for element in root:
        if element.tag.startswith("xacro:") and element.tag not in DEFINITIONS:
            raise RobotError(macro_left(f"<{element.tag}>"))
    return root


def _check_names(names: Iterable[str]) -> None:
    for name in names:
        if is_macro(name):
            raise RobotError(macro_left(f"the name {name!r}"))


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


def link_tree(source: str | os.PathLike[str]) -> LinkTree:
    """The links of a URDF file, or of URDF text, and the joints between them. Raises `RobotError`."""
    root = _robot_element(source)
    return _tree(_named(root, "link"), _named(root, "joint"))


def _tree(links: Iterable[str], elements: Mapping[str, Element]) -> LinkTree:
    return LinkTree(links, [_edge(element) for element in elements.values()])


def _edge(element: Element) -> Edge:
    return Edge(element.attrib["name"], *ends_of(element), element.get("type") in MOVING)


# What moves


class _Joints(Mapping[str, Joint]):
    """The joints by name, each read when it is asked for: `RobotError` for one whose numbers make no sense."""

    def __init__(self, elements: Mapping[str, Element], limits: Mapping[str, tuple[float, float]]) -> None:
        self.elements, self._limits, self._read = elements, limits, dict[str, Joint]()

    def __getitem__(self, name: str) -> Joint:
        if name not in self._read:
            self._read[name] = joint_of(self.elements[name], self._limits.get(name))
        return self._read[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self.elements)

    def __len__(self) -> int:
        return len(self.elements)


def _moving_joints(joints: Mapping[str, Joint], path: list[str]) -> dict[str, Joint]:
    """The joints that move, by name: those on the path and the leaders of its mimics, with the limits that hold."""
    moving: dict[str, Joint] = {}
    for joint in (joints[name] for name in path):
        if joint.kind in ("floating", "planar", BALL):
            kind = "a ball joint" if joint.kind == BALL else joint.kind
            raise RobotError(
                f"joint {joint.name!r} is {kind}, which is not supported",
                python=f"start behind it, base={joint.child!r}",
                shell=f"start behind it, --base {joint.child}",
            )
        if joint.kind == "fixed":
            continue
        if joint.mimic is None:
            _need_limits(joint)
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
        python, shell = limits_at_load(joint.name)
        raise RobotError(
            f"joint {joint.name!r} is {joint.kind} but has no limits: give it lower and upper{unlimited}",
            python=f"or {python}",
            shell=f"or {shell}",
        )


def _leader(joint: Joint, joints: Mapping[str, Joint]) -> tuple[Joint, float, float]:
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
    ends = sorted((limit - offset) / multiplier + 0.0 for limit in (follower.lower, follower.upper))  # no -0.0
    lower, upper = max(leader.lower, ends[0]), min(leader.upper, ends[1])
    pair = f"joint {follower.name!r} mimics {leader.name!r} (multiplier {multiplier:g}, offset {offset:g})"
    if lower > upper:
        raise RobotError(f"{pair}, but no position is within the limits of both")
    if lower > leader.lower + ROUNDING or upper < leader.upper - ROUNDING:
        before = f"[{leader.lower:g}, {leader.upper:g}]"
        log.warning("%s, whose limits so become [%g, %g] in place of %s", pair, lower, upper, before)
    kind = "revolute" if leader.kind == "continuous" and math.isfinite(upper - lower) else leader.kind
    velocity = min(leader.velocity, follower.velocity / abs(multiplier))
    acceleration = min(leader.acceleration, follower.acceleration / abs(multiplier))
    return replace(leader, kind=kind, lower=lower, upper=upper, velocity=velocity, acceleration=acceleration)


# Where links stand


def _placed(
    order: list[str], moving: Mapping[str, Joint], joints: _Joints, tree: LinkTree, turned: set[str]
) -> list[Joint]:
    """The joints in their order, each as it is in the normalised tree: those that do not move are fixed.

    Of a joint beside the chain that makes no sense the limits are left out or, if it is not known where it stands, all
    that it carries; this is logged.
    """
    placed, lost, odd = list[Joint](), set[str](), dict[str, RobotError]()
    taken = {*tree.links, *joints}
    for name in order:
        edge = tree.edge(name)
        if edge.parent in lost:
            lost.add(edge.child)
            continue
        joint = moving.get(name)
        if joint is None:
            try:
                joint = fixed_of(joints.elements[name])
            except RobotError as reason:
                if any(tree.carries(edge.child, tree.edge(each).child) for each in moving):
                    raise
                lost.add(edge.child)
                odd[name] = reason
                continue
            try:
                joint = _at_rest(joints[name], joints)
            except RobotError as reason:
                odd[name] = reason
        placed += _turned_round(joint, taken) if name in turned else [joint]
    if odd:
        told = "; ".join(map(str, odd.values()))
        log.warning("joints beside the chain make no sense, which does not matter to it: %s", f"{told:.2000}")
    return placed


def _resting(placed: Iterable[Joint], moving: Mapping[str, Joint], joints: _Joints) -> dict[str, Joint]:
    """The joints among the placed ones that could stand elsewhere, those aside that follow one that moves."""
    found = dict[str, Joint]()
    for name in (joint.name for joint in placed):
        with contextlib.suppress(RobotError, KeyError):  # odd ones, and those that are no joints of the description
            joint = joints[name]
            if name in moving or joint.kind not in MOVING:
                continue
            if joint.mimic is not None:
                leader, multiplier, offset = _leader(joint, joints)
                if leader.name in moving:
                    continue
                joint = replace(joint, mimic=(leader.name, multiplier, offset))
            found[name] = joint
    return found


def _at_rest(joint: Joint, joints: Mapping[str, Joint]) -> Joint:
    """The joint fixed where it stands when every joint is at zero, or at the limit nearest to zero."""
    return fixed_at(joint, _rest(joint, joints) if joint.kind in MOVING else 0.0)


def _rest(joint: Joint, joints: Mapping[str, Joint]) -> float:
    if joint.mimic is None:
        return min(max(0.0, joint.lower), joint.upper)
    leader, multiplier, offset = _leader(joint, joints)
    return multiplier * _rest(leader, joints) + offset


def _place(name: str, at: float, moving: Mapping[str, Joint], joints: Mapping[str, Joint]) -> Place:
    """Where a joint stands, one that is fixed at a value. Raises `RobotError` for one that makes no sense."""
    joint = joints[name]
    if joint.kind not in MOVING:
        return None, 0.0, at
    leader, multiplier, offset = _leader(joint, joints) if joint.mimic is not None else (joint, 1.0, 0.0)
    return (leader.name, multiplier, offset) if leader.name in moving else (None, 0.0, _rest(joint, joints))


def _turned_round(joint: Joint, taken: set[str]) -> list[Joint]:
    """The joint from its child link to its parent link: the same motion, seen from the other side.

    With the origin O and the motion M(q) a joint is O M(q), and turned round M(q)^-1 O^-1. URDF has the origin before
    the motion, so there are two: a joint without an origin that moves the other way, to a new link, and a fixed one.
    """
    back = turned_round(joint)
    if joint.kind not in MOVING:
        return [back]
    between, second = (_unused(f"{joint.name}_{word}", taken) for word in ("origin", "origin_joint"))
    first = replace(joint, parent=joint.child, child=between, axis=0.0 - joint.axis, xyz=np.zeros(3), rpy=np.zeros(3))
    return [first, replace(back, name=second, kind="fixed", mimic=None, parent=between)]


def _unused(name: str, taken: set[str]) -> str:
    while name in taken:
        name += "_"
    taken.add(name)
    return name
