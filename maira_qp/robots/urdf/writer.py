"""A DH table as URDF: the same arm for every program that reads robots.

In the standard convention joint i moves about the z axis of the frame *before* link i. So the URDF joint stands where
the rows before it end, turned by its own theta offset, and the frame of link i in URDF is that of the joint, not that
of the DH row. What is left after the last joint, `Tz(d) Tx(a) Rx(alpha)`, leads to the fixed frame `tool0`: the end of
the DH chain.

In the modified convention joint i moves about the z axis of the frame *behind* link i, and all of row i comes before
the motion: the frame of link i is that of row i, and `tool0` that of the last one.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

import numpy as np

from maira_qp.errors import RobotError
from maira_qp.robots.dh.table import DHLink, DHTable
from maira_qp.robots.urdf.rpy import cosine_sine, rpy_from_matrix

BASE = "base_link"
TOOL = "tool0"
_COLOURS = {
    "shell": "0.92 0.93 0.95 1",
    "joint": "0.16 0.45 0.8 1",
    "dark": "0.22 0.24 0.28 1",
    "tool": "0.98 0.6 0.15 1",
}


def urdf_text(table: DHTable) -> str:
    """URDF of a DH table: links `base_link`, `link1`, ... (one a row), `tool0`; numbers with all of their digits.

    Raises `RobotError` if a name holds characters that XML cannot.
    """
    robot = Element("robot", name=_legal(table.name))
    for name, rgba in _COLOURS.items():
        SubElement(SubElement(robot, "material", name=name), "color", rgba=rgba)
    radius = _radius(table)
    _base_body(SubElement(robot, "link", name=BASE), table, radius)
    for i in range(len(table.links)):
        _link_body(SubElement(robot, "link", name=f"link{i + 1}"), table, i, radius)
    _tool_body(SubElement(robot, "link", name=TOOL), radius)
    parent, origins = BASE, _origins(table)
    for i, (link, name) in enumerate(zip(table.links, _joint_names(table), strict=False), start=1):
        joint = _joint(robot, name, link.kind, parent, f"link{i}", next(origins))
        if link.kind != "fixed":
            _motion(joint, link)
        parent = f"link{i}"
    _joint(robot, _joint_names(table)[-1], "fixed", parent, TOOL, next(origins))
    ElementTree.indent(robot)
    return '<?xml version="1.0"?>\n' + ElementTree.tostring(robot, encoding="unicode") + "\n"


def _joint_names(table: DHTable) -> list[str]:
    """Names of the joints of all rows and of the tool's: the table's own for those that move, new ones for the rest."""
    moving = iter(table.joint_names)
    taken = set(table.joint_names)
    names = []
    for i, link in enumerate(table.links, start=1):
        if link.kind != "fixed":
            names.append(_legal(next(moving)))
        else:
            names.append(_unused(_legal(link.name or f"fixed{i}"), taken))
    return [*names, _unused("tool0_joint", taken)]


def _unused(name: str, taken: set[str]) -> str:
    """The name, with underscores if another joint has it; it is taken from now on."""
    while name in taken:
        name += "_"
    taken.add(name)
    return name


def _legal(name: str) -> str:
    """The name, if XML can hold it."""
    if re.search("[^\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]", name):
        raise RobotError(f"the name {name!r} holds characters that URDF cannot, such as line breaks")
    return name


def _joint(robot: Element, name: str, kind: str, parent: str, child: str, origin: dict[str, str]) -> Element:
    joint = SubElement(robot, "joint", name=name, type=kind)
    SubElement(joint, "parent", link=parent)
    SubElement(joint, "child", link=child)
    SubElement(joint, "origin", origin)
    return joint


def _motion(joint: Element, link: DHLink) -> None:
    SubElement(joint, "axis", xyz="0 0 1")
    bounds = {} if link.kind == "continuous" else {"lower": link.lower, "upper": link.upper}
    bounds |= {"effort": link.effort, "velocity": link.velocity}
    bounds |= {} if link.acceleration is None else {"acceleration": link.acceleration}
    SubElement(joint, "limit", {key: _words(value) for key, value in bounds.items()})


def _origins(table: DHTable) -> Iterator[dict[str, str]]:
    """Where each row's joint stands in the frame of the link before, and the tool's, as attributes of an origin."""
    if table.convention == "modified":  # Rx(alpha) Tx(a) Tz(d) Rz(theta)
        for row in table.links:
            ca, sa = cosine_sine(row.alpha)
            yield _origin((row.a, -sa * row.d, ca * row.d), row.alpha, row.theta)
        yield _origin((0.0, 0.0, 0.0), 0.0, 0.0)
        return
    before = last = DHLink(kind="fixed")
    for row in (*table.links, last):  # the rest of the row before, Tz(d) Tx(a) Rx(alpha), then Rz(theta)
        yield _origin((before.a, 0.0, before.d), before.alpha, row.theta)
        before = row


def _origin(xyz: tuple[float, float, float], alpha: float, theta: float) -> dict[str, str]:
    """A position [m] and the rotation `Rx(alpha) Rz(theta)` as the attributes of an origin."""
    if theta == 0 or alpha == 0:
        rpy = np.array([alpha, 0.0, theta])
    else:
        (ca, sa), (ct, st) = cosine_sine(alpha), cosine_sine(theta)
        rpy = rpy_from_matrix(np.array([[ct, -st, 0.0], [ca * st, ca * ct, -sa], [sa * st, sa * ct, ca]]))
    return {"xyz": _words(*xyz), "rpy": _words(*rpy)}


def _words(*numbers: float | None) -> str:
    """Numbers as text, each of which reads back as the same float; whole ones short, and no -0."""
    values = [float(number) + 0.0 for number in numbers if number is not None]
    return " ".join(f"{v:.0f}" if v == round(v) and abs(v) < 1e6 else repr(v) for v in values)


# What it looks like: rods along d and a, a ball in each joint. Rods that are there to be collided with end short of the
# joints, so that the two links on either side of a joint that is a point (a spherical shoulder) do not touch for ever.


def _radius(table: DHTable) -> float:
    """Radius of the rods [m]: slim against the reach, and never zero."""
    reach = sum(math.hypot(link.a, link.d) for link in table.links)
    return float(f"{0.03 * reach:.3g}") or 0.02


def _base_body(element: Element, table: DHTable, radius: float) -> None:
    for tag in ("visual", "collision"):
        _rod(element, tag, "dark", "z", 0.0, radius, 1.6 * radius)
    if table.convention == "modified" and table.links[0].a:
        _rod(element, "visual", "shell", "x", 0.0, table.links[0].a, radius)


def _limb(table: DHTable, i: int) -> tuple[float, float, float]:
    """Lengths along z and then x from joint i to the next [m], and where the first begins along z of link i [m]."""
    link = table.links[i]
    if table.convention == "standard":
        return link.d, link.a, 0.0
    return link.d, table.links[i + 1].a if i + 1 < len(table.links) else 0.0, -link.d


def _tool_body(element: Element, radius: float) -> None:
    _rod(element, "visual", "tool", "z", -0.5 * radius, 0.02 * radius, 1.05 * radius)  # around the end of the last rod


def _link_body(element: Element, table: DHTable, i: int, radius: float) -> None:
    """The rods behind joint i along z by d, then along x by a, and the ball of the joint, in the frame of link i."""
    link, (d, a, foot) = table.links[i], _limb(table, i)
    moves = link.kind != "fixed"
    next_moves = i + 1 < len(table.links) and table.links[i + 1].kind != "fixed"
    start = -max(link.upper or 0.0, 0.0) if link.kind == "prismatic" else 0.0
    rods = [("z", foot + start, foot + d, 0.0), ("x", 0.0, a, foot + d)]
    rods = [rod for rod in rods if rod[1] != rod[2]]
    for axis, begin, end, height in rods:
        _rod(element, "visual", "shell", axis, begin, end, radius, height)
    if moves:
        _ball(element, "visual", 1.3 * radius, foot)
        _rod(element, "visual", "dark", "z", foot - 1.45 * radius, foot + 1.45 * radius, 0.7 * radius)
    for k, (axis, begin, end, height) in enumerate(rods):
        margin = math.copysign(min(2.0 * radius, 0.4 * abs(end - begin)), end - begin)
        near = begin + margin if k == 0 and link.kind in ("revolute", "continuous") else begin
        far = end - margin if k == len(rods) - 1 and next_moves else end
        _rod(element, "collision", "shell", axis, near, far, radius, height)
    if moves and i > 0 and any(_limb(table, i - 1)[:2]):
        _ball(element, "collision", 1.3 * radius, foot)


def _rod(
    element: Element, tag: str, colour: str, axis: str, begin: float, end: float, radius: float, height: float = 0.0
) -> None:
    """A cylinder along x or z of the link, from `begin` to `end` [m]; `height` is its z if it lies along x."""
    middle = (begin + end) / 2
    xyz, rpy = ((0, 0, middle), (0, 0, 0)) if axis == "z" else ((middle, 0, height), (0, math.pi / 2, 0))
    part = SubElement(element, tag)
    SubElement(part, "origin", xyz=_rounded(*xyz), rpy=_words(*rpy))
    size = {"radius": _rounded(radius), "length": _rounded(abs(end - begin))}
    SubElement(SubElement(part, "geometry"), "cylinder", size)
    if tag == "visual":
        SubElement(part, "material", name=colour)


def _ball(element: Element, tag: str, radius: float, height: float) -> None:
    """A sphere in the joint, which is at that height on the z axis of the link [m]."""
    part = SubElement(element, tag)
    if height:
        SubElement(part, "origin", xyz=_rounded(0, 0, height))
    SubElement(SubElement(part, "geometry"), "sphere", radius=_rounded(radius))
    if tag == "visual":
        SubElement(part, "material", name="joint")


def _rounded(*numbers: float) -> str:
    """Sizes to look at need six digits, not all."""
    return _words(*(float(f"{number:.6g}") for number in numbers))
