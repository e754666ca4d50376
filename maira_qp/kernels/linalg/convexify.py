"""A symmetric matrix made positive by the size of its eigenvalues: a descent direction from any Hessian.

The compiled form of `problem.qp.hierarchy.convexified`. Most matrices that come are positive, which the pivots
of a factorisation show at little cost; the others are diagonalised.
"""

from __future__ import annotations

from maira_qp.kernels.jit.decorators import kernel
from maira_qp.kernels.linalg.ldl import factor_ldl
from maira_qp.kernels.linalg.symmetric_eigen import diagonalise

LEAST_SHARE, LEAST = 1e-9, 1e-12
"""Eigenvalues are lifted to this share of the largest, and to this size."""


@kernel
def convexify(H, k, D, V):
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
    for p in range(k):
        more = max(abs(D[p, p]), LEAST_SHARE * largest, LEAST) - D[p, p]
        if more > 0.0:
            for i in range(k):
                part = more * V[p, i]
                for j in range(k):
                    H[i, j] += part * V[p, j]
    return False
