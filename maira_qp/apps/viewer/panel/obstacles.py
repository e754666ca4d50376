"""The tab "Obstacles": solids are put into the way, sized, turned and taken away."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin
import viser

from maira_qp.apps.viewer.panel import readout
from maira_qp.apps.viewer.panel.controls import Ask, when_pressed
from maira_qp.apps.viewer.panel.fields import Field, PoseFields
from maira_qp.apps.viewer.panel.solids import KINDS, label_of, resized, sizes_of, solid
from maira_qp.apps.viewer.quantities import listing
from maira_qp.apps.viewer.session import Session
from maira_qp.apps.viewer.view import View
from maira_qp.problem.pose import as_pose
from maira_qp.robots.collision.shapes import Shape

NO_OBSTACLE = "-"
REMOVE, REMOVE_ALL = "This one", "All"


class ObstaclesTab:
    """Balls, boxes, cylinders and capsules that are put into the way."""

    def __init__(self, gui: viser.GuiApi, session: Session, ask: Ask) -> None:
        self._ask, self._length = ask, session.robot.length
        self._count = 0
        self._obstacles: dict[str, Shape] = {}
        kinds = gui.add_button_group("Add", KINDS)
        self._avoid = gui.add_checkbox("Keep clear of them", session.workplace.is_avoiding)
        self._which = gui.add_dropdown("Obstacle", (NO_OBSTACLE,), visible=False)
        with gui.add_form(None, visible=False) as self._form:
            self._size = Field(gui.add_text("radius [mm]", ""))
            self._pose = PoseFields(gui, pin.SE3.Identity())
            change = gui.add_button("Change it", icon=viser.Icon.CHECK)
        self._remove = gui.add_button_group("Remove", (REMOVE, REMOVE_ALL), visible=False)
        self._distances = gui.add_html("")

        change.on_click(lambda _: self._form.submit())
        self._form.on_submit(self._change)

        when_pressed(kinds, self._add)
        when_pressed(self._remove, self._take_away)

        @self._avoid.on_update
        def _(_: viser.GuiEvent) -> None:
            wanted = self._avoid.value
            ask.session("avoid", lambda session: session.avoid(wanted))

        @self._which.on_update
        def _(_: viser.GuiEvent) -> None:
            self._size.forget()
            self._pose.forget()

    def show(self, session: Session, view: View) -> None:
        """The obstacles, how far away they are, and the one that can be changed."""
        obstacles = session.workplace.obstacles
        if tuple(obstacles) != tuple(self._obstacles):
            added = [name for name in obstacles if name not in self._obstacles]
            self._which.options = tuple(obstacles) or (NO_OBSTACLE,)
            if added:
                self._which.value = added[-1]
            self._which.visible = self._form.visible = self._remove.visible = bool(obstacles)
            self._size.forget()
        self._obstacles = obstacles
        shape = obstacles.get(self._which.value)
        if shape is not None:
            self._size.handle.label, self._size.handle.visible = label_of(shape), bool(label_of(shape))
            self._size.show(listing(sizes_of(shape)))
            self._pose.show(shape.pose)
        self._distances.content = readout.distances(view)

    def _add(self, kind: str) -> None:
        self._count += 1
        angle = 2.4 * self._count  # golden: no two in the same place
        where = 0.45 * self._length * np.array([np.cos(angle), np.sin(angle), 0.9])
        size = max(round(0.12 * self._length, 2), 0.01)
        shape = solid(kind, size, pin.SE3(np.eye(3), where.round(2)), f"{kind.lower()} {self._count}")
        self._ask.each(lambda session: session.put_obstacle(shape))

    def _take_away(self, button: str) -> None:
        name = self._which.value if button == REMOVE else None
        self._ask.each(lambda session: session.remove_obstacles(name))

    def _change(self, event: viser.GuiEvent) -> None:
        """Sizes and pose as they were typed."""
        name = self._which.value
        with self._ask.failures(event.client):
            if name not in self._obstacles:
                return
            size, typed = self._size.text, self._pose.typed()
            if size is not None:
                resized(self._obstacles[name], size)  # is it a size?
            self._size.forget()

            def change(session: Session) -> None:
                shape = session.workplace.obstacles.get(name)
                if shape is None:
                    return  # it was taken away
                shape = shape if size is None else resized(shape, size)
                session.put_obstacle(replace(shape, pose=as_pose(typed.of(shape.pose))))  # type: ignore[type-var]

            self._ask.session(f"change {name}", change)
