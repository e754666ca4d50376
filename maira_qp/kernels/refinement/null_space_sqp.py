"""Settle the redundancy once the pose is reached: the compiled form of `solvers.reference.null_space_sqp`.

For one objective `1/2 sum_i w_i (q_i - ref_i)^2` (`Posture`, `LimitDistance`). Nearly all targets are brought to their
optimum by `stabilized_sqp_simd`, eight at a time. The others the walk here, which is that of
`solvers.reference.null_space_sqp` and explained there, takes alone from where the search left them: a Newton step in
the null space of the pose, with the Lagrangian's Hessian, inside the limits and a trust region; back onto the pose; the
step counts if the objective fell. It differs in two things. On the way a step brings the arm back only so far that what
is left is within the tolerances, and small against the step's own error, and all the way at the end. And where the
Hessian is indefinite and limits hold the arm, the step is one within these limits.
"""

from __future__ import annotations

import numpy as np

from maira_qp.kernels.jit.decorators import device_kernel, kernel
from maira_qp.kernels.kinematics.serial_chain import jacobian
from maira_qp.kernels.layout import Joint, Refinement, Setting, Settling
from maira_qp.kernels.linalg.convexify import convexify
from maira_qp.kernels.linalg.qr_null_space import balance, null_basis, reduce
from maira_qp.kernels.qp.null_space_qp import solve_row_qp
from maira_qp.kernels.refinement.feasibility_restoration import factor_rows, restore
from maira_qp.kernels.refinement.posture_objective import objective_cost
from maira_qp.kernels.refinement.stabilized_sqp_simd import ON_LIMIT
from maira_qp.kernels.refinement.weighted_sum import GRADIENT_SCALE, trade_off
from maira_qp.kernels.refinement.workspace import make_workspace
from maira_qp.kernels.search.levenberg_marquardt import is_reached, pose_cost, squares
from maira_qp.kernels.spatial.pose_hessian import add_curvature, weigh

NEAR_ENOUGH = 0.03
"""On the way the weighted pose error may be this share of the step's square [1/rad], within the tolerances."""

MULTIPLIER_THRESHOLD = 1e-6
"""Pivots below this share of the first make no multipliers: near a singularity they would be without bound."""


@kernel(allocates=True)
def settle_alone(chain, settings, targets, reference, weights, settling, q, outcome):
    """To the optimum near each q (N, n), one by one, in place, from where `settle_in_lanes` found none.

    `outcome` (N, 6) becomes [reached, iterations, projected gradient, objective, position error, orientation error];
    the iterations are added to those that it holds. q stays inside the limits to the bit.
    """
    work = make_workspace(q.shape[1])
    for k in range(len(q)):
        spent, left = 0, np.inf
        cost = pose_cost(chain, settings, targets[k], q[k], work.axes, work.origins, work.tool, work.e)
        if is_reached(settings, work.e):
            spent, left = walk(chain, settings, targets[k], reference, weights, settling, cost, work, q[k])
        tell(settings, reference, weights, work.e, outcome[k, Refinement.ITERATIONS] + spent, left, q[k], outcome[k])


@kernel(allocates=True)
def trade_off_each(chain, settings, targets, reference, weights, weight, settling, q, outcome):
    """From the optima q (N, n) of `Strict`, where they reach the targets, to those of `Weighted`."""
    work = make_workspace(q.shape[1])
    tolerance, most = settling[Settling.STATIONARITY_TOLERANCE] * min(1.0, weight), settling[Settling.MAX_SETTLING]
    for k in range(len(q)):
        if outcome[k, Refinement.REACHED] > 0.0:
            spent, left = trade_off(
                chain, settings, targets[k], reference, weights, weight, tolerance, most, work, q[k]
            )
            tell(
                settings, reference, weights, work.e, outcome[k, Refinement.ITERATIONS] + spent, left, q[k], outcome[k]
            )


@kernel
def tell(settings, reference, weights, e, iterations, left, q, outcome):
    """The outcome (6,) at q (n,) with the error e (6,) and a projected gradient of which so much is left."""
    position, orientation = squares(e)
    outcome[Refinement.REACHED], outcome[Refinement.ITERATIONS] = is_reached(settings, e), iterations
    outcome[Refinement.PROJECTED_GRADIENT], outcome[Refinement.OBJECTIVE] = left, objective_cost(q, reference, weights)
    outcome[Refinement.POSITION_ERROR] = np.sqrt(position) if settings[Setting.POSITION_WEIGHT] > 0.0 else 0.0
    outcome[Refinement.ORIENTATION_ERROR] = np.sqrt(orientation) if settings[Setting.ORIENTATION_WEIGHT] > 0.0 else 0.0


@kernel
def walk(chain, settings, target, reference, weights, settling, cost, work, q):
    """Along the self-motion from q (n,), whose pose costs `cost`, in place, to where the objective is stationary.

    `work` holds the kinematics of q before and after. Returns the iterations spent and the projected gradient.
    """
    axes, origins, tool, e, before = work.axes, work.origins, work.tool, work.e, work.before
    ahead, safe, locked = work.ahead, work.safe, work.locked
    n, restored, most = len(q), settling[Settling.RESTORED], settling[Settling.RESTORING]
    loosest = _cost_of_tolerance(settings)
    for i in range(n):
        safe[i] = q[i]
        locked[i] = not chain[i, Joint.LOWER] < chain[i, Joint.UPPER]
    value, radius, spent = objective_cost(q, reference, weights), settling[Settling.FIRST_RADIUS], 0
    arrived, refused = cost <= restored, False
    k, left = _projected_gradient(chain, settings, reference, weights, work, q)
    for _ in range(int(settling[Settling.MAX_SETTLING])):
        optimal = left <= settling[Settling.STATIONARITY_TOLERANCE]
        if optimal and arrived:
            break
        if (optimal or refused) and not arrived:
            cost, steps = restore(chain, settings, target, cost, restored, most, work, q)
            value, arrived, refused = objective_cost(q, reference, weights), True, False
            k, left = _projected_gradient(chain, settings, reference, weights, work, q)
            spent += steps
            continue
        longest = _step(chain, settings, weights, k, radius, work, q)
        if not longest > 0.0:
            break
        for row in range(6):
            before[row] = e[row]
        enough = min(max(restored, 0.5 * (NEAR_ENOUGH * longest * longest) ** 2), loosest)
        ahead_cost = pose_cost(chain, settings, target, ahead, axes, origins, tool, e)
        ahead_cost, steps = restore(chain, settings, target, ahead_cost, enough, most, work, ahead)
        spent += 1 + steps
        ahead_value = objective_cost(ahead, reference, weights)
        regained, largest = _regained(settings, work)
        gain, ahead_left = value - ahead_value + regained, np.inf
        clear = settling[Settling.RESOLUTION] * (1.0 + abs(value) + largest)
        if gain >= -clear and is_reached(settings, e):
            k, ahead_left = _projected_gradient(chain, settings, reference, weights, work, ahead)
        refused = not (ahead_left < left or (gain > clear and ahead_left < np.inf))
        if refused:
            radius = 0.25 * min(radius, longest) if arrived else radius
            pose_cost(chain, settings, target, q, axes, origins, tool, e)
            k, left = _projected_gradient(chain, settings, reference, weights, work, q)
            if radius < settling[Settling.LEAST_RADIUS]:
                break
        else:
            cost, value, left, arrived = ahead_cost, ahead_value, ahead_left, ahead_cost <= restored
            radius = 2.0 * radius if longest > 0.9 * radius else radius
            for i in range(n):
                q[i] = ahead[i]
    if not arrived:
        _, steps = restore(chain, settings, target, cost, restored, most, work, q)
        spent += steps
    if not is_reached(settings, e):
        for i in range(n):
            q[i] = safe[i]
        pose_cost(chain, settings, target, q, axes, origins, tool, e)
        arrived = False
    if not arrived:
        _, left = _projected_gradient(chain, settings, reference, weights, work, q)
    return spent, left


@device_kernel
def _cost_of_tolerance(settings):
    """A cost of the pose that is within the tolerances, whatever makes it up."""
    position = settings[Setting.POSITION_WEIGHT] * settings[Setting.POSITION_TOLERANCE]
    orientation = settings[Setting.ORIENTATION_WEIGHT] * settings[Setting.ORIENTATION_TOLERANCE]
    if position == 0.0 or (0.0 < orientation < position):
        return 0.5 * orientation * orientation
    return 0.5 * position * position


@device_kernel
def _projected_gradient(chain, settings, reference, weights, work, q):
    """The largest entry of the objective's gradient that the limits and the pose leave free, at q (n,).

    The compiled form of `problem.qp.hierarchy.projected_gradient`. Leaves the factored rows of the task, the
    basis Z (n, k) of their null space, the gradient g (n,) and c = Z^T g behind, and returns k too.
    """
    J, At, tau, order, joints, x = work.J, work.At, work.tau, work.order, work.joints, work.x
    Z, M, g, c, z, lower, upper, dq = work.Z, work.M, work.g, work.c, work.z, work.lower, work.upper, work.dq
    axes, origins, tool, locked, memory, index = (
        work.axes,
        work.origins,
        work.tool,
        work.locked,
        work.row_qp,
        work.row_qp_index,
    )
    n = len(q)
    jacobian(chain, axes, origins, tool, J)
    count, rank = factor_rows(settings, J, locked, At, tau, order, joints)
    k = count - rank
    for i in range(n):
        g[i] = weights[i] * (q[i] - reference[i])
        lower[i], upper[i] = chain[i, Joint.LOWER] - q[i], chain[i, Joint.UPPER] - q[i]
    null_basis(At, tau, joints, count, rank, g, x, Z, c)
    known = True
    for b in range(k):
        known = known and abs(c[b]) < np.inf  # NaN is not
        for a in range(k):
            M[a, b] = 1.0 / GRADIENT_SCALE if a == b else 0.0
    left = 0.0 if known and solve_row_qp(M, c, k, Z, lower, upper, memory, index, z, dq) else np.inf
    if left == 0.0:
        for i in range(n):
            left = max(left, abs(dq[i]))
    return k, left / GRADIENT_SCALE


@device_kernel
def _step(chain, settings, weights, k, radius, work, q):
    """To the optimum of the model within the trust region, into work.ahead (n,): the longest displacement of a joint.

    The multipliers depend on which limits hold the arm, and these on the step: it is taken twice where they differ.
    Where the model had to be made convex, and the arm stays on limits, the second step is one within those: there the
    model may be convex as it is, and then the walk converges quadratically.
    """
    J, At, tau, order, joints, locked, held = work.J, work.At, work.tau, work.order, work.joints, work.locked, work.held
    x, g, c, ahead = work.x, work.g, work.c, work.ahead
    lower, upper, H, M, Z, A, V = work.lower, work.upper, work.H, work.M, work.Z, work.A, work.V
    memory, index, z, dq = work.row_qp, work.row_qp_index, work.z, work.dq
    n, count, longest, differ = len(q), 0, 0.0, False
    for i in range(n):
        count += not locked[i]
        held[i] = q[i] <= chain[i, Joint.LOWER] or q[i] >= chain[i, Joint.UPPER]
        differ = differ or held[i] != locked[i]
        lower[i] = min(max(chain[i, Joint.LOWER] - q[i], -radius), 0.0)
        upper[i] = min(max(chain[i, Joint.UPPER] - q[i], 0.0), radius)
    rank, within = count - k, False  # of the rows as `_projected_gradient` factored them
    for _ in range(2):
        if differ or within:
            count, rank = factor_rows(settings, J, held, At, tau, order, joints)
        if within:
            k = count - rank
            null_basis(At, tau, joints, count, rank, g, x, Z, c)
        lagrangian_hessian(settings, weights, count, rank, work)
        reduce(H, k, Z, x, M)
        convex = convexify(M, k, A, V)
        solve_row_qp(M, c, k, Z, lower, upper, memory, index, z, dq)
        differ, longest, within = False, 0.0, False
        beyond = False
        for i in range(n):
            low, high = chain[i, Joint.LOWER], chain[i, Joint.UPPER]
            end = min(max(q[i] + dq[i], low), high)
            ahead[i] = low if end - low <= ON_LIMIT else high if high - end <= ON_LIMIT else end
            holds = ahead[i] <= low or ahead[i] >= high
            differ = differ or holds != held[i]
            within = within or (holds and not locked[i])
            beyond = beyond or (holds and not held[i])
            held[i] = holds
            longest = max(longest, abs(ahead[i] - q[i]))
        within = within and not (convex or beyond)
        if not (differ or within):
            break
    return longest


@kernel
def lagrangian_hessian(settings, weights, count, rank, work):
    """The Hessian of the objective's Lagrangian into work.H (n, n), by the rows as they are factored.

    Its own, and the pose's curvature times the multipliers (6,) that balance the gradient g (n,), left in `work`.
    """
    J, At, H, x, g, joints = work.J, work.At, work.H, work.x, work.g, work.joints
    while rank > 0 and abs(At[rank - 1, rank - 1]) <= MULTIPLIER_THRESHOLD * abs(At[0, 0]):
        rank -= 1
    for a in range(count):
        x[a] = g[joints[a]]
    balance(At, count, 6, rank, work.tau, work.order, x, work.multipliers)
    weigh(settings, work.multipliers, work.weighted)
    for i in range(len(J)):
        for j in range(len(J)):
            H[i, j] = 0.0
        H[i, i] = weights[i]
    add_curvature(J, work.weighted, H)


@device_kernel
def _regained(settings, work):
    """What the pose error that a step regained, or lost, is worth in units of the objective; the largest multiplier."""
    multipliers, e, before = work.multipliers, work.e, work.before
    p, o, s, largest = settings[Setting.POSITION_WEIGHT], settings[Setting.ORIENTATION_WEIGHT], 0.0, 0.0
    for row in range(6):
        s += multipliers[row] * (p if row < 3 else o) * (e[row] - before[row])
        largest = max(largest, abs(multipliers[row]))
    return s, largest
