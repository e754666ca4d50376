"""A small dense QP whose variables span a subspace that a box cuts, by a primal active-set method.

    min 1/2 z^T H z + c^T z   subject to   lower <= Z z <= upper,   lower <= 0 <= upper

z (k,) are coordinates in the subspace with the orthonormal basis Z (n, k), as of a lower level of the hierarchy. From
z = 0, which is always feasible, the active set changes one row at a time along a feasible, falling path (Nocedal and
Wright, "Numerical Optimization", 2006, algorithm 16.3, with the null-space step of section 16.2). Only rows that block
a step become active, so the active rows are independent. With one variable it is a clamp. H must be positive definite.
"""

from __future__ import annotations

import numpy as np

from maira_qp.kernels.jit.arena import Arena
from maira_qp.kernels.jit.decorators import device_kernel, kernel
from maira_qp.kernels.layout import Side
from maira_qp.kernels.linalg.ldl import factor_ldl, solve_ldl
from maira_qp.kernels.linalg.qr_null_space import balance, factor, null_vector

PARALLEL = 1e-12
"""A step moves a row if by more than this share of its own length: below, the row is a sum of active ones."""

WRONG = 1e-13
"""A multiplier has the wrong sign if by more than this share of the gradient's size."""

ROW_QP = Arena(
    "RowQP",
    "n",
    floats={**dict.fromkeys(("Bt", "Y", "M", "F"), "n, n"), **dict.fromkeys(("tau", "g", "step", "v"), "n")},
    integers=dict.fromkeys(("order", "rows", "sides"), "n"),
)
"""Work of a QP of n rows."""
RowQP, carve_row_qp = ROW_QP.Arrays, ROW_QP.carve


@kernel
def solve_row_qp(H, c, k, Z, lower, upper, floats, integers, z, x):
    """The solution into z (k,) and x = Z z (n,). False if H is not positive, or after too many passes.

    Where it is False, z is feasible and no worse than zero all the same. H, c, Z and z may be larger than k. Work, for
    more than one variable: floats and integers as long as `ROW_QP` says.
    """
    if k == 1:
        _clamp(H, c, Z, lower, upper, z, x)
        return True
    n = len(x)
    Bt, Y, M, F, tau, g, step, v, order, rows, sides = carve_row_qp(n, floats, integers)
    if not factor_ldl(H, k, 0.0, F):
        return False
    for p in range(k):
        z[p] = -c[p]
    solve_ldl(F, k, z)
    inside = True
    for i in range(n):
        x[i] = _row(Z, k, i, z)
        inside = inside and lower[i] <= x[i] <= upper[i]
    if inside:
        return True
    for p in range(k):
        z[p] = 0.0
    for i in range(n):
        x[i] = 0.0
    active = 0
    for _ in range(8 * n + 20):
        for a in range(active):
            for p in range(k):
                Bt[p, a] = Z[rows[a], p]
        rank = factor(Bt, k, active, PARALLEL, tau, order)
        size = _gradient(H, c, k, z, g)
        if rank < k:
            if not _newton_step(H, k, rank, Bt, tau, g, Y, M, F, v, step):
                return False
            blocking, side, share = _blocking_row(Z, k, lower, upper, step, x, rows[:active])
            for p in range(k):
                z[p] += share * step[p]
            for i in range(n):
                x[i] = _row(Z, k, i, z)
            for a in range(active):
                _put_on_its_bound(rows[a], sides[a], lower, upper, x)
            if blocking >= 0 and active == k:
                return False  # rounding took a row for independent that was not
            if blocking >= 0:
                rows[active], sides[active] = blocking, side
                _put_on_its_bound(blocking, side, lower, upper, x)
                active += 1
                continue
            _gradient(H, c, k, z, g)
        balance(Bt, k, active, rank, tau, order, g, v)
        leaving, worst = -1, WRONG * size
        for a in range(active):
            if -sides[a] * v[a] > worst:
                leaving, worst = a, -sides[a] * v[a]
        if leaving < 0:
            return True
        active -= 1
        rows[leaving], sides[leaving] = rows[active], sides[active]
    return False


@device_kernel
def _clamp(H, c, Z, lower, upper, z, x):
    """One variable: the free optimum, moved into the interval that the rows leave."""
    low, high = -np.inf, np.inf
    for i in range(len(x)):
        if Z[i, 0] != 0.0:
            slope = 1.0 / Z[i, 0]
            one, other = slope * lower[i], slope * upper[i]
            low, high = max(low, min(one, other)), min(high, max(one, other))
    z[0] = min(max(-c[0] / H[0, 0], low), high)
    for i in range(len(x)):
        x[i] = Z[i, 0] * z[0]


@device_kernel
def _gradient(H, c, k, z, g):
    """`H z + c` into g (k,); the size of what was added up."""
    size = 0.0
    for p in range(k):
        s, t = c[p], abs(c[p])
        for r in range(k):
            s += H[p, r] * z[r]
            t += abs(H[p, r] * z[r])
        g[p] = s
        size = max(size, t)
    return size


@device_kernel
def _row(Z, k, i, z):
    """Entry i of Z z."""
    s = 0.0
    for p in range(k):
        s += Z[i, p] * z[p]
    return s


@device_kernel
def _put_on_its_bound(i, side, lower, upper, x):
    """An active row holds to the bit."""
    x[i] = lower[i] if side == Side.AT_LOWER else upper[i]


@device_kernel
def _newton_step(H, k, rank, Bt, tau, g, Y, M, F, v, step):
    """The step (k,) to the optimum that leaves the active rows as they are; False if H is not positive."""
    f = k - rank
    for a in range(f):
        null_vector(Bt, k, rank, tau, a, step)
        for p in range(k):
            Y[p, a] = step[p]
    for a in range(f):
        s = 0.0
        for p in range(k):
            s -= Y[p, a] * g[p]
            h = 0.0
            for r in range(k):
                h += H[p, r] * Y[r, a]
            step[p] = h
        v[a] = s
        for b in range(a + 1):
            h = 0.0
            for p in range(k):
                h += Y[p, b] * step[p]
            M[a, b] = h
    if not factor_ldl(M, f, 0.0, F):
        return False
    solve_ldl(F, f, v)
    for p in range(k):
        s = 0.0
        for a in range(f):
            s += Y[p, a] * v[a]
        step[p] = s
    return True


@device_kernel
def _blocking_row(Z, k, lower, upper, step, x, active):
    """The first row not active to meet a bound along the step, which one, and at what share; -1 if none does."""
    blocking, side, share, longest = -1, 0, 1.0, 0.0
    for p in range(k):
        longest = max(longest, abs(step[p]))
    for i in range(len(x)):
        d = _row(Z, k, i, step)
        for row in active:
            d = 0.0 if row == i else d
        if d < -PARALLEL * longest and x[i] + share * d < lower[i]:
            blocking, side, share = i, Side.AT_LOWER, max((lower[i] - x[i]) / d, 0.0)
        elif d > PARALLEL * longest and x[i] + share * d > upper[i]:
            blocking, side, share = i, Side.AT_UPPER, max((upper[i] - x[i]) / d, 0.0)
    return blocking, side, share
