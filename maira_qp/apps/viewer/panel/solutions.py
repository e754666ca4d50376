"""The tab "Solutions": how the redundancy is used, the elbow, all solutions."""

from __future__ import annotations

import numpy as np
import viser

from maira_qp.apps.viewer.answers import Ghosts
from maira_qp.apps.viewer.panel import readout
from maira_qp.apps.viewer.panel.controls import Ask, Control, Slider
from maira_qp.apps.viewer.session import Session
from maira_qp.apps.viewer.view import View
from maira_qp.apps.viewer.workplace import Method

METHODS: dict[str, Method] = {
    "Strict hierarchy": "strict",
    "Weighted trade-off": "weighted",
    "Pose alone": "none",
}
NONE_CHOSEN = "-"


class SolutionsTab:
    """How the redundancy is used, the elbow, all solutions."""

    def __init__(self, gui: viser.GuiApi, session: Session, ask: Ask) -> None:
        self._ask = ask
        self._add_redundancy(gui, session)
        self._add_elbow(gui)
        show_all = gui.add_checkbox(
            "Show all solutions", session.shows_ghosts, hint="As ghosts, coloured by cost; click one to go there"
        )
        self._show_all = Control(
            show_all, lambda wanted: ask.session("ghosts", lambda session: session.show_ghosts(wanted))
        )
        self._shown: Ghosts | None = None
        self._choice = gui.add_dropdown("Go to", (NONE_CHOSEN,), visible=False)
        self._next = gui.add_button("Go to the next solution", visible=False)
        self._solutions = gui.add_html("")
        self._count = 0

        @self._choice.on_update
        def _(event: viser.GuiEvent) -> None:
            if event.client is not None and self._choice.value in self._choice.options[1:]:
                self._go_to(self._choice.options.index(self._choice.value) - 1)

        @self._next.on_click
        def _(_: viser.GuiEvent) -> None:
            self._go_to(self._count + 1)

    def _add_redundancy(self, gui: viser.GuiApi, session: Session) -> None:
        names, workplace = tuple(METHODS), session.workplace
        chosen = names[list(METHODS.values()).index(workplace.method)]
        method = gui.add_dropdown(
            "Redundancy", names, initial_value=chosen, hint="What the arm does with the freedom that the pose leaves"
        )
        self._weight = gui.add_slider(
            "Weight 10^", -6.0, 0.0, 0.1, float(np.log10(workplace.weight)),
            hint="Of the posture against the pose, as a power of ten",
        )  # fmt: skip

        def use(_: viser.GuiEvent) -> None:
            chosen, weight = METHODS[method.value], 10.0**self._weight.value
            self._ask.session("method", lambda session: session.use(chosen, weight))

        method.on_update(use)
        self._weight.on_update(use)

    def _add_elbow(self, gui: viser.GuiApi) -> None:
        swivel = gui.add_slider("Elbow [deg]", -180.0, 360.0, 0.5, 0.0, hint="Swivels the elbow; the tool stands still")
        self._swivel = Slider(
            swivel,
            lambda degrees: self._ask.session("swivel", lambda session: session.set_swivel(float(np.radians(degrees)))),
        )
        self._ends = gui.add_html("")

    def show(self, session: Session, view: View) -> None:
        """The elbow and the solutions."""
        self._weight.visible = session.workplace.method == "weighted"
        elbow = view.elbow
        self._swivel.handle.visible = self._ends.visible = session.has_swivel
        self._swivel.handle.disabled = elbow is None
        if elbow is not None:
            self._swivel.handle.min = round(float(np.degrees(elbow.curve.lower)), 1)
            self._swivel.handle.max = round(float(np.degrees(elbow.curve.upper)), 1)
            self._swivel.show(float(np.degrees(elbow.psi)))
        self._ends.content = readout.ends(session.robot, elbow)
        self._solutions.content = readout.solutions(session, view)
        self._show_all.show(session.shows_ghosts)
        if view.ghosts is not self._shown:
            self._shown = view.ghosts
            names = () if view.ghosts is None else view.ghosts.names
            self._choice.options = (NONE_CHOSEN, *names)
            self._choice.visible = self._next.visible = len(names) > 1

    def _go_to(self, index: int) -> None:
        self._count = index
        self._ask.each(lambda session: session.go_to_ghost(index))
