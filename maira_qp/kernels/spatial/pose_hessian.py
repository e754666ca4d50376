"""The second derivatives of a pose and of its cost `1/2 |W e|^2`, part by part; J (n, 6) is the Jacobian transposed."""

from __future__ import annotations

from maira_qp.kernels.jit.decorators import kernel
from maira_qp.kernels.jit.simd import load, load2, store, store2
from maira_qp.kernels.layout import Setting
from maira_qp.kernels.search.levenberg_marquardt import quadratic_model
from maira_qp.kernels.spatial.so3 import flattening


@kernel
def weigh(settings, x, y):
    """`y = W x`, both (6,)."""
    for row in range(3):
        store(y, row, settings[Setting.POSITION_WEIGHT] * load(x, row))
        store(y, row + 3, settings[Setting.ORIENTATION_WEIGHT] * load(x, row + 3))


@kernel
def newton_model(settings, J, e, weighted, H, c):
    """The cost's Hessian, of any definiteness, into H (n, n) and its gradient into c (n,). Work: weighted (6,)."""
    quadratic_model(settings, J, e, H, c, True)
    weigh(settings, e, weighted)
    weigh(settings, weighted, weighted)
    for row in range(6):
        weighted[row] *= -1.0
    add_curvature(J, weighted, H)
    subtract_flattening(settings, J, e, H)


@kernel
def add_curvature(J, weights, H):
    """Add the second derivative of the pose, its six rows weighted by `weights` (6,), to H (n, n).

    The compiled form of `Configuration.kinematic_hessian_product`: for i before j the entry is
    `w_i . (v_j x u_p + 1/2 w_j x u_phi)`, with the columns [v; w] of the Jacobian and the weights [u_p; u_phi].
    """
    p0, p1, p2 = load(weights, 0), load(weights, 1), load(weights, 2)
    r0, r1, r2 = 0.5 * load(weights, 3), 0.5 * load(weights, 4), 0.5 * load(weights, 5)
    for j in range(len(J)):
        v0, v1, v2 = load2(J, j, 0), load2(J, j, 1), load2(J, j, 2)
        w0, w1, w2 = load2(J, j, 3), load2(J, j, 4), load2(J, j, 5)
        x = v1 * p2 - v2 * p1 + w1 * r2 - w2 * r1
        y = v2 * p0 - v0 * p2 + w2 * r0 - w0 * r2
        z = v0 * p1 - v1 * p0 + w0 * r1 - w1 * r0
        for i in range(j):
            h = load2(H, i, j) + (load2(J, i, 3) * x + load2(J, i, 4) * y + load2(J, i, 5) * z)
            store2(H, i, j, h)
            store2(H, j, i, h)
        store2(H, j, j, load2(H, j, j) + (w0 * x + w1 * y + w2 * z))


@kernel
def subtract_flattening(settings, J, e, H):
    """Subtract from H (n, n) what a turn across the rotation error phi = e[3:] changes it less than by itself.

    The compiled form of the last term of `problem.tasks.frame.FrameTask.hessian`, `k (w x phi) . (w x phi)`.
    """
    x, y, z = load(e, 3), load(e, 4), load(e, 5)
    k = flattening(x * x + y * y + z * z) * settings[Setting.ORIENTATION_WEIGHT] ** 2
    for j in range(len(J)):
        w0, w1, w2 = load2(J, j, 3), load2(J, j, 4), load2(J, j, 5)
        a, b, c = k * (y * w2 - z * w1), k * (z * w0 - x * w2), k * (x * w1 - y * w0)
        for i in range(j + 1):
            w0, w1, w2 = load2(J, i, 3), load2(J, i, 4), load2(J, i, 5)
            h = load2(H, i, j) - (a * (y * w2 - z * w1) + b * (z * w0 - x * w2) + c * (x * w1 - y * w0))
            store2(H, i, j, h)
            store2(H, j, i, h)
