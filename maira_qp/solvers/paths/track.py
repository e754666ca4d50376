"""Follow a path of poses: first the way along branches and self-motions, for the whole path, then each of its poses.

Layers of configurations along the path (`layers.py`) are linked by dynamic programming (`line.py`); between the layers
the line is filled by descents, and what turns out to jump between two of them is not taken again. The line is smoothed
in a corridor around it (`corridor.py`). Where layers were too coarse to be linked, or the line has steps much larger
than others, they are made again finer.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import pairwise
from typing import Any

import numpy as np

from maira_qp.problem.targets import SEED_0, Targets
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

Solve = Callable[[int, np.ndarray | None], np.ndarray]
"""What is returned at a pose, by index, that is not on the line, from the configuration before (n,)"""


def track(
    engines: Any, arrays: ProblemArrays, targets: Targets, q0: np.ndarray | None, seed: int, rules: Rules
) -> PathSolution:
    """Follow the path of N targets from a start (n,), or from any, by some rules."""
    problem, path, reasons = engines.problem, PathArrays(arrays, np.ascontiguousarray(targets.rows[:, 0])), {}

    def solve(k: int, near: np.ndarray | None) -> np.ndarray:
        solution = engines.solve(targets.poses(k), near, SEED_0)
        if not solution.success:
            reasons[k] = solution.status.meaning
        return np.asarray(solution.q)

    start = None
    if q0 is not None and len(path):
        first = engines.solve(targets.poses(0), q0, SEED_0)
        start = first.q if first.success else None
    q = follow(path, start, rules.step, seed, solve) if len(path) else np.empty((0, path.n))
    errors = [residual(problem.costs(targets.poses(k))[0], problem.robot.at(q[k])) for k in range(len(path))]
    position, orientation = np.reshape(errors, (-1, 2)).T
    reached = np.asarray(problem.is_reached(position, orientation))
    continuous = np.ones(max(len(q) - 1, 0), dtype=bool)
    both = reached[:-1] & reached[1:] & (largest_steps(q, rules.step) <= 1.0)
    if both.any():
        continuous[both] = is_continuous(path, q)[both]
    return PathSolution(q, reached, position, orientation, rules, continuous, reasons, engines)


def follow(path: PathArrays, q0: np.ndarray | None, window: np.ndarray, seed: int, solve: Solve) -> np.ndarray:
    """Configurations (N, n) along the path, with as few steps beyond the window (n,) [rad or m] as were found.

    Args:
        path: N poses and their problem.
        q0: the first configuration (n,), which reaches the first pose; None: any.
        window: the largest step of each joint from pose to pose.
        seed: of the configurations that are drawn.
        solve: what is returned at poses that the line does not reach.
    """
    rng, density = np.random.default_rng(seed), DENSITY
    best, least, at, layers = None, np.inf, np.arange(0), list[np.ndarray]()
    for _ in range(ROUNDS):
        at = layer_indices(path, density.spacing)
        layers = layers_of(path, at, q0, density, rng)
        q = _continuous_line(path, at, layers, window) if all(map(len, layers)) else None
        if q is not None:
            q = smoothed(path, q, window, q0 is not None)
            steps = largest_steps(q, window)
            if steps.max(initial=0.0) < least:
                best, least = q, steps.max(initial=0.0)
            if least <= 1.0 and least <= CALM * steps.mean():
                break
        density = density.finer()
    return best if best is not None and least <= 1.0 else _in_parts(path, at, layers, window, solve)


def _continuous_line(
    path: PathArrays, at: np.ndarray, layers: list[np.ndarray], window: np.ndarray
) -> np.ndarray | None:
    """A line (N, n) that reaches every pose without a step beyond the window; None: none was found."""
    windows, forbidden = _windows(path, at, window), set[Edge]()
    for _ in range(REPAIRS):
        line, jumps = best_line(layers, windows, forbidden)
        if jumps:
            return None
        q, arrived = filled(path, at, np.array([layer[j] for layer, j in zip(layers, line, strict=True)]))
        amiss = np.flatnonzero(~arrived[1:] | (largest_steps(q, window) > 1.0)) + 1
        if not len(amiss):
            amiss = np.flatnonzero(~is_continuous(path, q)) + 1
        if not len(amiss):
            return q
        forbidden |= {(k, line[k - 1], line[k]) for k in np.unique(np.searchsorted(at, amiss)).tolist()}
    return None


def _windows(path: PathArrays, at: np.ndarray, window: np.ndarray) -> np.ndarray:
    """How far (L - 1, n) each joint may move from layer to layer."""
    robot = path.arrays.robot
    widest = np.maximum(window, WIDEST * np.where(robot.slides, robot.length, 1.0))
    return np.asarray(np.minimum(np.diff(at)[:, None] * window, widest))


def _in_parts(
    path: PathArrays, at: np.ndarray, layers: list[np.ndarray], window: np.ndarray, solve: Solve
) -> np.ndarray:
    """Lines (N, n) as far as each goes, and between them, from one to the next, what `solve` returns."""
    q, windows = np.full((len(path), path.n), np.nan), _windows(path, at, window)
    for first, last in _runs([len(layer) > 0 for layer in layers]):
        line, _ = best_line(layers[first:last], windows[first : last - 1], set())
        q[at[first:last]] = [layer[j] for layer, j in zip(layers[first:last], line, strict=True)]
    known = np.flatnonzero(~np.isnan(q[:, 0]))
    for left, right in pairwise(known.tolist()):
        between = np.arange(left, right + 1)
        some, arrived = filled(
            PathArrays(path.arrays, path.rows[between]), np.array([0, right - left]), q[[left, right]]
        )
        if arrived.all() and largest_steps(some, window).max() <= 1.0:
            q[between] = some
    if len(known):
        for k in range(known[0] - 1, -1, -1):
            q[k] = solve(k, q[k + 1])
    for k in np.flatnonzero(np.isnan(q[:, 0])).tolist():
        q[k] = solve(k, q[k - 1] if k else None)
    return q


def _runs(holds: list[bool]) -> Iterator[tuple[int, int]]:
    """First and past-the-last index of each run of what holds."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], np.asarray(holds, dtype=int), [0]])))
    yield from zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True)
