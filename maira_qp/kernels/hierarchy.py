"""A strict hierarchy of quadratic levels in a box: the compiled form of `maira_qp.problem.hierarchy`, see there.

The rows of the levels above are factored one level after the other in one growing factorisation: the last columns of
its orthogonal factor are a basis of what is left to the levels below. Rows that say nothing new are told by their size
before the rows above them are taken out of them.
"""

from __future__ import annotations

import math

from maira_qp.kernels.box_qp import solve_box_qp
from maira_qp.kernels.compilation import inner_kernel
from maira_qp.kernels.levels import WEIGHT
from maira_qp.kernels.null_space import NONE, extend, null_basis, others, reduce
from maira_qp.kernels.positive_part import make_positive
from maira_qp.kernels.row_qp import solve_row_qp

ROW_THRESHOLD = 1e-11
"""Pivots of tasks below this share of the longest row, or of the first pivot, count as zero."""

HESSIAN_THRESHOLD = 1e-6
"""The same for the Hessian of a level with an objective."""


@inner_kernel
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
    if not solve_box_qp(M, g, lower, upper, A, work.free, work.side, work.y, dq):
        return 0
    for i in range(n):
        displacements[0, i] = min(max(dq[i], lower[i]), upper[i])
        held[i] = not lower[i] < upper[i]
    count = others(held, joints)
    for level in range(1, len(objectives)):
        rank = _add_rows(objectives, work, level - 1, joints[:count], rank)
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
        make_positive(M, k, A, V)
        solve_row_qp(M, b, k, Z, low, high, work.row_memory, work.row_index, z, part)
        for i in range(n):
            dq[i] += part[i]
            displacements[level, i] = min(max(dq[i], lower[i]), upper[i])
    return len(objectives)


@inner_kernel
def _add_rows(objectives, work, level, joints, rank):
    """Factor what the levels below this one must leave as it is: the rank so far. `joints` are those that move."""
    F, H, rows, ends = work.F, work.H[level], work.rows, work.ends
    n, longest = len(joints), 0.0
    if objectives[level, WEIGHT] != 0.0:
        m = len(H)
        for a in range(n):
            for r in range(m):
                F[a, rank + r] = H[joints[a], r]
        return extend(F, n, rank, rank + m, HESSIAN_THRESHOLD, 0.0, work.tau, work.order)
    first = ends[level - 1] if level > 0 else 0
    m = ends[level] - first
    for r in range(m):
        square = 0.0
        for a in range(n):
            value = rows[first + r, joints[a]]
            F[a, rank + r] = value
            square += value * value
        longest = max(longest, square)
    return extend(F, n, rank, rank + m, ROW_THRESHOLD, math.sqrt(longest), work.tau, work.order)
