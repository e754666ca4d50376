"""`maira-qp view`: the robot in the browser."""

from __future__ import annotations

import importlib.util
import ipaddress
import logging
import os
import secrets
import sys
import time
import webbrowser
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from maira_qp.apps.arguments.flags import RobotFlags
from maira_qp.apps.arguments.optional import Flag, Maybe, explained
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
    """Address to serve at; the default is for this machine alone, 0.0.0.0 for whoever reaches it: then a token is asked
    for, since whoever has the page can read robot files and write recordings."""
    port: int = 8080
    """Port to serve at; if it is taken, the next one that is free; >= 0, 0: any."""
    token: Flag = False
    """Let in only who opens the address that is printed, with a token that is new each time; always beyond this
    machine."""
    browser: Flag = True
    """Do not open the page in a browser; else it opens where there is a screen."""
    map: Maybe[Path] = None
    """Folder of a map of maira-qp reach, to be shown about its arm; none: no map."""

    def run(self) -> int:
        """Serves until it is interrupted."""
        check_viser()
        if self.map is None:
            serve(self.choice, self.host, self.port, token=self.token, browser=self.browser)
            return 0
        if self.choice != RobotChoice():
            raise OptionError("--map has its robot: leave out --robot, --tip, --base and --limits")
        from maira_qp.apps.viewer.drawing.layers import map_of
        from maira_qp.scale.reach.reach_map import ReachMap

        reach = ReachMap.open(self.map)
        layers = [map_of(reach)]
        serve(reach.robot, self.host, self.port, layers=layers, token=self.token, browser=self.browser)
        return 0


def check_viser() -> None:
    """Whether there can be a viewer. Raises `OptionError`."""
    if importlib.util.find_spec("viser") is None:
        raise OptionError("the viewer needs viser: pip install 'maira-qp[view]'")


def serve(
    choice: RobotChoice | Robot,
    host: str,
    port: int,
    *,
    layers: Sequence[Layer] = (),
    token: bool = False,
    browser: bool = True,
) -> None:
    """Serve a robot until it is interrupted: one that flags choose, or as it is.

    Beyond this machine a token is asked for in any case; a browser is opened if there is a screen for it.

    Raises `OptionError`, `RobotError`, `FrameError`, `OSError`.
    """
    if not 0 <= port <= 65535:
        raise OptionError(f"port must be from 0 to 65535, got {port}")
    from maira_qp.apps.viewer.server import Viewer

    log = logging.getLogger("maira_qp.robots")
    level = log.level
    log.setLevel(logging.ERROR)  # missing meshes are told in the page
    try:
        secret = secrets.token_urlsafe(16) if token or not _is_this_machine(host) else None
        viewer = Viewer(choice, host, port, layers, secret)
        sys.stdout.write(f"the viewer of {viewer.current.robot.name} is at {viewer.address} (Ctrl-C ends it)\n")
        sys.stdout.flush()
        if browser and _has_screen():
            webbrowser.open(viewer.address)
        try:
            while True:
                time.sleep(3600)
        finally:
            viewer.close()
    finally:
        log.setLevel(level)


def _is_this_machine(host: str) -> bool:
    """Nobody else reaches it."""
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host.lower() == "localhost"


def _has_screen() -> bool:
    """A browser has somewhere to open; on Linux one in the terminal would be found otherwise."""
    return sys.platform in ("darwin", "win32") or bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))
