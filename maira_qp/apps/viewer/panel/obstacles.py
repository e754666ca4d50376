"""The tab "Obstacles": what stands in the way."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pinocchio as pin
import viser

from maira_qp.apps.viewer.panel import readout
from maira_qp.apps.viewer.panel.controls import Ask
from maira_qp.apps.viewer.session import Session
from maira_qp.apps.viewer.view import View
from maira_qp.robots.collision.shapes import Box, Shape, Sphere


class ObstaclesTab:
    """Balls and boxes that are put into the way."""

    def __init__(self, gui: viser.GuiApi, session: Session, ask: Ask) -> None:
        length = session.robot.length
        self._count = 0
        ball, box = gui.add_button("Add a ball"), gui.add_button("Add a box")
        remove = gui.add_button("Remove all", color="gray")
        avoid = gui.add_checkbox("Keep clear of them", session.is_avoiding)
        self._distances = gui.add_html("")

        def add(kind: Callable[[pin.SE3, str], Shape], name: str) -> None:
            self._count += 1
            angle = 2.4 * self._count  # golden: no two in the same place
            place = pin.SE3(np.eye(3), 0.45 * length * np.array([np.cos(angle), np.sin(angle), 0.9]))
            shape = kind(place, f"{name} {self._count}")
            ask.session(f"add {self._count}", lambda session: session.put_obstacle(shape))

        @ball.on_click
        def _(_: viser.GuiEvent) -> None:
            add(lambda place, name: Sphere(0.06 * length, place, name=name), "ball")

        @box.on_click
        def _(_: viser.GuiEvent) -> None:
            add(lambda place, name: Box(np.full(3, 0.12 * length), place, name=name), "box")

        @remove.on_click
        def _(_: viser.GuiEvent) -> None:
            ask.session("remove", lambda session: session.remove_obstacles())

        @avoid.on_update
        def _(_: viser.GuiEvent) -> None:
            wanted = avoid.value
            ask.session("avoid", lambda session: session.avoid(wanted))

    def show(self, view: View) -> None:
        """How far away they are."""
        self._distances.content = readout.distances(view)
