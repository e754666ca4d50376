"""A motion is recorded, played and saved, in the tab "Path"."""

from __future__ import annotations

import viser

from maira_qp.apps.viewer.panel import readout
from maira_qp.apps.viewer.panel.controls import Ask, add_saving
from maira_qp.apps.viewer.session import Session


class MotionControls:
    """A motion is recorded, played, saved where the viewer runs, or downloaded."""

    def __init__(self, gui: viser.GuiApi, ask: Ask) -> None:
        self._record = gui.add_button("Record", icon=viser.Icon.PLAYER_RECORD)
        play = gui.add_button("Play", icon=viser.Icon.PLAYER_PLAY)
        stop = gui.add_button("Stop the arm", color="gray", icon=viser.Icon.PLAYER_STOP)
        add_saving(gui, "motion.csv", lambda: self._recording, ask)
        self._state = gui.add_html("")
        self._is_recording = False

        @self._record.on_click
        def _(_: viser.GuiEvent) -> None:
            wanted = not self._is_recording
            ask.session("record", lambda session: session.record(wanted))

        @play.on_click
        def _(_: viser.GuiEvent) -> None:
            ask.session("play", lambda session: session.play())

        @stop.on_click
        def _(_: viser.GuiEvent) -> None:
            ask.session("stop", lambda session: session.stop())

    def show(self, session: Session) -> None:
        """How long the recording is."""
        self._recording, self._is_recording = session.recording, session.is_recording
        self._record.label = "End the recording" if session.is_recording else "Record"
        self._state.content = readout.recording(session.recording)
