"""What is drawn: the arm, its target, all solutions as ghosts, obstacles with their distances, motions and paths."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import pinocchio as pin
import viser

from maira_qp.apps.viewer.drawing.geometry import Body, Colour
from maira_qp.apps.viewer.drawing.path import PathDrawing
from maira_qp.apps.viewer.drawing.surroundings import MARGIN
from maira_qp.apps.viewer.drawing.triangles import triangles
from maira_qp.apps.viewer.motion.recording import Recording
from maira_qp.apps.viewer.view import View
from maira_qp.orientation import matrix_from_quaternion, quaternion_from_matrix
from maira_qp.robots.collision.shapes import Shape
from maira_qp.robots.model.robot import Robot

RED: Colour = (224, 49, 49)
AMBER: Colour = (240, 140, 0)
GREEN: Colour = (47, 158, 68)
GHOST: Colour = (76, 110, 245)
GIZMO = 0.15
"""Size of the gizmo on the target, in lengths of the arm."""
CLEAR = 1.01
"""A body that is red is so much larger, a ghost so much smaller: of surfaces in the same place each would flicker
through the other."""
VISIBLE_ERROR = 1e-3
"""From this position error on [m] a line leads from the tool to the target."""
MOST_SEGMENTS = 500
"""Of the line that shows a recorded motion."""


class ArmDrawing:
    """The bodies of an arm; those behind a joint at its limit are red."""

    def __init__(self, scene: viser.SceneApi, robot: Robot, bodies: list[Body]) -> None:
        self._robot = robot
        self._links = {link: f"/arm/{i}" for i, link in enumerate(dict.fromkeys(body.link for body in bodies))}
        self._frames = {link: scene.add_frame(name, show_axes=False) for link, name in self._links.items()}
        self._bodies = [
            (body, add_surface(scene, f"{self._links[body.link]}/{i}", body)) for i, body in enumerate(bodies)
        ]
        self._joint_of = dict(zip(robot.moved_links, robot.model.names[1:], strict=True))

    def show(self, q: np.ndarray, at_limit: list[str]) -> None:
        """The arm at q (n,)."""
        at = self._robot.at(q)
        for link, frame in self._frames.items():
            put(frame, at.placement(link))
        joints = {name.rsplit(" ", 1)[0] for name in at_limit}
        for body, mesh in self._bodies:
            is_held = self._joint_of.get(body.link) in joints
            mesh.color, mesh.scale = (RED, CLEAR) if is_held else (body.colour, 1.0)


class GhostDrawing:
    """An arm many times over, to be seen through."""

    def __init__(self, scene: viser.SceneApi, robot: Robot, bodies: list[Body]) -> None:
        self._scene, self._robot = scene, robot
        self._bodies = [body for body in bodies if body.link != robot.base]
        self._shown: object = None
        self._handles: list[viser.SceneNodeHandle] = []

    def show(self, configurations: np.ndarray | None) -> None:
        """At configurations (k, n); None: not at all. The same array again costs nothing."""
        if configurations is self._shown:
            return
        self._shown = configurations
        for handle in self._handles:
            handle.remove()
        self._handles = [] if configurations is None or not len(configurations) else self._drawn(configurations)

    def _drawn(self, configurations: np.ndarray) -> list[viser.SceneNodeHandle]:
        states = [self._robot.at(q) for q in configurations]
        handles: list[viser.SceneNodeHandle] = []
        for i, body in enumerate(self._bodies):
            poses = [at.placement(body.link) for at in states]
            handles.append(
                self._scene.add_batched_meshes_simple(
                    f"/ghosts/{i}",
                    body.surface.vertices,
                    body.surface.faces,
                    np.array([quaternion_from_matrix(T.rotation) for T in poses]),
                    np.array([T.translation for T in poses]),
                    batched_scales=np.full(len(poses), 1 / CLEAR),
                    batched_colors=GHOST,
                    opacity=0.12,
                    cast_shadow=False,
                    receive_shadow=False,
                )
            )
        return handles


class Handle:
    """Something that is dragged; while it is, nobody else moves it."""

    def __init__(self, gizmo: viser.TransformControlsHandle, moved: Callable[[np.ndarray], None]) -> None:
        """`moved` is called with the pose (4, 4)."""
        self._gizmo = gizmo
        self._is_held = False

        @gizmo.on_update
        async def _(event: viser.TransformControlsEvent) -> None:  # async: in the order of the events
            self._is_held = event.phase != "end"
            if event.phase != "start":
                T = np.eye(4)
                T[:3, :3], T[:3, 3] = matrix_from_quaternion(gizmo.wxyz), gizmo.position
                moved(T)

    def show(self, T: pin.SE3) -> None:
        """Put it to a pose, unless it is held."""
        if not self._is_held:
            put(self._gizmo, T)

    def remove(self) -> None:
        """And what hangs on it."""
        self._gizmo.remove()


class Obstacles:
    """Solids to be dragged, a line from each to the nearest point of the arm, and how long it is."""

    def __init__(self, scene: viser.SceneApi, moved: Callable[[str, np.ndarray], None]) -> None:
        """`moved` is called with the name of an obstacle and its pose (4, 4)."""
        self._scene, self._moved = scene, moved
        self._handles: dict[str, Handle] = {}
        self._meshes: dict[str, viser.MeshHandle] = {}
        self._lines: dict[str, tuple[viser.LineSegmentsHandle, viser.LabelHandle]] = {}

    def show(self, obstacles: Mapping[str, Shape], view: View) -> None:
        """The obstacles by their names, and the distances that are known."""
        for name in [name for name in self._handles if name not in obstacles]:
            self._handles.pop(name).remove()
            self._meshes.pop(name)
            for handle in self._lines.pop(name):
                handle.remove()
        for name, shape in obstacles.items():
            if name not in self._handles:
                self._add(name, shape)
            self._handles[name].show(shape.pose)
        known = {one.obstacle: one for one in view.clearances}
        for name, (line, label) in self._lines.items():
            line.visible = label.visible = name in known
            if name in known:
                one, colour = known[name], RED if known[name].distance < MARGIN else GREEN
                self._meshes[name].color = RED if colour == RED else AMBER
                line.points, line.colors = one.points[None], np.array(colour, dtype=np.uint8)
                label.position, label.text = one.points.mean(axis=0), f"{1e3 * one.distance:.0f} mm"

    def _add(self, name: str, shape: Shape) -> None:
        node = f"/obstacles/{len(self._handles)}-{name}"
        gizmo = self._scene.add_transform_controls(
            node, scale=0.22, disable_rotations=True, depth_test=False, opacity=0.8
        )
        inverse = shape.pose.inverse().homogeneous
        body = Body(name, triangles(shape).moved(inverse), AMBER, False)
        self._meshes[name] = add_surface(self._scene, f"{node}/body", body, opacity=0.75)
        self._handles[name] = Handle(gizmo, lambda T: self._moved(name, T))
        line = self._scene.add_line_segments(f"/distances/{name}", np.zeros((1, 2, 3)), GREEN, thickness=0.005)
        label = self._scene.add_label(f"/labels/{name}", "", anchor="bottom-center", font_screen_scale=0.8)
        self._lines[name] = line, label


class Scene:
    """All of it, for one robot."""

    def __init__(
        self,
        scene: viser.SceneApi,
        robot: Robot,
        bodies: list[Body],
        target_moved: Callable[[np.ndarray], None],
        obstacle_moved: Callable[[str, np.ndarray], None],
    ) -> None:
        size = robot.length
        light(scene)
        scene.add_grid(
            "/ground", width=8 * size, height=8 * size, cell_size=0.25, section_size=1.0, fade_distance=5 * size,
            cell_color=(225, 228, 232), section_color=(190, 196, 204),
        )  # fmt: skip
        self._arm = ArmDrawing(scene, robot, bodies)
        self._ghosts = GhostDrawing(scene, robot, bodies)
        gizmo = scene.add_transform_controls("/target", scale=GIZMO * size, depth_test=False, opacity=0.85)
        self._target = Handle(gizmo, target_moved)
        self._obstacles = Obstacles(scene, obstacle_moved)
        self._error = scene.add_line_segments("/error", np.zeros((1, 2, 3)), RED, thickness=0.003 * size, visible=False)
        self._motion = scene.add_line_segments(
            "/motion", np.zeros((1, 2, 3)), GHOST, thickness=0.004 * size, visible=False
        )
        self._motion_of: tuple[Recording, int] | None = None
        self._path = PathDrawing(scene, size)

    def show(self, view: View, obstacles: Mapping[str, Shape], recording: Recording) -> None:
        """What there is to see after a tick."""
        self._arm.show(view.q, view.at_limit)
        self._ghosts.show(None if view.ghosts is None else view.ghosts.q)
        self._target.show(view.target)
        self._obstacles.show(obstacles, view)
        self._error.visible = view.position_error > VISIBLE_ERROR
        if self._error.visible:
            self._error.points = np.array([[view.tool.translation, view.target.translation]])
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


def light(scene: viser.SceneApi) -> None:
    """Plain lights: a map of the surroundings and shadows take a browser without a graphics card seconds a frame."""
    scene.configure_environment_map(None)
    scene.configure_default_lights(cast_shadow=False)
    scene.add_light_hemisphere("/light", sky_color=(255, 255, 255), ground_color=(170, 176, 186), intensity=1.0)


def add_surface(scene: viser.SceneApi, name: str, body: Body, opacity: float | None = None) -> viser.MeshHandle:
    """A body as a mesh of the scene."""
    return scene.add_mesh_simple(
        name,
        body.surface.vertices,
        body.surface.faces,
        color=body.colour,
        flat_shading=body.is_faceted,
        side="double",
        opacity=opacity,
    )


def put(node: Any, T: pin.SE3) -> None:
    """A node of the scene to a pose in its parent."""
    node.position, node.wxyz = T.translation, quaternion_from_matrix(T.rotation)


def frame_camera(camera: viser.InitialCameraConfig, robot: Robot) -> None:
    """Where the camera of a new tab stands: all of the arm and its reach are seen."""
    size = robot.length
    camera.position = (0.75 * size, -1.1 * size, 0.75 * size)
    camera.look_at = (0.2 * size, 0.05 * size, 0.28 * size)
    camera.fov = float(np.radians(45))
