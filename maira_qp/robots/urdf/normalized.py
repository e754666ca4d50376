"""The text of a normalised URDF: the links and joints that a `Chain` keeps, numbers with all of their digits."""

from __future__ import annotations

import math
import os
from collections.abc import Iterable
from pathlib import Path
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

from maira_qp.robots.urdf.joint import MOVING, Joint
from maira_qp.robots.urdf.safe_xml import is_text
from maira_qp.robots.urdf.sum_limits import Sum, sum_element


def normalised(
    name: str,
    links: list[Element],
    joints: list[Joint],
    sums: Iterable[Sum],
    root: Element,
    source: str | os.PathLike[str],
) -> str:
    """The normalised URDF: links as they are, joints written anew with all digits.

    Elements and attributes with a prefix are not URDF's, and are left out. Meshes that are named relative to the file
    of the URDF are named by their whole path.
    """
    robot = Element("robot", name=name)
    robot.extend(_plain(part) for part in root.findall("material"))
    for link in links:
        kept = SubElement(robot, "link", name=link.attrib["name"])
        kept.extend(_plain(part) for part in link if part.tag in ("inertial", "visual", "collision"))
    for joint in joints:
        _write_joint(robot, joint)
    robot.extend(sum_element(each.limit, each.still) for each in sums)
    if not is_text(source):
        for mesh in robot.iter("mesh"):
            mesh.set("filename", _beside(mesh.get("filename", ""), Path(source).parent))
    ElementTree.indent(robot)
    return ElementTree.tostring(robot, encoding="unicode") + "\n"


def _plain(element: Element) -> Element:
    """A copy without what has a prefix, which would be bound to no namespace."""
    copy = Element(element.tag, {key: value for key, value in element.attrib.items() if ":" not in key})
    copy.text, copy.tail = element.text, element.tail
    copy.extend(_plain(part) for part in element if ":" not in part.tag)
    return copy


def _beside(filename: str, folder: Path) -> str:
    """The whole path of a mesh that is named relative to the folder of its URDF, if it is there; else the name."""
    if not filename or "://" in filename or os.path.isabs(filename):
        return filename
    try:
        path = (folder / filename).resolve()
        return str(path) if path.is_file() else filename
    except (OSError, ValueError):  # a name that no file can have
        return filename


def _write_joint(robot: Element, joint: Joint) -> None:
    element = SubElement(robot, "joint", name=joint.name, type=joint.kind)
    SubElement(element, "parent", link=joint.parent)
    SubElement(element, "child", link=joint.child)
    SubElement(element, "origin", xyz=_words(joint.xyz), rpy=_words(joint.rpy))
    if joint.kind not in MOVING:
        return
    SubElement(element, "axis", xyz=_words(joint.axis))
    bounds = {"lower": joint.lower, "upper": joint.upper} if math.isfinite(joint.upper - joint.lower) else {}
    known = {"effort": joint.effort, "velocity": joint.velocity}
    known = {key: value if math.isfinite(value) else 0.0 for key, value in known.items()}
    last = {"acceleration": joint.acceleration} if math.isfinite(joint.acceleration) else {}
    SubElement(element, "limit", {key: _words([value]) for key, value in (bounds | known | last).items()})
    if joint.mimic is not None:
        leader, multiplier, offset = joint.mimic
        SubElement(element, "mimic", joint=leader, multiplier=_words([multiplier]), offset=_words([offset]))


def _words(numbers: Iterable[float]) -> str:
    return " ".join(repr(float(number)) for number in numbers)
