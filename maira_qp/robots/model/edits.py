"""What a robot is changed by once it is loaded: tools, another base, joints that are locked, objects in its hand.

Each change is made twice: on the Pinocchio model at once, and on the URDF when that is asked for. Both are what a
description with the same fixed joints would be loaded as.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any
from xml.etree.ElementTree import Element, SubElement

import pinocchio as pin

from maira_qp.arrays import real_array
from maira_qp.errors import FrameError, OptionError, listed, shown
from maira_qp.orientation import rigid_or_point
from maira_qp.robots.model.joint_values import check_joints
from maira_qp.robots.model.reduced import UNIVERSE, Reduced, frames_of, locked
from maira_qp.robots.urdf.joint import fixed_at, joint_of
from maira_qp.robots.urdf.rpy import rpy_from_matrix
from maira_qp.robots.urdf.sum_limits import place_fixed


class Edit(ABC):
    """A change of a robot."""

    @abstractmethod
    def model(self, part: Reduced) -> Reduced:
        """The part of a model with the change made; the one that is given is left as it is."""

    @abstractmethod
    def urdf(self, root: Element) -> None:
        """Make the change in a normalised URDF."""


@dataclass(frozen=True, eq=False)
class Tool(Edit):
    """A frame that takes the place of a tip."""

    tip: str
    name: str
    pose: pin.SE3
    """In the tip"""

    def model(self, part: Reduced) -> Reduced:
        """With the frame on the joint that carries the tip."""
        tips = tuple(self.name if tip == self.tip else tip for tip in part.tips)
        return part._replace(model=_with_frame(part.model, self.tip, self.name, self.pose), tips=tips)

    def urdf(self, root: Element) -> None:
        """A link without shapes."""
        attach(root, self.tip, self.name, self.pose)


@dataclass(frozen=True, eq=False)
class Base(Edit):
    """A frame that takes the place of the base, which stands in it."""

    base: str
    name: str
    pose: pin.SE3
    """Of the base in the new one"""

    def model(self, part: Reduced) -> Reduced:
        """With all that stands on the universe moved, and the universe as the new base."""
        model = part.model.copy()
        for joint in range(1, model.njoints):
            if model.parents[joint] == 0:
                model.jointPlacements[joint] = self.pose * model.jointPlacements[joint]
        for frame in list(model.frames)[1:]:
            if frame.parentJoint == 0:
                frame.placement = self.pose * frame.placement
        model.inertias[0] = self.pose.act(model.inertias[0])
        if self.base not in frames_of(model):  # Pinocchio's universe, which from now on is a frame like others
            model.addFrame(pin.Frame(self.base, 0, 0, self.pose, pin.FrameType.BODY), False)
        if self.name != UNIVERSE:
            model.addFrame(pin.Frame(self.name, 0, 0, pin.SE3.Identity(), pin.FrameType.BODY), False)
        return part._replace(model=model, base=self.name)

    def urdf(self, root: Element) -> None:
        """A link above all others."""
        root.append(Element("link", name=self.name))
        _join(root, self.name, self.base, self.pose, self.name)


@dataclass(frozen=True, eq=False)
class Locked(Edit):
    """Joints that stand at values from now on, and so do their followers."""

    values: Mapping[str, float]

    def model(self, part: Reduced) -> Reduced:
        """Without these joints."""
        return locked(part, self.values)

    def urdf(self, root: Element) -> None:
        """With fixed joints in their place."""
        place_fixed(root, self.values)
        for element in root.findall("joint"):
            joint = joint_of(element)
            value = self.values.get(joint.name)
            if joint.mimic is not None and joint.mimic[0] in self.values:
                value = joint.mimic[1] * self.values[joint.mimic[0]] + joint.mimic[2]
            if value is None:
                continue
            fixed = fixed_at(joint, value)
            for part in list(element):
                if part.tag in ("origin", "axis", "limit", "mimic"):
                    element.remove(part)
            element.set("type", "fixed")
            SubElement(element, "origin", xyz=words(fixed.xyz), rpy=words(fixed.rpy))


@dataclass(frozen=True, eq=False)
class Held(Edit):
    """An object that a frame carries."""

    frame: str
    name: str
    pose: pin.SE3
    """In the frame"""
    shape: Element
    """Its URDF, `<collision>`"""
    touching: tuple[str, ...]
    """Links that it may touch"""

    def model(self, part: Reduced) -> Reduced:
        """With a frame for it."""
        return part._replace(model=_with_frame(part.model, self.frame, self.name, self.pose))

    def urdf(self, root: Element) -> None:
        """A link with its shape, to be seen and to collide."""
        visual = Element("visual")
        visual.extend(self.shape)
        attach(root, self.frame, self.name, self.pose, (visual, self.shape))


def _with_frame(model: pin.Model, carrier: str, name: str, pose: pin.SE3) -> pin.Model:
    """A copy of a model with one frame more, at a pose in another one."""
    model = model.copy()
    index = frames_of(model).get(carrier, 0)
    on = model.frames[index]
    model.addFrame(pin.Frame(name, on.parentJoint, index, on.placement * pose, pin.FrameType.BODY), False)
    return model


def attach(root: Element, carrier: str, name: str, pose: pin.SE3, parts: Iterable[Element] = ()) -> None:
    """Add a link to a URDF, fixed at a pose in another one."""
    SubElement(root, "link", name=name).extend(parts)
    _join(root, carrier, name, pose, name)


def _join(root: Element, parent: str, child: str, pose: pin.SE3, name: str) -> None:
    taken = {joint.get("name") for joint in root.findall("joint")}
    name = f"{name}_joint"
    while name in taken:
        name += "_"
    joint = SubElement(root, "joint", name=name, type="fixed")
    SubElement(joint, "parent", link=parent)
    SubElement(joint, "child", link=child)
    SubElement(joint, "origin", xyz=words(pose.translation), rpy=words(rpy_from_matrix(pose.rotation)))


def words(numbers: Iterable[float]) -> str:
    """Numbers as text, with all of their digits."""
    return " ".join(repr(float(number)) for number in numbers)


# What callers give


def placement(value: Any, name: str) -> pin.SE3:
    """A pose from a caller, `pin.SE3` or (4, 4), or a point (3,). Raises `PoseError`."""
    T = rigid_or_point(value, name)
    return pin.SE3(T[:3, :3].copy(), T[:3, 3].copy())


def new_frame(name: Any, frames: Sequence[str], argument: str) -> str:
    """The name of a frame that is to be added. Raises `FrameError` for one that there is already."""
    if not isinstance(name, str) or not name.strip() or not name.isprintable():
        raise FrameError(f"the name of a frame must be text that is not empty, got {argument}{shown(name)}")
    if name in frames:
        raise FrameError(f"there is a link {name!r} already; give another name, {argument}{unused(name, frames)!r}")
    return name


def tools(tool: Any, name: Any, tips: tuple[str, ...], frames: Sequence[str]) -> list[Tool]:
    """The tools that `Robot.with_tool` is asked for. Raises `PoseError`, `FrameError`."""
    if not isinstance(tool, Mapping):
        if len(tips) > 1:
            raise FrameError(f"the robot has several tips, name the one that gets the tool: {{{tips[0]!r}: tool}}")
        tool, name = dict.fromkeys(tips, tool), dict.fromkeys(tips, name)
    elif not isinstance(name, Mapping):
        name = {tip: f"{tip}_tool" for tip in tool}
    made = list[Tool]()
    for tip, pose in tool.items():
        if tip not in tips:
            raise FrameError(f"{shown(tip)} is not a tip of the robot; {listed(tips, tip)}")
        taken = [*frames, *(each.name for each in made)]
        made.append(Tool(tip, new_frame(name.get(tip, f"{tip}_tool"), taken, "name="), placement(pose, "tool")))
    return made


def unused(name: str, frames: Iterable[str]) -> str:
    """The name, or it with the first number that makes one that no frame has."""
    frames, count, made = set(frames), 1, name
    while made in frames:
        count += 1
        made = f"{name}{count}"
    return made


def placed_values(
    values: Any,
    ranges: Mapping[str, tuple[float, float]],
    verb: str,
    other: Callable[[str], str] = lambda name: "",
) -> dict[str, float]:
    """Values of joints {name: value} [rad, or m] within their ranges, checked; `other` says what a further name is.

    Raises `OptionError`.
    """
    if not isinstance(values, Mapping):
        raise OptionError(f"{verb} takes a mapping {{joint name: value}}, got {shown(values)}")
    for name in values:
        if name not in ranges and isinstance(name, str) and (reason := other(name)):
            raise OptionError(f"{verb}: {reason}")
    check_joints(values, tuple(ranges), verb, OptionError)
    placed = {}
    for name, value in values.items():
        lower, upper = ranges[name]
        placed[name] = float(real_array(value, (), f"{verb}: the value of joint {name!r}", OptionError))
        if not lower <= placed[name] <= upper:
            raise OptionError(
                f"{verb}: {placed[name]:g} is outside the range of joint {name!r}, {lower:g} to {upper:g}"
            )
    return placed


def edited(edits: Sequence[Edit], part: Reduced) -> Reduced:
    """The part with changes made, one after the other."""
    for edit in edits:
        part = edit.model(part)
    return part


def without_object(edits: Sequence[Edit], name: str) -> tuple[Edit, ...]:
    """The changes but that by which an object of that name is held. Raises `OptionError` if there is none."""
    held = [edit.name for edit in edits if isinstance(edit, Held)]
    if name not in held:
        raise OptionError(f"no object {shown(name)} is held; held: {', '.join(map(repr, held)) or 'none'}")
    on_it = [edit for edit in edits if name in (getattr(edit, "frame", None), getattr(edit, "tip", None))]
    if on_it:
        raise OptionError(f"{name!r} carries {on_it[0].name!r}, which must be given up first")  # type: ignore[attr-defined]
    return tuple(edit for edit in edits if not (isinstance(edit, Held) and edit.name == name))
