"""`maira-qp urdf`: a robot as URDF."""

from __future__ import annotations

import sys
from dataclasses import dataclass, field
from pathlib import Path

from maira_qp.apps.arguments.flags import RobotFlags
from maira_qp.apps.arguments.robot_choice import RobotChoice


@dataclass(frozen=True, kw_only=True)
class Urdf:
    """Write a robot as URDF: that of its DH table, or a URDF or MJCF file made plain (one chain, other joints fixed).

    Ellipsoids become the boxes around them, for URDF has none.
    """

    choice: RobotFlags = field(default_factory=RobotChoice)
    output: Path | None = None
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
