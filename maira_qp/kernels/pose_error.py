"""The pose error by the quaternion logarithm: the compiled form of `maira_qp.orientation.pose_error`."""

from __future__ import annotations

import math

from maira_qp.kernels.compilation import kernel


@kernel
def pose_error(tool, target, e):
    """Error of a pose (12,), R by rows and p, against the target (12,) into e (6,): [p_d - p; 2 log(quat(R_d R^T))]."""
    e[0], e[1], e[2] = target[9] - tool[9], target[10] - tool[10], target[11] - tool[11]
    # M = R_d R^T
    m00 = target[0] * tool[0] + target[1] * tool[1] + target[2] * tool[2]
    m11 = target[3] * tool[3] + target[4] * tool[4] + target[5] * tool[5]
    m22 = target[6] * tool[6] + target[7] * tool[7] + target[8] * tool[8]
    # vee(M - M^T), from (R_d - R) R^T: no cancellation where the two are close
    d0, d1, d2 = target[0] - tool[0], target[1] - tool[1], target[2] - tool[2]
    d3, d4, d5 = target[3] - tool[3], target[4] - tool[4], target[5] - tool[5]
    d6, d7, d8 = target[6] - tool[6], target[7] - tool[7], target[8] - tool[8]
    sx = d6 * tool[3] + d7 * tool[4] + d8 * tool[5] - (d3 * tool[6] + d4 * tool[7] + d5 * tool[8])
    sy = d0 * tool[6] + d1 * tool[7] + d2 * tool[8] - (d6 * tool[0] + d7 * tool[1] + d8 * tool[2])
    sz = d3 * tool[0] + d4 * tool[1] + d5 * tool[2] - (d0 * tool[3] + d1 * tool[4] + d2 * tool[5])
    w, x, y, z = 1 + m00 + m11 + m22, 1 + m00 - m11 - m22, 1 - m00 + m11 - m22, 1 - m00 - m11 + m22
    if w >= x and w >= y and w >= z:
        x, y, z = sx, sy, sz
    else:
        m01 = target[0] * tool[3] + target[1] * tool[4] + target[2] * tool[5]
        m10 = target[3] * tool[0] + target[4] * tool[1] + target[5] * tool[2]
        m02 = target[0] * tool[6] + target[1] * tool[7] + target[2] * tool[8]
        m20 = target[6] * tool[0] + target[7] * tool[1] + target[8] * tool[2]
        m12 = target[3] * tool[6] + target[4] * tool[7] + target[5] * tool[8]
        m21 = target[6] * tool[3] + target[7] * tool[4] + target[8] * tool[5]
        if x >= y and x >= z:
            w, y, z = sx, m10 + m01, m02 + m20
        elif y >= z:
            w, x, z = sy, m10 + m01, m21 + m12
        else:
            w, x, y = sz, m02 + m20, m21 + m12
    if w < 0:
        w, x, y, z = -w, -x, -y, -z
    norm = math.sqrt(x * x + y * y + z * z)
    factor = 2 * math.atan2(norm, w) / norm if norm > 0 else 0.0
    e[3], e[4], e[5] = factor * x, factor * y, factor * z
