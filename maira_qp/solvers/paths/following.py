"""The line along a path: through layers of configurations, with as few reconfigurations and as even steps as are found.

Layers at some of the poses (`layers.py`) are linked by dynamic programming (`line.py`); between them the line is filled
by descents, and what turns out to jump between two of them is not taken again. The line is smoothed in a corridor
around it (`corridor.py`). Where layers were too coarse to be linked, or the line has steps much larger than others,
they are made again finer, and in the end at all poses about there.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import pairwise

import numpy as np

from maira_qp.solvers.paths.continuity import is_continuous, misleading
from maira_qp.solvers.paths.corridor import filled, smoothed
from maira_qp.solvers.paths.descents import PathArrays
from maira_qp.solvers.paths.failures import ROUNDING, open_end
from maira_qp.solvers.paths.layers import Density, layer_indices, layers_from, layers_of
from maira_qp.solvers.paths.line import Edge, Line, best_line

COARSE = Density(spacing=0.3, most=150, fresh=16, cell=0.15)
DENSITIES = COARSE, COARSE.finer(), COARSE.finer().finer()
"""Of the layers that are made, one after the other."""
REPAIRS = 6
"""How often a line is sought in the same layers, without the links that turned out to jump."""
WIDEST = 0.6
"""How far a joint may move between two layers [rad, or of the arm's length], unless one step may be larger."""
WIDER = (1.0, 4.0, 16.0)
"""A line is sought with so many times the allowed steps, for smoothing may make them small enough."""
LOOPS = 8
"""Beginnings of a loop that are tried."""
CLOSINGS = 4
"""Lines that end where they begin of which it is tried whether they lead along the path."""
CALM, NARROWER, CLOSE = 4.0, (0.5, 0.7), 30
"""A line whose largest step is at most so many times the mean step is not sought again: with steps smaller than its
largest by such factors, which one large step in the place of many small ones is not, in finer layers, and in the end in
layers at all of so many poses on either side of that step."""


@dataclass(frozen=True, eq=False)
class Layering:
    """Layers of configurations at some poses of a path, and the best lines through them, none of them sought twice."""

    at: np.ndarray
    """(L,) indices of the poses"""
    layers: list[np.ndarray]
    """L configurations (M_l, n)"""
    is_start_given: bool
    _lines: dict[tuple[bytes, frozenset[Edge]], Line] = field(default_factory=dict, init=False)

    def line(self, path: PathArrays, forbidden: frozenset[Edge] = frozenset()) -> Line:
        """The best line without some links, by the steps that the path allows."""
        windows = self.windows(path)
        asked = windows.tobytes(), forbidden
        if asked not in self._lines:
            turns = path.problem.turns
            self._lines[asked] = best_line(self.layers, windows, set(forbidden), turns, self.is_start_given)
        return self._lines[asked]

    def windows(self, path: PathArrays) -> np.ndarray:
        """How far (L - 1, n) each joint may move from layer to layer."""
        return np.minimum(path.some(self.at).windows, _widest(path))


def follow(
    path: PathArrays,
    known: np.ndarray,
    is_start_given: bool,
    is_loop: bool,
    rng: np.random.Generator,
    densities: Sequence[Density] = DENSITIES,
) -> np.ndarray:
    """Configurations (N, n) along a path, with as few steps beyond the window as were found.

    Args:
        path: N poses and their problem.
        known: some configuration (N, n) for each pose, which reaches it.
        is_start_given: the first of them is that of the path.
        is_loop: the last is to be the first again.
        rng: of the configurations that are drawn.
        densities: of the layers, tried one after the other.
    """
    if len(path) < 2:
        return known
    nodes, fixed = [each[None] for each in known], (is_start_given or is_loop, is_loop)
    if is_start_given:
        for k, q in enumerate(_continued(path, known[0])):
            nodes[k + 1] = np.concatenate([q[None], nodes[k + 1]])

    best, least, line = None, np.inf, _loop if is_loop else _continuous_line
    layering = Layering(np.arange(0), [], is_start_given)
    for density in densities:
        at = layer_indices(path, density.spacing)
        layering = Layering(at, layers_of(path, at, nodes, is_start_given, density, rng), is_start_given)
        best, least = _bettered(path, best, fixed, partial(line, layering=layering))
        if best is not None and least <= 1.0 and _is_calm(path, best):
            return best
    if least > 1.0:
        roots, windows = layering.line(path).roots, layering.windows(path)
        layers = layers_from(path, layering.at, roots, windows, densities[-1], rng)
        if len(layers) == len(layering.at):
            layering = replace(layering, layers=layers)
            best, least = _bettered(path, best, fixed, partial(line, layering=layering))
            if best is not None and least <= 1.0 and _is_calm(path, best):
                return best
    if best is not None:
        at = _with_all_about(layering.at, path, int(path.largest_steps(best).argmax()))
        layering = Layering(at, layers_of(path, at, nodes, is_start_given, densities[-1], rng), is_start_given)
        best, least = _calmed(path, best, fixed, partial(line, layering=layering))
        if least <= 1.0:
            return best
    broken_up = _with_reconfigurations(path, known, layering)
    if best is None or breaks(path, broken_up) < breaks(path, best):
        best = broken_up
    return best


def _bettered(
    path: PathArrays,
    best: np.ndarray | None,
    fixed: tuple[bool, bool],
    line: Callable[[PathArrays], np.ndarray | None],
) -> tuple[np.ndarray | None, float]:
    """The best line (N, n) so far, or one with smaller steps; and its largest step."""
    least = np.inf
    for times in WIDER:
        best, least = _smoother(path, best, line(path.wider(times)), fixed)
        if least <= 1.0:
            break
    return (None, least) if best is None else _calmed(path, best, fixed, line)


def _smoother(
    path: PathArrays, best: np.ndarray | None, q: np.ndarray | None, fixed: tuple[bool, bool]
) -> tuple[np.ndarray | None, float]:
    """The one of two lines (N, n), or none, with the smaller largest step, the second smoothed, and that step."""
    q = None if q is None else _smoothed(path, q, fixed)
    known = [(float(path.largest_steps(each).max()), each) for each in (best, q) if each is not None]
    least, one = min(known, key=lambda each: each[0], default=(np.inf, None))
    return one, least


def _smoothed(path: PathArrays, q: np.ndarray, fixed: tuple[bool, bool]) -> np.ndarray:
    """A line (N, n) smoothed, or as it is where smoothing makes it jump."""
    smooth = smoothed(path, q, fixed)
    return smooth if not len(_jumps(path, smooth)) else q


def _jumps(path: PathArrays, q: np.ndarray) -> np.ndarray:
    """Indices (K,) of the poses to which a line (N, n) jumps from one branch to another."""
    return np.flatnonzero(~is_continuous(path, np.arange(len(q) - 1), q[:-1], q[1:])) + 1


def _calmed(
    path: PathArrays,
    best: np.ndarray,
    fixed: tuple[bool, bool],
    line: Callable[[PathArrays], np.ndarray | None],
) -> tuple[np.ndarray, float]:
    """A line (N, n), or one with smaller steps while it has a step much larger than others; and its largest step."""
    while not _is_calm(path, best):
        largest = float(path.largest_steps(best).max())
        for times in NARROWER:
            q = line(path.wider(times * largest))
            q = None if q is None else _smoothed(path, q, fixed)
            if q is not None and path.largest_steps(q).max() < largest:
                best = q
                break
        else:
            break
    return best, float(path.largest_steps(best).max())


def _with_all_about(at: np.ndarray, path: PathArrays, step: int) -> np.ndarray:
    """Indices (L,) of layers, and those of all poses about a step."""
    return np.union1d(at, np.arange(max(step + 1 - CLOSE, 0), min(step + 1 + CLOSE, len(path))))


def _is_calm(path: PathArrays, q: np.ndarray) -> bool:
    """Whether no step of a line (N, n) is much larger than others."""
    steps = path.largest_steps(q)
    return bool(steps.max() <= CALM * steps.mean())


def breaks(path: PathArrays, q: np.ndarray) -> int:
    """How many steps of a line (N, n) are larger than allowed."""
    return int((path.largest_steps(q) > 1.0 + ROUNDING).sum())


def _loop(path: PathArrays, layering: Layering) -> np.ndarray | None:
    """A line (N, n) whose end is its beginning; None: none was found from some of the beginnings."""
    begins = layering.layers[0]
    if not layering.is_start_given:
        free = layering.line(path).chosen[0]
        begins = np.concatenate([begins[[free]], np.delete(begins, free, axis=0)])[:LOOPS]
    tries = CLOSINGS
    for begin in begins:
        closed = replace(layering, layers=[begin[None], *layering.layers[1:-1], begin[None]])
        line = closed.line(path)
        if not line.reconfigurations and open_end(path.problem, line.q) is None:
            q = _continuous_line(path, closed)
            if q is not None and open_end(path.problem, q) is None:
                return q
            tries -= 1
            if not tries:
                break
    return None


def _continued(path: PathArrays, start: np.ndarray) -> Iterator[np.ndarray]:
    """Configurations (n,) at the second pose and on, each followed from the one before, as far as that goes."""
    q = start
    for k, window in enumerate(path.windows, 1):
        (there,), (arrived,) = path.descend(np.array([k]), q[None])
        if not arrived or (np.abs(there - q) > np.minimum(window, _widest(path))).any():
            return
        yield there
        q = there


def _continuous_line(path: PathArrays, layering: Layering) -> np.ndarray | None:
    """A line (N, n) that reaches every pose without a step beyond the window; None: none was found.

    Where a line jumps its link is not taken again, and, if it was not the first line, none that jumps between these
    layers: often there are many beside one another.
    """
    at, windows, forbidden = layering.at, layering.windows(path), frozenset[Edge]()
    for repair in range(REPAIRS):
        line = layering.line(path, forbidden)
        if line.reconfigurations:
            return None
        q, amiss = _along(path, at, line)
        if not len(amiss):
            return q
        for k in np.unique(np.searchsorted(at, amiss)).tolist():
            forbidden |= {line.edge(k)}
            if repair:
                forbidden |= misleading(path, at, layering.layers, k, windows[k - 1], line.q[k - 1])
    return None


def _along(path: PathArrays, at: np.ndarray, line: Line) -> tuple[np.ndarray, np.ndarray]:
    """The line through configurations at the poses `at` (L,), and the poses (K,) to which it does not lead."""
    q, arrived = filled(path, at, line.q)
    amiss = np.flatnonzero(~arrived[1:] | (path.largest_steps(q) > 1.0)) + 1
    return q, amiss if len(amiss) else _jumps(path, q)


def _widest(path: PathArrays) -> np.ndarray:
    """How far (n,) each joint may move between two layers, at most, unless one step is allowed to be larger."""
    robot = path.problem.robot
    return np.maximum(path.window / path.times, WIDEST * np.where(robot.slides, robot.length, 1.0))


def _with_reconfigurations(path: PathArrays, known: np.ndarray, layering: Layering) -> np.ndarray:
    """A line (N, n) with as few reconfigurations as were found: links that turn out to be more of them are not taken
    again, and, if they were not the first, none between their layers that do not lead along the path."""
    at, windows, forbidden = layering.at, layering.windows(path), frozenset[Edge]()
    best, fewest = known, np.inf
    for repair in range(REPAIRS):
        line = layering.line(path, forbidden)
        if line.reconfigurations >= fewest:
            break
        q = _broken_up(path, known, at, line.q)
        amiss = np.union1d(np.flatnonzero(path.largest_steps(q) > 1.0 + ROUNDING) + 1, _jumps(path, q))
        if len(amiss) < fewest:
            best, fewest = q, len(amiss)
        is_link = np.asarray((np.abs(np.diff(line.q, axis=0)) <= windows * (1.0 + ROUNDING)).all(axis=1))
        amiss = np.unique(np.searchsorted(at, amiss))
        amiss = amiss[is_link[amiss - 1]]
        if not len(amiss):
            break
        for k in amiss.tolist():
            forbidden |= {line.edge(k)}
            if repair:
                forbidden |= misleading(path, at, layering.layers, k, windows[k - 1], line.q[k - 1])
    return best


def _broken_up(path: PathArrays, known: np.ndarray, at: np.ndarray, knots: np.ndarray) -> np.ndarray:
    """A line (N, n) through configurations (L, n) at the poses `at`: before each reconfiguration it is followed pose by
    pose as far as that goes.

    What is lost on the way there and back is as it is `known` (N, n).
    """
    q, arrived = filled(path, at, knots)
    for k, (left, right) in enumerate(pairwise(at.tolist())):
        some = slice(left, right + 1)
        if arrived[some].all() and path.some(some).largest_steps(q[some]).max() <= 1.0:
            continue
        for i in range(left + 1, right):
            (q[i],), (is_there,) = path.descend(np.array([i]), q[i - 1 : i])
            step = slice(i - 1, i + 1)
            if not is_there or path.some(step).largest_steps(q[step])[0] > 1.0:
                q[i:right] = _followed_back(path, knots[k + 1], i, right)
                break
    lost = ~path.reached(q)[1]
    q[lost] = known[lost]
    return q


def _followed_back(path: PathArrays, end: np.ndarray, first: int, last: int) -> np.ndarray:
    """Configurations at poses first, ..., last - 1, followed pose by pose from one (n,) at the pose `last`."""
    q = np.empty((last - first, path.n))
    for i in range(last - 1, first - 1, -1):
        (end,), _ = path.descend(np.array([i]), end[None])
        q[i - first] = end
    return q
