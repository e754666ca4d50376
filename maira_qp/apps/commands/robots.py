"""`maira-qp robots`: which robots can be loaded by name."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from maira_qp.apps.arguments.optional import Flag, explained


@explained
@dataclass(frozen=True, kw_only=True)
class Robots:
    """List the robots that --robot takes by name.

    Shown are their joints and tips, and the packages that carry them. Packages that are not installed are named with
    what they hold; modules of robot_descriptions, such as ur5e_description, are names too, once their files are on this
    machine."""

    json: Flag = False
    """One JSON value on stdout."""

    def run(self) -> int:
        """Prints the list; always 0."""
        from maira_qp.apps.arguments.output import console, print_json
        from maira_qp.robots.library.names import ENTRIES
        from maira_qp.robots.library.packages import installed

        there = [_told(entry) for entry in installed()]
        missing: dict[str, list[str]] = {}
        for entry in ENTRIES:
            if entry not in installed():
                missing.setdefault(entry.package, []).append(entry.name)
        if self.json:
            print_json({"robots": there, "not_installed": missing})
            return 0
        out = console()
        out.print(_table(there))
        for package, names in missing.items():
            out.print(f"pip install {package}: {', '.join(names)}")
        return 0


def _told(entry: Any) -> dict[str, Any]:
    """A robot of the list, loaded to see its joints; an error where it cannot be."""
    from maira_qp.errors import MairaError
    from maira_qp.robots.model.robot import Robot

    found = {"name": entry.name, "package": entry.package}
    try:
        robot = Robot.load(entry.qualified)
    except MairaError as reason:
        return {**found, "error": str(reason)}
    return {**found, "joints": robot.n, "base": robot.base, "tips": list(robot.tips), "states": list(robot.states)}


def _table(robots: list[dict[str, Any]]) -> Any:
    from rich.table import Table

    from maira_qp.apps.arguments.output import folded

    table = Table(title="robots by name")
    for heading in ("name", "joints", "tip", "package"):
        table.add_column(heading, justify="right" if heading == "joints" else "left")
    for robot in robots:
        joints = str(robot.get("joints", "-"))
        tips = "\n".join([folded(tip, 28) for tip in robot["tips"]] if "tips" in robot else [robot["error"]])
        table.add_row(folded(robot["name"]), joints, tips, folded(robot["package"], 18))
    return table
