"""The viewer: a web server with a scene and a panel, and the loop behind them. All tabs see and move the same arm."""

from __future__ import annotations

import contextlib
import logging
import socket
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import numpy as np
import viser

from maira_qp.apps.arguments.robot_choice import RobotChoice
from maira_qp.apps.viewer.access import silenced, start_server
from maira_qp.apps.viewer.drawing.camera import Ball, Stand
from maira_qp.apps.viewer.drawing.layers import Layer
from maira_qp.apps.viewer.drawing.scene import Scene
from maira_qp.apps.viewer.loop import Loop
from maira_qp.apps.viewer.panel.panel import Panel
from maira_qp.apps.viewer.prepared import Prepared, prepared, prepared_robot
from maira_qp.apps.viewer.session import Session
from maira_qp.apps.viewer.view import View
from maira_qp.errors import MairaError, OptionError, PoseError
from maira_qp.paths import from_csv
from maira_qp.robots.model.robot import Robot

log = logging.getLogger(__name__)

PANEL_EVERY = 6
"""Ticks from one look of the panel to the next: ten a second can be read."""
SILENCE = 5.0
"""An error that comes again within this time [s] is not told again."""
UPLOADED = (".urdf", ".xml", ".toml", ".yaml", ".yml")
EVERYWHERE = ("0.0.0.0", "::")
"""Hosts that stand for every address of this machine."""
LARGEST_UPLOAD = 16 * 2**20
"""[bytes]"""


class Viewer:
    """Serves a robot until it is closed."""

    def __init__(
        self,
        choice: RobotChoice | Robot,
        host: str = "127.0.0.1",
        port: int = 8080,
        layers: Sequence[Layer] = (),
        token: str | None = None,
    ) -> None:
        """At a free port from `port` on; 0: any; layers are of this robot; pages without the token are not let in.

        Raises `RobotError`, `FrameError`, `OptionError`, `OSError`.
        """
        shown = prepared_robot(choice) if isinstance(choice, Robot) else prepared(choice)
        self._token, self._server = token, start_server(host, port, token)
        self._told: tuple[str, float] = "", 0.0
        self._stands: dict[int, Stand] = {}
        self._ticks = 0
        self._loop = Loop(shown.session, self._show, self._failed)
        self._present(shown)
        for layer in layers:
            layer(self._server, self)
        self._server.on_client_connect(self._connected)
        self._server.on_client_disconnect(self._disconnected)
        self._loop.start()

    @property
    def url(self) -> str:
        """Where it is served."""
        host = self._server.get_host()
        host = socket.gethostname() if host in EVERYWHERE else host
        return f"http://{f'[{host}]' if ':' in host else host}:{self._server.get_port()}"

    @property
    def address(self) -> str:
        """What a browser is to open: where it is served, with the token."""
        return self.url if self._token is None else f"{self.url}/?token={self._token}"

    @property
    def server(self) -> viser.ViserServer:
        """What serves it."""
        return self._server

    @property
    def current(self) -> Session:
        """The session that is shown; another thread's, so only to be looked at."""
        return self._loop.session

    def close(self) -> None:
        """The arm stops, and the tabs are left alone."""
        self._loop.stop()
        with silenced():
            self._server.stop()

    # What the panel asks

    def session(self, key: str, action: Callable[[Session], None]) -> None:
        """Do this before the next tick, unless something else comes under the same key."""
        self._loop.mailbox.put(key, action)

    def each(self, action: Callable[[Session], None]) -> None:
        """Do this before the next tick, whatever else comes."""
        self._loop.mailbox.add(action)

    def target_moved(self, tip: str, T: np.ndarray) -> None:
        """The target of a tip was dragged to a pose (4, 4)."""

        def move(session: Session) -> None:
            session.select(tip)
            session.move_target(T)

        self.session(f"target {tip}", move)

    def obstacle_moved(self, name: str, T: np.ndarray) -> None:
        """An obstacle was dragged to a pose (4, 4)."""
        self.session(name, lambda session: session.move_obstacle(name, T))

    def ghost_clicked(self, index: int) -> None:
        """One of the solutions that are shown was clicked."""
        self.session("ghost", lambda session: session.go_to_ghost(index))

    def robot(self, robot: str, tip: str | None, client: viser.ClientHandle | None) -> None:
        """Show another robot: a name of the catalog, or a file."""
        with self.failures(client):
            self._replace(prepared(RobotChoice(robot=robot, tip=tip)))

    def tip(self, tip: str | None, client: viser.ClientHandle | None) -> None:
        """Show the same robot with another tip; None: its own ones."""
        with self.failures(client):
            self._replace(self._prepared.with_tip(tip))

    def uploaded_robot(self, name: str, content: bytes, tip: str | None, client: viser.ClientHandle | None) -> None:
        """Show another robot, from a file that a browser sent; of its name only the suffix is used."""
        with self.failures(client), tempfile.TemporaryDirectory() as directory:
            suffix = Path(name).suffix.lower()
            if suffix not in UPLOADED or len(content) > LARGEST_UPLOAD:
                raise OptionError(f"a robot is a file of at most {LARGEST_UPLOAD >> 20} MB, {', '.join(UPLOADED)}")
            file = Path(directory) / f"uploaded{suffix}"
            file.write_bytes(content)
            self._replace(prepared(RobotChoice(robot=str(file), tip=tip), name, content))

    def path_file(self, path: str, degrees: bool, millimetres: bool, client: viser.ClientHandle | None) -> None:
        """Follow the path of a CSV file in m and rad, or in mm, or in degrees."""
        with self.failures(client):
            self._lay(Path(path).name, from_csv(path, degrees=degrees, millimetres=millimetres))

    def uploaded_path(
        self, name: str, content: bytes, degrees: bool, millimetres: bool, client: viser.ClientHandle | None
    ) -> None:
        """Follow the path of a file that a browser sent; its name is only shown."""
        with self.failures(client), tempfile.TemporaryDirectory() as directory:
            if len(content) > LARGEST_UPLOAD:
                raise OptionError(f"a path is a CSV file of at most {LARGEST_UPLOAD >> 20} MB")
            file = Path(directory) / "path.csv"
            file.write_bytes(content)
            try:
                self._lay(name, from_csv(file, degrees=degrees, millimetres=millimetres))
            except PoseError as reason:
                raise PoseError(str(reason).replace(str(file), name)) from reason

    def _lay(self, name: str, poses: np.ndarray) -> None:
        self._loop.mailbox.put("path file", lambda session: session.lay(session.route.with_file(name, poses)))

    @contextlib.contextmanager
    def failures(self, client: viser.ClientHandle | None) -> Iterator[None]:
        """What is wrong within is told to the client."""
        try:
            yield
        except (MairaError, OSError) as reason:
            if client is not None:
                client.add_notification("This does not work", str(reason)[:600], color="red", auto_close_seconds=12)

    # What the loop shows

    def _connected(self, client: viser.ClientHandle) -> None:
        self._stands[client.client_id] = Stand(client.camera, self._ball)

    def _disconnected(self, client: viser.ClientHandle) -> None:
        self._stands.pop(client.client_id, None)

    def _replace(self, shown: Prepared) -> None:
        def replace(_: Session) -> None:
            self._loop.session = shown.session
            self._present(shown)

        self._loop.mailbox.put("robot", replace)

    def _present(self, shown: Prepared) -> None:
        """A scene and a panel for a session, in place of those of the last."""
        self._prepared, session = shown, shown.session
        with self._server.atomic():
            self._server.scene.reset()
            self._server.gui.reset()
            self._scene = Scene(
                self._server.scene,
                session.robot,
                shown.geometry.bodies,
                self,
            )
            self._panel = Panel(self._server.gui, session, shown.loaded, self)
            self._ball = Ball(session.robot, session.q, shown.geometry.bodies)
            self._ball.frame(self._server.initial_camera)
            for stand in list(self._stands.values()):
                stand.see(self._ball)

    def _show(self, session: Session, view: View) -> None:
        with self._server.atomic():
            self._scene.show(view, session.workplace.obstacles, session.recording)
            if self._ticks % PANEL_EVERY == 0:
                self._panel.show(session, view)
        self._ticks += 1

    def _failed(self, reason: Exception) -> None:
        """Tells all tabs, but not sixty times a second."""
        if not isinstance(reason, MairaError):
            log.error("the viewer goes on after an error", exc_info=reason)
        text, now = str(reason)[:600] or type(reason).__name__, time.monotonic()
        if text == self._told[0] and now - self._told[1] < SILENCE:
            return
        self._told = text, now
        for client in self._server.get_clients().values():
            client.add_notification("This does not work", text, color="red", auto_close_seconds=12)
