"""A robot: its Pinocchio model, the frame that is its tip, or those that are, and its limits."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from functools import cached_property, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, overload

import numpy as np
import pinocchio as pin

from maira_qp.display import Card, Shown, joint_entries
from maira_qp.errors import ConfigurationError, OptionError, RobotError, shown
from maira_qp.robots.collision.urdf_geometry import collision_element
from maira_qp.robots.dh.table import Convention, DHLink, DHTable
from maira_qp.robots.library.names import OWN, entry_of
from maira_qp.robots.library.packages import description_file, installed, srdf_beside
from maira_qp.robots.mjcf.reader import read_mjcf
from maira_qp.robots.model import catalog
from maira_qp.robots.model.configuration import Configuration
from maira_qp.robots.model.edits import (
    Base,
    Edit,
    Held,
    Locked,
    edited,
    new_frame,
    placed_values,
    placement,
    tools,
    without_object,
)
from maira_qp.robots.model.joint_limits import JointLimits, SumLimit, drawn_within
from maira_qp.robots.model.joint_values import joint_array, joint_order
from maira_qp.robots.model.kinematics import Kinematics
from maira_qp.robots.model.reduced import Couplings, Reduced, coupled, frames_of, plain, reduced
from maira_qp.robots.model.sources import Description, DHSource, ModelSource, Source, URDFSource, given_table, part_of
from maira_qp.robots.srdf.reader import read_srdf
from maira_qp.robots.srdf.semantics import Semantics
from maira_qp.robots.urdf.reader import Chain, link_tree, read_urdf
from maira_qp.robots.urdf.safe_xml import is_text, xml_root
from maira_qp.robots.urdf.writer import urdf_text
from maira_qp.robots.urdf.xacro import expanded, is_xacro

if TYPE_CHECKING:
    from maira_qp.robots.model.arrays import KinematicTree


PACKAGE_DEPTH = 8
"""So many folders above a URDF file may hold the packages of its meshes."""


class Robot(Shown):
    """An arm from `base` to `tip`, or a tree to several tips, with n independent joints.

    It does not change, and threads may share it.

    Angles are in rad, lengths in m. `q` is a configuration (n,), in the order of `joint_names`, or a mapping
    {joint name: value} of all joints; names that no joint has raise `ConfigurationError`.
    """

    model: pin.Model
    """Pinocchio's model, nq == nv == n; a continuous joint is one angle without limits. Not to be written to."""
    name: str
    base: str
    """Link that poses are relative to."""
    tip: str
    """Link whose pose is asked for unless another is named: the first of the tips."""
    tips: tuple[str, ...]
    """The links to which the joints lead, one or more, in the order in which they were given."""
    is_chain: bool
    """Every joint moves the tip, and none mimics another: what the compiled engine can take."""
    n: int
    """Number of independent joints."""
    joint_names: tuple[str, ...]
    frames: tuple[str, ...]
    """Names of all links, and of the tool frames of a model, the base first: what `frame` may be."""
    moved_links: tuple[str, ...]
    """The link directly behind each moving joint, mimic joints too, parents before children."""
    slides: np.ndarray
    """Which joints (n,) are prismatic, and so in m where others are in rad."""
    lower: np.ndarray
    """Lower limits (n,) [rad, or m], -inf for a continuous joint; read-only, as are the arrays that follow."""
    upper: np.ndarray
    """Upper limits (n,) [rad, or m], inf for a continuous joint."""
    middle: np.ndarray
    """Middle (n,) between the limits [rad, or m], 0 for a continuous joint."""
    velocity_limit: np.ndarray
    """Largest speeds (n,) [rad/s, or m/s], inf where there is no limit."""
    effort_limit: np.ndarray
    """Largest torques or forces (n,) [N m, or N], inf where there is no limit."""
    acceleration_limit: np.ndarray
    """Largest accelerations (n,) [rad/s^2, or m/s^2], inf where there is no limit."""
    sum_limits: tuple[SumLimit, ...]
    """Hard limits of sums of joint values: ranges of an MJCF's tendons, and of joints that follow several others. Every
    solver keeps them, unasked."""
    length: float
    """Length of the arm stretched out [m], what errors of position are measured by: the distances between its joints
    and to the tip, and prismatic ranges, each of which counts no more than all distances together.

    Of several tips the one that is farthest."""
    dh: DHTable | None
    """The DH table that the robot was made from, if it was."""

    def __init__(self, part: Reduced, name: str, acceleration: np.ndarray, description: Description) -> None:
        """From a part of a model, accelerations (n,) and a description of it; use `from_model`."""
        self._part, self._description = part, description
        mimic, base, tips, self.sum_limits = part.mimic, part.base, part.tips, part.sums
        self.model = coupled(part.model, mimic)
        links = frames_of(self.model)
        frames = {base: links.get(base, 0), **links}  # the universe is no link
        self.name, self.base, self.tip, self.tips = name, base, tips[0], tips
        self.joint_names = tuple(each for each in self.model.names[1:] if each not in mimic)
        self.frames = tuple(frames)
        self.n = self.model.nv
        sliding = [joint.idx_q for joint in self.model.joints if joint.shortname().startswith("JointModelP")]
        self.slides = np.isin(np.arange(self.n), sliding)
        self.lower, self.upper = np.array(self.model.lowerPositionLimit), np.array(self.model.upperPositionLimit)
        self.velocity_limit, self.effort_limit = np.array(self.model.velocityLimit), np.array(self.model.effortLimit)
        self.acceleration_limit = np.array(acceleration)
        limits = self.lower, self.upper, self.velocity_limit, self.effort_limit, self.acceleration_limit
        for array in (self.slides, *limits):
            array.setflags(write=False)
        turns = np.isinf(self.lower)  # a continuous joint: one turn is all of it
        # what random configurations are drawn from
        self.drawn_range = np.where(turns, -np.pi, self.lower), np.where(turns, np.pi, self.upper)
        self.middle = 0.5 * self.drawn_range[0] + 0.5 * self.drawn_range[1]
        self.middle.setflags(write=False)
        self.dh = description.dh(self._limits)
        self.kinematics = Kinematics(self.model, frames, self.tip, self.name)
        ends = [self.model.frames[self.frame_id(tip)] for tip in self.tips]
        self.length = max(_length(self.model, end, self.drawn_range) for end in ends)
        behind = len(self.model.supports[ends[0].parentJoint])  # the joints before the first tip, and the universe
        self.is_chain = behind == self.model.njoints and not self.kinematics.has_mimic
        named = [self.model.frames[index] for index in frames.values()]
        named.sort(key=lambda frame: frame.type != pin.FrameType.BODY)  # a joint may carry no link, but another frame
        self.moved_links = tuple(
            next(f.name for f in named if f.parentJoint == joint) for joint in range(1, self.model.njoints)
        )

    @classmethod
    def from_model(
        cls,
        model: pin.Model,
        tip: str | Sequence[str] | None = None,
        base: str | None = None,
        *,
        limits: Mapping[str, tuple[float, float]] | None = None,
        name: str | None = None,
        acceleration: Any = None,
        mimic: Couplings | None = None,
        tool: Any = None,
    ) -> Robot:
        """From a Pinocchio model, which is copied; `from_urdf` and `from_dh` make one.

        The joints between the base and the tips move, in the order of the model, all others are fixed at zero or at
        their limit nearest to it. A continuous joint, in Pinocchio a pair (cos, sin), becomes one angle without limits,
        so that q may be shorter than that of the model. Without a base poses are relative to the model's universe, as
        Pinocchio's are.

        Args:
            model: each joint revolute, prismatic or continuous, or mimic; others must be off the way to the tips.
            tip: frame, or list of frames; None: the only one at the end of the joints. A joint that carries no link
                is named by a link of its own name.
            base: frame that poses are relative to, and that carries the tips; None: the universe.
            limits: {joint name: (lower, upper)} [rad, or m] in place of those of the model.
            name: of the robot; None: the model's.
            acceleration: largest accelerations (n,) [rad/s^2, or m/s^2], as in `limited`: no model holds them.
            mimic: {follower: (leader, multiplier, offset)} of joints that are not mimic joints in the model.
            tool: pose of a tool in the tip, or {tip: pose}, as for `with_tool`; None: the tip is the tool.

        Raises `RobotError` for a model that cannot be used: joints of other types on the way, such as a free-flyer,
        limits that are inverted, NaN or missing, nothing that moves; `FrameError` for a tip or base that is not a
        suitable frame; `OptionError` for limits of no joint, inverted ones, and accelerations.
        """
        part = reduced(model, tip, base, limits, mimic)
        if name is None:
            name = model.name or "robot"
        elif not isinstance(name, str) or not name.strip():
            raise RobotError(f"a robot's name must be text that is not empty, got {shown(name)}")
        source = ModelSource(plain(model, mimic, part), limits)
        return cls._of_part(part, name, acceleration, source)._with_tool(tool)

    @classmethod
    def _of_part(
        cls, part: Reduced, name: str, acceleration: Any, source: Source, semantics: Semantics | None = None
    ) -> Robot:
        wanted = part.limits.limited(None, None, None, acceleration, 0.0)
        return cls(part, name, wanted.acceleration, Description(source, semantics=semantics or Semantics()))

    @classmethod
    def _of_chain(cls, chain: Chain, source: Source, semantics: Semantics | None = None) -> Robot:
        return cls._of_part(part_of(chain), chain.name, chain.acceleration, source, semantics)

    @classmethod
    def from_dh(
        cls,
        links: DHTable | Iterable[DHLink | Mapping[str, Any]],
        name: str | None = None,
        *,
        convention: Convention | None = None,
        limits: Mapping[str, tuple[float, float]] | None = None,
        tool: Any = None,
    ) -> Robot:
        """From a DH table or its links; the base is `base_link`, the tip `tool0`.

        Args:
            links: the table, or `DHLink`s, or mappings of their fields.
            name: of the robot; None: the table's.
            convention: "standard" (distal) or "modified" (Craig's); None: the table's, of links the standard one.
            limits: {joint name: (lower, upper)} [rad, or m] in place of those of the table; a continuous joint that is
                given some is revolute.
            tool: pose of a tool in the tip, as for `with_tool`; None: the tip is the tool.

        Raises `RobotError`; `OptionError` for the limits; `PoseError` for the tool.
        """
        table = links if isinstance(links, DHTable) else DHTable(links, convention=convention or "standard")
        if name is not None or convention is not None:
            table = DHTable(table.links, table.name if name is None else name, convention or table.convention)
        table = given_table(table, limits)
        return cls._of_chain(read_urdf(urdf_text(table)), DHSource(table))._with_tool(tool)

    @classmethod
    def from_urdf(
        cls,
        source: str | os.PathLike[str],
        tip: str | Sequence[str] | None = None,
        base: str | None = None,
        *,
        limits: Mapping[str, tuple[float, float]] | None = None,
        tool: Any = None,
        srdf: str | os.PathLike[str] | None = None,
        group: str | None = None,
        xacro_args: Mapping[str, Any] | None = None,
    ) -> Robot:
        """From a URDF file, or from URDF text; the tip None is the only leaf, the base None the root.

        A list or tuple of tips makes a tree: the joints between the base and any of them move, and a trunk that they
        share is there once. One tip may be on the way to another, or the way may go up to a common link and down
        again, as from hand to hand: then the tree is turned round, and each joint on the way up has a link
        `<joint>_origin` beside it, which is where it stands on its parent. Joints that are not between base and tip
        are fixed at zero, and elsewhere by `at_rest`. Meshes are not opened.

        Args:
            source: path, or text that begins with `<`.
            tip: link, or list of links.
            base: link that poses are relative to.
            limits: {joint name: (lower, upper)} [rad, or m] in place of those in the description, for joints that have
                none, or wrong ones; a continuous joint that is given some is revolute.
            tool: pose of a tool in the tip, or {tip: pose}, as for `with_tool`; None: the tip is the tool.
            srdf: path or text of an SRDF, see `with_srdf`.
            group: of that SRDF; it takes the place of tip and base.
            xacro_args: values of the arguments of a file whose name ends in `.xacro`. It is expanded by the `xacro`
                package (`maira-qp[xacro]`), which evaluates Python expressions that stand in the file and reads the
                files that it includes: only for files from sources that you trust.

        What the joints that move do not need cannot refuse a description; it is logged. Raises `RobotError` for a
        description that cannot be used, or a tip that no joint moves; `FrameError` for a tip or base that is not a
        suitable link, for tips that are repeated and for a group that is not there; `OptionError` for limits of no
        joint, or inverted ones, and for a group beside a tip or base.
        """
        if is_xacro(source):
            source = expanded(source, xacro_args)
        elif xacro_args is not None:
            raise OptionError(f"xacro_args go with the path of a .xacro file, not with {shown(source)}")
        semantics = Semantics() if srdf is None else read_srdf(srdf)
        if group is not None:
            if tip is not None or base is not None:
                raise OptionError(f"a group has its own tip and base: give group={shown(group)}, or those")
            base, tip = semantics.ends(group, link_tree(source))
        chain = read_urdf(source, tip=tip, base=base, limits=limits)
        folders = () if is_text(source) else tuple(map(str, Path(source).resolve().parents[:PACKAGE_DEPTH]))
        read = URDFSource(chain.urdf, chain.tips, chain.base, chain.resting, folders)
        return cls._of_chain(chain, read, semantics)._with_tool(tool)

    @classmethod
    def from_mjcf(
        cls,
        source: str | os.PathLike[str],
        tip: str | Sequence[str] | None = None,
        base: str | None = None,
        *,
        limits: Mapping[str, tuple[float, float]] | None = None,
        tool: Any = None,
    ) -> Robot:
        """From an MJCF file, or from MJCF text, through the `mujoco` package (`maira-qp[mujoco]`).

        MuJoCo itself resolves defaults, includes, angles and frames, and `q` is its `qpos`. Joints between base and
        tips move, all others are fixed at zero, and elsewhere by `at_rest`; those of free joints and balls where the
        model has them. Keyframes are states, see `state`; links that MuJoCo does not let collide may touch. Shapes
        become those of URDF, a plane a box below it; an ellipsoid is `<ellipsoid radii="a b c"/>`, which URDF lacks.
        Meshes, height fields and textures are not opened.

        Linear equality constraints of joints and of fixed tendons make mimic joints: one, or one for each of several
        leaders, about the same axis. Ranges of fixed tendons, and of joints that follow several others, are
        `sum_limits`; where they depend on one joint they narrow its range. What cannot be kept is logged where it
        concerns joints that move: loops that `connect` and `weld` close, tendons through sites. An equality of higher
        degree is refused where it determines a joint that moves.

        MuJoCo reads whatever files the model includes, and makes whatever it asks for: take models from sources that
        you trust.

        Args:
            source: path, or text that begins with `<`, whose includes are relative to the working directory.
            tip: body or site, or list of those; a site with the name of a body is `<name>_site`. None: the only leaf.
            base: body or site that poses are relative to. None: the body on a free joint, if the tips hang on one,
                else the world.
            limits: {joint name: (lower, upper)} [rad, or m] in place of those in the model.
            tool: pose of a tool in the tip, or {tip: pose}, as for `with_tool`; None: the tip is the tool.

        Raises `RobotError` if MuJoCo is not installed or refuses the model, where equalities contradict each other, and
        what `from_urdf` raises: for a free joint or a ball between base and tip, or a slide without limits.
        """
        chain, semantics = read_mjcf(source, tip, base, limits)
        read = URDFSource(chain.urdf, chain.tips, chain.base, chain.resting)
        return cls._of_chain(chain, read, semantics)._with_tool(tool)

    @classmethod
    def load(
        cls,
        name: str,
        tip: str | Sequence[str] | None = None,
        base: str | None = None,
        *,
        limits: Mapping[str, tuple[float, float]] | None = None,
        tool: Any = None,
    ) -> Robot:
        """A robot by its name, from the package that carries its description; `available` lists the names.

        Each name means one robot of one package, whatever is installed: "panda" is that of `example-robot-data`, as
        "example-robot-data/panda" says in full. Names that end with `_description`, such as "ur5e_description", are
        modules of `robot_descriptions`; nothing is downloaded. An SRDF that lies beside a URDF, in its folder or in
        `../srdf`, belongs to the robot: the one that is called as the robot is, else the only one whose robot it is.

        Args:
            name: short, or with its package; in upper or lower case.
            tip, base: as in `from_urdf`; None: those that are listed for the robot, of a tip alone the root as base.
            limits: {joint name: (lower, upper)} [rad, or m] in place of those in the description.
            tool: pose of a tool in the tip, or {tip: pose}, as for `with_tool`; None: the tip is the tool.

        Raises `RobotError` for an unknown name, with the nearest ones, and where files are missing, with what to
        install; and what `from_urdf` raises.
        """
        entry = entry_of(name)
        if entry.package == OWN:
            robot = cls.from_dh(getattr(catalog, entry.name)())
            if tip is None and base is None and not limits:
                return robot._with_tool(tool)
            return cls.from_urdf(robot.urdf, robot.tip if tip is None else tip, base, limits=limits, tool=tool)
        if tip is None:
            tip, base = entry.tip, entry.base if base is None else base
        path = description_file(entry)
        root = xml_root(path)
        if root.tag == "mujoco":
            return cls.from_mjcf(path, tip, base, limits=limits, tool=tool)
        srdf = srdf_beside(path, entry.name, path.stem, root.get("name", ""))
        return cls.from_urdf(path, tip, base, limits=limits, tool=tool, srdf=srdf)

    @staticmethod
    def available() -> tuple[str, ...]:
        """The names that `load` takes, of the packages that are installed; `robot_descriptions` has more."""
        return tuple(entry.name for entry in installed())

    @classmethod
    def maira(cls) -> Robot:
        """MAIRA, a 7-axis arm with spherical shoulder and wrist."""
        return cls.from_dh(catalog.maira())

    @classmethod
    def iiwa14(cls) -> Robot:
        """KUKA LBR iiwa 14 R820, from its DH table."""
        return cls.from_dh(catalog.iiwa14())

    def limited(
        self,
        *,
        lower: Any = None,
        upper: Any = None,
        velocity: Any = None,
        acceleration: Any = None,
        margin: Any = 0.0,
    ) -> Robot:
        """The same robot with tighter limits of position and speed, and accelerations of the caller's choice.

        Each is None (as it is), a number for all joints, an array (n,), or a mapping {joint name: value}, in which the
        joints that are not named keep theirs. Mimic joints follow the limits of their leaders, limits of sums stay. The
        description's own limits are never loosened: a looser one is an error, not cut.

        Args:
            lower, upper: [rad, or m]; both make a revolute joint of a continuous one
            velocity: > 0 [rad/s, or m/s]
            acceleration: > 0 [rad/s^2, or m/s^2], inf for no limit
            margin: >= 0 [rad, or m], taken off both ends of the positions that then hold; a continuous joint has none

        Raises `OptionError` that names the joint for a limit that would be looser, lower > upper, a value out of range,
        NaN, or one end without the other, and for a name that is not in `joint_names`.
        """
        return self._with(self._limits.limited(lower, upper, velocity, acceleration, margin))

    def released(self, limits: Iterable[str]) -> Robot:
        """The same robot without some limits of its joints, such as "joint4 upper": what could it reach without them?

        They are moved away by a whole turn, those of a sliding joint by the arm's length. Raises `OptionError` for
        what is not the limit of a joint.
        """
        return self._with(self._limits.released(limits, np.where(self.slides, self.length, 2 * np.pi)))

    def with_srdf(self, srdf: str | os.PathLike[str]) -> Robot:
        """The same robot with what an SRDF says of it: groups, named states, and links that may touch.

        `state` gives the configuration of a name; a `CollisionLimit` looks for no collisions between the links of its
        `<disable_collisions>`. What it says of links and joints that are not the robot's does not matter.

        Args:
            srdf: path, or text that begins with `<`.

        Raises `RobotError` for what is no SRDF.
        """
        description = replace(self._description, semantics=self.semantics.joined(read_srdf(srdf)))
        return self._made(self._part, description, self._limits)

    @property
    def semantics(self) -> Semantics:
        """Groups, named configurations and links that may touch, of an SRDF or MJCF."""
        return self._description.semantics

    @property
    def states(self) -> tuple[str, ...]:
        """Names of configurations of an SRDF or MJCF, see `state`."""
        return self.semantics.state_names(self.joint_names)

    def state(self, name: str) -> np.ndarray:
        """The configuration (n,) [rad, or m] of a name that an SRDF (`<group_state>`) or MJCF (`<key>`) gives it.

        Where groups give different values to one joint, the name is `<group>/<name>`. Raises `ConfigurationError` for
        a name that there is not, or whose state leaves out joints of the robot.
        """
        return self.configuration(self.semantics.state(name, self.joint_names))

    @property
    def _limits(self) -> JointLimits:
        return JointLimits(self.joint_names, self.lower, self.upper, self.velocity_limit, self.acceleration_limit)

    def _with(self, limits: JointLimits) -> Robot:
        """The same robot with other limits."""
        return self._made(self._part, replace(self._description, is_limited=True), limits)

    def _edited(self, *edits: Edit) -> Robot:
        """The same robot with changes."""
        description = replace(self._description, edits=(*self._description.edits, *edits))
        return self._made(edited(edits, self._part), description, self._limits)

    def _made(self, part: Reduced, description: Description, limits: JointLimits) -> Robot:
        """A robot of the same name, with those of the limits that belong to its joints."""
        limits, model, places = limits.of(part.limits.joint_names), part.model.copy(), part.independent
        wanted = {
            "lowerPositionLimit": limits.lower,
            "upperPositionLimit": limits.upper,
            "velocityLimit": limits.velocity,
        }
        for key, values in wanted.items():
            array = np.array(getattr(model, key))
            array[places] = values
            setattr(model, key, array)
        return Robot(part._replace(model=model), self.name, limits.acceleration, description)

    def with_tool(self, tool: Any, name: Any = "tool") -> Robot:
        """The same robot with another tip: a new frame, at the pose `tool` in the old one.

        The old tip stays a frame among others, and a further tool stands in the one before it. In `urdf`, exports and
        the viewer the tool is a link that is fixed to the old tip.

        Args:
            tool: T_tip_tool [m], `pin.SE3` or (4, 4), or a point (3,); of several {tip: T}, others stay as they are.
            name: of the new frame; for a mapping of several {tip: name}, without which they are `<tip>_tool`.

        Raises `PoseError`; `FrameError` for what is no tip, and for a name that a link has.
        """
        return self._edited(*tools(tool, name, self.tips, self.frames))

    def _with_tool(self, tool: Any) -> Robot:
        return self if tool is None else self.with_tool(tool)

    def with_base(self, base: Any, name: str = "world") -> Robot:
        """The same robot with another base: poses are relative to a new frame, in which the old base stands at `base`.

        Args:
            base: T_new_old [m], `pin.SE3` or (4, 4).
            name: of the new base.

        Raises `PoseError`; `FrameError` for a name that a link has.
        """
        pose = placement(base, "base")
        return self._edited(Base(self.base, new_frame(name, self.frames, "name="), pose))

    def holding(
        self,
        shape: Any,
        pose: Any = None,
        frame: str | None = None,
        name: str = "held",
        *,
        touching: Iterable[str] = (),
    ) -> Robot:
        """The same robot with an object in its hand, which collides as its links do: `CollisionLimit` keeps it clear.

        It is a link of its own, fixed to the frame, in `urdf`, exports and the viewer too. The links that are fixed to
        that frame, and those next to it by a joint, such as the fingers of a hand, may touch it.

        Args:
            shape: `Sphere`, `Ellipsoid`, `Box`, `Capsule`, `Cylinder` or `Mesh` of a file; its own pose is one in the
                object. None: what is held by that name is given up.
            pose: of the object in the frame [m], `pin.SE3` or (4, 4); None: at its origin.
            frame: that carries it; None: the tip.
            name: of the object.
            touching: further links that it may touch.

        Raises `OptionError` for what is no shape, or if nothing of that name is held; `FrameError`, `PoseError`.
        """
        if shape is None:
            description = replace(self._description, edits=without_object(self._description.edits, name))
            return self._made(description.part, description, self._limits)
        links = tuple(touching)
        for link in links:
            self.frame_id(link)
        self.frame_id(frame)
        placed = placement(np.eye(4) if pose is None else pose, "pose")
        name = new_frame(name, self.frames, "name=")
        return self._edited(Held(frame or self.tip, name, placed, collision_element(shape), links))

    @property
    def held(self) -> tuple[str, ...]:
        """Names of the objects that the robot holds."""
        return tuple(edit.name for edit in self._held)

    @property
    def may_touch(self) -> set[frozenset[str]]:
        """Pairs of an object that is held and a link that it may touch."""
        return {frozenset((edit.name, link)) for edit in self._held for link in edit.touching}

    @property
    def _held(self) -> list[Held]:
        return [edit for edit in self._description.edits if isinstance(edit, Held)]

    def locked(self, values: Mapping[str, float]) -> Robot:
        """The same robot with fewer joints: some stand at values {joint name: value} [rad, or m] from now on.

        Joints that mimic them stand where that leads them.

        Raises `OptionError` for a joint that does not move, a value outside its range, or values that break a limit of
        a sum; `RobotError` if no joint is left that moves a tip.
        """
        ranges = dict(zip(self.joint_names, zip(self.lower.tolist(), self.upper.tolist(), strict=True), strict=True))
        placed = placed_values(values, ranges, "locked", self._follows)
        for limit in self.sum_limits:
            if not (left := limit.placed(placed)).coefficients and not left.lower <= 0.0 <= left.upper:
                joints = ", ".join(limit.coefficients)
                raise OptionError(f"locked: these values break the limit {limit.name!r} of the joints {joints}")
        return self._edited(Locked(placed))

    def at_rest(self, values: Mapping[str, float]) -> Robot:
        """The same robot with joints placed that do not move, those of another arm, say: `values` {joint name: value}.

        Joints that are not between the base and the tips stand at zero, or at their limit nearest to it, unless they
        are placed here [rad, or m]; those that mimic a placed one stand where that leads them. The joints that move are
        the same as before, so that nothing becomes slower.

        Raises `OptionError` for a joint that moves, or is locked, or follows another, or a value outside its range.
        """
        source = self._description.source.at_rest(values, self.joint_names)
        description = replace(self._description, source=source)
        return self._made(description.part, description, self._limits)

    def _follows(self, name: str) -> str:
        """What a joint that mimics another does; nothing for one that does not."""
        mimic = self._part.mimic
        return f"the joint {name!r} follows {mimic[name][0]!r}, which can be locked" if name in mimic else ""

    @property
    def mesh_folders(self) -> tuple[str, ...]:
        """Folders above the URDF file, nearest first, in which meshes are sought: `package://NAME/...` too."""
        return self._description.source.mesh_folders

    @cached_property
    def urdf(self) -> str:
        """The description as normalised URDF, see `maira_qp.robots.urdf.reader.Chain`, with the limits that hold.

        Raises `RobotError` where the robot was made from a Pinocchio model, which holds no shapes.
        """
        return self._description.urdf(self.tips, self.base, self._limits)

    @cached_property
    def tree(self) -> KinematicTree:
        """The joints as arrays for the kernels, of a robot without mimic joints. Not to be written to."""
        from maira_qp.robots.model.arrays import KinematicTree  # heavy: Numba comes with it

        limits = self.lower, self.upper
        return KinematicTree.build(
            self.kinematics, limits, self.drawn_range, self.velocity_limit, self.acceleration_limit
        )

    @cached_property
    def chain(self) -> np.ndarray:
        """The chain (n + 1, 17) for the kernels, where `is_chain`. Not to be written to."""
        return self.tree.chain()

    def configuration(self, values: Any, default: Any = None) -> np.ndarray:
        """A configuration (n,) [rad or m] from an array (n,) or a mapping {joint name: value}.

        Args:
            values: joint values; a mapping may leave out joints if there is a default.
            default: configuration whose values the joints keep that a mapping does not name; None: all must be named.

        Raises `ConfigurationError`, which lists the joints that are missing, or those that there are.
        """
        return self._checked(values, "q", None if default is None else self._checked(default, "default"))

    def joints(self, q: Any) -> dict[str, float]:
        """The values of a configuration by the names of the joints. Raises `ConfigurationError`."""
        return dict(zip(self.joint_names, self._checked(q).tolist(), strict=True))

    def order(self, names: Iterable[str]) -> np.ndarray:
        """Where each joint of the robot is in a list of names: indices (n,), so that `q = values[robot.order(names)]`.

        For values that come with names in another order, such as a `JointState` of ROS: `names` may hold joints that
        are not the robot's. Raises `OptionError` if a joint of the robot is missing, or is named twice.
        """
        return joint_order(names, self.joint_names)

    def integrate(self, q: Any, dq: Any) -> np.ndarray:
        """The configuration (n,) that the displacement dq (n,) [rad, or m] leads to from q (n,): here q + dq.

        Raises `ConfigurationError`.
        """
        return self.kinematics.integrate(self._checked(q), self._checked(dq, "dq"))

    def difference(self, q0: Any, q1: Any) -> np.ndarray:
        """The displacement (n,) [rad, or m] that leads from q0 (n,) to q1 (n,): here q1 - q0.

        Raises `ConfigurationError`.
        """
        return self.kinematics.difference(self._checked(q0, "q0"), self._checked(q1, "q1"))

    def at(self, q: np.ndarray) -> Configuration:
        """The robot at q (n,), a float64 array that is not checked: for loops that made it themselves."""
        return Configuration(self.kinematics, q)

    def forward(self, q: Any, frame: str | None = None) -> pin.SE3:
        """Pose of a frame (None: the tip) in the base at q (n,). Raises `ConfigurationError`, `FrameError`."""
        return self.at(self._checked(q)).placement(frame)

    def jacobian(self, q: Any, frame: str | None = None) -> np.ndarray:
        """Jacobian (6, n) of a frame (None: the tip) at q (n,), base axes: linear rows [m/rad] over angular [rad/rad].

        Raises `ConfigurationError`, `FrameError`.
        """
        return self.at(self._checked(q)).jacobian(frame).copy()

    def jacobian_derivative(self, q: Any, frame: str | None = None) -> np.ndarray:
        """Derivative (n, 6, n) of a frame's Jacobian (None: the tip) at q (n,): entry [i] is dJ/dq_i, base axes.

        At a joint velocity v the Jacobian changes at the rate `np.tensordot(v, derivative, 1)`. Exact, but with mimic
        joints, where it is by central differences, to about 1e-10. Raises `ConfigurationError`, `FrameError`.
        """
        return self.at(self._checked(q)).jacobian_derivative(frame)

    def jacobians(self, q: np.ndarray) -> np.ndarray:
        """Jacobians (N, 6, n) of the tip at configurations q (N, n), unchecked: `jacobian`, many at once."""
        if not self.is_chain:
            return np.array([self.at(each).jacobian(None).copy() for each in q]).reshape(-1, 6, self.n)
        from maira_qp.kernels.kinematics.serial_chain import jacobians  # heavy: Numba comes with it

        J = np.empty((*q.shape, 6))
        jacobians(self.chain, np.ascontiguousarray(q), J)
        return J.swapaxes(1, 2)

    def condition_number(self, q: Any, frame: str | None = None) -> float:
        """Largest over smallest singular value of a frame's Jacobian at q (n,); inf where it is singular to rounding.

        Raises `ConfigurationError`, `FrameError`.
        """
        return float(condition_numbers(self.jacobian(q, frame)))

    def manipulability(self, q: Any, frame: str | None = None) -> float:
        """Product of the min(6, n) singular values of a frame's Jacobian at q (n,): sqrt(det(J J^T)) where n >= 6.

        Source: Yoshikawa, "Manipulability of robotic mechanisms", 1985. Raises `ConfigurationError`, `FrameError`.
        """
        return float(np.prod(np.linalg.svd(self.jacobian(q, frame), compute_uv=False)))

    def random_configuration(self, rng: np.random.Generator) -> np.ndarray:
        """Draw a configuration (n,) with the generator `rng`: uniform within the limits or in a turn.

        It keeps `sum_limits` too; where these leave little of the joints' ranges it is nearly uniform: a random walk.

        Raises `OptionError`; `ConfigurationError` where nothing keeps `sum_limits`.
        """
        if not isinstance(rng, np.random.Generator):
            raise OptionError(f"rng must be a numpy.random.Generator, such as default_rng(0), got {shown(rng)}")
        if not self.sum_limits:
            return drawn(rng, *self.drawn_range)
        draw = partial(drawn, rng, *self.drawn_range)
        return drawn_within(rng, draw, self.drawn_range, self.sum_limits, self.joint_names)

    @overload
    def clip(  # pyright: ignore[reportOverlappingOverload]
        self, q: Mapping[str, float]
    ) -> dict[str, float]: ...

    @overload
    def clip(self, q: Any) -> np.ndarray: ...

    def clip(self, q: Any) -> Any:
        """The configuration (n,) within the limits of the joints that is nearest to q (n,), whatever `sum_limits` say.

        Of a mapping, which need not name all joints, the same joints by name. Raises `ConfigurationError`.
        """
        if isinstance(q, Mapping):
            clipped = np.clip(self._checked(q, default=self.middle), self.lower, self.upper)
            return {name: float(clipped[self.joint_names.index(name)]) for name in q}
        return np.clip(self._checked(q), self.lower, self.upper)

    def frame_id(self, frame: str | None) -> int:
        """Pinocchio's index of a frame (None: the tip). Raises `FrameError`."""
        return self.kinematics.frame_id(frame)

    def _checked(self, q: Any, name: str = "q", default: np.ndarray | None = None) -> np.ndarray:
        return joint_array(q, self.joint_names, name, ConfigurationError, default)

    @property
    def title(self) -> str:
        """One line of what it is, such as "Robot('maira', n=7, base='base_link', tip='tool0')"."""
        ends = f"tip={self.tip!r}" if len(self.tips) == 1 else f"tips={self.tips!r}"
        return f"Robot({self.name!r}, n={self.n}, base={self.base!r}, {ends})"

    def _card(self) -> Card:
        units = ["m" if slides else "rad" for slides in self.slides]
        ranges = [
            f"{low:.3f} .. {high:.3f} {unit}" if np.isfinite(high - low) else "continuous"
            for low, high, unit in zip(self.lower, self.upper, units, strict=True)
        ]
        speeds = [
            f"{speed:.3g} {unit}/s" if np.isfinite(speed) else ""
            for speed, unit in zip(self.velocity_limit, units, strict=True)
        ]
        return Card(
            title=self.title,
            facts=(
                ("length", f"{self.length:.3g} m"),
                ("limits of sums", ", ".join(limit.name for limit in self.sum_limits)),
            ),
            entries=joint_entries(self.joint_names, ranges),
            headings=("joint", "range", "speed limit"),
            rows=list(zip(self.joint_names, ranges, speeds, strict=True)),
        )

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Robot):
            return NotImplemented
        if self is other or self._traits != other._traits or self.semantics != other.semantics:
            return self is other
        if self._description.source.has_urdf and other._description.source.has_urdf:
            return self.urdf == other.urdf
        mine, others = self._part, other._part
        return type(self._description.source) is type(other._description.source) and mine[:2] == others[:2]

    def __hash__(self) -> int:
        return hash(self._traits)

    @cached_property
    def _traits(self) -> tuple[object, ...]:
        """What differs between most robots that are not equal."""
        limits = self._limits
        arrays = limits.lower, limits.upper, limits.velocity, limits.acceleration
        return self.name, self.base, self.tips, self.joint_names, *(tuple(array.tolist()) for array in arrays)

    def __reduce__(self) -> tuple[type[Robot], tuple[object, ...]]:
        return Robot, (self._part, self.name, self.acceleration_limit, self._description)


def drawn(rng: np.random.Generator, lower: np.ndarray, upper: np.ndarray, *count: int) -> np.ndarray:
    """Configurations (*count, n), uniform between lower and upper ends (n,)."""
    share = rng.random((*count, len(lower)))
    return np.clip((1 - share) * lower + share * upper, lower, upper)


def condition_numbers(J: np.ndarray) -> np.ndarray:
    """Largest over smallest singular value of Jacobians (..., 6, n); inf where one is singular to rounding."""
    values = np.linalg.svd(J, compute_uv=False)
    largest, smallest = values[..., 0], values[..., -1]
    regular = smallest > max(J.shape[-2:]) * np.finfo(float).eps * largest
    return np.divide(largest, smallest, out=np.full(largest.shape, np.inf), where=regular)


def _length(model: pin.Model, tip: pin.Frame, limits: tuple[np.ndarray, np.ndarray]) -> float:
    """`Robot.length` [m] to one tip; 1 where all of its joints and the tip are in one point."""
    links, ranges, joint = float(np.linalg.norm(tip.placement.translation)), [], tip.parentJoint
    while joint > 0:
        index = model.joints[joint].idx_q
        if "P" in model.joints[joint].shortname().removeprefix("JointModel")[:1]:
            ranges.append(float(limits[1][index] - limits[0][index]))
        if model.parents[joint] > 0:
            links += float(np.linalg.norm(model.jointPlacements[joint].translation))
        joint = model.parents[joint]
    most = links if links > 1e-12 else 1.0
    length = links + sum(min(each, most) for each in ranges)
    return length if length > 1e-12 else 1.0
