"""The tab "Path": poses are added, or a circle or a file taken; the path is followed, scrubbed, played and saved."""

from __future__ import annotations

from collections.abc import Callable

import viser

from maira_qp.apps.viewer.panel import readout
from maira_qp.apps.viewer.panel.controls import Ask, Slider, add_saving, when_pressed
from maira_qp.apps.viewer.paths.followed import Followed
from maira_qp.apps.viewer.paths.route import LEAST_SPACING, Route
from maira_qp.apps.viewer.session import FARTHEST, Session
from maira_qp.apps.viewer.view import View
from maira_qp.errors import OptionError

FROM_HERE, FROM_ANYWHERE = "Where the arm is", "Anywhere"
ADD, UNDO, CLEAR = "Add pose", "Undo", "Clear"
PLAY, PAUSE, NEXT, WHY = "Play", "Pause", "Next failure", "Why?"


class PathTab:
    """All controls of a path."""

    def __init__(self, gui: viser.GuiApi, session: Session, ask: Ask) -> None:
        self._ask, self._followed = ask, None
        self._add_sources(gui, session)
        self._add_following(gui)
        self._state = gui.add_html("")
        self._at = Slider(gui.add_slider("Pose", 0.0, 1.0, 1.0, 0.0, visible=False), self._stand_at)
        self._speed = gui.add_number("Poses per second", 20.0, min=0.1, max=1e4, visible=False)
        self._playing = gui.add_button_group("Arm", (PLAY, PAUSE), visible=False)
        self._failing = gui.add_button_group("Failures", (NEXT, WHY), visible=False)
        with gui.add_folder("Save", expand_by_default=False):
            add_saving(gui, "path.csv", self._what_is_saved, ask)

        when_pressed(self._playing, self._play)
        failures = {NEXT: Session.stand_at_next_failure, WHY: Session.explain_path}
        when_pressed(self._failing, lambda what: ask.each(failures[what]))

    def show(self, view: View) -> None:
        """The path, how it is followed, and where on it the arm is."""
        path, station = view.path, view.path.station
        self._followed, self._cancel.visible = path.followed, path.is_sought
        self._state.content = readout.path(view)
        is_known = path.followed is not None
        self._at.handle.visible = is_known and len(path.route) > 1
        self._speed.visible = self._playing.visible = self._at.handle.visible
        self._failing.visible = path.followed is not None and not path.followed.solution
        if self._at.handle.visible:
            self._at.handle.max = len(path.route) - 1.0
        if station is not None:
            self._at.show(station.index)

    def _add_sources(self, gui: viser.GuiApi, session: Session) -> None:
        """Of poses."""
        ask, length = self._ask, session.robot.length
        corners = gui.add_button_group("Corners", (ADD, UNDO, CLEAR))
        spacing = gui.add_number(
            "Spacing [mm]", 1e3 * session.route.spacing, min=1e3 * LEAST_SPACING, max=1e3, step=1.0,
            hint="Largest distance from pose to pose on lines and circles",
        )  # fmt: skip
        closed = gui.add_checkbox("Closed", session.route.is_closed, hint="It ends where it begins, as the arm does")
        with gui.add_folder("Circle or file", expand_by_default=False):
            radius = gui.add_number("Radius [mm]", round(100 * length), min=1, max=round(1e3 * FARTHEST * length))
            circle = gui.add_button("Circle about the target", icon=viser.Icon.CIRCLE)
            file = gui.add_text("CSV", "", hint="Columns x, y, z and qw, qx, qy, qz or roll, pitch, yaw")
            millimetres = gui.add_checkbox("Lengths in mm", False, hint="Else in m")
            degrees = gui.add_checkbox("Angles in degrees", False, hint="Else in rad")
            load = gui.add_button("Load the path", icon=viser.Icon.FILE)
            upload = gui.add_upload_button("Upload a path", mime_type=".csv", icon=viser.Icon.UPLOAD)

        changed: dict[str, Callable[[Session], Route]] = {
            ADD: lambda session: session.route.with_corner(session.target.homogeneous),
            UNDO: lambda session: session.route.without_last(),
            CLEAR: lambda session: session.route.cleared(),
        }
        when_pressed(corners, lambda change: ask.each(lambda session: session.lay(changed[change](session))))

        @spacing.on_update
        def _(_: viser.GuiEvent) -> None:
            metres = 1e-3 * spacing.value
            ask.session("spacing", lambda session: session.lay(session.route.spaced(metres)))

        @closed.on_update
        def _(_: viser.GuiEvent) -> None:
            wanted = closed.value
            ask.session("closed", lambda session: session.lay(session.route.closed(wanted)))

        @circle.on_click
        def _(_: viser.GuiEvent) -> None:
            r, largest = 1e-3 * radius.value, FARTHEST * length
            ask.each(lambda session: session.lay(session.route.with_circle(session.target.homogeneous, r, largest)))

        @load.on_click
        def _(event: viser.GuiEvent) -> None:
            ask.path_file(file.value.strip(), degrees.value, millimetres.value, event.client)

        @upload.on_upload
        def _(event: viser.GuiEvent) -> None:
            ask.uploaded_path(upload.value.name, upload.value.content, degrees.value, millimetres.value, event.client)

    def _add_following(self, gui: viser.GuiApi) -> None:
        start = gui.add_dropdown("Start", (FROM_HERE, FROM_ANYWHERE), hint="Which configurations it may begin with")
        follow = gui.add_button("Follow", icon=viser.Icon.ROUTE)
        self._cancel = gui.add_button("Cancel", icon=viser.Icon.X, visible=False)

        @follow.on_click
        def _(_: viser.GuiEvent) -> None:
            is_from_here = start.value == FROM_HERE
            self._ask.session("follow", lambda session: session.follow_path(is_from_here))

        @self._cancel.on_click
        def _(_: viser.GuiEvent) -> None:
            self._ask.session("follow", lambda session: session.cancel_path())

    def _play(self, button: str) -> None:
        rate = float(self._speed.value)
        action = (lambda session: session.play_path(rate)) if button == PLAY else Session.pause_path
        self._ask.session("along the path", action)

    def _stand_at(self, index: float) -> None:
        self._ask.session("along the path", lambda session: session.stand_at(round(index)))

    def _what_is_saved(self) -> Followed:
        """Raises `OptionError`."""
        if self._followed is None:
            raise OptionError("no path is followed yet")
        return self._followed
