"""A rotation as three rotations about given axes a, b, c: both triples of angles, exact next to singularities too.

The steps and letters of `analytic.srs.geometry`, step 3. Source: Davenport, "Rotations about nonorthogonal axes", 1973.
"""

from __future__ import annotations

import numpy as np

from maira_qp.kernels.jit.decorators import device_kernel, kernel
from maira_qp.kernels.layout import Davenport
from maira_qp.kernels.spatial.vectors import cross, dot


@kernel
def davenport_angles(joint, R, reached_within, q):
    """The angles [rad] that make each of R (N, 3, 3) into q (N, 2, 3), tau = +1 first; NaN where the axes cannot.

    Up to `reached_within` [rad] a hole is none. Angles are in (-pi, pi] but the middle ones, which are not wrapped.
    """
    a, b, c = _vector(joint, Davenport.A), _vector(joint, Davenport.B), _vector(joint, Davenport.C)
    e = _vector(joint, Davenport.ACROSS)
    h, difference, total = cross(c, e), joint[Davenport.DIFFERENCE], joint[Davenport.SUM]
    for k in range(len(R)):
        y, turned = _times(R, k, c), _times(R, k, e)
        across = cross(a, y)
        gamma = np.arctan2(np.sqrt(dot(across, across)), dot(a, y))
        near = np.sin(0.5 * (gamma + difference)) * np.sin(0.5 * (gamma - difference))
        far = np.sin(0.5 * (total + gamma)) * np.sin(0.5 * (total - gamma))
        theta = 2.0 * np.arctan2(np.sqrt(max(near, 0.0)), np.sqrt(max(far, 0.0)))
        if not max(abs(difference) - gamma, gamma - (np.pi - abs(np.pi - total))) <= reached_within:
            theta = np.nan
        for branch in range(2):
            middle = joint[Davenport.PHASE] + (1.0 - 2.0 * branch) * theta
            x = cross(a, _turned(b, middle, c))  # short near a singularity, as `across` is, but of exact direction
            first = np.arctan2(dot(cross(a, x), across), dot(x, across))
            left = _turned(b, -middle, _turned(a, -first, turned))
            q[k, branch, 0], q[k, branch, 1] = first, middle
            q[k, branch, 2] = np.arctan2(dot(left, h), dot(left, e))


@device_kernel
def _vector(row, k):
    return row[k], row[k + 1], row[k + 2]


@device_kernel
def _times(R, k, v):
    return (
        R[k, 0, 0] * v[0] + R[k, 0, 1] * v[1] + R[k, 0, 2] * v[2],
        R[k, 1, 0] * v[0] + R[k, 1, 1] * v[1] + R[k, 1, 2] * v[2],
        R[k, 2, 0] * v[0] + R[k, 2, 1] * v[1] + R[k, 2, 2] * v[2],
    )


@device_kernel
def _turned(axis, angle, v):
    """A vector turned about a unit axis (Rodrigues)."""
    s, half = np.sin(angle), np.sin(0.5 * angle)
    w = cross(axis, v)
    u = cross(axis, w)
    c = 2.0 * half * half
    return v[0] + s * w[0] + c * u[0], v[1] + s * w[1] + c * u[1], v[2] + s * w[2] + c * u[2]
