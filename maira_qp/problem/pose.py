"""Targets: rigid transformations from whatever a caller has, checked, and never silently bent."""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin

from maira_qp.arrays import real_array
from maira_qp.errors import PoseError
from maira_qp.orientation import matrix_from_quaternion, nearest_rotation, orthonormality_deviation

ORTHONORMAL_WITHIN = 1e-5
"""A matrix with |R R^T - I| below this is taken as its nearest rotation, a quaternion with ||q| - 1| below this as its
unit quaternion: what rounding to single precision leaves."""


def pose(
    position: Any = (0.0, 0.0, 0.0),
    *,
    quaternion: Any = None,
    rpy: Any = None,
    matrix: Any = None,
    project: bool = False,
) -> pin.SE3:
    """A target pose T_base_tool.

    Args:
        position: (3,) [m]; with a 4x4 `matrix` it must be left out.
        quaternion: (4,), scalar first (w, x, y, z), of unit length.
        rpy: (3,) [rad], roll, pitch and yaw about fixed axes, `Rz(yaw) Ry(pitch) Rx(roll)` as in URDF.
        matrix: (4, 4) transformation or (3, 3) rotation; orthonormal to 1e-5.
        project: take the nearest rotation to a rounded matrix (or quaternion) on purpose, however far it is.

    At most one of `quaternion`, `rpy` and `matrix`; without any the orientation is the identity.
    Raises `PoseError`.
    """
    orientations = {"quaternion": quaternion, "rpy": rpy, "matrix": matrix}
    given = [name for name, value in orientations.items() if value is not None]
    if len(given) > 1:
        raise PoseError(f"one orientation is enough, got {' and '.join(given)}")
    if matrix is not None and np.shape(matrix) == (4, 4):
        if tuple(np.shape(position)) != (3,) or np.any(np.asarray(position) != 0):
            raise PoseError("a 4x4 matrix holds its own position; leave out the argument `position`")
        return as_pose(matrix, project=project)
    p = real_array(position, (3,), "position", PoseError)
    if matrix is not None:
        R = real_array(matrix, (3, 3), "matrix (3x3, or 4x4)", PoseError)
    elif quaternion is not None:
        R = matrix_from_quaternion(_unit_quaternion(quaternion, project))
    elif rpy is not None:
        R = pin.rpy.rpyToMatrix(real_array(rpy, (3,), "rpy", PoseError))
    else:
        R = np.eye(3)
    return pin.SE3(_rotation(R, "matrix", project), p)


def as_pose(target: Any, *, project: bool = False) -> pin.SE3:
    """A checked `pin.SE3` from a `pin.SE3` or a 4x4 array. Raises `PoseError`."""
    T = real_array(target.homogeneous if isinstance(target, pin.SE3) else target, (4, 4), "target", PoseError)
    if not np.array_equal(T[3], (0.0, 0.0, 0.0, 1.0)):
        raise PoseError(f"the last row of a pose must be [0, 0, 0, 1], got {T[3].tolist()}")
    return pin.SE3(_rotation(T[:3, :3], "target", project), T[:3, 3].copy())


def _unit_quaternion(value: Any, project: bool) -> np.ndarray:
    q = real_array(value, (4,), "quaternion (w, x, y, z)", PoseError)
    largest = np.abs(q).max()
    if largest == 0:
        raise PoseError("a zero quaternion has no direction")
    norm = largest * np.linalg.norm(q / largest)
    if not project and abs(norm - 1) > ORTHONORMAL_WITHIN:
        raise PoseError(
            f"the quaternion's norm is {norm:.6g}, not 1 (order: w, x, y, z); "
            "to take the nearest unit quaternion on purpose: mq.pose(position, quaternion=q, project=True)"
        )
    q = q / largest
    return q / np.linalg.norm(q)


def _rotation(R: np.ndarray, name: str, project: bool) -> np.ndarray:
    """The rotation that R (3, 3) stands for. Raises `PoseError` where it stands for none."""
    scale = np.abs(R).max()
    singular_values = np.linalg.svd(R / scale, compute_uv=False) if scale > 0 else np.zeros(3)
    if singular_values[2] <= 1e-6 * singular_values[0]:
        raise PoseError(f"the rotation part of the {name} is singular: no rotation is nearest to it")
    if np.linalg.det(R / scale) < 0:
        raise PoseError(f"the rotation part of the {name} has a negative determinant: it is a reflection")
    deviation = orthonormality_deviation(R) if scale < 1e100 else np.inf
    if deviation > ORTHONORMAL_WITHIN and not project:
        raise PoseError(
            f"the rotation part of the {name} is not orthonormal: max |R R^T - I| = {deviation:.3g} "
            f"(allowed: {ORTHONORMAL_WITHIN:g}); "
            "to take the nearest rotation on purpose: mq.pose(matrix=T, project=True)"
        )
    return nearest_rotation(R / scale) if deviation > 1e-14 else R
