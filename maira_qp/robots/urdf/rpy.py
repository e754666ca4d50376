"""Roll, pitch and yaw as URDF defines them: fixed axes x, y, z in this order, `R = Rz(yaw) Ry(pitch) Rx(roll)`."""

from __future__ import annotations

import math

import numpy as np

_NOISE = 1e-15
"""Sines and cosines below this are rounding noise of an angle that is meant to be a multiple of pi/2."""


def cosine_sine(angle: float) -> tuple[float, float]:
    """Cosine and sine of an angle [rad], with exact zeros and ones at the multiples of pi/2."""
    c, s = math.cos(angle), math.sin(angle)
    if abs(c) < _NOISE:
        return 0.0, math.copysign(1.0, s)
    if abs(s) < _NOISE and angle != s:  # a tiny angle is its own sine and is meant
        return math.copysign(1.0, c), 0.0
    return c, s


def matrix_from_rpy(rpy: np.ndarray) -> np.ndarray:
    """Rotation matrix (3, 3) of the roll, pitch and yaw (3,) [rad]."""
    (cr, sr), (cp, sp), (cy, sy) = (cosine_sine(float(angle)) for angle in rpy)
    return np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )


def rpy_from_matrix(R: np.ndarray) -> np.ndarray:
    """Roll, pitch and yaw (3,) [rad] of a rotation matrix (3, 3), exact to rounding at every rotation.

    Near a pitch of ±pi/2 yaw and roll are not determined one by one. Yaw is then whatever its arc tangent gives, and
    roll is read off `Rz(-yaw) R`, so that the three together still give R (Slabaugh, "Computing Euler angles from a
    rotation matrix", 1999, names the ambiguity).
    """
    yaw = math.atan2(R[1, 0], R[0, 0])
    c, s = cosine_sine(yaw)
    pitch = math.atan2(-R[2, 0], c * R[0, 0] + s * R[1, 0])
    roll = math.atan2(s * R[0, 2] - c * R[1, 2], c * R[1, 1] - s * R[0, 1])
    return np.array([roll, pitch, yaw]) + 0.0  # no -0.0
