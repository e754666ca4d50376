"""Walk along the self-motions of eight targets side by side, to where the objective is stationary.

A stabilised sequential quadratic programming method (Wright, "Superlinear convergence of a stabilized SQP method to a
degenerate solution", 1998; Hager, "Stabilized sequential quadratic programming", 1999). With the objective f, the
weighted pose error W e(q), the rows A = W J and the multipliers y of the Lagrangian f(q) - y^T W e(q), a step solves
one QP with boxes, which restores the pose and descends along the self-motion at once:

    min   1/2 |A dq - W e|^2 + weight (y^T (A dq - W e) + g^T dq + 1/2 dq^T (B + mu I) dq)
    subject to   lower - q <= dq <= upper - q,   |dq_i| <= radius,       and then   y <- y + (A dq - W e) / weight

with the gradient g of f and the exact Hessian B of the Lagrangian. The weight is so small that the pose is met as if it
were a constraint, but the QP has a solution at a singularity too. mu is 0 where the matrix is positive without it. A
step counts if the augmented Lagrangian falls, or what is left of the gradient of the Lagrangian does by half.

It takes no factorisation of the rows, no basis of their null space and no rank, whatever the number of joints. And by
its multipliers a walk proves the optimum that it ends at: the gradient of the Lagrangian bounds what the limits and the
pose leave free of that of f. What few walks prove none are left to `kernels.refinement.null_space_sqp`.
"""

from __future__ import annotations

import math

import numpy as np

from maira_qp.kernels.jit.arena import Arena
from maira_qp.kernels.jit.decorators import device_kernel, kernel
from maira_qp.kernels.jit.simd import LANES, broadcast, load, load2, magnitude, maximum, minimum, select, store, store2
from maira_qp.kernels.kinematics.serial_chain import jacobian
from maira_qp.kernels.layout import Joint, Refinement, Setting, Settling, Walk
from maira_qp.kernels.qp.box_qp_simd import solve_box_qps
from maira_qp.kernels.refinement.posture_objective import objective_cost
from maira_qp.kernels.refinement.weighted_sum import GRADIENT_SCALE
from maira_qp.kernels.search.levenberg_marquardt import is_reached, pose_cost, quadratic_model
from maira_qp.kernels.spatial.pose_hessian import add_curvature, weigh

ON_LIMIT = 1e-12
"""A step that ends as near to a limit [rad or m] ends on it."""

MOST_STEPS = 50
"""A walk that has not converged by then hardly will."""

SMALL_WEIGHT = 1e-9
"""Of the objective beside the pose, in units of the mean of the posture's weights."""

PENALTY = 10.0
"""Of the squared pose error in the augmented Lagrangian, in units of the largest multiplier and that mean."""

MOST_CHANGE = 1e4
"""Multipliers that a step would change by more, in units of that mean, stay: its box did not let it meet the pose."""

FIRST_DAMPING, MORE_DAMPING, LESS_DAMPING, LEAST_DAMPING = 1.0, 4.0, 0.1, 0.1
"""mu in units of that mean: the first, its factors where the matrix is not positive and where it is; below the last
it is 0."""


WALKS = Arena(
    "Walks",
    "n",
    lanes=True,
    floats={
        "state": f"{Walk.WIDTH}",
        **dict.fromkeys(("target", "tool"), "12"),
        **dict.fromkeys(("e", "ahead_e", "y", "ahead_y", "weighted"), "6"),
        **dict.fromkeys(("q", "ahead", "slope", "ahead_slope", "c", "lower", "upper", "side", "dq"), "n"),
        **dict.fromkeys(("axes", "origins"), "n, 3"),
        **dict.fromkeys(("J", "ahead_J"), "n, 6"),
        **dict.fromkeys(("H", "A"), "n, n"),
    },
)
"""All arrays of eight walks of a chain of n joints; `slope` is the gradient of the Lagrangian, `ahead` a trial."""
Walks, _zero_walks = WALKS.Arrays, WALKS.make


@kernel(allocates=True)
def make_walks(n):
    """Eight walks, all of them ended; those that never begin stand still at zero."""
    walks = _zero_walks(n)
    store(walks.state, Walk.ENDED, 1.0)
    return walks


@kernel(allocates=True)
def settle_in_lanes(chain, settings, targets, reference, weights, settling, q, outcome):
    """`walk_in_lanes` with memory of its own."""
    walks, lane_of = make_walks(q.shape[1]), np.empty(LANES, np.int64)
    walk_in_lanes(chain, settings, targets, reference, weights, settling, walks, lane_of, q, outcome)


@kernel
def walk_in_lanes(chain, settings, targets, reference, weights, settling, walks, lane_of, q, outcome):
    """From configurations q (N, n) to the optimum of the objective near each, in place, where a walk converges.

    The others stay as they are, and so do those that do not reach the targets (N, 12). `outcome` (N, 6) becomes
    [reached, steps, bound of the projected gradient, objective, position error, orientation error] where the bound
    proves an optimum that reaches its target; elsewhere [0, steps, infinity, and no numbers]. Work: `walks` and, of
    int64, lane_of (LANES,).
    """
    n, opened, state = q.shape[1], 0, walks.state
    for lane in range(LANES):
        lane_of[lane] = -1
    while True:
        busy = False
        for lane in range(LANES):
            if state[Walk.ENDED, lane] > 0.0:
                k = lane_of[lane]
                if k >= 0:
                    for i in range(n):
                        q[k, i] = walks.q[i, lane] if state[Walk.CONVERGED, lane] > 0.0 else q[k, i]
                    _tell(chain, settings, settling, walks, lane, outcome[k])
                lane_of[lane] = opened if opened < len(q) else -1
                if opened < len(q):
                    _begin(walks, lane, targets[opened], q[opened], settling)
                    opened += 1
            busy = busy or lane_of[lane] >= 0
        if not busy:
            break
        _advance(chain, settings, reference, weights, settling, walks)


@device_kernel
def _tell(chain, settings, settling, walks, lane, outcome):
    """The outcome (6,) of a walk that has ended in a lane.

    With the entries s of the Lagrangian's gradient, but for those that push a joint against the limit it is on, the
    steepest direction that the limits and the pose leave free is no steeper than |s|: on it, the gradient of the
    objective is the Lagrangian's, and those entries do not help.
    """
    q, slope, e, position, turn, square = walks.q, walks.slope, walks.e, 0.0, 0.0, 0.0
    for row in range(3):
        position += e[row, lane] * e[row, lane] if settings[Setting.POSITION_WEIGHT] > 0.0 else 0.0
        turn += e[3 + row, lane] * e[3 + row, lane] if settings[Setting.ORIENTATION_WEIGHT] > 0.0 else 0.0
    position, turn = math.sqrt(position), math.sqrt(turn)
    for i in range(len(q)):
        s, now = slope[i, lane], q[i, lane]
        held = now <= chain[i, Joint.LOWER] if s > 0.0 else now >= chain[i, Joint.UPPER]
        square += 0.0 if held else s * s
    bound = math.sqrt(square)
    reached = position <= settings[Setting.POSITION_TOLERANCE] and turn <= settings[Setting.ORIENTATION_TOLERANCE]
    proved = walks.state[Walk.CONVERGED, lane] > 0.0 and reached and bound <= settling[Settling.STATIONARITY_TOLERANCE]
    outcome[Refinement.REACHED], outcome[Refinement.ITERATIONS] = proved, walks.state[Walk.STEPS, lane]
    outcome[Refinement.PROJECTED_GRADIENT] = bound if proved else np.inf
    outcome[Refinement.OBJECTIVE] = walks.state[Walk.VALUE, lane] if proved else np.nan
    outcome[Refinement.POSITION_ERROR] = position if proved else np.nan
    outcome[Refinement.ORIENTATION_ERROR] = turn if proved else np.nan


@device_kernel
def _begin(walks, lane, target, q, settling):
    """Begin a walk from q (n,) in one lane."""
    state = walks.state
    for i in range(len(q)):
        walks.ahead[i, lane] = q[i]
    for i in range(12):
        walks.target[i, lane] = target[i]
    for row in range(6):
        walks.ahead_y[row, lane] = 0.0
    state[Walk.RADIUS, lane], state[Walk.FACTOR, lane] = settling[Settling.FIRST_RADIUS], 0.0
    state[Walk.STEPS, lane] = -1.0
    state[Walk.STARTING, lane], state[Walk.ENDED, lane] = 1.0, 0.0


@device_kernel
def _advance(chain, settings, reference, weights, settling, walks):
    """One step in every lane; where a walk begins, a look at where it stands."""
    state, q, ahead = walks.state, walks.q, walks.ahead
    n, scale, nothing = len(q), 0.0, broadcast(q, 0.0)
    for weight in weights:
        scale += weight / n
    starting, radius, factor = load(state, Walk.STARTING) > 0.0, load(state, Walk.RADIUS), load(state, Walk.FACTOR)
    definite = _solve_model(chain, settings, weights, scale, walks)
    longest = _propose(chain, settings, scale, walks)
    cost = pose_cost(chain, settings, walks.target, ahead, walks.axes, walks.origins, walks.tool, walks.ahead_e)
    value = objective_cost(ahead, reference, weights)
    jacobian(chain, walks.axes, walks.origins, walks.tool, walks.ahead_J)
    left = _lagrangian_gradient(chain, settings, reference, weights, walks)
    fell = _augmented_lagrangian_fell(settings, settling, scale, cost, value, walks)
    halved = (left < 0.5 * load(state, Walk.LEFT)) & (
        cost < maximum(load(state, Walk.COST), settling[Settling.RESTORED])
    )
    taken = (starting & is_reached(settings, walks.ahead_e)) | (~starting & definite & (fell | halved))
    _move(walks, taken)
    cost, left = select(taken, cost, load(state, Walk.COST)), select(taken, left, load(state, Walk.LEFT))
    grown = select(longest > 0.9 * radius, 2.0 * radius, radius)
    radius = select(starting | ~definite, radius, select(taken, grown, 0.25 * minimum(radius, longest)))
    less = select(taken, LESS_DAMPING * factor, factor)
    factor = select(starting | definite, less, maximum(MORE_DAMPING * factor, FIRST_DAMPING))
    steps = load(state, Walk.STEPS) + 1.0
    converged = (
        taken & (left <= 0.5 * settling[Settling.STATIONARITY_TOLERANCE]) & (cost <= settling[Settling.RESTORED])
    )
    ended = (
        converged
        | (steps >= minimum(settling[Settling.MAX_SETTLING], MOST_STEPS))
        | (radius < settling[Settling.LEAST_RADIUS])
    )
    store(state, Walk.COST, cost)
    store(state, Walk.VALUE, select(taken, value, load(state, Walk.VALUE)))
    store(state, Walk.LEFT, left)
    store(state, Walk.RADIUS, radius)
    store(state, Walk.FACTOR, select(factor < LEAST_DAMPING, 0.0, factor))
    store(state, Walk.STEPS, steps)
    store(state, Walk.STARTING, 0.0)
    store(state, Walk.ENDED, select(ended | (starting & ~taken), 1.0, nothing))
    store(state, Walk.CONVERGED, select(converged, 1.0, nothing))


@device_kernel
def _solve_model(chain, settings, weights, scale, walks):
    """The step from q into dq (n,): a mask of the lanes in which the matrix is positive."""
    state, q, c, H = walks.state, walks.q, walks.c, walks.H
    weight, radius, factor = SMALL_WEIGHT / scale, load(state, Walk.RADIUS), load(state, Walk.FACTOR)
    quadratic_model(settings, walks.J, walks.e, H, c, (radius > 0.0) | ~(radius > 0.0))
    weigh(settings, walks.y, walks.weighted)
    for row in range(6):
        store(walks.weighted, row, weight * load(walks.weighted, row))
    add_curvature(walks.J, walks.weighted, H)
    for i in range(len(q)):
        store2(H, i, i, load2(H, i, i) + weight * (weights[i] + scale * factor))
        store(c, i, load(c, i) + weight * load(walks.slope, i))
        store(walks.lower, i, minimum(maximum(chain[i, Joint.LOWER] - load(q, i), -radius), 0.0))
        store(walks.upper, i, maximum(minimum(chain[i, Joint.UPPER] - load(q, i), radius), 0.0))
    return solve_box_qps(H, c, walks.lower, walks.upper, walks.A, walks.side, walks.dq)


@device_kernel
def _propose(chain, settings, scale, walks):
    """q + dq and the multipliers there into ahead (n,) and ahead_y (6,): the longest displacement of a joint."""
    starting = load(walks.state, Walk.STARTING) > 0.0
    q, dq, ahead, ahead_y, weighted = walks.q, walks.dq, walks.ahead, walks.ahead_y, walks.weighted
    longest, change = broadcast(q, 0.0), broadcast(q, 0.0)
    for i in range(len(q)):
        now = load(q, i)
        low, high = chain[i, Joint.LOWER], chain[i, Joint.UPPER]
        there = minimum(maximum(now + load(dq, i), low), high)
        there = select(there - low <= ON_LIMIT, low, select(high - there <= ON_LIMIT, high, there))
        longest = maximum(longest, magnitude(there - now))
        store(ahead, i, select(starting, load(ahead, i), there))
    for row in range(6):
        s = -load(walks.e, row)
        for i in range(len(q)):
            s = s + load2(walks.J, i, row) * load(dq, i)
        store(weighted, row, s * (scale / SMALL_WEIGHT))
    weigh(settings, weighted, weighted)
    for row in range(6):
        change = maximum(change, magnitude(load(weighted, row)))
    believed = change < MOST_CHANGE * scale
    for row in range(6):
        there = load(walks.y, row) + select(believed, load(weighted, row), 0.0)
        store(ahead_y, row, select(starting, load(ahead_y, row), there))
    return longest


@device_kernel
def _lagrangian_gradient(chain, settings, reference, weights, walks):
    """g + A^T y ahead, into ahead_slope (n,): the largest entry of what the limits leave of it."""
    ahead, J, left = walks.ahead, walks.ahead_J, broadcast(walks.q, 0.0)
    weigh(settings, walks.ahead_y, walks.weighted)
    for i in range(len(ahead)):
        now = load(ahead, i)
        s = weights[i] * (now - reference[i])
        for row in range(6):
            s = s + load2(J, i, row) * load(walks.weighted, row)
        store(walks.ahead_slope, i, s)
        left = maximum(
            left,
            magnitude(minimum(maximum(-GRADIENT_SCALE * s, chain[i, Joint.LOWER] - now), chain[i, Joint.UPPER] - now)),
        )
    return left / GRADIENT_SCALE


@device_kernel
def _augmented_lagrangian_fell(settings, settling, scale, cost, value, walks):
    """Whether `f - y^T W e + penalty/2 |W e|^2` is lower ahead than at q, with the multipliers y ahead."""
    state, ahead_y, weighted, largest = walks.state, walks.ahead_y, walks.weighted, broadcast(walks.q, 0.0)
    gain = load(state, Walk.VALUE) - value
    weigh(settings, ahead_y, weighted)
    for row in range(6):
        gain = gain - load(weighted, row) * (load(walks.e, row) - load(walks.ahead_e, row))
        largest = maximum(largest, magnitude(load(ahead_y, row)))
    gain = gain + PENALTY * (scale + largest) * (load(state, Walk.COST) - cost)
    return gain > -settling[Settling.RESOLUTION] * (scale + magnitude(load(state, Walk.VALUE)) + largest)


@device_kernel
def _move(walks, taken):
    """Go ahead in the lanes where the step is taken."""
    for row in range(6):
        store(walks.e, row, select(taken, load(walks.ahead_e, row), load(walks.e, row)))
        store(walks.y, row, select(taken, load(walks.ahead_y, row), load(walks.y, row)))
    for i in range(len(walks.q)):
        store(walks.q, i, select(taken, load(walks.ahead, i), load(walks.q, i)))
        store(walks.slope, i, select(taken, load(walks.ahead_slope, i), load(walks.slope, i)))
        for row in range(6):
            store2(walks.J, i, row, select(taken, load2(walks.ahead_J, i, row), load2(walks.J, i, row)))
