"""Targets: rigid transformations from whatever a caller has, checked, and never silently bent."""

from __future__ import annotations

import logging
import math
from typing import Any

import numpy as np
import pinocchio as pin

from maira_qp.arrays import is_listing, is_native, real_array
from maira_qp.errors import OptionError, PoseError, shown
from maira_qp.orientation import (
    ORTHONORMAL_WITHIN,
    ROUNDED_WITHIN,
    exact_rotation,
    matrix_from_quaternion,
    rigid,
    rigid_or_point,
    rounding_of,
)
from maira_qp.robots.unit_hints import degrees_hint_of_angles

log = logging.getLogger(__name__)

PLACE_WITHIN = 1e-9
"""A rotation as near to one is good enough for where an obstacle is."""

LAST = [0.0, 0.0, 0.0, 1.0]

ROUNDED = "max |R R^T - I| of the target is %.2g: the nearest rotation is taken"


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
        quaternion: (4,), scalar first (w, x, y, z), of unit length to 2e-3, as three decimals leave it.
        rpy: (3,) [rad], roll, pitch and yaw about fixed axes, `Rz(yaw) Ry(pitch) Rx(roll)` as in URDF.
        matrix: (4, 4) transformation or (3, 3) rotation; max |R R^T - I| <= 2e-3, as three decimals leave it.
        project: take the nearest rotation to a matrix (or quaternion) on purpose, however far it is.

    The nearest rotation to what was rounded is taken; above 1e-5 the deviation is logged, and `Solution` has it as
    `target_deviation` where an array was the target. At most one of `quaternion`, `rpy` and `matrix`; without any the
    orientation is the identity.
    Raises `PoseError`.

    ```python
    from math import pi

    import maira_qp as mq

    mq.pose([0.4, 0.2, 0.9])
    mq.pose([0.4, 0.2, 0.9], quaternion=[0, 1, 0, 0])  # looking down
    mq.pose([0.4, 0.2, 0.9], rpy=[pi, 0, 0])  # the same
    ```
    """
    orientations = {"quaternion": quaternion, "rpy": rpy, "matrix": matrix}
    given = [name for name, value in orientations.items() if value is not None]
    if len(given) > 1:
        raise PoseError(f"one orientation is enough, got {' and '.join(given)}")
    if not isinstance(project, (bool, np.bool_)):
        raise PoseError(f"project must be True or False, got {shown(project)}")
    p = real_array(position, (3,), "position", PoseError)
    if matrix is not None and _has_four_rows(matrix):
        if p.any():
            raise PoseError("a 4x4 matrix holds its own position; leave out the argument `position`")
        return as_pose(matrix, "matrix", project=project)
    if matrix is not None:
        R = real_array(matrix, (3, 3), "matrix (3x3, or 4x4)", PoseError)
    elif quaternion is not None:
        R = matrix_from_quaternion(_unit_quaternion(quaternion, project))
    elif rpy is not None:
        angles = real_array(rpy, (3,), "rpy", PoseError)
        hint = degrees_hint_of_angles(angles, "rpy")
        if hint:
            log.warning(hint)
        R = pin.rpy.rpyToMatrix(angles)
    else:
        R = np.eye(3)
    exact = exact_rotation(R, "matrix", project=project)
    _tell(rounding_of(R), ROUNDED)
    return pin.SE3(exact, p)


def _has_four_rows(matrix: Any) -> bool:
    """Whether a matrix is to hold a position too."""
    return is_listing(matrix) and hasattr(matrix, "__len__") and len(matrix) == 4


def as_pose(target: Any, name: str = "target", *, project: bool = False) -> pin.SE3:
    """A checked `pin.SE3` from a `pin.SE3` or a 4x4 array. Raises `PoseError`, with `name` in it."""
    given = target.homogeneous if isinstance(target, pin.SE3) else target
    T = rigid(given, name, project=project)
    _tell(rounding_of(given), ROUNDED)
    return pin.SE3(T[:3, :3].copy(), T[:3, 3].copy())


def as_place(value: Any, name: str) -> pin.SE3:
    """Where a body is, a pose or a point (3,): at once if the rotation is one to `PLACE_WITHIN`. Raises `PoseError`."""
    T = np.ascontiguousarray(value.homogeneous) if isinstance(value, pin.SE3) else value
    if not is_native(T, (4, 4)):
        return as_pose(rigid_or_point(value, name), name)
    (a, b, c, x), (d, e, f, y), (g, h, i, z), last = T.tolist()
    lengths = abs(a * a + b * b + c * c - 1), abs(d * d + e * e + f * f - 1), abs(g * g + h * h + i * i - 1)
    angles = abs(a * d + b * e + c * f), abs(a * g + b * h + c * i), abs(d * g + e * h + f * i)
    turned = a * (e * i - f * h) + b * (f * g - d * i) + c * (d * h - e * g)
    off = max(*lengths, *angles)
    if off < PLACE_WITHIN and turned > 0 and math.isfinite(x + y + z) and last == LAST:
        return pin.SE3(T)
    return as_pose(value, name)


def deviation_of(quaternion: Any = None, matrix: Any = None) -> float:
    """How far an orientation that `pose` takes is from a rotation, if that is to be told; 0 within 1e-5.

    ||q| - 1| of a quaternion (4,), max |R R^T - I| of a matrix (3, 3) or (4, 4).
    """
    if matrix is not None:
        return rounding_of(matrix)
    deviation = 0.0 if quaternion is None else abs(float(np.linalg.norm(quaternion)) - 1)
    return deviation if deviation > ORTHONORMAL_WITHIN else 0.0


def _tell(deviation: float, message: str) -> None:
    if deviation > ORTHONORMAL_WITHIN:
        log.info(message, deviation)


def _unit_quaternion(value: Any, project: bool) -> np.ndarray:
    q = real_array(value, (4,), "quaternion (w, x, y, z)", PoseError)
    largest = np.abs(q).max()
    if largest == 0:
        raise PoseError("the quaternion is zero: it has no direction")
    norm = largest * np.linalg.norm(q / largest)
    deviation = abs(norm - 1)
    if not project and deviation > ROUNDED_WITHIN:
        raise PoseError(
            f"the quaternion's norm is {norm:.6g}, not 1 (order: w, x, y, z)",
            python="to take the unit quaternion on purpose: mq.pose(position, quaternion=q, project=True)",
            shell="to take the unit quaternion on purpose: --project",
        )
    _tell(deviation, "the quaternion's norm is off 1 by %.2g: its unit quaternion is taken")
    q = q / largest
    return q / np.linalg.norm(q)


def unit_vector(value: Any, name: str) -> np.ndarray:
    """A direction (3,) of length 1. Raises `OptionError`."""
    v = real_array(value, (3,), name, OptionError)
    largest = np.abs(v).max()
    if largest == 0:
        raise OptionError(f"{name} has no direction: it is zero")
    v = v / largest
    return v / np.linalg.norm(v)
