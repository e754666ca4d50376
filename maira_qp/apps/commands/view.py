"""`maira-qp view`: the robot in the browser."""

from __future__ import annotations

import importlib.util
import logging
import sys
import time
from dataclasses import dataclass, field

from maira_qp.apps.arguments.flags import RobotFlags
from maira_qp.apps.arguments.robot_choice import RobotChoice
from maira_qp.errors import OptionError


@dataclass(frozen=True, kw_only=True)
class View:
    """Show a robot in the browser: drag its target, its joints and obstacles, and read what the solver says."""

    choice: RobotFlags = field(default_factory=RobotChoice)
    host: str = "127.0.0.1"
    """Address to serve at; the default is for this machine alone, 0.0.0.0 for whoever reaches it: there is no password,
    and whoever sees the page can read robot files and write recordings."""
    port: int = 8080
    """Port to serve at; if it is taken, the next one that is free; >= 0, 0: any."""

    def run(self) -> int:
        """Serves until it is interrupted."""
        if importlib.util.find_spec("viser") is None:
            raise OptionError("the viewer needs viser: pip install 'maira-qp[view]'")
        if not 0 <= self.port <= 65535:
            raise OptionError(f"port must be from 0 to 65535, got {self.port}")
        from maira_qp.apps.viewer.server import Viewer

        log = logging.getLogger("maira_qp.robots")
        level = log.level
        log.setLevel(logging.ERROR)  # missing meshes are told in the page
        try:
            viewer = Viewer(self.choice, self.host, self.port)
            sys.stdout.write(f"the viewer of {viewer.current.robot.name} is at {viewer.url} (Ctrl-C ends it)\n")
            sys.stdout.flush()
            try:
                while True:
                    time.sleep(3600)
            finally:
                viewer.close()
        finally:
            log.setLevel(level)
