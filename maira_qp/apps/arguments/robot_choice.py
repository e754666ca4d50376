"""Which robot: a name of the catalog, a URDF file, or a file with a DH table."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from maira_qp.errors import OptionError

if TYPE_CHECKING:
    from maira_qp.robots.model.robot import Robot

CATALOG = ("maira", "iiwa14")
COUNTS = {2: "two", 3: "three", 4: "four", 5: "five"}


@dataclass(frozen=True, kw_only=True)
class RobotChoice:
    """Which robot, and which part of it."""

    robot: str = "maira"
    """A name that `maira-qp robots` lists, a URDF, xacro or MJCF file (.urdf, .xacro, .xml), or a DH table (.toml,
    .yaml or .yml)."""
    tip: str | None = None
    """Link that is the tool; none: the only end of the chain; of a robot with several, one must be
    named."""
    base: str | None = None
    """Link that poses are relative to; none: the root."""
    limits: tuple[str, ...] = ()
    """Limits of joints of a URDF in place of its own [rad, or m], such as joint1=-1.5:1.5."""

    def load(self) -> Robot:
        """The robot. Raises `RobotError`, `FrameError`, `OptionError`."""
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

    def load_with_one_tip(self) -> Robot:
        """The robot, for what asks for one pose. Raises what `load` does; `OptionError` for several tips."""
        robot = self.load()
        if len(robot.tips) > 1:
            count = COUNTS.get(len(robot.tips), len(robot.tips))
            each = " or ".join(f"--tip {tip}" for tip in robot.tips)
            raise OptionError(f"{robot.name} has {count} tips; name one: {each}")
        return robot


def _limits(word: str) -> tuple[str, tuple[float, float]]:
    """A joint's name, and its limits. Raises `OptionError`."""
    name, _, ends = word.rpartition("=")
    try:
        lower, upper = map(float, ends.split(":"))
    except ValueError:
        raise OptionError(f"--limits takes JOINT=LOWER:UPPER, such as joint1=-1.5:1.5, not {word!r}") from None
    return name, (lower, upper)
