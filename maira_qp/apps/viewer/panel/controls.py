"""What the tabs of the panel are made with: whom they ask, sliders that follow, where files go."""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any, Protocol

import viser

from maira_qp.apps.viewer.saving import SUFFIXES, Savable, plain_name, save
from maira_qp.apps.viewer.session import Session
from maira_qp.errors import OptionError

UNTOUCHED = 0.4
"""A control that a person used is left alone for so long [s]: what is shown is older than what was asked for."""


class Ask(Protocol):
    """What the controls ask: of the session, in its own thread, or of what is around it."""

    def session(self, key: str, action: Callable[[Session], None]) -> None:
        """Do this before the next tick, and nothing that was asked under the same key before and is not yet done."""

    def each(self, action: Callable[[Session], None]) -> None:
        """Do this before the next tick; each counts, however many come between two ticks."""

    def robot(self, robot: str, tip: str | None, client: viser.ClientHandle | None) -> None:
        """Another robot: a name of the catalog, or a file."""

    def tip(self, tip: str | None, client: viser.ClientHandle | None) -> None:
        """The robot that is shown, with another tip; None: its own ones."""

    def uploaded_robot(self, name: str, content: bytes, tip: str | None, client: viser.ClientHandle | None) -> None:
        """Another robot, from a file that a browser sent."""

    def path_file(self, path: str, degrees: bool, millimetres: bool, client: viser.ClientHandle | None) -> None:
        """The path is that of a CSV file where the viewer runs, in m and rad, or in mm, or in degrees."""

    def uploaded_path(
        self, name: str, content: bytes, degrees: bool, millimetres: bool, client: viser.ClientHandle | None
    ) -> None:
        """The path is that of a CSV file that a browser sent."""

    def failures(self, client: viser.ClientHandle | None) -> AbstractContextManager[None]:
        """Errors within are told to the client."""
        ...


def when_pressed(group: viser.GuiButtonGroupHandle, act: Callable[[str], None]) -> None:
    """`act` is called with the label of each button of a group that is pressed, and must be quick.

    The label is read before the next message comes, which may be of another button.
    """

    @group.on_click
    async def _(event: viser.GuiEvent[viser.GuiButtonGroupHandle]) -> None:
        act(event.target.value)


class Control:
    """A drop-down, a box to tick or a slider that follows a value, but not while a person uses it."""

    def __init__(self, handle: Any, chosen: Callable[[Any], None]) -> None:
        """`chosen` is called with what a person chose, and must be quick."""
        self.handle = handle
        self._touched = -UNTOUCHED

        @handle.on_update
        async def _(event: viser.GuiEvent) -> None:
            if event.client is not None:
                self._touched = time.monotonic()
                chosen(handle.value)

    def show(self, value: Any) -> None:
        """The value is this."""
        if value != self.handle.value and time.monotonic() - self._touched > UNTOUCHED:
            self.handle.value = value


class Slider(Control):
    """A slider that follows a value."""

    def show(self, value: float) -> None:
        """The value is this, or the nearest that the slider has."""
        value = round(value / self.handle.step) * self.handle.step
        super().show(round(min(max(value, self.handle.min), self.handle.max), 6))


def add_saving(gui: viser.GuiApi, name: str, what: Callable[[], Savable], ask: Ask) -> None:
    """A field for a file's name, and buttons that save `what()` where the viewer runs, or send it to the browser."""
    field = gui.add_text("File", name, hint=f"A name that ends in {' or '.join(SUFFIXES)}")
    here = gui.add_button("Save where the viewer runs", icon=viser.Icon.DEVICE_FLOPPY)
    download = gui.add_button("Download", icon=viser.Icon.DOWNLOAD)

    @here.on_click
    def _(event: viser.GuiEvent) -> None:
        with ask.failures(event.client):
            path = save(what(), field.value, Path.cwd())
            if event.client is not None:
                event.client.add_notification("Saved", str(path), auto_close_seconds=6, color="green")

    @download.on_click
    def _(event: viser.GuiEvent) -> None:
        with ask.failures(event.client):
            rows = what()
            if not len(rows):
                raise OptionError("there is nothing to save yet")
            chosen = plain_name(field.value)
            if event.client is not None:
                event.client.send_file_download(chosen, rows.content(Path(chosen).suffix), save_immediately=True)
