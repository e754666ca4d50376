"""The path in the scene: a line, green where it is followed and red where it is not, and a point at each failure."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import viser

from maira_qp.apps.viewer.drawing.geometry import Colour
from maira_qp.apps.viewer.paths.followed import Followed, PathView
from maira_qp.apps.viewer.paths.route import Route
from maira_qp.orientation import quaternion_from_matrix

FOLLOWED: Colour = (47, 158, 68)
LOST: Colour = (224, 49, 49)
UNKNOWN: Colour = (76, 110, 245)
MOST_SEGMENTS = 2000
MOST_POINTS = 400
FRAMES = 40
"""Most corners whose axes are drawn."""


class PathDrawing:
    """The poses of a path, drawn anew when they or what is known of them changes."""

    def __init__(self, scene: viser.SceneApi, size: float) -> None:
        """For an arm of a length [m]."""
        self._scene, self._size = scene, size
        self._shown: tuple[object, object] = None, None
        self._handles: list[viser.SceneNodeHandle] = []

    def show(self, view: PathView) -> None:
        """The same again costs nothing."""
        shown = view.route, None if view.followed is None else view.followed.solution
        if shown == self._shown:
            return
        self._shown = shown
        for handle in self._handles:
            handle.remove()
        self._handles = []
        if len(view.route):
            self._draw_axes(view.route)
            self._draw_line(view.route, view.followed)
            if view.followed is not None and view.followed.failures:
                self._draw_failures(view.route, view.followed)

    def _draw_axes(self, route: Route) -> None:
        """Of corners, or where the path begins."""
        poses = (route.given if route.kind == "corners" else route.poses[:1])[:FRAMES]
        self._handles.append(
            self._scene.add_batched_axes(
                "/path/axes",
                np.array([quaternion_from_matrix(T[:3, :3]) for T in poses]),
                poses[:, :3, 3],
                axes_length=0.04 * self._size,
                axes_radius=0.002 * self._size,
            )
        )

    def _draw_line(self, route: Route, path: Followed | None) -> None:
        """Two lines: a page takes the colours of single segments for linear ones, and shows them paler."""
        begins, ends, lost = segments(len(route), None if path is None else path.lost)
        lines = np.stack([route.poses[begins, :3, 3], route.poses[ends, :3, 3]], axis=1)
        known = UNKNOWN if path is None else FOLLOWED
        for name, chosen, colour, width in ("line", ~lost, known, 0.005), ("lost", lost, LOST, 0.007):
            if chosen.any():
                self._handles.append(
                    self._scene.add_line_segments(f"/path/{name}", lines[chosen], colour, thickness=width * self._size)
                )

    def _draw_failures(self, route: Route, path: Followed) -> None:
        """The first is named."""
        indices = thinned(list(path.failures), MOST_POINTS)
        points = route.poses[indices, :3, 3]
        self._handles.append(
            self._scene.add_point_cloud(
                "/path/failures",
                points,
                LOST,
                point_size=0.012 * self._size,
                point_shape="circle",
                precision="float32",
                point_shading="flat",
            )
        )
        first = path.solution.first_failure
        if first is not None:
            self._handles.append(
                self._scene.add_label(
                    "/path/first failure",
                    f"pose {first}",
                    position=route.poses[first, :3, 3],
                    anchor="bottom-center",
                    font_screen_scale=0.8,
                )
            )


def segments(count: int, lost: np.ndarray | None) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """First and last poses (m,) of at most `MOST_SEGMENTS` segments of a path of so many poses, and whether it is lost
    anywhere on each (m,), by `Followed.lost` (count - 1,)."""
    edges = np.unique(np.linspace(0, max(count - 1, 0), min(count, MOST_SEGMENTS + 1)).astype(int))
    begins, ends = edges[:-1], edges[1:]
    if lost is None or not len(begins):
        return begins, ends, np.zeros(len(begins), dtype=bool)
    return begins, ends, np.logical_or.reduceat(lost, begins)


def thinned(indices: Sequence[int], most: int) -> list[int]:
    """At most so many of some indices, evenly chosen, the first and the last among them."""
    chosen = np.unique(np.linspace(0, len(indices) - 1, min(len(indices), most)).astype(int))
    return [indices[k] for k in chosen]
