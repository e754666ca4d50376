"""Damped Gauss-Newton descent of a pose cost inside a box: the compiled form of `maira_qp.solvers.descent`.

From the same start and settings it takes the same steps; the algorithm and its source stand there.
"""

from __future__ import annotations

import numpy as np

from maira_qp.kernels.box_qp import solve_box_qp
from maira_qp.kernels.chain import LOWER, UPPER, forward, jacobian
from maira_qp.kernels.compilation import kernel
from maira_qp.kernels.pose_error import pose_error

# the entries of `settings`
POSITION_WEIGHT, ORIENTATION_WEIGHT = 0, 1
POSITION_TOLERANCE, ORIENTATION_TOLERANCE = 2, 3
MAX_ITERATIONS, DAMPING, STALL_STEPS, STALL_RATIO = 4, 5, 6, 7
ACCEPTED, REFUSED, LEAST_FACTOR, MOST_FACTOR, LEAST_DAMPING = 8, 9, 10, 11, 12
SETTINGS = 13


@kernel
def pose_cost(chain, settings, target, q, axes, origins, tool, e):
    """`1/2 |W e|^2` at q (n,); the kinematics and the error are left in the arrays."""
    forward(chain, q, axes, origins, tool)
    pose_error(tool, target, e)
    p, o = settings[POSITION_WEIGHT], settings[ORIENTATION_WEIGHT]
    return 0.5 * (p * p * (e[0] * e[0] + e[1] * e[1] + e[2] * e[2]) + o * o * (e[3] * e[3] + e[4] * e[4] + e[5] * e[5]))


@kernel
def is_reached(settings, e):
    """The error (6,) is within the tolerances, a part with weight 0 being free."""
    position = np.sqrt(e[0] * e[0] + e[1] * e[1] + e[2] * e[2])
    orientation = np.sqrt(e[3] * e[3] + e[4] * e[4] + e[5] * e[5])
    return (settings[POSITION_WEIGHT] == 0.0 or position <= settings[POSITION_TOLERANCE]) and (
        settings[ORIENTATION_WEIGHT] == 0.0 or orientation <= settings[ORIENTATION_TOLERANCE]
    )


@kernel
def quadratic_model(settings, J, e, H, c):
    """Gauss-Newton's H (n, n) and c (n,) from the transposed Jacobian J (n, 6) and e (6,); the largest entry of |H|."""
    n = len(c)
    p2, o2 = settings[POSITION_WEIGHT] ** 2, settings[ORIENTATION_WEIGHT] ** 2
    largest = 0.0
    for i in range(n):
        a0, a1, a2 = p2 * J[i, 0], p2 * J[i, 1], p2 * J[i, 2]
        a3, a4, a5 = o2 * J[i, 3], o2 * J[i, 4], o2 * J[i, 5]
        c[i] = -(a0 * e[0] + a1 * e[1] + a2 * e[2] + a3 * e[3] + a4 * e[4] + a5 * e[5])
        for j in range(i + 1):
            h = a0 * J[j, 0] + a1 * J[j, 1] + a2 * J[j, 2] + a3 * J[j, 3] + a4 * J[j, 4] + a5 * J[j, 5]
            H[i, j] = h
            H[j, i] = h
        largest = max(largest, H[i, i])  # of a positive matrix the largest entry stands on the diagonal
    return largest


@kernel
def descend(chain, settings, target, q):
    """Descend from q (n,), in place. Returns the cost, whether the target is reached, and the iterations."""
    n = len(q)
    axes, origins, tool, e = np.empty((n, 3)), np.empty((n, 3)), np.empty(12), np.empty(6)
    J, H, A = np.empty((n, 6)), np.empty((n, n)), np.empty((n, n))
    c, diagonal, dq, y, trial = np.empty(n), np.empty(n), np.empty(n), np.empty(n), np.empty(n)
    lower, upper, free, side = np.empty(n), np.empty(n), np.empty(n, np.int64), np.empty(n, np.int64)
    factor, stall_left, iterations = 1.0, settings[STALL_STEPS], 0
    cost = pose_cost(chain, settings, target, q, axes, origins, tool, e)
    reached = is_reached(settings, e)
    fresh, largest = True, 0.0  # fresh: the arrays hold the kinematics of q, H and c are yet to be made from them
    while not reached and iterations < settings[MAX_ITERATIONS]:
        iterations += 1
        if fresh:
            jacobian(chain, axes, origins, tool, J)
            largest = quadratic_model(settings, J, e, H, c)
            for i in range(n):
                lower[i], upper[i], diagonal[i] = chain[i, LOWER] - q[i], chain[i, UPPER] - q[i], H[i, i]
        mu = factor * settings[DAMPING] * 2.0 * cost + max(1.0, factor) * settings[LEAST_DAMPING] * largest
        for i in range(n):
            H[i, i] = diagonal[i] + mu
        solved = solve_box_qp(H, c, lower, upper, A, free, side, y, dq)
        moved = False
        for i in range(n):
            trial[i] = min(max(q[i] + dq[i], chain[i, LOWER]), chain[i, UPPER])
            moved = moved or trial[i] != q[i]
        if solved and not moved:
            break
        value = pose_cost(chain, settings, target, trial, axes, origins, tool, e) if solved else np.inf
        fresh = value < cost
        if fresh:
            for i in range(n):
                q[i] = trial[i]
            reached = is_reached(settings, e)
            factor = max(factor * settings[ACCEPTED], settings[LEAST_FACTOR])
            stall_left = settings[STALL_STEPS] if value < (1.0 - settings[STALL_RATIO]) * cost else stall_left - 1
            cost = value
            if stall_left <= 0:
                break
        else:
            factor *= settings[REFUSED]
            if factor > settings[MOST_FACTOR]:
                break
    return cost, reached, iterations
