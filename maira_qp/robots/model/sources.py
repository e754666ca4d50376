"""What a robot was loaded from, and what it was changed by since: its description as URDF follows from both."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any
from xml.etree import ElementTree

from maira_qp.errors import RobotError
from maira_qp.robots.dh.table import DHLink, DHTable
from maira_qp.robots.model.edits import Edit, edited, placed_values, words
from maira_qp.robots.model.joint_limits import JointLimits, Limits, given_limits
from maira_qp.robots.model.reduced import Reduced, reduced
from maira_qp.robots.srdf.semantics import Semantics
from maira_qp.robots.urdf.joint import Joint, fixed_at, turned_round
from maira_qp.robots.urdf.model import model_of
from maira_qp.robots.urdf.reader import Chain, read_urdf
from maira_qp.robots.urdf.sum_limits import place_fixed
from maira_qp.robots.urdf.writer import urdf_text

FOLLOWING = 1e-9
"""Share by which the limits of a mimic joint become wider than its leader's, and differ at least for that."""


def part_of(chain: Chain) -> Reduced:
    """The model of a description that was read. Raises `RobotError`."""
    model, mimic = model_of(chain)
    return reduced(model, chain.tips, chain.base, None, mimic)._replace(sums=chain.sums)


class Source(ABC):
    """A description that a robot can be loaded from again."""

    dh: DHTable | None = None
    """The DH table, if it is one."""
    has_urdf = True
    mesh_folders: tuple[str, ...] = ()
    """Where the meshes that it names may be"""

    @abstractmethod
    def text(self) -> str:
        """The description as normalised URDF, see `maira_qp.robots.urdf.reader.Chain`. Raises `RobotError`."""

    @abstractmethod
    def part(self) -> Reduced:
        """The model."""

    @abstractmethod
    def at_rest(self, values: Any, moving: tuple[str, ...]) -> Source:
        """The same with joints that do not move placed at values; `moving` are those that do. Raises `OptionError`."""


@dataclass(frozen=True)
class URDFSource(Source):
    """Normalised URDF."""

    normalised: str
    tips: tuple[str, ...]
    base: str
    resting: Mapping[str, Joint] = field(default_factory=dict)
    """See `maira_qp.robots.urdf.reader.Chain`"""
    mesh_folders: tuple[str, ...] = ()

    def text(self) -> str:
        """The text."""
        return self.normalised

    def part(self) -> Reduced:
        """By the reader."""
        return part_of(read_urdf(self.normalised, tip=self.tips, base=self.base))

    def at_rest(self, values: Any, moving: tuple[str, ...]) -> URDFSource:
        """With the origins of the fixed joints moved to where the values lead."""
        joints = self.resting
        ranges = {name: (joint.lower, joint.upper) for name, joint in joints.items() if joint.mimic is None}
        leaders = {name: joint.mimic[0] for name, joint in joints.items() if joint.mimic is not None}
        placed = placed_values(values, ranges, "at_rest", lambda name: _not_at_rest(name, moving, leaders))
        for name, joint in joints.items():
            if joint.mimic is not None and joint.mimic[0] in placed:
                leader, multiplier, offset = joint.mimic
                placed[name] = multiplier * placed[leader] + offset
        root = ElementTree.fromstring(self.normalised)
        place_fixed(root, placed)
        for element in root.findall("joint"):
            if (joint := joints.get(element.attrib["name"])) is not None and joint.name in placed:
                fixed = fixed_at(joint, placed[joint.name])
                parent, origin = element.find("parent"), element.find("origin")
                assert parent is not None
                assert origin is not None
                if parent.get("link") != joint.parent:
                    fixed = turned_round(fixed)
                origin.attrib |= {"xyz": words(fixed.xyz), "rpy": words(fixed.rpy)}
        return replace(self, normalised=ElementTree.tostring(root, encoding="unicode"))


@dataclass(frozen=True)
class DHSource(Source):
    """A DH table."""

    dh: DHTable  # pyright: ignore[reportIncompatibleVariableOverride]

    def text(self) -> str:
        """The URDF that is written from the table."""
        return read_urdf(urdf_text(self.dh)).urdf

    def part(self) -> Reduced:
        """By way of the URDF."""
        return part_of(read_urdf(urdf_text(self.dh)))

    def at_rest(self, values: Any, moving: tuple[str, ...]) -> DHSource:
        """All of its joints move."""
        placed_values(values, {}, "at_rest", lambda name: _not_at_rest(name, moving, {}))
        return self


@dataclass(frozen=True, eq=False)
class ModelSource(Source):
    """A Pinocchio model."""

    whole: Reduced
    """See `maira_qp.robots.model.reduced.plain`"""
    limits: Limits | None
    """In place of those of the model"""
    rest: Mapping[str, float] = field(default_factory=dict)
    """Where joints stand that do not move"""
    has_urdf = False

    def text(self) -> str:
        """There is none."""
        raise RobotError(
            f"{self.whole.model.name!r} was made from a Pinocchio model, of which there is no URDF; with its URDF use "
            "Robot.from_urdf"
        )

    def part(self) -> Reduced:
        """The part of the model."""
        model, mimic, base, tips, *_ = self.whole
        return reduced(model, tips, base, self.limits, mimic, self.rest)

    def at_rest(self, values: Any, moving: tuple[str, ...]) -> ModelSource:
        """With other values."""
        placed = placed_values(values, self.whole.resting, "at_rest", lambda name: _not_at_rest(name, moving, {}))
        return replace(self, rest={**self.rest, **placed})


def _not_at_rest(name: str, moving: tuple[str, ...], leaders: Mapping[str, str]) -> str:
    """Why a joint is not placed; nothing for one that is not known."""
    if name in moving:
        return f"the joint {name!r} moves; robot.locked({{{name!r}: value}}) fixes it"
    return f"the joint {name!r} follows {leaders[name]!r}, which can be placed" if name in leaders else ""


@dataclass(frozen=True)
class Description:
    """A source, and what was changed since, in the order of the changes."""

    source: Source
    edits: tuple[Edit, ...] = ()
    is_limited: bool = False
    """The limits of the joints are other ones than those of the source."""
    semantics: Semantics = field(default_factory=Semantics)
    """Groups, named configurations and links that may touch."""

    @property
    def part(self) -> Reduced:
        """The model with the changes made."""
        return edited(self.edits, self.source.part())

    def urdf(self, tips: tuple[str, ...], base: str, limits: JointLimits) -> str:
        """The description as normalised URDF, with limits that are now those of its joints. Raises `RobotError`."""
        if (table := self.dh(limits)) is not None:
            return read_urdf(urdf_text(table)).urdf
        text = self.source.text()
        if not self.edits and not self.is_limited:
            return text
        root = ElementTree.fromstring(text)
        for edit in self.edits:
            edit.urdf(root)
        if self.is_limited:
            write_limits(root, limits)
        return read_urdf(ElementTree.tostring(root, encoding="unicode"), tip=tips, base=base).urdf

    def dh(self, limits: JointLimits) -> DHTable | None:
        """The DH table that the robot is, with its limits; None: it is none."""
        table = self.source.dh
        return None if table is None or self.edits else limited_table(table, limits) if self.is_limited else table


def given_table(table: DHTable, limits: Limits | None) -> DHTable:
    """The DH table with limits of position that are given for some joints at load. Raises `OptionError`."""
    given, names, links = given_limits(limits, table.joint_names), iter(table.joint_names), list[DHLink]()
    for link in table.links:
        pair = None if link.kind == "fixed" else given.get(next(names))
        if pair is not None:
            kind = "revolute" if link.kind == "continuous" else link.kind
            link = replace(link, kind=kind, lower=pair[0], upper=pair[1])
        links.append(link)
    return DHTable(links, table.name, table.convention)


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


def write_limits(root: ElementTree.Element, limits: JointLimits) -> None:
    """Write other limits of the independent joints into a normalised URDF, see `maira_qp.robots.urdf.reader.Chain`.

    Those of mimic joints become as wide as these need them.
    """
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
