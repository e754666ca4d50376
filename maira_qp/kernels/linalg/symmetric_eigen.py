"""Eigenvalues and eigenvectors of a small symmetric matrix.

Householder's reflections make it tridiagonal, and the QR algorithm with Wilkinson's shifts diagonal (Golub and Van
Loan, "Matrix Computations", 2013, algorithms 8.3.1 to 8.3.3). The eigenvectors are kept as rows: a rotation then mixes
two rows, which the compiler makes a few wide instructions.
"""

from __future__ import annotations

import math

from maira_qp.kernels.jit.decorators import device_kernel, kernel

STEPS = 30
"""Of the QR algorithm for each eigenvalue: two are common."""

NEGLIGIBLE = 1e-16
"""Entries off the diagonal below this share of the largest entry count as zero."""


@kernel
def diagonalise(H, k, D, V):
    """Eigenvalues on the diagonal of D (k, k) and eigenvectors in the rows of V (k, k) of a symmetric H (k, k)."""
    size, total = 0.0, 0.0
    for i in range(k):
        for j in range(k):
            D[i, j] = H[i, j]
            V[i, j] = 1.0 if i == j else 0.0
            size = max(size, abs(H[i, j]))
            total += H[i, j]
    if abs(total) < math.inf:  # NaN is not
        _make_tridiagonal(D, V, k)
        _make_diagonal(D, V, k, NEGLIGIBLE * size)


@device_kernel
def _make_tridiagonal(D, V, k):
    """Reflections from both sides of D, and from the left of V."""
    for j in range(k - 2):
        head, square = D[j + 1, j], 0.0
        for i in range(j + 2, k):
            square += D[i, j] * D[i, j]
        if square == 0.0:
            continue
        norm = math.sqrt(head * head + square)
        end = -norm if head > 0.0 else norm
        # the reflection I - scale v v^T, v in row j of D, and scale D v in its column j
        D[j, j + 1] = head - end
        for i in range(j + 2, k):
            D[j, i] = D[i, j]
        scale = 1.0 / (norm * (norm + abs(head)))
        product = 0.0
        for i in range(j + 1, k):
            s = 0.0
            for p in range(j + 1, k):
                s += D[i, p] * D[j, p]
            D[i, j] = scale * s
            product += D[i, j] * D[j, i]
        product *= 0.5 * scale
        for i in range(j + 1, k):
            D[i, j] -= product * D[j, i]
        for i in range(j + 1, k):
            a, b = D[j, i], D[i, j]
            for p in range(j + 1, i + 1):
                D[i, p] -= a * D[p, j] + b * D[j, p]
                D[p, i] = D[i, p]
        for c in range(1, k):
            s = 0.0
            for i in range(j + 1, k):
                s += D[j, i] * V[i, c]
            s *= scale
            for i in range(j + 1, k):
                V[i, c] -= s * D[j, i]
        D[j + 1, j], D[j, j + 1] = end, end


@device_kernel
def _make_diagonal(D, V, k, negligible):
    """The QR algorithm on the tridiagonal D, its rotations applied to the rows of V too."""
    last = k - 1
    for _ in range(STEPS * k):
        while last > 0 and abs(D[last, last - 1]) <= negligible:
            last -= 1
        if last <= 0:
            break
        first = last - 1
        while first > 0 and abs(D[first, first - 1]) > negligible:
            first -= 1
        off = D[last, last - 1]
        half = 0.5 * (D[last - 1, last - 1] - D[last, last])
        root = math.sqrt(half * half + off * off)
        x = D[first, first] - D[last, last] + off * off / (half + (root if half >= 0.0 else -root))
        z = D[first + 1, first]
        for j in range(first, last):
            norm = math.sqrt(x * x + z * z)
            c, s = (x / norm, z / norm) if norm > 0.0 else (1.0, 0.0)
            if j > first:
                D[j, j - 1] = norm
            a, b, d = D[j, j], D[j + 1, j], D[j + 1, j + 1]
            across = 2.0 * c * s * b
            D[j, j] = c * c * a + across + s * s * d
            D[j + 1, j + 1] = s * s * a - across + c * c * d
            D[j + 1, j] = c * s * (d - a) + (c * c - s * s) * b
            if j + 1 < last:
                x, z = D[j + 1, j], s * D[j + 2, j + 1]
                D[j + 2, j + 1] *= c
            for p in range(k):
                a, b = V[j, p], V[j + 1, p]
                V[j, p], V[j + 1, p] = c * a + s * b, c * b - s * a
