"""Eight small dense QPs with boxes at once, by block principal pivoting: see `maira_qp.kernels.box_qp`.

All eight are factorised together however their active sets differ: a variable on its bound becomes a row and a column
of the identity matrix. The passes go on until every lane is settled; a lane that is settled repeats its last pass to
the bit. The few that cycle are solved one by one.
"""

from __future__ import annotations

import numpy as np

from maira_qp.kernels.box_qp import BLOCK_PASSES, solve_along_feasible_path
from maira_qp.kernels.compilation import bare_kernel
from maira_qp.kernels.lanes import LANES, any_lane, full, lane_bits, load, load2, select, size, store, store2


@bare_kernel
def solve_box_qps(H, c, lower, upper, A, side, alone, x):
    """Minimise `1/2 x^T H x + c^T x` over `lower <= x <= upper` in each lane, into x (n,).

    Work: A (n, n) and side (n,), and without lanes `alone` (2 n^2 + 7 n,). Returns a mask of the lanes whose matrix is
    positive definite.
    """
    _guess(c, lower, upper, side)
    definite = load(c, 0) == load(c, 0)  # everywhere, but for NaN
    for _ in range(BLOCK_PASSES):
        definite = _solve_free(H, c, lower, upper, A, side, x)
        moved = _pivot(H, c, lower, upper, side, x)
        if not any_lane(moved):
            return definite
    moving = lane_bits(moved & definite)
    for lane in range(LANES):
        if (moving >> np.uint64(lane)) & np.uint64(1):
            _solve_alone(H, c, lower, upper, lane, alone, x)
    return definite


@bare_kernel
def _guess(c, lower, upper, side):
    """A variable starts at a bound where 0 is on that bound and the slope there leads out of the box."""
    for i in range(len(c)):
        low, high, slope = load(lower, i), load(upper, i), load(c, i)
        at_upper = select((high <= 0.0) & (slope < 0.0), 1.0, full(c, 0.0))
        at_bound = select((low >= 0.0) & (slope > 0.0), -1.0, at_upper)
        store(side, i, select(low < high, at_bound, -1.0))


@bare_kernel
def _solve_free(H, c, lower, upper, A, side, x):
    """x (n,) with the bound variables on their bounds and the free ones optimal, by A = L D L^T."""
    n, bound = len(c), False
    for i in range(n):
        s = load(side, i)
        fixed = s != 0.0
        bound = any_lane(fixed) or bound
        store(x, i, select(fixed, select(s < 0.0, load(lower, i), load(upper, i)), -load(c, i)))
    if bound:
        for i in range(n):
            free, r = load(side, i) == 0.0, load(x, i)
            for j in range(n):
                s = load(side, j)
                on_bound = select(s < 0.0, load(lower, j), load(upper, j))
                r = r - select(free & (s != 0.0), load2(H, i, j) * on_bound, 0.0)
            store(x, i, r)
    definite = load(c, 0) == load(c, 0)  # everywhere, but for NaN
    for a in range(n):
        free, r, d = load(side, a) == 0.0, load(x, a), load2(H, a, a)
        for b in range(a):
            t = load2(H, a, b)
            if bound:
                t = select(free & (load(side, b) == 0.0), t, 0.0)
            for k in range(b):
                t = t - load2(A, a, k) * load2(A, k, b)
            row = t * load2(A, b, b)
            store2(A, b, a, t)  # L D above the diagonal, L below it
            store2(A, a, b, row)
            d = d - t * row
            r = r - row * load(x, b)
        d = select(free, d, 1.0)
        definite = definite & (d > 0.0)
        store2(A, a, a, 1.0 / d)  # the inverse of D on it
        store(x, a, r)
    for a in range(n - 1, -1, -1):
        r = load(x, a) * load2(A, a, a)
        for k in range(a + 1, n):
            r = r - load2(A, k, a) * load(x, k)
        store(x, a, r)
    return definite


@bare_kernel
def _pivot(H, c, lower, upper, side, x):
    """Move what contradicts the guess: see `box_qp`. Returns a mask of the lanes in which something moved."""
    n = len(c)
    moved = load(c, 0) < load(c, 0)  # nowhere
    for i in range(n):
        s, xi, low, high = load(side, i), load(x, i), load(lower, i), load(upper, i)
        free = s == 0.0
        now = select(free & (xi < low), -1.0, select(free & (xi > high), 1.0, s))
        if any_lane(~free):
            slope = load(c, i)
            scale = size(load(c, i))
            for j in range(n):
                term = load2(H, i, j) * load(x, j)
                slope = slope + term
                scale = scale + size(term)
            now = select((low < high) & (s * slope > 1e-13 * scale), 0.0, now)
        moved = moved | (now != s)
        store(side, i, now)
    return moved


@bare_kernel
def _solve_alone(H, c, lower, upper, lane, alone, x):
    """The QP of one lane along a feasible path."""
    n = len(c)
    H1, A1 = alone[: n * n].reshape(n, n), alone[n * n : 2 * n * n].reshape(n, n)
    vectors = alone[2 * n * n : 2 * n * n + 7 * n].reshape(7, n)
    c1, lower1, upper1, x1, y = vectors[0], vectors[1], vectors[2], vectors[3], vectors[4]
    free, side = vectors[5].view(np.int64), vectors[6].view(np.int64)
    for i in range(n):
        for j in range(n):
            H1[i, j] = H[i, j, lane]
        c1[i], lower1[i], upper1[i], x1[i] = c[i, lane], lower[i, lane], upper[i, lane], x[i, lane]
    solve_along_feasible_path(H1, c1, lower1, upper1, A1, free, side, y, x1)
    for i in range(n):
        x[i, lane] = x1[i]
