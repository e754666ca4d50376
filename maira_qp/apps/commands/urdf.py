"""`maira-qp urdf`: a robot as URDF."""

from __future__ import annotations

import sys
from dataclasses import dataclass, field
from pathlib import Path

from maira_qp.apps.arguments.flags import RobotFlags
from maira_qp.apps.arguments.optional import Maybe, explained
from maira_qp.apps.arguments.robot_choice import RobotChoice


@explained
@dataclass(frozen=True, kw_only=True)
class Urdf:
    """Write a robot as a URDF file: of a DH table, or of one chain.

    Joints that are not of the chain are fixed. Ellipsoids become the boxes around them, for URDF has none.

    Example:

        maira-qp urdf --robot arm.toml --output arm.urdf"""

    choice: RobotFlags = field(default_factory=RobotChoice)
    output: Maybe[Path] = None
    """File to write; none: stdout."""

    def run(self) -> int:
        """Writes the URDF; always 0."""
        from maira_qp.io.atomic_write import replace_text
        from maira_qp.robots.collision.urdf_geometry import without_ellipsoids
        from maira_qp.robots.urdf.writer import urdf_text

        robot = self.choice.load()
        text = without_ellipsoids(robot.urdf) if robot.dh is None else urdf_text(robot.dh)
        if self.output is None:
            sys.stdout.write(text)
        else:
            replace_text(self.output, text)
        return 0
