"""`maira-qp view`: the robot in the browser."""

from __future__ import annotations

import importlib.util
import logging
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from maira_qp.apps.arguments.flags import RobotFlags
from maira_qp.apps.arguments.optional import Maybe, explained
from maira_qp.apps.arguments.robot_choice import RobotChoice
from maira_qp.errors import OptionError

if TYPE_CHECKING:
    from maira_qp.apps.viewer.drawing.layers import Layer
    from maira_qp.robots.model.robot import Robot


@explained
@dataclass(frozen=True, kw_only=True)
class View:
    """Show the robot in the browser and drag its target.

    Joints and obstacles can be dragged as well; the page shows what the solver says.

    Example:

        maira-qp view --robot panda"""

    choice: RobotFlags = field(default_factory=RobotChoice)
    host: str = "127.0.0.1"
    """Address to serve at; the default is for this machine alone, 0.0.0.0 for whoever reaches it: there is no password,
    and whoever sees the page can read robot files and write recordings."""
    port: int = 8080
    """Port to serve at; if it is taken, the next one that is free; >= 0, 0: any."""
    map: Maybe[Path] = None
    """Folder of a map of maira-qp reach, to be shown about its arm; none: no map."""

    def run(self) -> int:
        """Serves until it is interrupted."""
        check_viser()
        if self.map is None:
            serve(self.choice, self.host, self.port)
            return 0
        if self.choice != RobotChoice():
            raise OptionError("--map has its robot: leave out --robot, --tip, --base and --limits")
        from maira_qp.apps.viewer.drawing.layers import map_of
        from maira_qp.scale.reach.reach_map import ReachMap

        reach = ReachMap.open(self.map)
        serve(self.choice, self.host, self.port, robot=reach.robot, layers=[map_of(reach)])
        return 0


def check_viser() -> None:
    """Whether there can be a viewer. Raises `OptionError`."""
    if importlib.util.find_spec("viser") is None:
        raise OptionError("the viewer needs viser: pip install 'maira-qp[view]'")


def serve(
    choice: RobotChoice, host: str, port: int, *, robot: Robot | None = None, layers: Sequence[Layer] = ()
) -> None:
    """Serve a robot until it is interrupted: that of the flags, or another one.

    Raises `OptionError`, `RobotError`, `FrameError`, `OSError`.
    """
    if not 0 <= port <= 65535:
        raise OptionError(f"port must be from 0 to 65535, got {port}")
    from maira_qp.apps.viewer.server import Viewer

    log = logging.getLogger("maira_qp.robots")
    level = log.level
    log.setLevel(logging.ERROR)  # missing meshes are told in the page
    try:
        with tempfile.TemporaryDirectory() as folder:
            if robot is not None:
                file = Path(folder) / f"{robot.name}.urdf"
                file.write_text(robot.urdf, encoding="utf-8")
                choice = RobotChoice(robot=str(file), tip=robot.tip, base=robot.base)
            viewer = Viewer(choice, host, port, layers)
            sys.stdout.write(f"the viewer of {viewer.current.robot.name} is at {viewer.url} (Ctrl-C ends it)\n")
            sys.stdout.flush()
            try:
                while True:
                    time.sleep(3600)
            finally:
                viewer.close()
    finally:
        log.setLevel(level)
