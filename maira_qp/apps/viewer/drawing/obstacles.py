"""Solids to be dragged and turned, a line from each to the nearest point of the arm, and how long it is."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np
import viser

from maira_qp.apps.viewer.drawing.geometry import Body, Colour
from maira_qp.apps.viewer.drawing.handles import Handle
from maira_qp.apps.viewer.drawing.surfaces import add_surface
from maira_qp.apps.viewer.drawing.surroundings import MARGIN
from maira_qp.apps.viewer.drawing.triangles import triangles
from maira_qp.apps.viewer.view import View
from maira_qp.robots.collision.shapes import Shape

RED: Colour = (224, 49, 49)
AMBER: Colour = (240, 140, 0)
GREEN: Colour = (47, 158, 68)
GIZMO = 0.15
"""Size of a gizmo, in lengths of the arm."""


class Obstacles:
    """What stands around the arm."""

    def __init__(self, scene: viser.SceneApi, size: float, moved: Callable[[str, np.ndarray], None]) -> None:
        """For an arm of a length [m]; `moved` is called with the name of an obstacle and its pose (4, 4)."""
        self._scene, self._size, self._moved = scene, size, moved
        self._count = 0
        self._shapes: dict[str, Shape] = {}
        self._handles: dict[str, Handle] = {}
        self._meshes: dict[str, viser.MeshHandle] = {}
        self._lines: dict[str, tuple[viser.LineSegmentsHandle, viser.LabelHandle]] = {}

    def show(self, obstacles: Mapping[str, Shape], view: View) -> None:
        """The obstacles by their names, and the distances that are known."""
        for name in [name for name, shape in self._shapes.items() if not _is_alike(shape, obstacles.get(name))]:
            self._remove(name)
        for name, shape in obstacles.items():
            if name not in self._handles:
                self._add(name, shape)
            self._shapes[name] = shape
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
        self._count += 1
        node = f"/obstacles/{self._count}-{name}"
        gizmo = self._scene.add_transform_controls(
            node, scale=GIZMO * self._size, disable_sliders=True, depth_test=False, opacity=0.6, line_width=1.5
        )
        body = Body(name, triangles(replace(shape, pose=None)), AMBER, False)  # type: ignore[type-var]
        self._meshes[name] = add_surface(self._scene, f"{node}/body", body, opacity=0.75)
        self._handles[name] = Handle(gizmo, lambda T: self._moved(name, T))
        line = self._scene.add_line_segments(
            f"/distances/{name}", np.zeros((1, 2, 3)), GREEN, thickness=0.003 * self._size
        )
        label = self._scene.add_label(f"/labels/{name}", "", anchor="bottom-center", font_screen_scale=0.8)
        self._lines[name] = line, label

    def _remove(self, name: str) -> None:
        del self._shapes[name], self._meshes[name]
        self._handles.pop(name).remove()
        for handle in self._lines.pop(name):
            handle.remove()


def _is_alike(shape: Shape, other: Shape | None) -> bool:
    """Both are drawn in the same way, wherever they stand."""
    if shape is other:
        return True
    if type(shape) is not type(other):
        return False
    sizes = [{key: value for key, value in vars(one).items() if "pose" not in key} for one in (shape, other)]
    return sizes[0] == sizes[1]
