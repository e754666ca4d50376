"""Solutions by exhaustive multi-start: descents from random starts until it is long since one led to a new solution.

What is found is a list without proof. How long the search went on is told by `starts` and `without_new`: if every
solution is hit by a share s of all starts, one is missed with a probability of about (1 - s)^without_new.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

BATCH = 64
"""Starts between two looks at what they led to."""
PATIENCE, PATIENCE_EACH = 256, 32
"""Starts without a new solution after which the search ends: at least so many, and so many for each that is known."""
MOST_STARTS = 4096
"""Starts after which it ends in any case: at a singular pose there may be no end of solutions."""

Distance = Callable[[np.ndarray, np.ndarray], np.ndarray]


@dataclass(frozen=True)
class MultiStart:
    """What was found."""

    q: np.ndarray
    """Distinct configurations (k, n) [rad or m]"""
    starts: int
    """Descents in all"""
    without_new: int
    """Descents since the last one that led to a new configuration"""


def multi_start(
    arrivals: Callable[[np.ndarray], np.ndarray],
    draw: Callable[[int], np.ndarray],
    apart: Distance,
    resolution: float,
    first: np.ndarray,
    batch: int = BATCH,
    patience: int = PATIENCE,
    patience_each: int = PATIENCE_EACH,
    most_starts: int = MOST_STARTS,
) -> MultiStart:
    """Descents from the starts `first` (k, n) and then from random ones.

    `arrivals` tells where starts (N, n) lead, (N, n), NaN for those that lead nowhere; `draw` makes so many starts;
    `apart` tells how far (...) configurations (..., n) are from each other; up to `resolution` they are the same.
    """
    found, starts, without_new = np.empty((0, first.shape[1])), 0, 0
    begin = np.concatenate([first, draw(batch)])
    while without_new < max(patience, patience_each * len(found)) and starts < most_starts:
        ends = arrivals(begin)
        new = new_among(ends, found, apart, resolution)
        starts, without_new = starts + len(ends), (len(ends) - 1 - new[-1]) if new else without_new + len(ends)
        found, begin = np.concatenate([found, ends[new]]), draw(batch)
    return MultiStart(found, starts, without_new)


def new_among(q: np.ndarray, known: np.ndarray, apart: Distance, resolution: float) -> list[int]:
    """Which of q (N, n) are neither NaN, nor among those known (k, n), nor among those before them."""
    new: list[int] = []
    strangers = np.isfinite(q).all(axis=1) & (apart(q[:, None], known) > resolution).all(axis=1)
    for i in np.flatnonzero(strangers):
        if (apart(q[i], q[new]) > resolution).all():
            new.append(int(i))
    return new
