"""Follow a path of poses: first the way along branches and self-motions, for the whole path, then each of its poses.

Layers of configurations along the path (`layers.py`) are linked by dynamic programming (`line.py`); between the layers
the line is filled by descents, and what turns out to jump between two of them is not taken again. The line is smoothed
in a corridor around it (`corridor.py`). Where layers were too coarse to be linked, or the line has steps much larger
than others, they are made again finer.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from typing import Any

import numpy as np

from maira_qp.problem.targets import SEED_0, Targets, seed_words
from maira_qp.results.path_solution import PathSolution, Rules
from maira_qp.solvers.compiled.problem_arrays import ProblemArrays
from maira_qp.solvers.paths.continuity import is_continuous
from maira_qp.solvers.paths.corridor import filled, largest_steps, smoothed
from maira_qp.solvers.paths.descents import PathArrays
from maira_qp.solvers.paths.layers import Density, layer_indices, layers_of
from maira_qp.solvers.paths.line import Edge, best_line
from maira_qp.solvers.reference.engine import residual

DENSITY = Density(spacing=0.3, most=150, fresh=16)
ROUNDS = 3
"""How often layers are made, each time finer."""
REPAIRS = 6
"""How often a line is sought in the same layers, without the links that turned out to jump."""
WIDEST = 0.6
"""How far a joint may move between two layers [rad, or of the arm's length], unless one step may be larger."""
CALM = 4.0
"""A line whose largest step is at most so many times the mean step is not sought again in finer layers."""


def track(
    engines: Any, arrays: ProblemArrays, targets: Targets, q0: np.ndarray | None, seed: int, rules: Rules
) -> PathSolution:
    """Follow the path of N targets from a start (n,), or from any, by some rules.

    `engines` solve for single poses, see `solvers.dispatch`. Poses that nothing was found to reach divide the path:
    each part between them is followed by itself.
    """
    path, rng = PathArrays(arrays, np.ascontiguousarray(targets.rows[:, 0])), np.random.default_rng(seed)
    alone = engines.solve_batch(targets, None, seed_words(seed), None, None)
    q, reached, reasons = alone.q.copy(), alone.success.copy(), {}
    if q0 is not None and len(path):
        first = engines.solve(targets.poses(0), q0, SEED_0)
        q[0], reached[0] = first.q, first.success
    for begin, end in runs(reached):
        part = PathArrays(arrays, path.rows[begin:end])
        q[begin:end] = follow(part, q[begin:end], begin == 0 and q0 is not None, rules.step, rng)
    for k in np.flatnonzero(~reached).tolist():
        solution = engines.solve(targets.poses(k), q[k - 1] if k else q0, SEED_0)
        q[k], reasons[k] = solution.q, solution.status.meaning
    return _judged(engines, path, targets, q, rules, reasons)


def _judged(
    engines: Any, path: PathArrays, targets: Targets, q: np.ndarray, rules: Rules, reasons: dict[int, str]
) -> PathSolution:
    """The result, by a fresh forward kinematics of each configuration (N, n)."""
    problem, continuous = engines.problem, np.ones(max(len(q) - 1, 0), dtype=bool)
    errors = [residual(problem.costs(targets.poses(k))[0], problem.robot.at(q[k])) for k in range(len(q))]
    position, orientation = np.reshape(errors, (-1, 2)).T
    reached = np.asarray(problem.is_reached(position, orientation))
    both = reached[:-1] & reached[1:] & (largest_steps(q, rules.step) <= 1.0)
    if both.any():
        continuous[both] = is_continuous(path, q)[both]
    return PathSolution(q, reached, position, orientation, rules, continuous, reasons, engines)


def follow(
    path: PathArrays, known: np.ndarray, is_start_given: bool, window: np.ndarray, rng: np.random.Generator
) -> np.ndarray:
    """Configurations (N, n) along a path, with as few steps beyond the window as were found.

    Args:
        path: N poses and their problem.
        known: some configuration (N, n) for each pose, which reaches it.
        is_start_given: the first of them is that of the path.
        window: the largest step (n,) of each joint from pose to pose [rad or m].
        rng: of the configurations that are drawn.
    """
    if len(path) < 2:
        return known
    density, best, least = DENSITY, None, np.inf
    at, layers = np.arange(0), list[np.ndarray]()
    for _ in range(ROUNDS):
        at = layer_indices(path, density.spacing)
        layers = layers_of(path, at, known, is_start_given, density, rng)
        q = _continuous_line(path, at, layers, window, is_start_given)
        if q is not None:
            q = smoothed(path, q, window, is_start_given)
            steps = largest_steps(q, window)
            if steps.max() < least:
                best, least = q, steps.max()
            if least <= CALM * steps.mean():
                break
        density = density.finer()
    return best if best is not None else _with_reconfigurations(path, at, layers, window, is_start_given)


def _continuous_line(
    path: PathArrays, at: np.ndarray, layers: list[np.ndarray], window: np.ndarray, is_start_given: bool
) -> np.ndarray | None:
    """A line (N, n) that reaches every pose without a step beyond the window; None: none was found."""
    windows, forbidden = _windows(path, at, window), set[Edge]()
    for _ in range(REPAIRS):
        line = best_line(layers, windows, forbidden, path.arrays.problem.turns, is_start_given)
        if line.reconfigurations:
            return None
        q, arrived = filled(path, at, line.q)
        amiss = np.flatnonzero(~arrived[1:] | (largest_steps(q, window) > 1.0)) + 1
        if not len(amiss):
            amiss = np.flatnonzero(~is_continuous(path, q)) + 1
        if not len(amiss):
            return q
        forbidden |= {(k, line.chosen[k - 1], line.chosen[k]) for k in np.unique(np.searchsorted(at, amiss)).tolist()}
    return None


def _windows(path: PathArrays, at: np.ndarray, window: np.ndarray) -> np.ndarray:
    """How far (L - 1, n) each joint may move from layer to layer."""
    robot = path.arrays.robot
    widest = np.maximum(window, WIDEST * np.where(robot.slides, robot.length, 1.0))
    return np.asarray(np.minimum(np.diff(at)[:, None] * window, widest))


def _with_reconfigurations(
    path: PathArrays, at: np.ndarray, layers: list[np.ndarray], window: np.ndarray, is_start_given: bool
) -> np.ndarray:
    """A line (N, n) with the fewest reconfigurations: before each it is followed pose by pose as far as that goes."""
    knots = best_line(layers, _windows(path, at, window), set(), path.arrays.problem.turns, is_start_given).q
    q, arrived = filled(path, at, knots)
    for k, (left, right) in enumerate(pairwise(at.tolist())):
        if arrived[left : right + 1].all() and largest_steps(q[left : right + 1], window).max() <= 1.0:
            continue
        for i in range(left + 1, right):
            (q[i],), (is_there,) = path.descend(np.array([i]), q[i - 1 : i])
            if not is_there or largest_steps(q[i - 1 : i + 1], window)[0] > 1.0:
                back = _followed_back(path, knots[k + 1], i, right)
                q[i:right] = back
                break
    return q


def _followed_back(path: PathArrays, end: np.ndarray, first: int, last: int) -> np.ndarray:
    """Configurations at poses first, ..., last - 1, followed pose by pose from one (n,) at the pose `last`."""
    q = np.empty((last - first, path.n))
    for i in range(last - 1, first - 1, -1):
        (end,), _ = path.descend(np.array([i]), end[None])
        q[i - first] = end
    return q


def runs(holds: np.ndarray) -> Iterator[tuple[int, int]]:
    """First and past-the-last index of each run of what holds (N,)."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], holds.astype(int), [0]])))
    yield from zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True)
