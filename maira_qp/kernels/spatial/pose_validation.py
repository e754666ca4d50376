"""Poses from callers, checked and made exact, a row of twelve numbers each."""

from __future__ import annotations

from maira_qp.kernels.jit.decorators import device_kernel, kernel

FINE, NOT_FINITE, NOT_RIGID = 0, 1, 2

EXACT = 1e-14
"""A rotation this near to orthonormal is taken as it is."""


@kernel
def pose_row(T, within, row):
    """R by rows and p of a transformation T (4, 4) into `row` (12,), R made the nearest rotation; or what is wrong.

    R may be off orthonormal by `within`, which must be small: the polar factor is the sum of a series, of which four
    terms are exact to rounding then (Higham, "Functions of matrices", 2008, chapter 8).
    """
    total = 0.0
    for i in range(4):
        for j in range(4):
            total += 0.0 * T[i, j]
    for i in range(3):
        row[9 + i] = T[i, 3]
        for j in range(3):
            row[3 * i + j] = T[i, j]
    if total != 0.0:
        return NOT_FINITE
    if T[3, 0] != 0.0 or T[3, 1] != 0.0 or T[3, 2] != 0.0 or T[3, 3] != 1.0:
        return NOT_RIGID
    deviation = _deviation(row)
    right_handed = (
        T[0, 0] * (T[1, 1] * T[2, 2] - T[1, 2] * T[2, 1])
        - T[0, 1] * (T[1, 0] * T[2, 2] - T[1, 2] * T[2, 0])
        + T[0, 2] * (T[1, 0] * T[2, 1] - T[1, 1] * T[2, 0])
        > 0.0
    )
    if not (deviation <= within and right_handed):
        return NOT_RIGID
    if deviation > EXACT:
        _make_orthonormal(T, row)
    return FINE


@kernel
def pose_rows(T, within, rows, faults):
    """`pose_row` of each of T (N, 4, 4) into rows (N, 12), and what is wrong into `faults` (N,)."""
    for k in range(len(T)):
        faults[k] = pose_row(T[k], within, rows[k])


@device_kernel
def _deviation(row):
    """The largest entry of |R R^T - I|."""
    largest = 0.0
    for i in range(3):
        for j in range(i + 1):
            product = row[3 * i] * row[3 * j] + row[3 * i + 1] * row[3 * j + 1] + row[3 * i + 2] * row[3 * j + 2]
            largest = max(largest, abs(product - (1.0 if i == j else 0.0)))
    return largest


@device_kernel
def _make_orthonormal(T, row):
    """R (I - D / 2 + 3 D^2 / 8 - 5 D^3 / 16) with D = R^T R - I, of the R in T (4, 4), into the row."""
    for k in range(9):
        row[k] = -0.3125 * T[k // 3, k % 3]
    for coefficient in (0.375, -0.5, 1.0):  # Horner's rule
        for i in range(3):
            a, b, c = row[3 * i], row[3 * i + 1], row[3 * i + 2]
            for j in range(3):
                row[3 * i + j] = coefficient * T[i, j] + (a * _off(T, 0, j) + b * _off(T, 1, j) + c * _off(T, 2, j))


@device_kernel
def _off(T, i, j):
    """An entry of R^T R - I."""
    return T[0, i] * T[0, j] + T[1, i] * T[1, j] + T[2, i] * T[2, j] - (1.0 if i == j else 0.0)
