"""What is drawn: the arm, its targets, all solutions as ghosts, obstacles with their distances, motions and paths."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Protocol

import numpy as np
import viser

from maira_qp.apps.viewer.drawing.geometry import Body, Colour
from maira_qp.apps.viewer.drawing.ghosts import GhostDrawing
from maira_qp.apps.viewer.drawing.handles import Handle, put
from maira_qp.apps.viewer.drawing.obstacles import GIZMO, RED, Obstacles
from maira_qp.apps.viewer.drawing.path import PathDrawing
from maira_qp.apps.viewer.drawing.surfaces import add_surface, light
from maira_qp.apps.viewer.motion.recording import Recording
from maira_qp.apps.viewer.view import View
from maira_qp.robots.collision.shapes import Shape
from maira_qp.robots.model.robot import Robot

MOTION: Colour = (76, 110, 245)
VIOLET: Colour = (156, 54, 181)
"""Of links that are in each other."""
CLEAR = 1.01
"""A body that has the colour of a warning is so much larger: of surfaces in the same place each would flicker through
the other."""
VISIBLE_ERROR = 1e-3
"""From this distance on [m] a line leads from a tool to its target."""
MOST_SEGMENTS = 500
"""Of the line that shows a recorded motion."""


class ArmDrawing:
    """The bodies of an arm; those behind a joint at its limit are red, those that are in each other violet."""

    def __init__(self, scene: viser.SceneApi, robot: Robot, bodies: list[Body]) -> None:
        self._robot = robot
        self._links = {link: f"/arm/{i}" for i, link in enumerate(dict.fromkeys(body.link for body in bodies))}
        self._frames = {link: scene.add_frame(name, show_axes=False) for link, name in self._links.items()}
        self._bodies = [
            (body, add_surface(scene, f"{self._links[body.link]}/{i}", body)) for i, body in enumerate(bodies)
        ]
        self._joint_of = dict(zip(robot.moved_links, robot.model.names[1:], strict=True))

    def show(self, view: View) -> None:
        """The arm where it is."""
        at = self._robot.at(view.q)
        for link, frame in self._frames.items():
            put(frame, at.placement(link))
        joints = {name.rsplit(" ", 1)[0] for name in view.at_limit}
        in_each_other = {link for one in view.overlaps for link in (one.first, one.second)}
        for body, mesh in self._bodies:
            if body.link in in_each_other:
                mesh.color, mesh.scale = VIOLET, CLEAR
            elif self._joint_of.get(body.link) in joints:
                mesh.color, mesh.scale = RED, CLEAR
            else:
                mesh.color, mesh.scale = body.colour, 1.0


class TargetDrawing:
    """What a target is dragged by, and a line to it from the tool that is not there."""

    def __init__(self, scene: viser.SceneApi, name: str, size: float, moved: Callable[[np.ndarray], None]) -> None:
        """For an arm of a length [m]; `moved` is called with a pose (4, 4)."""
        gizmo = scene.add_transform_controls(f"/target/{name}", scale=GIZMO * size, depth_test=False, opacity=0.85)
        self._handle = Handle(gizmo, moved)
        self._line = scene.add_line_segments(
            f"/error/{name}", np.zeros((1, 2, 3)), RED, thickness=0.003 * size, visible=False
        )

    def show(self, view: View, tip: str) -> None:
        """The target of a tip."""
        tool, target = view.tools[tip].translation, view.targets[tip]
        self._handle.show(target, view.has_base_axes)
        self._line.visible = bool(np.linalg.norm(tool - target.translation) > VISIBLE_ERROR)
        if self._line.visible:
            self._line.points = np.array([[tool, target.translation]])


class Hands(Protocol):
    """What is done with a hand in the scene."""

    def target_moved(self, tip: str, T: np.ndarray) -> None:
        """The target of a tip was dragged to a pose (4, 4)."""

    def obstacle_moved(self, name: str, T: np.ndarray) -> None:
        """An obstacle was dragged to a pose (4, 4)."""

    def ghost_clicked(self, index: int) -> None:
        """One of the solutions that are shown was clicked."""


class Scene:
    """All of it, for one robot."""

    def __init__(self, scene: viser.SceneApi, robot: Robot, bodies: list[Body], hands: Hands) -> None:
        size = robot.length
        light(scene)
        scene.add_grid(
            "/ground", width=8 * size, height=8 * size, cell_size=0.25, section_size=1.0, fade_distance=5 * size,
            cell_color=(225, 228, 232), section_color=(190, 196, 204),
        )  # fmt: skip
        self._arm = ArmDrawing(scene, robot, bodies)
        self._ghosts = GhostDrawing(scene, robot, bodies, hands.ghost_clicked)
        self._targets = {
            tip: TargetDrawing(scene, str(i), size, lambda T, tip=tip: hands.target_moved(tip, T))
            for i, tip in enumerate(robot.tips)
        }
        self._obstacles = Obstacles(scene, size, hands.obstacle_moved)
        self._motion = scene.add_line_segments(
            "/motion", np.zeros((1, 2, 3)), MOTION, thickness=0.004 * size, visible=False
        )
        self._motion_of: tuple[Recording, int] | None = None
        self._path = PathDrawing(scene, size)

    def show(self, view: View, obstacles: Mapping[str, Shape], recording: Recording) -> None:
        """What there is to see after a tick."""
        self._arm.show(view)
        self._ghosts.show(view.ghosts)
        for tip, target in self._targets.items():
            target.show(view, tip)
        self._obstacles.show(obstacles, view)
        self._show_motion(recording)
        self._path.show(view.path)

    def _show_motion(self, recording: Recording) -> None:
        """The way of the tool, drawn anew when enough has come to it."""
        known = (
            self._motion_of is not None and self._motion_of[0] is recording and len(recording) - self._motion_of[1] < 10
        )
        if known:
            return
        self._motion_of = recording, len(recording)
        self._motion.visible = len(recording) > 1
        if self._motion.visible:
            rows = recording.q[:: 1 + len(recording) // MOST_SEGMENTS]
            points = np.array([recording.robot.forward(q).translation for q in rows])
            self._motion.points = np.stack([points[:-1], points[1:]], axis=1)
