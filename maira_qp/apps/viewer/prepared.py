"""A robot on its way into the viewer: loaded, its shapes found, a session begun."""

from __future__ import annotations

import contextlib
import tempfile
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

from maira_qp.apps.arguments.robot_choice import RobotChoice
from maira_qp.apps.viewer.drawing.geometry import Geometry, geometry_of
from maira_qp.apps.viewer.panel.robot import Loaded, tips_text
from maira_qp.apps.viewer.session import Session
from maira_qp.apps.viewer.tips import tips_in
from maira_qp.errors import FrameError, MairaError
from maira_qp.robots.model.robot import Robot


class Prepared(NamedTuple):
    """A robot that is ready to be shown."""

    session: Session
    geometry: Geometry
    choice: RobotChoice
    loaded: Loaded
    content: bytes | None
    """Of a file that was uploaded"""

    def with_tip(self, tip: str | None) -> Prepared:
        """The same robot with another tip; None: its own ones. Raises `MairaError`, `OSError`."""
        choice = replace(self.choice, tip=tip)
        if self.content is None:
            return prepared(choice)
        with tempfile.TemporaryDirectory() as directory:
            file = Path(directory) / Path(choice.robot).name
            file.write_bytes(self.content)
            return prepared(replace(choice, robot=str(file)), self.loaded.name, self.content)


def prepared(choice: RobotChoice, name: str | None = None, content: bytes | None = None) -> Prepared:
    """A session and what its robot looks like; meshes are sought above the file that the robot is from."""
    file = Path(choice.robot)
    is_urdf = file.is_file() and file.suffix.lower() in (".urdf", ".xml")
    try:
        robot = choice.load()
    except FrameError:
        tips = tips_in(file) if choice.tip is None and is_urdf else ()
        if not tips:
            raise
        robot = replace(choice, tip=tips[0]).load()  # of several ends; the panel names it, and lists the others
    geometry = geometry_of(robot, robot.mesh_folders)
    links = tips_in(file) if is_urdf else tuple(reversed(robot.moved_links))
    loaded = Loaded(
        name or (file.name if file.is_file() else choice.robot), _tips(choice, robot, links), geometry.notes
    )
    return Prepared(Session(robot, robot.mesh_folders), geometry, choice, loaded, content)


def prepared_robot(robot: Robot) -> Prepared:
    """A session of a robot as it is, with its tools and limits."""
    geometry = geometry_of(robot, robot.mesh_folders)
    loaded = Loaded(robot.name, {tips_text(robot): None}, geometry.notes)
    choice = RobotChoice(robot=f"{robot.name}.urdf", base=robot.base)
    return Prepared(Session(robot, robot.mesh_folders), geometry, choice, loaded, robot.urdf.encode())


def _tips(choice: RobotChoice, robot: Robot, links: tuple[str, ...]) -> dict[str, str | None]:
    """What may be the tip: what is now, the ones that the robot has by its name, and single links."""
    tips: dict[str, str | None] = {tips_text(robot): choice.tip}
    if choice.tip is not None:
        with contextlib.suppress(MairaError):
            own = replace(choice, tip=None, tool=None).load()
            tips.setdefault(tips_text(own), None)
    for link in (*robot.tips, *links):
        tips.setdefault(link, link)
    return tips
