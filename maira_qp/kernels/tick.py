"""One control tick: the compiled form of `maira_qp.solvers.tick`, where the algorithm is explained."""

from __future__ import annotations

import math

import numpy as np

from maira_qp.kernels.box_qp import solve_box_qp
from maira_qp.kernels.chain import LOWER, UPPER, jacobian
from maira_qp.kernels.compilation import bare_kernel, kernel
from maira_qp.kernels.descent import DAMPING, LEAST_DAMPING, ORIENTATION_WEIGHT, POSITION_WEIGHT, pose_cost, squares
from maira_qp.kernels.objective import objective_cost
from maira_qp.kernels.pose_hessian import newton_model
from maira_qp.kernels.positive_part import make_positive
from maira_qp.kernels.restoration import factor_rows
from maira_qp.kernels.rigid import FINE, pose_row
from maira_qp.kernels.row_qp import solve_row_qp
from maira_qp.kernels.settling import lagrangian_hessian, null_basis, reduce
from maira_qp.kernels.workspace import make_workspace

BAD_CONFIGURATION = -1

# the entries of `objective`, before 2 n more: the reference and the weights of the posture
KIND, WEIGHT = 0, 1
NONE, WEIGHTED, STRICT = 0, 1, 2

# the entries of `numbers`
SMALL_ERROR, HALVINGS, STEP_TIME, WITHIN = 0, 1, 2, 3


@kernel
def tick(chain, settings, objective, numbers, velocity, T, q, ahead, speed, errors):
    """A tick from q (n,) toward a target T (4, 4), with velocity limits (n,).

    `ahead` (n,) becomes the configuration after it, `speed` (n,) the velocity, `errors` (2,) what is left. Returns what
    is wrong with the target, see `rigid`, or `BAD_CONFIGURATION`; then nothing is done.
    """
    target = np.empty(12)
    fault = pose_row(T, numbers[WITHIN], target)
    for i in range(len(q)):
        if not abs(q[i]) < np.inf:
            fault = BAD_CONFIGURATION
    if fault == FINE:
        _tick(chain, settings, objective, numbers, velocity, target, make_workspace(len(q)), q, ahead, speed, errors)
    return fault


@bare_kernel
def _tick(chain, settings, objective, numbers, velocity, target, work, q, ahead, speed, errors):
    n, dt, kind, weight = len(q), numbers[STEP_TIME], int(objective[KIND]), objective[WEIGHT]
    reference, weights = objective[2 : 2 + n], objective[2 + n : 2 + 2 * n]
    H, c, lower, upper, dq, trial = work.H, work.c, work.lower, work.upper, work.dq, work.trial
    axes, origins, tool, e, J, step = work.axes, work.origins, work.tool, work.e, work.J, work.diagonal
    cost = pose_cost(chain, settings, target, q, axes, origins, tool, e)
    jacobian(chain, axes, origins, tool, J)
    newton_model(settings, J, e, work.weighted, H, c)
    for i in range(n):
        reach = velocity[i] * dt
        lower[i] = min(max(chain[i, LOWER] - q[i], -reach), reach)
        upper[i] = min(max(chain[i, UPPER] - q[i], -reach), reach)
        if kind == WEIGHTED:
            H[i, i] += weight * weights[i]
            c[i] += weight * weights[i] * (q[i] - reference[i])
    make_positive(H, n, work.A, work.V)
    largest = 0.0
    for i in range(n):
        largest = max(largest, H[i, i])
    mu = settings[DAMPING] * min(2.0 * cost, 1.0) + settings[LEAST_DAMPING] * largest
    for i in range(n):
        H[i, i] += mu
        step[i] = 0.0
    if solve_box_qp(H, c, lower, upper, work.A, work.free, work.side, work.y, dq):
        share = weight if kind == WEIGHTED else 0.0
        now = cost + share * objective_cost(q, reference, weights)
        for i in range(n):
            dq[i] = min(max(dq[i], lower[i]), upper[i])
        best = _halved(chain, settings, target, reference, weights, share, now, math.inf, numbers, work, q, step, dq)
        if kind == STRICT:
            _add_level(settings, reference, weights, work, q, dq, ahead)
            for i in range(n):
                trial[i] = q[i] + step[i]
            most = max(0.5 * (now + best), 0.5 * numbers[SMALL_ERROR] ** 2)
            before = objective_cost(trial, reference, weights)
            before += 1e-9 * (1.0 + abs(before))
            _halved(chain, settings, target, reference, weights, 0.0, most, before, numbers, work, q, step, ahead)
    for i in range(n):
        low, high = chain[i, LOWER], chain[i, UPPER]
        move = min(max(step[i], lower[i]), upper[i])
        ahead[i] = min(max(q[i] + move, low), high) if low <= q[i] <= high else q[i] + move
        speed[i] = min(max(move / dt, -velocity[i]), velocity[i])
    pose_cost(chain, settings, target, ahead, axes, origins, tool, e)
    position, orientation = squares(e)
    errors[0] = math.sqrt(position) if settings[POSITION_WEIGHT] > 0.0 else 0.0
    errors[1] = math.sqrt(orientation) if settings[ORIENTATION_WEIGHT] > 0.0 else 0.0


@bare_kernel
def _halved(chain, settings, target, reference, weights, share, most, highest, numbers, work, q, step, part):
    """Add the `part` (n,) to the `step` (n,), halved until the merit is at most `most` and the objective `highest`.

    The merit is the pose's cost and a share of the objective. Returns it at the end of the step, or `most`.
    """
    n, trial, scale = len(q), work.trial, 1.0
    for _ in range(int(numbers[HALVINGS])):
        for i in range(n):
            trial[i] = q[i] + (step[i] + scale * part[i])
        value = objective_cost(trial, reference, weights)
        merit = pose_cost(chain, settings, target, trial, work.axes, work.origins, work.tool, work.e) + share * value
        if merit <= most and value <= highest:
            for i in range(n):
                step[i] += scale * part[i]
            return merit
        scale *= 0.5
    return most


@bare_kernel
def _add_level(settings, reference, weights, work, q, dq, part):
    """What level 2 adds to the displacement dq (n,) of level 1, in its null space and within the bounds: part (n,)."""
    J, At, tau, order, joints, held, locked = work.J, work.At, work.tau, work.order, work.joints, work.held, work.locked
    g, c, x, z, Z, M, H, low, high = work.g, work.c, work.x, work.z, work.Z, work.M, work.H, work.y, work.safe
    lower, upper = work.lower, work.upper
    n = len(q)
    for i in range(n):
        g[i] = weights[i] * (q[i] - reference[i])
        held[i] = lower[i] >= 0.0 or upper[i] <= 0.0
        locked[i] = not lower[i] < upper[i]
    count, rank = factor_rows(settings, J, held, At, tau, order, joints)
    lagrangian_hessian(settings, weights, count, rank, work)
    for i in range(n):
        for j in range(n):
            g[i] += H[i, j] * dq[j]
        part[i], low[i], high[i] = 0.0, min(lower[i] - dq[i], 0.0), max(upper[i] - dq[i], 0.0)
    count, rank = factor_rows(settings, J, locked, At, tau, order, joints)
    k = count - rank
    if k > 0:
        null_basis(At, tau, joints, count, rank, g, x, Z, c)
        reduce(H, k, Z, x, M)
        make_positive(M, k, work.A, work.V)
        solve_row_qp(M, c, k, Z, low, high, work.memory, work.index, z, part)
