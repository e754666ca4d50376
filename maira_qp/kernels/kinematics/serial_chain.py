"""Kinematics of a serial chain whose joints all move along or about their own z axis.

A chain of n joints is one array (n + 1, 17): row i holds the fixed placement of joint i in the frame before it, R by
rows [0:9] and p [9:12], then 1 for a prismatic and 0 for a revolute joint [12], its limits [13], [14], and the range
that random configurations are drawn from [15], [16]; the last row holds the placement of the tool behind the last
joint.

The other arrays are of one configuration, or, with a last axis of `LANES`, of eight: see `lanes`.
"""

from __future__ import annotations

import numpy as np

from maira_qp.kernels.jit.arena import Arena
from maira_qp.kernels.jit.decorators import kernel
from maira_qp.kernels.jit.simd import broadcast, load, load2, store, store2
from maira_qp.kernels.jit.simd_trig import sine_cosine
from maira_qp.kernels.layout import Joint

KINEMATICS = Arena("Kinematics", "n", floats={"axes": "n, 3", "origins": "n, 3", "tool": "12", "e": "6"})
"""Of one configuration of n joints, and its pose error."""
Kinematics, carve_kinematics = KINEMATICS.Arrays, KINEMATICS.carve


@kernel
def forward(chain, q, axes, origins, tool):
    """Tool pose, R by rows and p, into `tool` (12,); joint axes and origins in base axes into their arrays (n, 3)."""
    n = len(q)
    r00, r01, r02 = broadcast(q, 1.0), broadcast(q, 0.0), broadcast(q, 0.0)
    r10, r11, r12 = broadcast(q, 0.0), broadcast(q, 1.0), broadcast(q, 0.0)
    r20, r21, r22 = broadcast(q, 0.0), broadcast(q, 0.0), broadcast(q, 1.0)
    px, py, pz = broadcast(q, 0.0), broadcast(q, 0.0), broadcast(q, 0.0)
    for i in range(n + 1):
        x, y, z = chain[i, 9], chain[i, 10], chain[i, 11]
        px = px + (r00 * x + r01 * y + r02 * z)
        py = py + (r10 * x + r11 * y + r12 * z)
        pz = pz + (r20 * x + r21 * y + r22 * z)
        f00, f01, f02 = chain[i, 0], chain[i, 1], chain[i, 2]
        f10, f11, f12 = chain[i, 3], chain[i, 4], chain[i, 5]
        f20, f21, f22 = chain[i, 6], chain[i, 7], chain[i, 8]
        a, b, c = r00, r01, r02
        r00, r01, r02 = a * f00 + b * f10 + c * f20, a * f01 + b * f11 + c * f21, a * f02 + b * f12 + c * f22
        a, b, c = r10, r11, r12
        r10, r11, r12 = a * f00 + b * f10 + c * f20, a * f01 + b * f11 + c * f21, a * f02 + b * f12 + c * f22
        a, b, c = r20, r21, r22
        r20, r21, r22 = a * f00 + b * f10 + c * f20, a * f01 + b * f11 + c * f21, a * f02 + b * f12 + c * f22
        if i == n:
            break
        store2(axes, i, 0, r02)
        store2(axes, i, 1, r12)
        store2(axes, i, 2, r22)
        if chain[i, Joint.PRISMATIC] != 0.0:
            slide = load(q, i)
            px = px + slide * r02
            py = py + slide * r12
            pz = pz + slide * r22
        else:
            si, co = sine_cosine(load(q, i))
            r00, r01 = co * r00 + si * r01, co * r01 - si * r00
            r10, r11 = co * r10 + si * r11, co * r11 - si * r10
            r20, r21 = co * r20 + si * r21, co * r21 - si * r20
        store2(origins, i, 0, px)
        store2(origins, i, 1, py)
        store2(origins, i, 2, pz)
    store(tool, 0, r00)
    store(tool, 1, r01)
    store(tool, 2, r02)
    store(tool, 3, r10)
    store(tool, 4, r11)
    store(tool, 5, r12)
    store(tool, 6, r20)
    store(tool, 7, r21)
    store(tool, 8, r22)
    store(tool, 9, px)
    store(tool, 10, py)
    store(tool, 11, pz)


@kernel
def jacobian(chain, axes, origins, tool, J):
    """Geometric Jacobian into J (n, 6), transposed: row i is [linear, angular] of joint i, base axes."""
    px, py, pz = load(tool, 9), load(tool, 10), load(tool, 11)
    for i in range(len(axes)):
        x, y, z = load2(axes, i, 0), load2(axes, i, 1), load2(axes, i, 2)
        if chain[i, Joint.PRISMATIC] != 0.0:
            store2(J, i, 0, x)
            store2(J, i, 1, y)
            store2(J, i, 2, z)
            store2(J, i, 3, 0.0)
            store2(J, i, 4, 0.0)
            store2(J, i, 5, 0.0)
        else:
            dx, dy, dz = px - load2(origins, i, 0), py - load2(origins, i, 1), pz - load2(origins, i, 2)
            store2(J, i, 0, y * dz - z * dy)
            store2(J, i, 1, z * dx - x * dz)
            store2(J, i, 2, x * dy - y * dx)
            store2(J, i, 3, x)
            store2(J, i, 4, y)
            store2(J, i, 5, z)


@kernel(allocates=True)
def jacobians(chain, q, J):
    """Transposed Jacobians into J (N, n, 6) of the configurations q (N, n)."""
    n = q.shape[1]
    axes, origins, tool = np.empty((n, 3)), np.empty((n, 3)), np.empty(12)
    for k in range(len(q)):
        forward(chain, q[k], axes, origins, tool)
        jacobian(chain, axes, origins, tool, J[k])
