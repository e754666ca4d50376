"""Which displacements the rows of a task do not feel, by a QR factorisation.

With the rows of A (m, n), Householder's reflections and column pivoting give `A^T P = Q R` (Golub and Van Loan, "Matrix
Computations", 2013, section 5.4.2); the rank r is the number of pivots above a share of the first. The last n - r
columns of Q are an orthonormal basis of the null space of A. The same factors give the shortest x with `A x = b`, and
the multipliers of the rows that balance a gradient.

The factored matrix is held as `At`, its first n rows and m columns: R on and above the diagonal, below it the
reflections, each with a first entry of 1 that is not stored and a scale in `tau` (m,); `order` (m,) of int64 is P.
"""

from __future__ import annotations

import math

from maira_qp.kernels.compilation import bare_kernel


@bare_kernel
def factor(At, n, m, threshold, tau, order):
    """Factor the (n, m) corner of At in place. The rank: pivots above `threshold` times the first."""
    for c in range(m):
        order[c] = c
    first = 0.0
    for j in range(min(n, m)):
        pivot, most = j, -1.0
        for c in range(j, m):
            square = 0.0
            for i in range(j, n):
                square += At[i, c] * At[i, c]
            if square > most:
                pivot, most = c, square
        norm = math.sqrt(max(most, 0.0))
        if j == 0:
            first = norm
        if not norm > threshold * first:
            return j
        if pivot != j:
            order[j], order[pivot] = order[pivot], order[j]
            for i in range(n):
                At[i, j], At[i, pivot] = At[i, pivot], At[i, j]
        head = At[j, j]
        diagonal = -norm if head > 0.0 else norm
        tau[j] = (diagonal - head) / diagonal
        At[j, j] = diagonal
        scale = 1.0 / (head - diagonal)
        for i in range(j + 1, n):
            At[i, j] *= scale
        for c in range(j + 1, m):
            s = At[j, c]
            for i in range(j + 1, n):
                s += At[i, j] * At[i, c]
            s *= tau[j]
            At[j, c] -= s
            for i in range(j + 1, n):
                At[i, c] -= s * At[i, j]
    return min(n, m)


@bare_kernel
def reflect(At, n, j, tau, x):
    """Apply reflection j to x (n,), in place."""
    s = x[j]
    for i in range(j + 1, n):
        s += At[i, j] * x[i]
    s *= tau[j]
    x[j] -= s
    for i in range(j + 1, n):
        x[i] -= s * At[i, j]


@bare_kernel
def null_vector(At, n, rank, tau, k, x):
    """Column k, from 0, of the basis of the null space into x (n,)."""
    for i in range(n):
        x[i] = 0.0
    x[rank + k] = 1.0
    for j in range(rank - 1, -1, -1):
        reflect(At, n, j, tau, x)


@bare_kernel
def shortest_solution(At, n, rank, tau, order, b, x):
    """The shortest x (n,) with `A x = b`, b (m,); rows beyond the rank are left out."""
    for i in range(rank, n):
        x[i] = 0.0
    for j in range(rank):
        s = b[order[j]]
        for i in range(j):
            s -= At[i, j] * x[i]
        x[j] = s / At[j, j]
    for j in range(rank - 1, -1, -1):
        reflect(At, n, j, tau, x)


@bare_kernel
def balance(At, n, m, rank, tau, order, x, multipliers):
    """Multipliers (m,) with `A^T multipliers = -x` in least squares; x (n,) is overwritten.

    Rows beyond the rank get 0; a rank below that of the factorisation gives smaller multipliers near a singularity.
    """
    for j in range(m):
        multipliers[j] = 0.0
    for j in range(rank):
        reflect(At, n, j, tau, x)
    for j in range(rank - 1, -1, -1):
        s = -x[j]
        for c in range(j + 1, rank):
            s -= At[j, c] * multipliers[order[c]]
        multipliers[order[j]] = s / At[j, j]
