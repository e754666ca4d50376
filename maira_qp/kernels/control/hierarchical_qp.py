"""A strict hierarchy of quadratic levels in a box: the compiled form of `problem.qp.hierarchy`, see there.

The rows of the levels above are factored one level after the other in one growing factorisation: the last columns of
its orthogonal factor are a basis of what is left to the levels below. Rows that say nothing new are told by their size
before the rows above them are taken out of them.
"""

from __future__ import annotations

import math

from maira_qp.kernels.jit.decorators import device_kernel
from maira_qp.kernels.linalg.convexify import convexify
from maira_qp.kernels.linalg.qr_null_space import NONE, extend, null_basis, others, reduce
from maira_qp.kernels.qp.box_qp import solve_box_qp
from maira_qp.kernels.qp.null_space_qp import solve_row_qp

ROW_THRESHOLD = 1e-11
"""Pivots of tasks below this share of the longest row, or of the first pivot, count as zero."""

ESCAPE = 1e-3
"""As in `problem.qp.hierarchy`."""


@device_kernel
def solve_each_level(objectives, share, work):
    """The displacements of the first level alone, of the first two, and so on into work.displacements (L, n): how many.

    Within the bounds work.lower and work.upper, with the models of `levels.level_models`, each pull times `share`.
    """
    H, c, mu, lower, upper, low, high = work.H, work.c, work.mu, work.lower, work.upper, work.low, work.high
    dq, part, g, z, b = work.dq, work.part, work.g, work.z, work.b
    displacements, joints, Z, M, A, V, F = work.displacements, work.joints, work.Z, work.M, work.A, work.V, work.F
    n, held, rank = len(dq), work.locked, NONE
    for i in range(n):
        g[i] = share * c[0, i]
        for j in range(n):
            M[i, j] = H[0, i, j] + (mu[0] if i == j else 0.0)
    if work.saddle[0] >= 0.0:
        _descend_first(M, g, lower, upper, work)
    if not solve_box_qp(M, g, lower, upper, A, work.free, work.side, work.y, dq):
        return 0
    worth = 1.0
    if work.still[0] > 0.0:
        for i in range(n):
            g[i] = share * c[0, i]
        worth = _worth(H[0], mu[0], g, dq, work.still[0])
        for i in range(n):
            worth = worth if lower[i] <= 0.0 <= upper[i] else 1.0
    for i in range(n):
        dq[i] *= worth
        displacements[0, i] = min(max(dq[i], lower[i]), upper[i])
        held[i] = not lower[i] < upper[i]
    count = others(held, joints)
    for level in range(1, len(objectives)):
        rank = add_rows(work, level - 1, joints[:count], rank, ROW_THRESHOLD)
        k = count - rank
        if k == 0:
            return level
        for i in range(n):
            s = share * c[level, i] + mu[level] * dq[i]
            for j in range(n):
                s += H[level, i, j] * dq[j]
            g[i] = s
            part[i], low[i], high[i] = 0.0, min(lower[i] - dq[i], 0.0), max(upper[i] - dq[i], 0.0)
        null_basis(F, work.tau, joints, count, rank, g, work.y, Z, b)
        reduce(H[level], k, Z, work.y, M)
        for p in range(k):
            M[p, p] += mu[level]
        if work.saddle[level] >= 0.0:
            descend(M, b, k, Z, work.saddle[level], A, V, z)
        else:
            convexify(M, k, A, V)
        solve_row_qp(M, b, k, Z, low, high, work.row_qp, work.row_qp_index, z, part)
        worth = _worth(H[level], mu[level], g, part, work.still[level]) if work.still[level] > 0.0 else 1.0
        for i in range(n):
            dq[i] += worth * part[i]
            displacements[level, i] = min(max(dq[i], lower[i]), upper[i])
    return len(objectives)


@device_kernel
def _worth(H, mu, c, step, still):
    """The share of a step (n,) that is worth its way, as `problem.qp.hierarchy._worth`; c (n,) the gradient."""
    fall, square = 0.0, 0.0
    for i in range(len(step)):
        s = 2.0 * c[i] + mu * step[i]
        for j in range(len(step)):
            s += H[i, j] * step[j]
        fall -= 0.5 * s * step[i]
        square += step[i] * step[i]
    return max(0.0, 1.0 - still * math.sqrt(square) / fall) if fall > 0.0 else 0.0


@device_kernel
def _descend_first(H, c, lower, upper, work):
    """`descend` in the joints that can move, where others are locked at a displacement."""
    n, joints, R, Z, b, A, V = len(c), work.joints, work.C, work.Z, work.b, work.A, work.V
    k = 0
    for i in range(n):
        if lower[i] < upper[i]:
            joints[k] = i
            k += 1
    for p in range(k):
        i = joints[p]
        b[p] = c[i]
        for j in range(n):
            Z[j, p] = 1.0 if i == j else 0.0
            b[p] += 0.0 if lower[j] < upper[j] else H[i, j] * lower[j]
        for r in range(k):
            R[p, r] = H[i, joints[r]]
    descend(R, b, k, Z, work.saddle[0], A, V, work.z)
    for p in range(k):
        i = joints[p]
        c[i] = b[p]
        for j in range(n):
            c[i] -= 0.0 if lower[j] < upper[j] else H[i, j] * lower[j]
        for r in range(k):
            H[i, joints[r]] = R[p, r]


@device_kernel
def descend(H, c, k, Z, saddle, A, V, x):
    """H (k, k) made positive, and c (k,) given a pull out of saddle points, as `problem.qp.hierarchy.descending`.

    Work: A and V (k, k), x (k,).
    """
    if convexify(H, k, A, V):
        return
    n = len(Z)
    if k == 1:
        A[0, 0], V[0, 0] = -H[0, 0], 1.0
    for p in range(k):
        value = A[p, p]
        if value >= -saddle:
            continue
        slope, least = 0.0, -ESCAPE * value
        for a in range(k):
            slope += c[a] * V[p, a]
        if abs(slope) >= least:
            continue
        side = -slope
        if abs(slope) < 1e-9 * least:
            side = 0.0
            for i in range(n):
                s = 0.0
                for a in range(k):
                    s += Z[i, a] * V[p, a]
                side = s if abs(s) > abs(side) else side
        pull = slope + math.copysign(least, side)
        for a in range(k):
            c[a] -= pull * V[p, a]


@device_kernel
def add_rows(work, level, joints, rank, threshold):
    """Factor what the levels below this one must leave as it is: the rank so far. `joints` are those that move.

    Pivots below the threshold, a share of the longest row or of the first pivot, count as zero.
    """
    F, rows, ends = work.F, work.rows, work.ends
    n, longest = len(joints), 0.0
    first = ends[level - 1] if level > 0 else 0
    m = ends[level] - first
    for r in range(m):
        square = 0.0
        for value in rows[first + r]:
            square += value * value
        for a in range(n):
            F[a, rank + r] = rows[first + r, joints[a]]
        longest = max(longest, square)
    return extend(F, n, rank, rank + m, threshold, math.sqrt(longest), work.tau, work.order)
