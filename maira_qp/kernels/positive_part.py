"""A symmetric matrix made positive by the size of its eigenvalues: a descent direction from any Hessian.

The compiled form of `maira_qp.problem.hierarchy.positive_part`. Most matrices that come are positive, which the pivots
of a factorisation show at little cost; the others are diagonalised by Jacobi's rotations (Golub and Van Loan, "Matrix
Computations", 2013, section 8.5).
"""

from __future__ import annotations

import math

from maira_qp.kernels.compilation import bare_kernel
from maira_qp.kernels.ldl import factor_ldl

SWEEPS = 30
"""Jacobi's method converges quadratically: six or seven sweeps are common."""

LEAST_SHARE, LEAST = 1e-9, 1e-12
"""Eigenvalues are lifted to this share of the largest, and to this size."""


@bare_kernel
def make_positive(H, k, D, V):
    """Replace H (k, k) by its positive part, in place, unless it is positive already: whether it was. Work: D, V."""
    if k == 1:
        positive = H[0, 0] > 0.0
        H[0, 0] = max(abs(H[0, 0]), LEAST)
        return positive
    largest = 0.0
    for i in range(k):
        largest = max(largest, abs(H[i, i]))
    if factor_ldl(H, k, max(LEAST_SHARE * largest, LEAST), D):
        return True
    diagonalise(H, k, D, V)
    largest = 0.0
    for i in range(k):
        largest = max(largest, abs(D[i, i]))
    for i in range(k):
        D[i, i] = max(abs(D[i, i]), LEAST_SHARE * largest, LEAST)
    for i in range(k):
        for j in range(i + 1):
            h = 0.0
            for p in range(k):
                h += V[i, p] * D[p, p] * V[j, p]
            H[i, j] = h
            H[j, i] = h
    return False


@bare_kernel
def diagonalise(H, k, D, V):
    """Eigenvalues on the diagonal of D (k, k) and eigenvectors in the columns of V (k, k) of a symmetric H (k, k)."""
    size = 0.0
    for i in range(k):
        for j in range(k):
            D[i, j] = H[i, j]
            V[i, j] = 1.0 if i == j else 0.0
            size = max(size, abs(H[i, j]))
    for _ in range(SWEEPS):
        off = 0.0
        for i in range(k):
            for j in range(i):
                off = max(off, abs(D[i, j]))
        if not off > 1e-15 * size:  # NaN ends here too
            break
        for i in range(k):
            for j in range(i):
                _rotate(D, V, k, j, i)


@bare_kernel
def _rotate(D, V, k, p, q):
    """The rotation in the plane of p and q that makes D[p, q] zero."""
    if D[p, q] == 0.0:
        return
    theta = (D[q, q] - D[p, p]) / (2.0 * D[p, q])
    t = 1.0 / (abs(theta) + math.sqrt(1.0 + theta * theta))
    t = t if theta >= 0.0 else -t
    c = 1.0 / math.sqrt(1.0 + t * t)
    s = t * c
    for i in range(k):
        a, b = D[i, p], D[i, q]
        D[i, p], D[i, q] = c * a - s * b, s * a + c * b
    for i in range(k):
        a, b = D[p, i], D[q, i]
        D[p, i], D[q, i] = c * a - s * b, s * a + c * b
    for i in range(k):
        a, b = V[i, p], V[i, q]
        V[i, p], V[i, q] = c * a - s * b, s * a + c * b
