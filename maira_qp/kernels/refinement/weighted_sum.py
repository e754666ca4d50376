"""Descend the pose's cost and an objective in one sum: `Weighted`'s end of `solvers.reference.null_space_sqp`.

    q <- clip(q + dq),   dq = argmin  c^T dq + 1/2 dq^T (H + mu I) dq   subject to   lower - q <= dq <= upper - q

with the gradient and the positive part of the exact Hessian of `1/2 |W e|^2 + weight objective`, and the damping and
acceptance of `solvers.reference.levenberg_marquardt`.
"""

from __future__ import annotations

import math

from maira_qp.kernels.jit.decorators import device_kernel, kernel
from maira_qp.kernels.kinematics.serial_chain import jacobian
from maira_qp.kernels.layout import Joint, Setting
from maira_qp.kernels.linalg.convexify import make_positive
from maira_qp.kernels.qp.box_qp import solve_box_qp
from maira_qp.kernels.refinement.posture_objective import objective_cost
from maira_qp.kernels.search.levenberg_marquardt import pose_cost
from maira_qp.kernels.spatial.pose_hessian import newton_model

GRADIENT_SCALE = 1e-3
"""See `problem.qp.hierarchy.projected_gradient`."""


@kernel
def trade_off(chain, settings, target, reference, weights, weight, tolerance, most, work, q):
    """Descend from q (n,), in place, until no entry of the gradient is larger than `tolerance`, or `most` iterations.

    `work` holds the kinematics of q before and after. Returns the iterations and the projected gradient.
    """
    axes, origins, tool, e, trial = work.axes, work.origins, work.tool, work.e, work.trial
    H, c, diagonal, lower, upper, dq = work.H, work.c, work.diagonal, work.lower, work.upper, work.dq
    n, damping, spent, fresh, largest, left = len(q), 1.0, 0, True, 0.0, math.inf
    cost = pose_cost(chain, settings, target, q, axes, origins, tool, e)
    value = cost + weight * objective_cost(q, reference, weights)
    while True:
        if fresh:
            left, largest = _model(chain, settings, reference, weights, weight, cost, work, q)
        if left <= tolerance or spent >= most:
            break
        spent += 1
        mu = (
            damping * settings[Setting.DAMPING] * 2.0 * cost
            + max(1.0, damping) * settings[Setting.LEAST_DAMPING] * largest
        )
        for i in range(n):
            H[i, i] = diagonal[i] + mu
        if not solve_box_qp(H, c, lower, upper, work.A, work.free, work.side, work.y, dq):
            break
        moved = False
        for i in range(n):
            trial[i] = min(max(q[i] + dq[i], chain[i, Joint.LOWER]), chain[i, Joint.UPPER])
            moved = moved or trial[i] != q[i]
        if not moved:
            break
        trial_cost = pose_cost(chain, settings, target, trial, axes, origins, tool, e)
        trial_value = trial_cost + weight * objective_cost(trial, reference, weights)
        fresh = trial_value < value
        if fresh:
            cost, value = trial_cost, trial_value
            for i in range(n):
                q[i] = trial[i]
            damping = max(damping * settings[Setting.ACCEPTED], settings[Setting.LEAST_FACTOR])
        else:
            damping *= settings[Setting.REFUSED]
            if damping > settings[Setting.MOST_FACTOR]:
                break
    if not fresh:
        pose_cost(chain, settings, target, q, axes, origins, tool, e)
    return spent, left


@device_kernel
def _model(chain, settings, reference, weights, weight, cost, work, q):
    """H and c of the sum at q (n,); what the limits leave of c, relative to a large error, and the largest of |H|."""
    J, e, H, c, diagonal, lower, upper = work.J, work.e, work.H, work.c, work.diagonal, work.lower, work.upper
    n, left, largest = len(q), 0.0, 0.0
    jacobian(chain, work.axes, work.origins, work.tool, J)
    newton_model(settings, J, e, work.weighted, H, c)
    for i in range(n):
        H[i, i] += weight * weights[i]
        c[i] += weight * weights[i] * (q[i] - reference[i])
        lower[i], upper[i] = chain[i, Joint.LOWER] - q[i], chain[i, Joint.UPPER] - q[i]
        known = abs(c[i]) < math.inf  # NaN is not
        slope = min(max(-GRADIENT_SCALE * c[i], lower[i]), upper[i]) / GRADIENT_SCALE if known else math.inf
        left = max(left, abs(slope))
        lower[i], upper[i] = max(lower[i], -settings[Setting.LONGEST]), min(upper[i], settings[Setting.LONGEST])
    make_positive(H, n, work.A, work.V)
    for i in range(n):
        diagonal[i] = H[i, i]
        largest = max(largest, H[i, i])
    return left / max(1.0, math.sqrt(2.0 * cost)), largest
