"""A line that reaches all poses of a path, made smooth: within a corridor along the self-motion around it.

At each pose the line's configuration and others beside it, at even distances along the direction that leaves the pose
as it is, are layers again, each of a few, and the line through them with the least largest steps is the next one. The
corridor narrows from pass to pass. What is left of corners is evened out (`evenness.py`).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.interpolate import PchipInterpolator

from maira_qp.kernels.paths.corridor import link_beside
from maira_qp.solvers.paths.descents import PathArrays
from maira_qp.solvers.paths.evenness import EVEN, LOW, evened

BESIDE = 5
"""Configurations on either side of a line."""
WIDTHS = (0.3, 0.1)
"""How far [rad or m] the outermost are from it, pass by pass."""
STRIDES = (16, 8, 4, 2, 1, 1, 1)
"""Poses that are between those that are drawn to the middle of their neighbours, pass by pass."""
LARGEST_STEPS = 10.0
"""What the eighth power of a step, by the largest of the line, counts against its square."""


def smoothed(path: PathArrays, q: np.ndarray, fixed: tuple[bool, bool]) -> np.ndarray:
    """A line (N, n) on the path with smaller largest steps, by what is allowed; its first and last may be fixed."""
    for stride in STRIDES:
        if 2 * stride < len(q):
            q = _drawn_to_the_middle(path, q, stride)
    if path.n <= path.rank or len(q) < 3:
        return q
    for width in WIDTHS:
        q = _best_within(path, q, width, fixed)
    q = evened(path, q, fixed, EVEN)
    return q if path.largest_steps(q).max() <= 1.0 else evened(path, q, fixed, LOW)


def filled(
    path: PathArrays, knots: np.ndarray, q: np.ndarray, between: Callable = PchipInterpolator
) -> tuple[np.ndarray, np.ndarray]:
    """A line (N, n) through configurations (K, n) at the poses `knots` (K,), and which of its poses it reaches (N,).

    Descents begin on the curves `between` the knots: cubic ones without overshoot, or a `CubicSpline` through an even
    line, which has no corners either.
    """
    if len(knots) == len(path):
        return q.copy(), np.ones(len(q), dtype=bool)
    guess = between(path.place[knots], q)(path.place) if len(knots) > 1 else np.repeat(q, len(path), axis=0)
    line, arrived = path.descend(np.arange(len(path)), guess)
    line[knots], arrived[knots] = q, True
    return line, arrived


def _drawn_to_the_middle(path: PathArrays, q: np.ndarray, stride: int) -> np.ndarray:
    """The line with some of its configurations moved to between their neighbours, where that shortens the steps."""
    q, count = q.copy(), len(q)
    for first in (stride, 2 * stride):
        i = np.arange(first, count - stride, 2 * stride)
        if len(i):
            middle, arrived = path.descend(i, 0.5 * (q[i - stride] + q[i + stride]))
            shorter = arrived & (_span(path, middle, q, i, stride) < _span(path, q[i], q, i, stride))
            q[i[shorter]] = middle[shorter]
    if stride == 1:
        return q
    knots = np.unique(np.append(np.arange(0, count, stride), count - 1))
    between, arrived = filled(path, knots, q[knots])
    is_better = arrived.all() and path.largest_steps(between).max() <= 1.2 * path.largest_steps(q).max()
    return between if is_better else q


def _span(path: PathArrays, middle: np.ndarray, q: np.ndarray, i: np.ndarray, stride: int) -> np.ndarray:
    """The larger of the steps from neighbours to configurations in the middle."""
    before, after = np.abs(middle - q[i - stride]) / path.window, np.abs(middle - q[i + stride]) / path.window
    return np.maximum(before.max(axis=1), after.max(axis=1))


def _best_within(path: PathArrays, q: np.ndarray, width: float, fixed: tuple[bool, bool]) -> np.ndarray:
    """The line of least largest steps in a corridor of so much [rad or m] on either side."""
    count, wide, largest = len(q), 2 * BESIDE + 1, path.largest_steps(q).max()
    if largest == 0.0:
        return q
    along = path.self_motions(q)[:, :, -1]
    shifts = width * np.linspace(-1.0, 1.0, wide)
    beside, arrived = path.descend(
        np.repeat(np.arange(count), wide), (q[:, None] + shifts[:, None] * along[:, None]).reshape(-1, path.n)
    )
    nodes = beside.reshape(count, wide, path.n)
    is_node = arrived.reshape(count, wide) & (np.abs(nodes - q[:, None]).max(axis=2) <= 3.0 * width)
    nodes[:, BESIDE], is_node[:, BESIDE] = q, True
    for end, is_fixed in zip((0, -1), fixed, strict=True):
        if is_fixed:
            is_node[end] = np.arange(wide) == BESIDE
    line, back = np.empty(count, dtype=np.int64), np.empty((count, wide), dtype=np.int64)
    link_beside(nodes, is_node, path.windows, largest, LARGEST_STEPS, np.empty((2, wide)), back, line)
    better = nodes[np.arange(count), line]
    return better if path.largest_steps(better).max() < largest else q
