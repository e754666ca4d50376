"""Kinematics of a serial chain whose joints all move along or about their own z axis.

A chain of n joints is one array (n + 1, 15): row i holds the fixed placement of joint i in the frame before it, R by
rows [0:9] and p [9:12], then 1 for a prismatic and 0 for a revolute joint [12], and its limits [13], [14]; the last row
holds the placement of the tool behind the last joint.
"""

from __future__ import annotations

import numpy as np

from maira_qp.kernels.compilation import kernel
from maira_qp.kernels.sine import sine_cosine

ROW = 15
PRISMATIC, LOWER, UPPER = 12, 13, 14


@kernel
def forward(chain, q, axes, origins, tool):
    """Tool pose, R by rows and p, into `tool` (12,); joint axes and origins in base axes into their arrays (n, 3)."""
    n = len(q)
    r00, r01, r02, r10, r11, r12, r20, r21, r22 = 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0
    px, py, pz = 0.0, 0.0, 0.0
    for i in range(n + 1):
        row = chain[i]
        x, y, z = row[9], row[10], row[11]
        px += r00 * x + r01 * y + r02 * z
        py += r10 * x + r11 * y + r12 * z
        pz += r20 * x + r21 * y + r22 * z
        f00, f01, f02, f10, f11, f12, f20, f21, f22 = (
            row[0],
            row[1],
            row[2],
            row[3],
            row[4],
            row[5],
            row[6],
            row[7],
            row[8],
        )
        a, b, c = r00, r01, r02
        r00, r01, r02 = a * f00 + b * f10 + c * f20, a * f01 + b * f11 + c * f21, a * f02 + b * f12 + c * f22
        a, b, c = r10, r11, r12
        r10, r11, r12 = a * f00 + b * f10 + c * f20, a * f01 + b * f11 + c * f21, a * f02 + b * f12 + c * f22
        a, b, c = r20, r21, r22
        r20, r21, r22 = a * f00 + b * f10 + c * f20, a * f01 + b * f11 + c * f21, a * f02 + b * f12 + c * f22
        if i == n:
            break
        axes[i, 0], axes[i, 1], axes[i, 2] = r02, r12, r22
        if row[PRISMATIC] != 0.0:
            px += q[i] * r02
            py += q[i] * r12
            pz += q[i] * r22
        else:
            si, co = sine_cosine(q[i])
            r00, r01 = co * r00 + si * r01, co * r01 - si * r00
            r10, r11 = co * r10 + si * r11, co * r11 - si * r10
            r20, r21 = co * r20 + si * r21, co * r21 - si * r20
        origins[i, 0], origins[i, 1], origins[i, 2] = px, py, pz
    tool[0], tool[1], tool[2] = r00, r01, r02
    tool[3], tool[4], tool[5] = r10, r11, r12
    tool[6], tool[7], tool[8] = r20, r21, r22
    tool[9], tool[10], tool[11] = px, py, pz


@kernel
def jacobian(chain, axes, origins, tool, J):
    """Geometric Jacobian into J (n, 6), transposed: row i is [linear, angular] of joint i, base axes."""
    for i in range(len(axes)):
        x, y, z = axes[i, 0], axes[i, 1], axes[i, 2]
        if chain[i, PRISMATIC] != 0.0:
            J[i, 0], J[i, 1], J[i, 2] = x, y, z
            J[i, 3], J[i, 4], J[i, 5] = 0.0, 0.0, 0.0
        else:
            dx, dy, dz = tool[9] - origins[i, 0], tool[10] - origins[i, 1], tool[11] - origins[i, 2]
            J[i, 0], J[i, 1], J[i, 2] = y * dz - z * dy, z * dx - x * dz, x * dy - y * dx
            J[i, 3], J[i, 4], J[i, 5] = x, y, z


@kernel
def jacobians(chain, q, J):
    """Transposed Jacobians into J (N, n, 6) of the configurations q (N, n)."""
    n = q.shape[1]
    axes, origins, tool = np.empty((n, 3)), np.empty((n, 3)), np.empty(12)
    for k in range(len(q)):
        forward(chain, q[k], axes, origins, tool)
        jacobian(chain, axes, origins, tool, J[k])
