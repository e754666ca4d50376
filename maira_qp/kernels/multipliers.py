"""Multipliers of rows that balance a gradient: the compiled form of `maira_qp.problem.costs.multipliers`.

They are those of least squares, and the smallest of those. Rows that are independent give them by a QR factorisation.
Where there are more rows than joints, or rows that depend on each other, singular values below a share of the largest
count as zero, and so do those below that share of the longest row with all of its joints: where the joints that move a
task are held, what is left of its rows is rounding. The singular values are the roots of the eigenvalues of `A A^T` or
`A^T A`, whichever is smaller, which is exact enough since such multipliers only bend a model.
"""

from __future__ import annotations

import math

from maira_qp.kernels.compilation import bare_kernel
from maira_qp.kernels.eigenvectors import diagonalise
from maira_qp.kernels.null_space import NONE, balance, extend, others, shortest_solution

INDEPENDENT = 1e-4
"""Rows are independent if no pivot is below this share of the first, or of the longest row."""

SQUARED_THRESHOLD = 1e-12
"""The square of the share of the largest singular value below which one counts as zero."""


@bare_kernel
def find_multipliers(rows, g, held, F, tau, order, joints, x, G, D, V, multipliers):
    """Multipliers (m,) with `A^T multipliers = -g`, A the columns of rows (m, n) of joints that are not `held` (n,).

    Work: F (s, s), tau, order and x (s,), s the larger of m and n; joints (n,) of int64; G, D, V (n, n).
    """
    m, count, longest = len(rows), others(held, joints), _longest(rows)
    few = count < m
    for a in range(count):
        i = joints[a]
        x[a] = -g[i] if few else g[i]
        for r in range(m):
            if few:
                F[r, a] = rows[r, i]
            else:
                F[a, r] = rows[r, i]
    if few:
        if extend(F, m, NONE, count, INDEPENDENT, longest, tau, order) == count:
            shortest_solution(F, m, count, tau, order, x, multipliers)
            return
    elif extend(F, count, NONE, m, INDEPENDENT, longest, tau, order) == m:
        balance(F, count, m, m, tau, order, x, multipliers)
        return
    _of_truncated_rows(rows, longest, g, joints[:count], x, G, D, V, multipliers)


@bare_kernel
def _longest(rows):
    """Norm of the longest of the rows (m, n)."""
    longest = 0.0
    for row in rows:
        square = 0.0
        for value in row:
            square += value * value
        longest = max(longest, square)
    return math.sqrt(longest)


@bare_kernel
def _of_truncated_rows(rows, longest, g, joints, x, G, D, V, multipliers):
    """The same by eigenvalues, for rows of any rank."""
    m, count = len(rows), len(joints)
    few = count < m
    k = min(m, count)
    for a in range(k):
        s = g[joints[a]]
        if not few:
            s = 0.0
            for i in joints:
                s += rows[a, i] * g[i]
        x[a] = s
        for b in range(k):
            s = 0.0
            if few:
                for r in range(m):
                    s += rows[r, joints[a]] * rows[r, joints[b]]
            else:
                for i in joints:
                    s += rows[a, i] * rows[b, i]
            G[a, b] = s
    diagonalise(G, k, D, V)
    largest = longest * longest
    for p in range(k):
        largest = max(largest, D[p, p])
    for a in range(k):
        G[0, a] = 0.0
    for p in range(k):
        if D[p, p] > SQUARED_THRESHOLD * largest:
            s = 0.0
            for a in range(k):
                s -= V[p, a] * x[a]
            for a in range(k):
                G[0, a] += s / D[p, p] * V[p, a]
    for r in range(m):
        s = 0.0
        for a in range(count):
            s += rows[r, joints[a]] * G[0, a] if few else 0.0
        multipliers[r] = s if few else G[0, r]
