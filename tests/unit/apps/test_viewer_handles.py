"""Gizmos in the viewer's scene: along the axes of the pose, or of the base."""

import asyncio
from types import SimpleNamespace

import numpy as np
import pytest

import maira_qp as mq
from maira_qp.orientation import matrix_from_quaternion, quaternion_from_matrix

pytest.importorskip("viser", reason="the viewer needs viser")


class Gizmo:
    """What viser's transform controls do for a handle."""

    def __init__(self) -> None:
        self.position, self.wxyz = np.zeros(3), np.array([1.0, 0, 0, 0])

    def on_update(self, callback) -> None:
        """Keep who is to hear of it."""
        self._callback = callback

    def drag(self, phase: str, position: np.ndarray, R: np.ndarray) -> None:
        """As a person's hand does."""
        self.position, self.wxyz = position, quaternion_from_matrix(R)
        asyncio.run(self._callback(SimpleNamespace(phase=phase)))


@pytest.mark.parametrize("has_base_axes", [False, True])
def test_what_a_gizmo_turns_by_turns_the_pose(has_base_axes, rng):
    from maira_qp.apps.viewer.drawing.handles import Handle

    gizmo, moved = Gizmo(), []
    handle = Handle(gizmo, moved.append)
    T = mq.pose(rng.uniform(-1, 1, 3), rpy=rng.uniform(-1, 1, 3))
    handle.show(T, has_base_axes)
    axes = matrix_from_quaternion(gizmo.wxyz)
    np.testing.assert_allclose(axes, np.eye(3) if has_base_axes else T.rotation, atol=1e-12)
    turn = mq.pose(rpy=[0, 0, 0.3]).rotation  # about the z axis that is drawn
    gizmo.drag("start", T.translation, axes)
    for share in (0.5, 1.0):
        way = share * axes[:, 0]
        partly = mq.pose(rpy=[0, 0, 0.3 * share]).rotation
        gizmo.drag("update", T.translation + way, axes @ partly)
        handle.show(mq.pose([9, 9, 9]), has_base_axes)  # while it is held nobody else moves it
    gizmo.drag("end", T.translation + axes[:, 0], axes @ turn)
    expected = turn @ T.rotation if has_base_axes else T.rotation @ turn
    np.testing.assert_allclose(moved[-1][:3, :3], expected, atol=1e-12)
    np.testing.assert_allclose(moved[-1][:3, 3], T.translation + axes[:, 0], atol=1e-12)
    handle.show(T, has_base_axes)
    np.testing.assert_allclose(gizmo.position, T.translation, atol=1e-12)
