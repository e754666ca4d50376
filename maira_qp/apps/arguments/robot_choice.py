"""Which robot: a name of the catalog, a URDF file, or a file with a DH table."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np

from maira_qp.apps.arguments.numbers import ToolPose
from maira_qp.apps.arguments.optional import UNSAID, Maybe, explained
from maira_qp.errors import OptionError, PoseError
from maira_qp.robots.urdf.rpy import matrix_from_rpy

if TYPE_CHECKING:
    from maira_qp.robots.model.robot import Robot

COUNTS = {2: "two", 3: "three", 4: "four", 5: "five"}


@explained
@dataclass(frozen=True, kw_only=True)
class RobotChoice:
    """Which robot, and which part of it."""

    robot: str = "maira"
    """A name that `maira-qp robots` lists, a URDF, xacro or MJCF file (.urdf, .xacro, .xml), or a DH table (.toml,
    .yaml or .yml)."""
    tip: Maybe[str] = None
    """Link that is the tool; none: the only end of the chain; of a robot with several, one must be
    named."""
    base: Maybe[str] = None
    """Link that poses are relative to; none: the root."""
    tool: ToolPose = None
    """A tool in the tip, which then is what poses are of: X Y Z [m], or with ROLL PITCH YAW [rad] or a quaternion
    W X Y Z behind them, in mm with --mm and in deg with --deg where a command has these; none: the tip itself."""
    limits: Annotated[tuple[str, ...], UNSAID] = ()
    """Limits of joints of a URDF in place of its own [rad, or m], such as joint1=-1.5:1.5."""

    def load(self, *, degrees: bool = False, millimetres: bool = False) -> Robot:
        """The robot, its tool in such units. Raises `RobotError`, `FrameError`, `OptionError`, `PoseError`."""
        return self._with_tool(self._load(), degrees, millimetres)

    def _with_tool(self, robot: Robot, degrees: bool, millimetres: bool) -> Robot:
        return robot if self.tool is None else robot.with_tool(_tool(self.tool, degrees, millimetres))

    def _load(self) -> Robot:
        from maira_qp.robots.dh.table import DHTable
        from maira_qp.robots.model.robot import Robot
        from maira_qp.robots.urdf.safe_xml import xml_root

        suffix = Path(self.robot).suffix.lower()
        limits = dict(map(_limits, self.limits))
        if suffix == ".xml" and xml_root(self.robot).tag == "mujoco":
            return Robot.from_mjcf(self.robot, tip=self.tip, base=self.base, limits=limits)
        if suffix in (".urdf", ".xml", ".xacro"):
            return Robot.from_urdf(Path(self.robot), tip=self.tip, base=self.base, limits=limits)
        if suffix not in (".toml", ".yaml", ".yml"):
            return Robot.load(self.robot, tip=self.tip, base=self.base, limits=limits)
        robot = Robot.from_dh(DHTable.from_file(self.robot))
        if self.tip is None and self.base is None and not limits:
            return robot
        return Robot.from_urdf(robot.urdf, tip=self.tip or robot.tip, base=self.base, limits=limits)

    def load_with_one_tip(self, *, degrees: bool = False, millimetres: bool = False) -> Robot:
        """The robot, for what asks for one pose. Raises what `load` does; `OptionError` for several tips."""
        robot = self._load()
        if len(robot.tips) > 1:
            count = COUNTS.get(len(robot.tips), len(robot.tips))
            each = " or ".join(f"--tip {tip}" for tip in robot.tips)
            raise OptionError(f"{robot.name} has {count} tips; name one: {each}")
        return self._with_tool(robot, degrees, millimetres)


def _tool(numbers: tuple[float, ...], degrees: bool, millimetres: bool) -> Any:
    """A tool from the numbers of --tool. Raises `PoseError`."""
    from maira_qp.problem.pose import pose

    if len(numbers) not in (3, 6, 7):
        raise PoseError(
            "--tool takes X Y Z, or these with ROLL PITCH YAW or with a quaternion W X Y Z behind them, "
            f"not {len(numbers)} numbers"
        )
    position, rest = np.array(numbers[:3]) / (1e3 if millimetres else 1.0), numbers[3:]
    if len(rest) == 3:
        return pose(position, matrix=matrix_from_rpy(np.radians(rest) if degrees else np.array(rest)))
    return pose(position, quaternion=rest or None)


def _limits(word: str) -> tuple[str, tuple[float, float]]:
    """A joint's name, and its limits. Raises `OptionError`."""
    name, _, ends = word.rpartition("=")
    try:
        lower, upper = map(float, ends.split(":"))
    except ValueError:
        raise OptionError(f"--limits takes JOINT=LOWER:UPPER, such as joint1=-1.5:1.5, not {word!r}") from None
    return name, (lower, upper)
