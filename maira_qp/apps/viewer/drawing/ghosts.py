"""All solutions as arms that can be seen through, coloured by cost; a click on one is a wish to go there."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import viser

from maira_qp.apps.viewer.answers import Ghosts
from maira_qp.apps.viewer.drawing.geometry import Body, Colour
from maira_qp.orientation import quaternion_from_matrix
from maira_qp.robots.model.robot import Robot

BEST, MIDDLE, WORST = np.array([47, 158, 68]), np.array([245, 159, 0]), np.array([201, 42, 42])
"""Colours of the least cost, one half way and the largest."""
OPACITY = 0.22
SMALLER = 1 / 1.01
"""A ghost is so much smaller than the arm: of surfaces in the same place each would flicker through the other."""


def ghost_colour(rank: float) -> Colour:
    """Of a cost between the least, 0, and the largest, 1."""
    first, last, share = (BEST, MIDDLE, 2 * rank) if rank < 0.5 else (MIDDLE, WORST, 2 * rank - 1)
    red, green, blue = np.round((1 - share) * first + share * last).astype(int).tolist()
    return red, green, blue


class GhostDrawing:
    """An arm many times over."""

    def __init__(self, scene: viser.SceneApi, robot: Robot, bodies: list[Body], clicked: Callable[[int], None]) -> None:
        """`clicked` is called with the index of a solution."""
        self._scene, self._robot, self._clicked = scene, robot, clicked
        self._bodies = [body for body in bodies if body.link != robot.base]
        self._shown: Ghosts | None = None
        self._handles: list[viser.BatchedMeshHandle] = []

    def show(self, ghosts: Ghosts | None) -> None:
        """The same again costs nothing; None: no ghosts."""
        if ghosts is self._shown:
            return
        self._shown = ghosts
        for handle in self._handles:
            handle.remove()
        self._handles = [] if ghosts is None or not len(ghosts.shown) else self._drawn(ghosts)

    def _drawn(self, ghosts: Ghosts) -> list[viser.BatchedMeshHandle]:
        states = [self._robot.at(q) for q in ghosts.q]
        colours = np.array([ghost_colour(rank) for rank in ghosts.ranks.tolist()], dtype=np.uint8)
        handles = []
        for i, body in enumerate(self._bodies):
            poses = [at.placement(body.link) for at in states]
            handle = self._scene.add_batched_meshes_simple(
                f"/ghosts/{i}",
                body.surface.vertices,
                body.surface.faces,
                np.array([quaternion_from_matrix(T.rotation) for T in poses]),
                np.array([T.translation for T in poses]),
                batched_scales=np.full(len(poses), SMALLER),
                batched_colors=colours,
                opacity=OPACITY,
                cast_shadow=False,
                receive_shadow=False,
            )
            self._listen(handle)
            handles.append(handle)
        return handles

    def _listen(self, handle: viser.BatchedMeshHandle) -> None:
        @handle.on_click
        def _(event: viser.SceneNodePointerEvent) -> None:
            if event.instance_index is not None:
                self._clicked(event.instance_index)
