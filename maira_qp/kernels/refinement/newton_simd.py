"""Descend the costs of eight poses that are not reached to their stationary points, side by side, by Newton's method.

    q <- clip(q + dq),   dq = argmin  c^T dq + 1/2 dq^T (H + mu I) dq   subject to   lower - q <= dq <= upper - q

with the gradient c and the exact Hessian H of `1/2 |W e|^2`, where Gauss and Newton's would converge slowly: the error
that is left at the end is large. Where H is not positive for the joints that are free, the next step is one with Gauss
and Newton's H. mu is as in `solvers.reference.levenberg_marquardt`. What few descents do not converge are left to
`kernels.refinement.weighted_sum`.
"""

from __future__ import annotations

import numpy as np

from maira_qp.kernels.jit.decorators import device_kernel, kernel
from maira_qp.kernels.jit.simd import (
    LANES,
    any_lane,
    broadcast,
    load,
    load2,
    magnitude,
    maximum,
    minimum,
    select,
    square_root,
    store,
    store2,
)
from maira_qp.kernels.kinematics.serial_chain import jacobian
from maira_qp.kernels.layout import Joint, Newton, Setting
from maira_qp.kernels.qp.box_qp_simd import solve_box_qps
from maira_qp.kernels.refinement.weighted_sum import GRADIENT_SCALE
from maira_qp.kernels.search.damping import bound_step, damp, next_factor, take_step
from maira_qp.kernels.search.levenberg_marquardt import begin, make_lanes, pose_cost, quadratic_model
from maira_qp.kernels.spatial.pose_hessian import add_curvature, subtract_flattening

MOST_STEPS = 30
"""A descent that has not converged by then is left."""


@kernel
def newton_in_lanes(chain, settings, targets, starts, tolerance, floats, lane_of, q, left, steps):
    """From configurations q (N starts, n), so many for each of targets (N, 12), to the stationary points near them.

    In place; q that are NaN are left out. `left` (N starts,) becomes the largest entry of the gradient that the limits
    leave, in units of the error where that is above 1, and `steps` of int64 how many were taken. Memory: floats
    of `LANES_ARENA` and, of int64, lane_of (LANES,).
    """
    n, opened, lanes = q.shape[1], 0, make_lanes(q.shape[1], floats)
    state = lanes.state
    for lane in range(LANES):
        lane_of[lane] = -1
    while True:
        busy = False
        for lane in range(LANES):
            if state[Newton.ENDED, lane] > 0.0:
                k = lane_of[lane]
                if k >= 0:
                    left[k], steps[k] = state[Newton.LEFT, lane], int(state[Newton.ITERATIONS, lane])
                    for i in range(n):
                        q[k, i] = lanes.q[i, lane]
                while opened < len(q) and q[opened, 0] != q[opened, 0]:
                    left[opened], steps[opened] = np.inf, 0
                    opened += 1
                lane_of[lane] = opened if opened < len(q) else -1
                if opened < len(q):
                    begin(state, lanes.q, lanes.target, lane, q[opened], targets[opened // starts])
                    opened += 1
            busy = busy or lane_of[lane] >= 0
        if not busy:
            break
        _advance(chain, settings, tolerance, lanes)


@device_kernel
def _advance(chain, settings, tolerance, lanes):
    """One step in every lane; where a descent begins, a look at where it stands."""
    state, q, trial, c = lanes.state, lanes.q, lanes.trial, lanes.c
    n, nothing = len(q), broadcast(q, 0.0)
    cost, factor, starting = load(state, Newton.COST), load(state, Newton.FACTOR), load(state, Newton.STARTING) > 0.0
    definite = _solve(chain, settings, lanes)
    take_step(chain, q, lanes.dq, definite & ~starting, trial)
    value = pose_cost(chain, settings, lanes.target, trial, lanes.axes, lanes.origins, lanes.tool, lanes.e)
    better = starting | (definite & (value < cost))
    exact = starting | definite
    renewed = better | ~exact
    for i in range(n):
        store(q, i, select(better, load(trial, i), load(q, i)))
    jacobian(chain, lanes.axes, lanes.origins, lanes.tool, lanes.J)
    largest = _renew_model(settings, exact, renewed, lanes)
    cost = select(better, value, cost)
    left = nothing
    for i in range(n):
        now, slope = load(q, i), -GRADIENT_SCALE * load(c, i)
        left = maximum(
            left, magnitude(minimum(maximum(slope, chain[i, Joint.LOWER] - now), chain[i, Joint.UPPER] - now))
        )
    left = left / (GRADIENT_SCALE * maximum(1.0, square_root(2.0 * cost)))
    factor = select(exact, next_factor(settings, factor, better), factor)
    steps = select(starting, 0.0, load(state, Newton.ITERATIONS) + 1.0)
    ended = (left <= tolerance) | (steps >= MOST_STEPS) | ~(cost < np.inf)
    store(state, Newton.COST, cost)
    store(state, Newton.FACTOR, select(starting, 1.0, factor))
    store(state, Newton.LEFT, left)
    store(state, Newton.ITERATIONS, steps)
    store(state, Newton.LARGEST, select(renewed, largest, load(state, Newton.LARGEST)))
    store(state, Newton.STARTING, 0.0)
    store(state, Newton.ENDED, select(ended, 1.0, nothing))
    store(state, Newton.EXACT, select(exact, 1.0, nothing))


@device_kernel
def _solve(chain, settings, lanes):
    """The step from q into dq (n,): a mask of the lanes in which the matrix is positive."""
    state, q, H = lanes.state, lanes.q, lanes.H
    cost, factor, largest = load(state, Newton.COST), load(state, Newton.FACTOR), load(state, Newton.LARGEST)
    damp(settings, factor, cost, largest, lanes.diagonal, H)
    bound_step(chain, settings, q, lanes.lower, lanes.upper)
    if any_lane(load(state, Newton.STARTING) == 0.0):
        return solve_box_qps(H, lanes.c, lanes.lower, lanes.upper, lanes.A, lanes.side, lanes.dq)
    return load(state, Newton.STARTING) == 0.0


@device_kernel
def _renew_model(settings, exact, renewed, lanes):
    """H and c at the configuration that was looked at last, in the lanes that are `renewed`; the largest of |H|.

    Where `exact` is false H is that of Gauss and Newton.
    """
    J, e, c, H, A, weighted = lanes.J, lanes.e, lanes.c, lanes.H, lanes.A, lanes.goal
    n, p2, o2 = len(c), settings[Setting.POSITION_WEIGHT] ** 2, settings[Setting.ORIENTATION_WEIGHT] ** 2
    largest = quadratic_model(settings, J, e, A, c, renewed)
    for row in range(3):
        store(weighted, row, select(exact, -p2 * load(e, row), 0.0))
        store(weighted, row + 3, select(exact, -o2 * load(e, row + 3), 0.0))
    add_curvature(J, weighted, A)
    for row in range(3):
        store(e, row + 3, select(exact, load(e, row + 3), 0.0))
    subtract_flattening(settings, J, e, A)
    for j in range(n):
        for i in range(n):
            store2(H, i, j, select(renewed, load2(A, i, j), load2(H, i, j)))
        store(lanes.diagonal, j, select(renewed, load2(A, j, j), load(lanes.diagonal, j)))
    return largest
