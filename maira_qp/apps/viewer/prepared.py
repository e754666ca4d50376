"""A robot on its way into the viewer: loaded, its shapes found, a session begun."""

from __future__ import annotations

import tempfile
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

from maira_qp.apps.arguments.robot_choice import RobotChoice
from maira_qp.apps.viewer.drawing.geometry import Geometry, geometry_of
from maira_qp.apps.viewer.panel.robot import Loaded
from maira_qp.apps.viewer.session import Session
from maira_qp.apps.viewer.tips import tips_in
from maira_qp.errors import FrameError


class Prepared(NamedTuple):
    """A robot that is ready to be shown."""

    session: Session
    geometry: Geometry
    choice: RobotChoice
    loaded: Loaded
    content: bytes | None
    """Of a file that was uploaded"""

    def with_tip(self, tip: str) -> Prepared:
        """The same robot with another tip. Raises `MairaError`, `OSError`."""
        choice = replace(self.choice, tip=tip)
        if self.content is None:
            return prepared(choice)
        with tempfile.TemporaryDirectory() as directory:
            file = Path(directory) / Path(choice.robot).name
            file.write_bytes(self.content)
            return prepared(replace(choice, robot=str(file)), self.loaded.name, self.content)


def prepared(choice: RobotChoice, name: str | None = None, content: bytes | None = None) -> Prepared:
    """A session and what its robot looks like; meshes are sought beside the robot's file and in the folders above."""
    file = Path(choice.robot)
    directories = [str(folder) for folder in file.resolve().parents] if file.is_file() else []
    is_urdf = bool(directories) and file.suffix.lower() in (".urdf", ".xml")
    try:
        robot = choice.load()
    except FrameError:
        tips = tips_in(file) if choice.tip is None and is_urdf else ()
        if not tips:
            raise
        robot = replace(choice, tip=tips[0]).load()  # of several ends; the panel names it, and lists the others
    tips = tips_in(file) if is_urdf else tuple(reversed(robot.moved_links))
    geometry = geometry_of(robot, directories)
    shown = robot.tip, *(tip for tip in tips if tip != robot.tip)
    loaded = Loaded(name or (file.name if directories else choice.robot), shown, geometry.notes)
    return Prepared(Session(robot, directories), geometry, choice, loaded, content)
