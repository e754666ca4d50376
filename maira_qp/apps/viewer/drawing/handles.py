"""Gizmos: what is dragged in the scene."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pinocchio as pin
import viser

from maira_qp.orientation import matrix_from_quaternion, quaternion_from_matrix


class Handle:
    """Something that is dragged; while it is, nobody else moves it.

    Its arrows lie along the axes of the pose, or along those of the base: then what it turns by since it was grasped
    turns the pose.
    """

    def __init__(self, gizmo: viser.TransformControlsHandle, moved: Callable[[np.ndarray], None]) -> None:
        """`moved` is called with the pose (4, 4)."""
        self._gizmo = gizmo
        self._has_base_axes = False
        self._is_held = False
        self._rotation = self._grasped = np.eye(3)

        @gizmo.on_update
        async def _(event: viser.TransformControlsEvent) -> None:  # async: in the order of the events
            if not self._is_held:
                self._grasped = self._rotation
            self._is_held = event.phase != "end"
            if event.phase != "start":
                T = np.eye(4)
                T[:3, :3], T[:3, 3] = matrix_from_quaternion(gizmo.wxyz), gizmo.position
                if self._has_base_axes:
                    T[:3, :3] = T[:3, :3] @ self._grasped
                moved(T)

    def show(self, T: pin.SE3, has_base_axes: bool = False) -> None:
        """Put it to a pose, unless it is held."""
        if not self._is_held:
            self._rotation, self._has_base_axes = T.rotation, has_base_axes
            put(self._gizmo, pin.SE3(np.eye(3), T.translation) if has_base_axes else T)

    def remove(self) -> None:
        """And what hangs on it."""
        self._gizmo.remove()


def put(node: Any, T: pin.SE3) -> None:
    """A node of the scene to a pose in its parent."""
    node.position, node.wxyz = T.translation, quaternion_from_matrix(T.rotation)
