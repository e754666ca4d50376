"""Minima of many functions of one variable, each within an interval, side by side.

Brent's method ("Algorithms for minimization without derivatives", 1973, chapter 5), of which every line acts on arrays:
the vertex of the parabola through the three best points where that is a good step, a golden section else.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

RESOLUTION = 1e-8
"""Minima are known to about this: closer, values of a function differ by their rounding alone."""
MOST = 100
"""Steps at most."""
_GOLDEN = 0.5 * (3 - np.sqrt(5))


def minima(
    function: Callable[[np.ndarray, np.ndarray], np.ndarray], low: np.ndarray, high: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Where (m,) in [low, high] (m,) each of m functions has a local minimum, and its value (m,).

    `function(rows, x)` gives the values (k,) of the functions with the numbers `rows` (k,) at x (k,).
    """
    a, b = low.copy(), high.copy()
    x = a + _GOLDEN * (b - a)
    rows = np.arange(len(x))
    fx = function(rows, x)
    w, v, fw, fv = x.copy(), x.copy(), fx.copy(), fx.copy()
    step, before = np.zeros(len(x)), np.zeros(len(x))  # the last, and the one before that
    for _ in range(MOST):
        middle = 0.5 * (a + b)
        rows = np.flatnonzero(np.abs(x - middle) > 2 * RESOLUTION - 0.5 * (b - a))
        if not len(rows):
            break
        points, values = np.array([x, w, v])[:, rows], np.array([fx, fw, fv])[:, rows]
        step[rows], before[rows] = _step((a[rows], b[rows]), points, values, (step[rows], before[rows]))
        u = x[rows] + np.where(np.abs(step[rows]) >= RESOLUTION, step[rows], np.copysign(RESOLUTION, step[rows]))
        fu = function(rows, u)
        better = fu <= fx[rows]
        inner, value = np.where(better, x[rows], u), np.where(better, fx[rows], fu)  # the worse of the two
        left = (u < x[rows]) != better
        a[rows], b[rows] = np.where(left, inner, a[rows]), np.where(left, b[rows], inner)
        second = better | (value <= fw[rows]) | (w[rows] == x[rows])
        third = ~second & ((value <= fv[rows]) | (v[rows] == x[rows]) | (v[rows] == w[rows]))
        v[rows] = np.where(second, w[rows], np.where(third, inner, v[rows]))
        fv[rows] = np.where(second, fw[rows], np.where(third, value, fv[rows]))
        w[rows], fw[rows] = np.where(second, inner, w[rows]), np.where(second, value, fw[rows])
        x[rows], fx[rows] = np.where(better, u, x[rows]), np.where(better, fu, fx[rows])
    return x, fx


def _step(
    ends: tuple[np.ndarray, np.ndarray], points: np.ndarray, values: np.ndarray, steps: tuple[np.ndarray, np.ndarray]
) -> tuple[np.ndarray, np.ndarray]:
    """The next step (k,) from the best of three points (3, k), and what is the one before it from then on.

    steps: the last one (k,) and the one before.
    """
    (a, b), (x, w, v), (fx, fw, fv), (step, before) = ends, points, values, steps
    r, q = (x - w) * (fx - fv), (x - v) * (fx - fw)
    p, q = (x - v) * q - (x - w) * r, 2 * (q - r)
    p, q = np.where(q > 0, -p, p), np.abs(q)
    good = (
        (np.abs(before) > RESOLUTION) & (np.abs(p) < np.abs(0.5 * q * before)) & (p > q * (a - x)) & (p < q * (b - x))
    )
    parabola = p / np.where(good, q, 1.0)
    near_end = (x + parabola - a < 2 * RESOLUTION) | (b - x - parabola < 2 * RESOLUTION)
    parabola = np.where(near_end, np.copysign(RESOLUTION, 0.5 * (a + b) - x), parabola)
    longer = np.where(x < 0.5 * (a + b), b - x, a - x)
    return np.where(good, parabola, _GOLDEN * longer), np.where(good, step, longer)
