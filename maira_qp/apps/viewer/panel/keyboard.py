"""Keys: commands of the page, which its palette (Ctrl-K) lists with what they are on."""

from __future__ import annotations

from collections.abc import Callable

import viser

from maira_qp.apps.viewer.panel.controls import Ask
from maira_qp.apps.viewer.session import Session

STEP, SMALL_STEP = 0.01, 0.001
"""What a key moves the target by, and with Shift [m]."""
KEYS_OF_AXES = (("x", "L", "J"), ("y", "I", "K"), ("z", "O", "U"))
"""Axis, forth, back. W A S D Q E and the arrows move the camera."""
KEYS_OF_SLIDERS = """
<img hidden alt="" src="data:," onerror="
  if (!window.keysOfSliders) {
    window.keysOfSliders = true;
    document.body.addEventListener('keydown', event => {
      if (event.key.startsWith('Arrow') && event.target.closest('[role=slider], [role=tab]')) event.stopPropagation();
    });
    document.body.addEventListener('pointerdown', event => {
      if (event.target.tagName === 'CANVAS') document.activeElement.blur();
    }, true);
  }
">
"""
"""Arrow keys that move a slider do not turn the camera too, which listens at the document; and a click into the scene
leaves the field that was typed into, which has the keys. A page of viser takes no scripts of its server in another
way."""


class Keyboard:
    """The commands."""

    def __init__(self, gui: viser.GuiApi, ask: Ask) -> None:
        self._gui, self._ask = gui, ask
        gui.add_html(KEYS_OF_SLIDERS)
        self._add("Home", Session.go_home, "H")
        self._add("Put the target to the tool", Session.stop, "T")
        self._add("Undo", Session.undo, "Z", "cmd/ctrl")
        self._add("Redo", Session.redo, "Y", "cmd/ctrl")
        self._add("Show all solutions, or not", lambda session: session.show_ghosts(not session.shows_ghosts), "G")
        self._add("Axes of the tool, or of the base", lambda one: one.use_axes(not one.has_base_axes), "X")
        for axis, (name, forth, back) in enumerate(KEYS_OF_AXES):
            for key, sign in ((forth, 1), (back, -1)):
                for modifier, step in ((None, STEP), ("shift", SMALL_STEP)):
                    label = f"Move the target by {1e3 * sign * step:+.0f} mm along {name}"
                    self._add(label, _nudge(axis, sign * step), key, modifier)

    def _add(self, label: str, action: Callable[[Session], None], key: str, modifier: str | None = None) -> None:
        command = self._gui.add_command(label, hotkey=key, modifier=modifier)  # type: ignore[arg-type]

        @command.on_trigger
        async def _(_: object) -> None:
            self._ask.each(action)


def _nudge(axis: int, way: float) -> Callable[[Session], None]:
    return lambda session: session.nudge(axis, way)
