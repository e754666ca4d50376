"""Descend the pose's cost and an objective in one sum: `Weighted`'s end of `solvers.reference.null_space_sqp`.

    q <- clip(q + dq),   dq = argmin  c^T dq + 1/2 dq^T (H + mu I) dq   subject to   lower - q <= dq <= upper - q

with the gradient and the positive part of the exact Hessian of `1/2 |W e|^2 + weight objective`, and the damping and
acceptance of `solvers.reference.levenberg_marquardt`.
"""

from __future__ import annotations

import math

from maira_qp.kernels.jit.decorators import device_kernel
from maira_qp.kernels.kinematics.serial_chain import jacobian
from maira_qp.kernels.layout import Joint
from maira_qp.kernels.linalg.convexify import convexify
from maira_qp.kernels.refinement.damped_descent import damped_descent
from maira_qp.kernels.refinement.posture_objective import objective_cost
from maira_qp.kernels.search.damping import bound_step
from maira_qp.kernels.spatial.pose_hessian import newton_model

GRADIENT_SCALE = 1e-3
"""See `problem.qp.hierarchy.projected_gradient`."""


@device_kernel
def _model(chain, settings, problem, tolerance, cost, work, q):
    """H and c of the sum at q (n,); what the limits leave of c, relative to a large error, and the largest of |H|."""
    J, e, H, c, lower, upper = work.J, work.e, work.H, work.c, work.lower, work.upper
    reference, weights, weight = problem
    n, left, largest = len(q), 0.0, 0.0
    jacobian(chain, work.axes, work.origins, work.tool, J)
    newton_model(settings, J, e, work.weighted, H, c)
    for i in range(n):
        H[i, i] += weight * weights[i]
        c[i] += weight * weights[i] * (q[i] - reference[i])
        low, high = chain[i, Joint.LOWER] - q[i], chain[i, Joint.UPPER] - q[i]
        known = abs(c[i]) < math.inf  # NaN is not
        slope = min(max(-GRADIENT_SCALE * c[i], low), high) / GRADIENT_SCALE if known else math.inf
        left = max(left, abs(slope))
    bound_step(chain, settings, q, lower, upper)
    convexify(H, n, work.A, work.V)
    for i in range(n):
        largest = max(largest, H[i, i])
    return left / max(1.0, math.sqrt(2.0 * cost)), largest


@device_kernel
def _value(problem, cost, q):
    """The sum at q (n,)."""
    reference, weights, weight = problem
    return cost + weight * objective_cost(q, reference, weights)


_descend = damped_descent(_model, _value)


@device_kernel
def trade_off(chain, settings, target, reference, weights, weight, tolerance, most, work, q):
    """Descend from q (n,), in place, until no entry of the gradient is larger than `tolerance`, or `most` iterations.

    `work` holds the kinematics of q before and after. Returns the iterations and the projected gradient.
    """
    _, spent, left = _descend(chain, settings, target, (reference, weights, weight), tolerance, most, work, q)
    return spent, left
