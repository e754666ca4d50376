"""A small dense QP with a box, by block principal pivoting, and by a primal active-set method where that cycles.

    min 1/2 x^T H x + c^T x   subject to   lower <= x <= upper

Each variable is free or at a bound. A pass of block pivoting solves for the free ones and moves, all at once, what
contradicts the guess: a free variable outside its bounds goes to the bound, a bound whose multiplier has the wrong sign
lets go (Judice and Pires, "A block principal pivoting algorithm for large-scale strictly monotone linear
complementarity problems", 1994). Two or three passes suffice in general, however many bounds are active. Where they do
not, the active set is changed one variable at a time along a feasible, falling path (Nocedal and Wright, "Numerical
Optimization", 2006, algorithm 16.3). H must be positive definite.
"""

from __future__ import annotations

from maira_qp.kernels.jit.decorators import device_kernel, kernel
from maira_qp.kernels.layout import Side

BLOCK_PASSES = 8


@kernel
def solve_box_qp(H, c, lower, upper, A, free, side, y, x):
    """The solution into x (n,). Work: A (n, n), free and side (n,) of int64, y (n,). False if H is not positive."""
    n = len(c)
    for i in range(n):
        side[i] = Side.FREE if lower[i] < upper[i] else Side.AT_LOWER
    for _ in range(BLOCK_PASSES):
        if not _solve_free(H, c, lower, upper, A, free, side, x):
            return False
        settled = True
        for i in range(n):
            free[i] = _contradicts(H, c, lower, upper, side, x, i)
            settled = settled and not free[i]
        if settled:
            return True
        for i in range(n):
            if free[i]:
                side[i] = (Side.AT_LOWER if x[i] < lower[i] else Side.AT_UPPER) if side[i] == Side.FREE else Side.FREE
    return solve_along_feasible_path(H, c, lower, upper, A, free, side, y, x)


@kernel
def solve_along_feasible_path(H, c, lower, upper, A, free, side, y, x):
    """The primal active-set method, from x (n,) clipped to the box."""
    n = len(c)
    for i in range(n):
        x[i] = min(max(x[i], lower[i]), upper[i])
        side[i] = Side.AT_LOWER if x[i] <= lower[i] else Side.AT_UPPER if x[i] >= upper[i] else Side.FREE
    for _ in range(8 * n + 20):
        if not _solve_free(H, c, lower, upper, A, free, side, y):
            return False
        share, blocking = 1.0, -1
        for i in range(n):
            if y[i] < lower[i] and share * (x[i] - y[i]) > x[i] - lower[i]:
                share, blocking = (x[i] - lower[i]) / (x[i] - y[i]), i
            elif y[i] > upper[i] and share * (y[i] - x[i]) > upper[i] - x[i]:
                share, blocking = (upper[i] - x[i]) / (y[i] - x[i]), i
        for i in range(n):
            x[i] = y[i] if blocking < 0 else min(max(x[i] + share * (y[i] - x[i]), lower[i]), upper[i])
        if blocking >= 0:
            side[blocking] = Side.AT_LOWER if y[blocking] < lower[blocking] else Side.AT_UPPER
            x[blocking] = lower[blocking] if side[blocking] == Side.AT_LOWER else upper[blocking]
            continue
        leaving, worst = -1, 0.0
        for i in range(n):
            if side[i] != Side.FREE and _contradicts(H, c, lower, upper, side, x, i):
                push = abs(_slope(H, c, x, i))
                if push > worst:
                    worst, leaving = push, i
        if leaving < 0:
            return True
        side[leaving] = Side.FREE
    return True


@device_kernel
def _contradicts(H, c, lower, upper, side, x, i):
    """Variable i does not belong where it is: outside its bounds, or pushed off its bound by more than rounding."""
    if side[i] == Side.FREE:
        return x[i] < lower[i] or x[i] > upper[i]
    size = abs(c[i])
    for j in range(len(c)):
        size += abs(H[i, j] * x[j])
    return lower[i] < upper[i] and side[i] * _slope(H, c, x, i) > 1e-13 * size


@device_kernel
def _slope(H, c, x, i):
    """Entry i of the gradient H x + c."""
    g = c[i]
    for j in range(len(c)):
        g += H[i, j] * x[j]
    return g


@device_kernel
def _solve_free(H, c, lower, upper, A, free, side, x):
    """x (n,) with the bound variables on their bounds, the free ones optimal, by A = L D L^T; False if D is not > 0."""
    n, m = len(c), 0
    for i in range(n):
        if side[i] == Side.FREE:
            free[m] = i
            m += 1
        else:
            x[i] = lower[i] if side[i] == Side.AT_LOWER else upper[i]
    for a in range(m):
        i = free[a]
        s = -c[i]
        if m < n:
            for j in range(n):
                if side[j] != Side.FREE:
                    s -= H[i, j] * x[j]
        x[i] = s
    for a in range(m):
        i = free[a]
        s = x[i]
        for b in range(a):
            t = H[i, free[b]]
            for k in range(b):
                t -= A[a, k] * A[k, b]
            A[b, a] = t  # L D above the diagonal, L below it
            A[a, b] = t * A[b, b]
        t = H[i, i]
        for k in range(a):
            t -= A[a, k] * A[k, a]
        if not t > 0.0:
            return False
        A[a, a] = 1.0 / t  # the inverse of D on it
        for k in range(a):
            s -= A[a, k] * x[free[k]]
        x[i] = s
    for a in range(m - 1, -1, -1):
        i = free[a]
        s = x[i] * A[a, a]
        for k in range(a + 1, m):
            s -= A[k, a] * x[free[k]]
        x[i] = s
    return True
