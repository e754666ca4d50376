"""Layers of configurations along a path: at some of its poses, configurations that reach it, from all over the arm.

Each layer is made of the one before. Its configurations are followed to the next pose, beside them others that differ
along the self-motion, and some that begin anywhere: so that a layer covers what leads on, and what comes new. What
follows is followed by descents, and no branch has a label: labels flip where a shoulder or a wrist passes zero.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from maira_qp.robots.model.revolutions import TURN
from maira_qp.solvers.paths.descents import PathArrays

CELL, WIDER = 0.15, 1.3
"""Edge of the cells [rad or m] of which a layer keeps one configuration each, and how fast they grow if there are too
many."""
ASIDE = 0.25
"""How far [rad or m] along the self-motion others begin, about."""
NEAR_LIMIT = 0.3
"""A configuration this near to a limit [rad] may be held up by it before the next layer."""
ON_LIMIT = 1e-9
"""One that is nearer to it than this [rad] is on it."""
HASH = np.uint64(0x9E3779B97F4A7C15)
"""Odd, its powers tell cells apart, modulo 2^64."""
FIRST_TIMES = 6
"""The first layer begins from so many times as many configurations as others do, and each without a redundancy."""
FAR = 3.0
"""A metre counts as so many radians, divided by the arm's length: of what lies between two layers."""


@dataclass(frozen=True)
class Density:
    """How closely layers cover a path."""

    spacing: float
    """What the pose moves between two layers, at most [rad]"""
    most: int
    """Configurations of a layer"""
    fresh: int
    """Configurations that each layer begins from anywhere"""
    both_ways: bool = False
    """What a layer holds is followed back to the one before as well: what leads there from a singular pose, say"""

    def finer(self) -> Density:
        """Three times as many layers of half as many configurations more, followed both ways."""
        return Density(self.spacing / 3, 3 * self.most // 2, 3 * self.fresh // 2, True)


def arc_lengths(path: PathArrays) -> np.ndarray:
    """How far (N,) the pose has moved up to each, the larger of its rotation and its scaled translation [rad]."""
    R, p = path.rows[:, :9].reshape(-1, 3, 3), path.rows[:, 9:]
    cosine = 0.5 * (np.einsum("nij,nij->n", R[1:], R[:-1]) - 1.0)
    turned = np.arccos(np.clip(cosine, -1.0, 1.0))
    moved = np.linalg.norm(np.diff(p, axis=0), axis=1) * FAR / path.arrays.robot.length
    return np.concatenate([[0.0], np.cumsum(np.maximum(turned, moved))])


def layer_indices(path: PathArrays, spacing: float) -> np.ndarray:
    """Indices (L,) of the poses at which there are layers, the first and the last among them."""
    s, last = arc_lengths(path), len(path) - 1
    count = min(len(path), max(4, int(np.ceil(s[-1] / spacing)) + 1))
    evenly = np.searchsorted(s, np.linspace(0.0, s[-1], count))
    return np.unique(np.concatenate([[0], np.minimum(evenly, last), [last]]))


def layers_of(
    path: PathArrays,
    at: np.ndarray,
    known: list[np.ndarray],
    is_start_given: bool,
    density: Density,
    rng: np.random.Generator,
) -> list[np.ndarray]:
    """Configurations (M_l, n) that reach the poses `at` (L,), an array a layer.

    Each holds the known ones (k, n) of its pose, of N poses; where the start is given, the first holds no other. Joints
    whose range is a turn or more are at one turn.
    """
    layers, before = [], np.empty((0, path.n))
    for index in at.tolist():
        here = known[index]
        if layers or not is_start_given:
            is_redundant = path.n > path.rank  # else its configurations are few, and none leads to another
            fresh = density.fresh * (1 if layers and is_redundant else FIRST_TIMES)
            starts = [_held_up(path, before), before, *_aside(before, rng), _anywhere(path, fresh, rng)]
            starts = np.concatenate(starts)
            found, arrived = path.descend(np.full(len(starts), index), starts)
            here = _merged(path, index, here, found[arrived], density.most)
        layers.append(here)
        before = here
    if density.both_ways:
        for k in range(len(layers) - 2, 0 if is_start_given else -1, -1):
            starts = np.concatenate([_held_up(path, layers[k + 1]), layers[k + 1]])
            found, arrived = path.descend(np.full(len(starts), at[k]), starts)
            layers[k] = _merged(path, at[k], layers[k], found[arrived], density.most)
    return layers


def _merged(path: PathArrays, index: int, here: np.ndarray, found: np.ndarray, most: int) -> np.ndarray:
    """Both, (k, n) and (m, n), at one turn, one of each cell, at most so many."""
    here = path.problem.turns.in_window(np.concatenate([here, found]))
    at_limits = _at_limits(path, here, ON_LIMIT)
    kept = _thinned(here, at_limits != here, most)
    here, at_limits = here[kept], at_limits[kept]
    if not path.problem.turns.everywhere.any():
        return here
    exact = path.exactly(np.full(len(kept), index), at_limits)
    return exact + TURN * np.round((here - at_limits) / TURN)


def _held_up(path: PathArrays, q: np.ndarray) -> np.ndarray:
    """Those of the configurations (M, n) that are near a limit but for whole turns, at the turn in which it limits.

    A layer has one turn of all, in which a descent passes where another turn ends. Where only the end itself leads on,
    as to a pose in the corner of all limits, none of what it finds would do.
    """
    there = _at_limits(path, q, NEAR_LIMIT)
    return there[(there != q).any(axis=1)]


def _at_limits(path: PathArrays, q: np.ndarray, near: float) -> np.ndarray:
    """The configurations (M, n) with joints that are as near as that [rad] to a limit at the turn in which it limits.

    Of joints with a turn or more, if they are not as near to one at the turn at which they are.
    """
    turns, robot, there = path.problem.turns, path.problem.robot, q
    if not turns.everywhere.any():
        return q
    stays = (np.abs(q - robot.lower) < near) | (np.abs(robot.upper - q) < near)
    for limit, inward in ((robot.lower, 1.0), (robot.upper, -1.0)):
        limits = turns.everywhere & np.isfinite(limit)
        room = inward * turns.shortest(q - np.where(limits, limit, 0.0))
        is_near = limits & ~stays & (room >= -ON_LIMIT) & (room < near)
        there = np.where(is_near, limit + inward * np.maximum(room, 0.0), there)
    return there


def _aside(q: np.ndarray, rng: np.random.Generator) -> list[np.ndarray]:
    """Twice as many configurations, each moved in a random direction: from there a descent ends aside."""
    moved = []
    for _ in range(2):
        direction = rng.normal(size=q.shape)
        direction /= np.linalg.norm(direction, axis=1, keepdims=True)
        moved.append(q + ASIDE * rng.uniform(0.2, 1.5, size=(len(q), 1)) * direction)
    return moved


def _anywhere(path: PathArrays, count: int, rng: np.random.Generator) -> np.ndarray:
    """Random configurations (count, n) within the limits, each joint at one turn."""
    return rng.uniform(*path.arrays.problem.turns.window, size=(count, path.n))


def _thinned(q: np.ndarray, on_limits: np.ndarray, most: int) -> np.ndarray:
    """Indices of one of the configurations (M, n) of each cell and set of joints (M, n) on limits, at most so many."""
    cell, marks = CELL, HASH ** np.arange(1, 2 * q.shape[1] + 1, dtype=np.uint64)
    while len(q):
        keys = np.concatenate([np.round(q / cell).astype(np.int64), on_limits], axis=1).astype(np.uint64) @ marks
        _, first = np.unique(keys, return_index=True)
        if len(first) <= most:
            return np.sort(first)
        cell *= WIDER
    return np.arange(0)
