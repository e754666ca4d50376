"""Poses from callers, checked and made exact, a row of twelve numbers each."""

from __future__ import annotations

from maira_qp.kernels.compilation import bare_kernel

FINE, NOT_FINITE, NOT_RIGID = 0, 1, 2

EXACT = 1e-14
"""A rotation this near to orthonormal is taken as it is."""


@bare_kernel
def pose_row(T, within, row):
    """R by rows and p of a transformation T (4, 4) into `row` (12,), R made the nearest rotation; or what is wrong.

    R may be off orthonormal by `within`, which must be small: then two steps of Newton's iteration for the polar
    factor, `R <- R (3 I - R^T R) / 2`, are exact to rounding (Higham, "Functions of matrices", 2008, section 8.3).
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
        _polar_step(row)
        _polar_step(row)
    return FINE


@bare_kernel
def pose_rows(T, within, rows, faults):
    """`pose_row` of each of T (N, 4, 4) into rows (N, 12), and what is wrong into `faults` (N,)."""
    for k in range(len(T)):
        faults[k] = pose_row(T[k], within, rows[k])


@bare_kernel
def _deviation(row):
    """The largest entry of |R R^T - I|."""
    largest = 0.0
    for i in range(3):
        for j in range(i + 1):
            product = row[3 * i] * row[3 * j] + row[3 * i + 1] * row[3 * j + 1] + row[3 * i + 2] * row[3 * j + 2]
            largest = max(largest, abs(product - (1.0 if i == j else 0.0)))
    return largest


@bare_kernel
def _polar_step(row):
    """One step of Newton's iteration: rows of R mixed by (3 I - R R^T) / 2, which is the same."""
    a, b, c, d, e, f, g, h, k = row[0], row[1], row[2], row[3], row[4], row[5], row[6], row[7], row[8]
    x, y, z = (
        1.5 - 0.5 * (a * a + b * b + c * c),
        1.5 - 0.5 * (d * d + e * e + f * f),
        1.5 - 0.5 * (g * g + h * h + k * k),
    )
    u, v, w = -0.5 * (a * d + b * e + c * f), -0.5 * (a * g + b * h + c * k), -0.5 * (d * g + e * h + f * k)
    row[0], row[1], row[2] = x * a + u * d + v * g, x * b + u * e + v * h, x * c + u * f + v * k
    row[3], row[4], row[5] = u * a + y * d + w * g, u * b + y * e + w * h, u * c + y * f + w * k
    row[6], row[7], row[8] = v * a + w * d + z * g, v * b + w * e + z * h, v * c + w * f + z * k
