"""SRDF, as a file or as text. The format: http://wiki.ros.org/srdf."""

from __future__ import annotations

import math
import os
from xml.etree.ElementTree import Element

from maira_qp.errors import RobotError
from maira_qp.robots.srdf.semantics import Group, Semantics
from maira_qp.robots.urdf.safe_xml import xml_root


def read_srdf(source: str | os.PathLike[str]) -> Semantics:
    """Groups, named states and `<disable_collisions>` of an SRDF file, or of text that begins with `<`.

    Values of a state that are no single number, such as those of a floating base, are left out. Raises `RobotError`.
    """
    root = xml_root(source)
    if root.tag != "robot":
        raise RobotError(f"not an SRDF: the outermost element is <{root.tag}>, not <robot>")
    groups, states = dict[str, Group](), dict[str, dict[str, float]]()
    for element in root.findall("group"):
        groups[_text(element, "name")] = Group(
            chains=tuple((_text(each, "base_link"), _text(each, "tip_link")) for each in element.findall("chain")),
            joints=tuple(_text(each, "name") for each in element.findall("joint")),
            links=tuple(_text(each, "name") for each in element.findall("link")),
            subgroups=tuple(_text(each, "name") for each in element.findall("group")),
        )
    for element in root.findall("group_state"):
        values = {_text(each, "name"): _value(each) for each in element.findall("joint")}
        group, name = element.get("group"), _text(element, "name")
        states[f"{group}/{name}" if group else name] = {
            joint: value for joint, value in values.items() if value is not None
        }
    pairs = {frozenset((_text(each, "link1"), _text(each, "link2"))) for each in root.iter("disable_collisions")}
    return Semantics(groups, states, frozenset(pairs))


def _text(element: Element, key: str) -> str:
    """An attribute that must be there. Raises `RobotError`."""
    text = element.get(key)
    if not text:
        raise RobotError(f"a <{element.tag}> of the SRDF lacks {key}: {element.attrib!s:.200}")
    return text


def _value(joint: Element) -> float | None:
    """The value of a joint in a state [rad, or m], None where it is several numbers. Raises `RobotError`."""
    words = _text(joint, "value").split()
    try:
        values = [float(word) for word in words]
    except ValueError:
        values = [math.nan]
    if not all(map(math.isfinite, values)):
        raise RobotError(f"the value of joint {joint.get('name')!r} in a state of the SRDF: {joint.get('value')!r:.80}")
    return values[0] if len(values) == 1 else None
