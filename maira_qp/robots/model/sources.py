"""What a robot was imported from, beside its model: the text of its URDF, with the limits that it has now."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
from xml.etree import ElementTree

from maira_qp.robots.dh.table import DHTable
from maira_qp.robots.model.joint_limits import JointLimits
from maira_qp.robots.urdf.reader import read_urdf
from maira_qp.robots.urdf.writer import urdf_text

FOLLOWING = 1e-9
"""Share by which the limits of a mimic joint become wider than its leader's, and differ at least for that."""


class Source(ABC):
    """A description that holds more than a model does, such as shapes."""

    dh: DHTable | None
    """The DH table, if it is one."""

    @abstractmethod
    def urdf(self) -> str:
        """The description as normalised URDF, see `maira_qp.robots.urdf.reader.Chain`."""

    @abstractmethod
    def limited(self, limits: JointLimits) -> Source:
        """The same with other limits of its joints."""


@dataclass(frozen=True)
class URDFSource(Source):
    """Normalised URDF, and limits that are to be written into it."""

    text: str
    tips: tuple[str, ...]
    base: str
    limits: JointLimits | None = None
    dh = None

    def urdf(self) -> str:
        """The text with the limits in it."""
        if self.limits is None:
            return self.text
        return read_urdf(limited_urdf(self.text, self.limits), tip=self.tips, base=self.base).urdf

    def limited(self, limits: JointLimits) -> URDFSource:
        """The same text, and limits that are written when it is asked for."""
        return replace(self, limits=limits)


@dataclass(frozen=True)
class DHSource(Source):
    """A DH table."""

    dh: DHTable  # pyright: ignore[reportIncompatibleVariableOverride]

    def urdf(self) -> str:
        """The URDF that is written from the table."""
        return read_urdf(urdf_text(self.dh)).urdf

    def limited(self, limits: JointLimits) -> DHSource:
        """The table with other limits."""
        return DHSource(limited_table(self.dh, limits))


def limited_table(table: DHTable, limits: JointLimits) -> DHTable:
    """The DH table with other limits; a continuous joint that has been given some is revolute."""
    joints = iter(zip(limits.lower, limits.upper, limits.velocity, limits.acceleration, strict=True))
    links = []
    for link in table.links:
        if link.kind != "fixed":
            lower, upper, velocity, acceleration = map(float, next(joints))
            limited = {"velocity": velocity, "acceleration": acceleration if acceleration < math.inf else None}
            limited |= {"lower": lower, "upper": upper} if upper < math.inf else {"lower": None, "upper": None}
            kind = "revolute" if link.kind == "continuous" and upper < math.inf else link.kind
            link = replace(link, kind=kind, **limited)
        links.append(link)
    return DHTable(links, table.name, table.convention)


def limited_urdf(urdf: str, limits: JointLimits) -> str:
    """The text of a normalised URDF, see `urdf_reader.Chain`, with other limits of its independent joints.

    Those of mimic joints become as wide as these need them.
    """
    root = ElementTree.fromstring(urdf)
    joints = {joint.attrib["name"]: joint for joint in root.findall("joint")}
    for i, name in enumerate(limits.joint_names):
        joint = joints[name]
        keys = {"velocity": limits.velocity[i], "acceleration": limits.acceleration[i]}
        if limits.upper[i] < math.inf:
            keys |= {"lower": limits.lower[i], "upper": limits.upper[i]}
            if joint.get("type") == "continuous":
                joint.set("type", "revolute")
        for limit in joint.findall("limit"):
            limit.attrib |= {key: repr(float(value)) if math.isfinite(value) else "0" for key, value in keys.items()}
        if limits.upper[i] < math.inf:
            _let_follow(root, name, float(limits.lower[i]), float(limits.upper[i]))
    return ElementTree.tostring(root, encoding="unicode")


def _let_follow(root: ElementTree.Element, leader: str, lower: float, upper: float) -> None:
    """Widen the limits of a leader's mimic joints to what its own, [rad, or m], lead them to."""
    for joint in root.findall("joint"):
        mimic, limit = joint.find("mimic"), joint.find("limit")
        if mimic is not None and limit is not None and mimic.get("joint") == leader:
            multiplier, offset = float(mimic.attrib["multiplier"]), float(mimic.attrib["offset"])
            ends = sorted(multiplier * end + offset for end in (lower, upper))
            slack = FOLLOWING * max(1.0, abs(ends[0]), abs(ends[1]))
            if ends[0] < float(limit.get("lower", -math.inf)) - slack:
                limit.set("lower", repr(ends[0] - slack))
            if ends[1] > float(limit.get("upper", math.inf)) + slack:
                limit.set("upper", repr(ends[1] + slack))
