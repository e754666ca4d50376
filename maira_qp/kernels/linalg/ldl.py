"""Small positive matrices by the factorisation L D L^T, of their (k, k) corners."""

from __future__ import annotations

from maira_qp.kernels.jit.decorators import kernel


@kernel
def factor_ldl(H, k, least, F):
    """L below the diagonal of F, D on it, L D above; False where a pivot of the symmetric H is not above `least`."""
    for i in range(k):
        pivot = H[i, i]
        for j in range(i):
            h = H[i, j]
            for p in range(j):
                h -= F[i, p] * F[p, j]
            F[j, i] = h
            F[i, j] = h / F[j, j]
            pivot -= F[i, j] * h
        if not pivot > least:
            return False
        F[i, i] = pivot
    return True


@kernel
def solve_ldl(F, k, x):
    """Solve with the factored matrix, x (k,) in place."""
    for i in range(k):
        for j in range(i):
            x[i] -= F[i, j] * x[j]
    for i in range(k - 1, -1, -1):
        x[i] /= F[i, i]
        for j in range(i + 1, k):
            x[i] -= F[j, i] * x[j]
