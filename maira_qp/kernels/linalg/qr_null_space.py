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

import numpy as np

from maira_qp.kernels.jit.decorators import device_kernel, kernel

NONE = np.int64(0)
"""No literal, for which the compiler would make versions of their own of the functions that it is passed to."""

NO_PART = 1e-10
"""A joint with a smaller entry in a basis vector takes no part, and must not feel its limit."""


@kernel
def factor(At, n, m, threshold, tau, order):
    """Factor the (n, m) corner of At in place. The rank: pivots above `threshold` times the first."""
    return extend(At, n, NONE, m, threshold, 0.0, tau, order)


@kernel
def extend(At, n, rank, m, threshold, size, tau, order):
    """Factor columns rank to m of At (n, m) too, in place, where those before them are factored already: the new rank.

    A new pivot counts above `threshold` times the first new one, or times `size` where that is larger.
    """
    for c in range(rank, m):
        order[c] = c
        for j in range(rank):
            _reflect_column(At, n, j, tau, c)
    first = size
    for j in range(rank, min(n, m)):
        pivot, most = j, -1.0
        for c in range(j, m):
            square = 0.0
            for i in range(j, n):
                square += At[i, c] * At[i, c]
            if square > most:
                pivot, most = c, square
        norm = math.sqrt(max(most, 0.0))
        if j == rank:
            first = max(first, norm)
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
            _reflect_column(At, n, j, tau, c)
    return max(rank, min(n, m))


@device_kernel
def _reflect_column(At, n, j, tau, c):
    """Apply reflection j to column c of At, in place."""
    s = At[j, c]
    for i in range(j + 1, n):
        s += At[i, j] * At[i, c]
    s *= tau[j]
    At[j, c] -= s
    for i in range(j + 1, n):
        At[i, c] -= s * At[i, j]


@kernel
def reflect(At, n, j, tau, x):
    """Apply reflection j to x (n,), in place."""
    s = x[j]
    for i in range(j + 1, n):
        s += At[i, j] * x[i]
    s *= tau[j]
    x[j] -= s
    for i in range(j + 1, n):
        x[i] -= s * At[i, j]


@kernel
def others(held, joints):
    """The joints that are not `held` (n,) into `joints`: how many."""
    count = 0
    for i in range(len(held)):
        if not held[i]:
            joints[count] = i
            count += 1
    return count


@kernel
def null_vector(At, n, rank, tau, k, x):
    """Column k, from 0, of the basis of the null space into x (n,)."""
    for i in range(n):
        x[i] = 0.0
    x[rank + k] = 1.0
    for j in range(rank - 1, -1, -1):
        reflect(At, n, j, tau, x)


@kernel
def null_basis(At, tau, joints, count, rank, g, x, Z, c):
    """Basis Z (n, k) of the null space of the factored rows, and `c = Z^T g` (k,); k = count - rank. Work: x (n,)."""
    for b in range(count - rank):
        null_vector(At, count, rank, tau, b, x)
        for i in range(len(g)):
            Z[i, b] = 0.0
        s = 0.0
        for a in range(count):
            part = x[a] if abs(x[a]) >= NO_PART else 0.0
            Z[joints[a], b] = part
            s += part * g[joints[a]]
        c[b] = s


@kernel
def reduce(H, k, Z, x, M):
    """`Z^T H Z` into M (k, k); work: x (n,)."""
    n = len(x)
    for b in range(k):
        for i in range(n):
            s = 0.0
            for j in range(n):
                s += H[i, j] * Z[j, b]
            x[i] = s
        for a in range(b + 1):
            s = 0.0
            for i in range(n):
                s += Z[i, a] * x[i]
            M[a, b], M[b, a] = s, s


@kernel
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


@kernel
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
