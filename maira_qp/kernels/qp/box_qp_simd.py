"""Eight small dense QPs with boxes at once, by block principal pivoting: see `kernels.qp.box_qp`.

All eight are factorised together however their active sets differ: a variable on its bound becomes a row and a column
of the identity matrix. The passes go on until every lane is settled; a lane that is settled repeats its last pass to
the bit. Where that takes long, a pass moves one variable a lane, the first that contradicts the guess, which cannot
cycle (Murty, "Note on a Bard-type scheme for solving the complementarity problem", 1974).

For one problem `box_qp` is a source of its own. It factorises the free variables alone, which lanes cannot, as their
active sets differ: with seven variables it takes 1.01, 0.91 and 0.80 us, the looser the box the longer, where this
source compiled for floats takes 1.46, 1.46 and 1.37.
"""

from __future__ import annotations

from maira_qp.kernels.jit.decorators import device_kernel, kernel
from maira_qp.kernels.jit.simd import (
    any_lane,
    broadcast,
    load,
    load2,
    magnitude,
    maximum,
    minimum,
    select,
    store,
    store2,
)
from maira_qp.kernels.qp.box_qp import BLOCK_PASSES


@kernel
def solve_box_qps(H, c, lower, upper, A, side, x):
    """Minimise `1/2 x^T H x + c^T x` over `lower <= x <= upper` in each lane, into x (n,).

    Work: A (n, n) and side (n,). Returns a mask of the lanes whose matrix is positive definite. Where a lane does not
    settle in time, by rounding or, with twenty variables and a slope that no Jacobian makes, by chance, its x is inside
    the box and need not be the minimum.
    """
    n = len(c)
    _guess(c, lower, upper, side)
    definite = load(c, 0) == load(c, 0)  # everywhere, but for NaN
    for turn in range(BLOCK_PASSES + 8 * n + 20):
        definite = definite & _solve_free(H, c, lower, upper, A, side, x)
        moved = _pivot(H, c, lower, upper, side, x, turn >= BLOCK_PASSES)
        if not any_lane(moved & definite):
            return definite
    for i in range(n):
        store(x, i, minimum(maximum(load(x, i), load(lower, i)), load(upper, i)))
    return definite


@device_kernel
def _guess(c, lower, upper, side):
    """A variable starts at a bound where 0 is on that bound and the slope there leads out of the box."""
    for i in range(len(c)):
        low, high, slope = load(lower, i), load(upper, i), load(c, i)
        at_upper = select((high <= 0.0) & (slope < 0.0), 1.0, broadcast(c, 0.0))
        at_bound = select((low >= 0.0) & (slope > 0.0), -1.0, at_upper)
        store(side, i, select(low < high, at_bound, -1.0))


@device_kernel
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


@device_kernel
def _pivot(H, c, lower, upper, side, x, one):
    """Move what contradicts the guess, or the first of it: see `box_qp`. A mask of the lanes where something moved."""
    n = len(c)
    moved = load(c, 0) < load(c, 0)  # nowhere
    for i in range(n):
        s, xi, low, high = load(side, i), load(x, i), load(lower, i), load(upper, i)
        free = s == 0.0
        now = select(free & (xi < low), -1.0, select(free & (xi > high), 1.0, s))
        if any_lane(~free):
            slope = load(c, i)
            scale = magnitude(slope)
            for j in range(n):
                term = load2(H, i, j) * load(x, j)
                slope = slope + term
                scale = scale + magnitude(term)
            now = select((low < high) & (s * slope > 1e-13 * scale), 0.0, now)
        if one:
            now = select(moved, s, now)
        moved = moved | (now != s)
        store(side, i, now)
    return moved
