"""`maira-qp fk`: where the tool is."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import tyro

from maira_qp.apps.arguments.flags import RobotFlags
from maira_qp.apps.arguments.numbers import JointValues
from maira_qp.apps.arguments.optional import Flag, explained
from maira_qp.apps.arguments.robot_choice import RobotChoice


@explained
@dataclass(frozen=True, kw_only=True)
class Fk:
    """Print where the tool is at joint values (forward kinematics).

    Example:

        maira-qp fk 0 10 0 20 0 30 0 --deg"""

    q: tyro.conf.Positional[JointValues] = None
    """Joint values [rad, or deg with --deg; m for a sliding joint]; none: zero."""
    choice: RobotFlags = field(default_factory=RobotChoice)
    deg: Flag = False
    """Angles in and out in degrees."""
    mm: Flag = False
    """Lengths in and out in millimetres; those of the matrix stay in m."""
    json: Flag = False
    """One JSON value on stdout."""

    def run(self) -> int:
        """Prints the pose; always 0."""
        from maira_qp.apps.arguments.output import Units, print_json
        from maira_qp.orientation import quaternion_from_matrix
        from maira_qp.robots.unit_hints import degrees_hint
        from maira_qp.robots.urdf.rpy import rpy_from_matrix

        robot = self.choice.load_with_one_tip(degrees=self.deg, millimetres=self.mm)
        units = Units(robot, self.deg, self.mm)
        q = units.read(self.q or np.zeros(robot.n), "the joint values")
        T = robot.forward(q).homogeneous
        hint = degrees_hint(q, robot, "the configuration")
        found = {
            "robot": robot.name,
            "base": robot.base,
            "tip": robot.tip,
            "q": units.write(q),
            "q_units": units.joints,
            "inside_limits": bool(((robot.lower <= q) & (q <= robot.upper)).all()),
            "position": T[:3, 3] * units.metre,
            "position_unit": units.length,
            "quaternion": quaternion_from_matrix(T[:3, :3]),
            "rpy": rpy_from_matrix(T[:3, :3]) * units.radian,
            "rpy_unit": units.angle,
            "matrix": T,
            "condition_number": robot.condition_number(q),
            "manipulability": robot.manipulability(q),
            "hints": units.hints([hint]),
        }
        if self.json:
            print_json(found)
        else:
            _show(found, robot.joint_names)
        return 0


def _show(found: dict[str, Any], joint_names: tuple[str, ...]) -> None:
    """The pose as a table on stdout."""
    from rich.table import Table

    from maira_qp.apps.arguments.output import console, joint_table, numbers

    table = Table(title=f"{found['robot']}: {found['tip']} in {found['base']}", show_header=False)
    table.add_row(f"position x y z [{found['position_unit']}]", numbers(found["position"]))
    table.add_row("quaternion w x y z", numbers(found["quaternion"]))
    table.add_row(f"roll pitch yaw [{found['rpy_unit']}]", numbers(found["rpy"]))
    table.add_row("matrix", "\n".join(numbers(row) for row in found["matrix"]))
    table.add_row("condition number", f"{found['condition_number']:.4g}")
    table.add_row("manipulability", f"{found['manipulability']:.4g}")
    table.add_row("inside the joint limits", "yes" if found["inside_limits"] else "no")
    out = console()
    out.print(joint_table(joint_names, found["q"], found["q_units"]))
    out.print(table)
    for hint in found["hints"]:
        out.print(f"hint: {hint}", style="bold yellow")
