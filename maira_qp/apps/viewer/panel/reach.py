"""The tab "Reach": how the redundancy is used, the elbow, all solutions."""

from __future__ import annotations

import numpy as np
import viser

from maira_qp.apps.viewer.panel import readout
from maira_qp.apps.viewer.panel.controls import Ask, Slider
from maira_qp.apps.viewer.session import Method, Session
from maira_qp.apps.viewer.view import View

METHODS: dict[str, Method] = {
    "Strict hierarchy": "strict",
    "Weighted trade-off": "weighted",
    "Pose alone": "none",
}


class ReachTab:
    """How the redundancy is used, the elbow, all solutions."""

    def __init__(self, gui: viser.GuiApi, session: Session, ask: Ask) -> None:
        names = tuple(METHODS)
        chosen = names[list(METHODS.values()).index(session.method)]
        method = gui.add_dropdown(
            "Redundancy", names, initial_value=chosen, hint="What the arm does with the freedom the pose leaves"
        )
        self._method = method
        self._weight = gui.add_slider(
            "log10 weight", -6.0, 0.0, 0.1, float(np.log10(session.weight)), hint="Of the posture against the pose"
        )
        swivel = gui.add_slider("Swivel [deg]", -180.0, 360.0, 0.5, 0.0, hint="Moves the elbow; the tool stands still")
        self._swivel = Slider(
            swivel,
            lambda degrees: ask.session("swivel", lambda session: session.set_swivel(float(np.radians(degrees)))),
        )
        self._ends = gui.add_html("")
        ghosts = gui.add_checkbox("Show all solutions", session.shows_ghosts)
        self._next = gui.add_button("Go to the next solution", visible=False)
        self._solutions = gui.add_html("")
        self._count = 0

        def use(_: viser.GuiEvent) -> None:
            chosen, weight = METHODS[method.value], 10.0**self._weight.value
            ask.session("method", lambda session: session.use(chosen, weight))

        method.on_update(use)
        self._weight.on_update(use)

        @ghosts.on_update
        def _(_: viser.GuiEvent) -> None:
            wanted = ghosts.value
            ask.session("ghosts", lambda session: session.show_ghosts(wanted))

        @self._next.on_click
        def _(_: viser.GuiEvent) -> None:
            self._count += 1
            index = self._count
            ask.session("ghost", lambda session: session.go_to_ghost(index))

    def show(self, session: Session, view: View) -> None:
        """The elbow and the solutions."""
        self._weight.visible = session.method == "weighted"
        elbow = view.elbow
        self._swivel.handle.visible = self._ends.visible = session.has_swivel
        self._swivel.handle.disabled = elbow is None
        if elbow is not None:
            self._swivel.handle.min = round(float(np.degrees(elbow.curve.lower)), 1)
            self._swivel.handle.max = round(float(np.degrees(elbow.curve.upper)), 1)
            self._swivel.show(float(np.degrees(elbow.psi)))
        self._ends.content = readout.ends(session.robot, elbow)
        self._solutions.content = readout.solutions(session, view)
        self._next.visible = view.ghosts is not None and len(view.ghosts.q) > 1
