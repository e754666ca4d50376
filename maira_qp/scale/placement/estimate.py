"""What bases are worth: how many tool poses are reached from each, and how well; by a map, by verdicts, by solves."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from maira_qp.problem.options import Options
from maira_qp.results.status import Reach
from maira_qp.robots.model.robot import Robot
from maira_qp.scale.placement.candidates import poses_of_bases, seen_from
from maira_qp.scale.reach.metrics import limit_distances, manipulabilities
from maira_qp.scale.reach.reach_map import ReachMap
from maira_qp.solvers.reachability import reachability
from maira_qp.solvers.solver import Solver

POSES = 65_536
"""Poses that are looked at together, which bounds the memory."""
FEW = 1024
"""The same where it may take long."""
RESTARTS = 15
"""Of descents, after which few poses are missed"""
QUALITIES = {"limit_distance": limit_distances, "manipulability": manipulabilities}
"""What makes one base better than another that reaches as much."""
Look = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]
"""Takes poses (N, 4, 4): which (N,) are reached, and how good (N,) that is."""


class Scores(NamedTuple):
    """What M bases are worth."""

    share: np.ndarray
    """(M,) of the poses, reached"""
    least: np.ndarray
    """(M,) the smallest quality of the poses that are reached; NaN: none is"""
    mean: np.ndarray
    """(M,) and the mean"""

    @property
    def order(self) -> np.ndarray:
        """Their indices (M,), the best first: by share, then by the smallest quality, then by the mean."""
        least, mean = (np.nan_to_num(values, nan=-1.0) for values in (self.least, self.mean))
        return np.lexsort((np.arange(len(self.share)), -mean, -least, -self.share))


def scores_of(reached: np.ndarray, quality: np.ndarray) -> Scores:
    """The scores of M bases from what became of N poses seen from each, both (M, N)."""
    count = reached.sum(axis=1)
    known = reached & ~np.isnan(quality)
    each = known.sum(axis=1)
    least = np.where(known, quality, np.inf).min(axis=1, initial=np.inf)
    total = np.where(known, quality, 0.0).sum(axis=1)
    none = each == 0
    return Scores(
        count / reached.shape[1],
        np.where(none, np.nan, least),
        np.where(none, np.nan, total / np.maximum(each, 1)),
    )


def scores_at(
    bases: np.ndarray,
    poses: np.ndarray,
    look: Look,
    progress: Callable[[int, int], object] | None = None,
    *,
    least: int = 0,
    misses: int | None = None,
) -> Scores:
    """The scores of bases, x, y, z [m] and yaw [rad] (M, 4), for poses (N, 4, 4).

    With `misses` only of the first bases: of `least`, and of more until so many poses were not reached.
    """
    parts, step, first, missed = [], max(1, (POSES if misses is None else FEW) // len(poses)), 0, 0
    while first < len(bases) and (misses is None or first < least or missed < misses):
        some = bases[first : first + step]
        reached, quality = look(seen_from(poses_of_bases(some), poses).reshape(-1, 4, 4))
        parts.append(scores_of(reached.reshape(len(some), -1), quality.reshape(len(some), -1)))
        first, missed = first + len(some), missed + int((~reached).sum())
        if progress is not None:
            progress(first, len(bases))
    return Scores(*(np.concatenate(each) for each in zip(*parts, strict=True)))


def by_map(reach: ReachMap, quality: str) -> Look:
    """What a map says of poses; a quality is the best of their cells."""

    def look(T: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return reach.query(T) == Reach.REACHABLE, reach.at(T[:, :3, 3], quality)

    return look


def by_verdicts(robot: Robot, options: Options, quality: str, seed: int, threads: int | None) -> Look:
    """What the solver finds, without the proofs of what it does not."""
    solver = Solver(robot, options=replace(options, max_restarts=min(options.max_restarts, RESTARTS)))

    def look(T: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        found = reachability(solver, T, seed=seed, threads=threads, proof_boxes=0)
        reached, values = found.verdict == Reach.REACHABLE, np.full(len(T), np.nan)
        values[reached] = QUALITIES[quality](robot, found.q[reached])
        return reached, values

    return look


def by_solves(solver: Solver, quality: str, seed: int, threads: int | None) -> Look:
    """What a solver returns."""

    def look(T: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        batch = solver.solve_batch(T, seed=seed, threads=threads)
        return batch.success, QUALITIES[quality](solver.robot, batch.q)

    return look
