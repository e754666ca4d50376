"""Rotations by unit quaternions: from matrices, product, logarithm, exponential, and the pose error.

Quaternions are scalar first, (w, x, y, z). The logarithm of a unit quaternion (w, v) is the vector
`atan2(|v|, w) v / |v|`, half of the rotation vector; `atan2` keeps it exact at both ends of the range, where `acos` and
`asin` lose half of the digits (Sola, "Quaternion kinematics for the error-state Kalman filter", 2017, section 2).
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from maira_qp.arrays import is_listing, real_array
from maira_qp.errors import PoseError

ORTHONORMAL_WITHIN = 1e-5
"""A matrix with |R R^T - I| below this is taken as its nearest rotation, a quaternion with ||q| - 1| below this as its
unit quaternion, without a word: what rounding to single precision leaves."""
ROUNDED_WITHIN = 2e-3
"""Up to this they are too, and results say so: three decimals leave 1.8e-3 of a matrix, 1e-3 of a quaternion."""
A_POSE = "a pose (pin.SE3, (4, 4) array, mq.pose([x, y, z]) or mq.pose([x, y, z], quaternion=[w, x, y, z]))"
"""What is valid as one, for messages."""


def quaternion_from_matrix(R: np.ndarray) -> np.ndarray:
    """Unit quaternion (4,), w >= 0, of a rotation matrix (3, 3).

    The largest of the four components is computed first and the rest from it, so that no division is by a small
    number (Shepperd, "Quaternion from rotation matrix", 1978).
    """
    skew = (R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1])
    return np.array(_quaternion(R, skew))


def _quaternion(R: np.ndarray, skew: tuple[float, float, float]) -> tuple[float, float, float, float]:
    """The quaternion of R, w >= 0, with `skew` = vee(R - R^T) given apart (it may be known more exactly than R is)."""
    (r00, r01, r02), (r10, r11, r12), (r20, r21, r22) = R.tolist()
    s0, s1, s2 = skew
    # four times the squares of w, x, y, z
    squares = (1 + r00 + r11 + r22, 1 + r00 - r11 - r22, 1 - r00 + r11 - r22, 1 - r00 - r11 + r22)
    largest = max(squares)
    pivot = squares.index(largest)
    if pivot == 0:
        q = (largest, s0, s1, s2)
    elif pivot == 1:
        q = (s0, largest, r10 + r01, r02 + r20)
    elif pivot == 2:
        q = (s1, r10 + r01, largest, r21 + r12)
    else:
        q = (s2, r02 + r20, r21 + r12, largest)
    scale = math.copysign(1.0 / math.hypot(*q), q[0])
    return (q[0] * scale, q[1] * scale, q[2] * scale, q[3] * scale)


def matrix_from_quaternion(quaternion: np.ndarray) -> np.ndarray:
    """Rotation matrix (3, 3) of a unit quaternion (4,)."""
    w, x, y, z = quaternion
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def quaternion_product(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Hamilton product (4,) of two quaternions (4,): the rotation b, then a."""
    aw, ax, ay, az = a
    bw, bx, by, bz = b
    return np.array(
        [
            aw * bw - ax * bx - ay * by - az * bz,
            aw * bx + ax * bw + ay * bz - az * by,
            aw * by - ax * bz + ay * bw + az * bx,
            aw * bz + ax * by - ay * bx + az * bw,
        ]
    )


def quaternion_log(quaternion: np.ndarray) -> np.ndarray:
    """Logarithm (3,) of a unit quaternion (4,): half of the rotation vector, the short way round, norm <= pi / 2."""
    return np.array(_log(*quaternion))


def _log(w: float, x: float, y: float, z: float) -> tuple[float, float, float]:
    if w < 0:
        w, x, y, z = -w, -x, -y, -z
    norm = math.hypot(x, y, z)
    factor = math.atan2(norm, w) / norm if norm > 0 else 1.0
    return (factor * x, factor * y, factor * z)


def quaternion_exp(u: np.ndarray) -> np.ndarray:
    """Unit quaternion (4,) whose logarithm is u (3,): the inverse of `quaternion_log` for |u| <= pi / 2."""
    x, y, z = u
    norm = math.hypot(x, y, z)
    factor = math.sin(norm) / norm if norm > 0 else 1.0
    return np.array([math.cos(norm), factor * x, factor * y, factor * z])


def orientation_error(R: np.ndarray, R_d: np.ndarray) -> np.ndarray:
    """Rotation vector (3,) [rad] that takes R (3, 3) to R_d (3, 3) in base axes: `2 log(quat(R_d R^T))`.

    The skew part of R_d R^T is computed as that of (R_d - R) R^T, which is the same and has no cancellation when the
    two are close: the error is exact to the last digits of the matrices however small it is.
    """
    D = (R_d - R) @ R.T
    skew = (D[2, 1] - D[1, 2], D[0, 2] - D[2, 0], D[1, 0] - D[0, 1])
    x, y, z = _log(*_quaternion(R_d @ R.T, skew))
    return np.array([2 * x, 2 * y, 2 * z])


def skew(v: np.ndarray) -> np.ndarray:
    """`skew(v) @ x = v x x`, (3, 3)."""
    x, y, z = v.tolist()
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def pose_error(T: Any, T_d: Any) -> np.ndarray:
    """Error (6,) of a pose T against the desired T_d, in base axes: [p_d - p in m; orientation error in rad].

    Poses are (4, 4) arrays or `pin.SE3`. Raises `PoseError` for what is neither.
    """
    T, T_d = (
        real_array(getattr(pose, "homogeneous", pose), (4, 4), name, PoseError, finite=None, wanted=A_POSE)
        for pose, name in ((T, "T"), (T_d, "T_d"))
    )
    return np.concatenate([T_d[:3, 3] - T[:3, 3], orientation_error(T[:3, :3], T_d[:3, :3])])


def orthonormality_deviation(R: np.ndarray) -> float:
    """How far a matrix (3, 3) is from orthonormal: the largest entry of |R R^T - I|."""
    with np.errstate(over="ignore", invalid="ignore"):
        return float(np.abs(R @ R.T - np.eye(3)).max())


def rounding_of(matrix: Any) -> float:
    """How far the rotation part of a matrix (3, 3) or (4, 4) from a caller is from orthonormal, if that is to be told.

    0 within `ORTHONORMAL_WITHIN`.
    """
    deviation = orthonormality_deviation(np.asarray(matrix, dtype=float)[:3, :3])
    return deviation if deviation > ORTHONORMAL_WITHIN else 0.0


def nearest_rotation(M: np.ndarray) -> np.ndarray:
    """The rotation (3, 3) nearest to M (3, 3), det M > 0, in the Frobenius norm: the orthogonal polar factor, by SVD.

    Source: Higham, "Computing the polar decomposition", 1986, section 2.
    """
    U, _, Vt = np.linalg.svd(M)
    return U @ Vt


def exact_rotation(R: np.ndarray, name: str, *, project: bool = False) -> np.ndarray:
    """The rotation (3, 3) that a matrix (3, 3) from a caller stands for; `project`: however far it is from one.

    Raises `PoseError`, with `name` in it, for a reflection, for a singular matrix, and without `project` for one that
    is not orthonormal to `ROUNDED_WITHIN`.
    """
    scale = np.abs(R).max()
    deviation = orthonormality_deviation(R) if scale < 1e100 else math.inf
    if deviation > ORTHONORMAL_WITHIN:
        singular_values = np.linalg.svd(R / scale, compute_uv=False) if scale > 0 else np.zeros(3)
        if singular_values[2] <= 1e-6 * singular_values[0]:
            raise PoseError(f"the rotation part of the {name} is singular: no rotation is nearest to it")
    if np.linalg.det(R / scale) < 0:
        raise PoseError(f"the rotation part of the {name} has a negative determinant: it is a reflection")
    if deviation > ROUNDED_WITHIN and not project:
        raise PoseError(
            f"the rotation part of the {name} is not orthonormal: max |R R^T - I| = {deviation:.3g} "
            f"(allowed: {ROUNDED_WITHIN:g}, as of three decimals)",
            python="to take the nearest rotation on purpose: mq.pose(matrix=T, project=True)",
            shell="to take the nearest rotation on purpose: --project",
        )
    return nearest_rotation(R / scale) if deviation > 1e-14 else R


def rigid(matrix: Any, name: str, *, project: bool = False) -> np.ndarray:
    """A homogeneous transformation (4, 4) from a caller, its rotation part made exact. Raises `PoseError`."""
    T = real_array(matrix, (4, 4), name, PoseError, wanted=A_POSE)
    if not np.array_equal(T[3], (0.0, 0.0, 0.0, 1.0)):
        raise PoseError(f"the last row of the {name} must be [0, 0, 0, 1], got {T[3].tolist()}")
    T[:3, :3] = exact_rotation(T[:3, :3], name, project=project)
    return T


def rigid_or_point(value: Any, name: str) -> np.ndarray:
    """`rigid` of a `pin.SE3` or (4, 4); of a point (3,) [m] the pose (4, 4) there, turned by nothing.

    Raises `PoseError`.
    """
    value = getattr(value, "homogeneous", value)
    if not (is_listing(value) and hasattr(value, "__len__") and len(value) and not any(map(is_listing, value))):
        return rigid(value, name)
    T = np.eye(4)
    T[:3, 3] = real_array(value, (3,), name, PoseError, wanted=f"{A_POSE}, or a point (3,)")
    return T


def rotation_between(a: np.ndarray, d: np.ndarray) -> np.ndarray:
    """Rotation vector (3,) [rad] that takes the unit vector a (3,) to d (3,) the short way; half a turn has many."""
    across, along = skew(a) @ d, float(a @ d)
    sine = math.hypot(*across.tolist())
    if sine < 1e-12 and along < 0:
        across = skew(a)[:, np.abs(a).argmin()]
        return math.pi * across / np.linalg.norm(across)
    return across * (math.atan2(sine, along) / sine) if sine > 0 else np.zeros(3)
