"""Layers of configurations along a path: at some of its poses, configurations that reach it, from all over the arm.

Each layer is made of the one before. Its configurations are followed to the next pose, beside them others that differ
along the self-motion, and some that begin anywhere: so that a layer covers what leads on, and what comes new. What
follows is followed by descents, and no branch has a label: labels flip where a shoulder or a wrist passes zero.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from maira_qp.kernels.paths.boxes import within_a_step
from maira_qp.kernels.paths.thinning import thin
from maira_qp.robots.model.revolutions import TURN
from maira_qp.solvers.paths.descents import PathArrays

WIDER = 1.3
"""How fast the cells of a layer grow if there are too many, at least."""
ASIDE = 0.25
"""How far [rad or m] along the self-motion others begin, about."""
NEAR_LIMIT = 0.3
"""A configuration this near to a limit [rad] may be held up by it before the next layer."""
ON_LIMIT = 1e-9
"""One that is nearer to it than this [rad] is on it."""
BEYOND = 0.03
"""How far [rad or m] beyond the end of a self-motion descents to this end begin."""
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
    cell: float
    """Edge of the cells [rad or m] of which a layer keeps one configuration each; larger where they are too many"""
    is_thorough: bool = False
    """What a layer holds is followed back to the one before as well: what leads there from a singular pose, say; and it
    holds where self-motions end at limits: what leads through where they hardly begin"""

    def finer(self) -> Density:
        """Three times as many layers of half as many configurations more, of half the cells, thorough ones."""
        return Density(self.spacing / 3, 3 * self.most // 2, 3 * self.fresh // 2, self.cell / 2, True)


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
            here = _merged(path, index, here, found[arrived], density)
            if density.is_thorough and is_redundant:
                starts = _at_ends(path, here, _with_turns(path), density, rng)
                found, arrived = path.descend(np.full(len(starts), index), starts)
                here = _merged(path, index, here, found[arrived], density)
        layers.append(here)
        before = here
    if density.is_thorough:
        for k in range(len(layers) - 2, 0 if is_start_given else -1, -1):
            starts = np.concatenate([_held_up(path, layers[k + 1]), layers[k + 1]])
            found, arrived = path.descend(np.full(len(starts), at[k]), starts)
            layers[k] = _merged(path, at[k], layers[k], found[arrived], density)
    return layers


def layers_from(
    path: PathArrays, at: np.ndarray, roots: np.ndarray, windows: np.ndarray, density: Density, rng: np.random.Generator
) -> list[np.ndarray]:
    """Layers (M_l, n) of nothing but what is linked with roots (R, n) in the first, as many as that leads to.

    Joints are at the turns that lead there. So narrow ways are found, for which layers from all over the arm have no
    room.

    Args:
        path: the poses.
        at: (L,) indices of the poses of the layers.
        roots: configurations at the first of them.
        windows: (L - 1, n) how far each joint may move from layer to layer.
        density: of the layers.
        rng: of the configurations that are drawn.
    """
    robot, layers = path.problem.robot, [roots]
    for index, window in zip(at[1:].tolist(), windows, strict=True):
        before, here = layers[-1], np.empty((0, path.n))
        few = np.resize(before, (max(len(before), density.most), path.n))
        starts = np.concatenate([before, *_aside(few, rng)])
        for _ in range(2):
            found, arrived = path.descend(np.full(len(starts), index), starts)
            here = np.concatenate([here, found[arrived]])
            linked = np.empty(len(here), np.bool_)
            within_a_step(_as_boxes(before), _as_boxes(here), window, linked)
            here = here[linked]
            are_on = (here < robot.lower + ON_LIMIT) | (here > robot.upper - ON_LIMIT)
            here = here[_thinned(here, are_on, density)]
            starts = _at_ends(path, here, [], density, rng) if path.n > path.rank else here[:0]
            if not len(starts):
                break
        if not len(here):
            break
        layers.append(here)
    return layers


def _as_boxes(q: np.ndarray) -> np.ndarray:
    """Boxes (M, 2, n) without extent, of configurations (M, n)."""
    return np.stack([q, q], axis=1)


def _merged(path: PathArrays, index: int, here: np.ndarray, found: np.ndarray, density: Density) -> np.ndarray:
    """Both, (k, n) and (m, n), at one turn, one of each cell, at most as many as a layer holds."""
    here = path.problem.turns.in_window(np.concatenate([here, found]))
    at_limits, are_on = _at_limits(path, here)
    kept = _thinned(here, are_on, density)
    here, at_limits = here[kept], at_limits[kept]
    turned = are_on[kept][:, _with_turns(path)].any(axis=1)
    if turned.any():
        away = TURN * np.round((here[turned] - at_limits[turned]) / TURN)
        here[turned] = path.exactly(np.full(len(away), index), at_limits[turned]) + away
    return here


def _held_up(path: PathArrays, q: np.ndarray) -> np.ndarray:
    """Those of the configurations (M, n) that are near a limit but for whole turns, at the turn in which it limits.

    A layer has one turn of all, in which a descent passes where another turn ends. Where only the end itself leads on,
    as to a pose in the corner of all limits, none of what it finds would do. One that is near both limits of a joint is
    there twice.
    """
    there, is_moved = q, np.zeros(len(q), dtype=bool)
    for i in _with_turns(path):
        at_lower, at_upper = _at_limits_of(path, there, i, NEAR_LIMIT)
        lower, upper = np.isfinite(at_lower), np.isfinite(at_upper)
        second = there[lower & upper]
        second[:, i] = at_upper[lower & upper]
        there = there.copy()
        there[:, i] = np.where(lower, at_lower, np.where(upper, at_upper, there[:, i]))
        there = np.concatenate([there, second])
        is_moved = np.concatenate([is_moved | lower | upper, np.ones(len(second), dtype=bool)])
    return there[is_moved]


def _at_ends(
    path: PathArrays, q: np.ndarray, turning: list[int], density: Density, rng: np.random.Generator
) -> np.ndarray:
    """Starts (K, n) of descents that end where self-motions of configurations (M, n) nearby leave the limits.

    Somewhat beyond, but for the joint that ends it, which is at its limit and stays there. `turning` joints are at one
    turn of all.
    """
    robot, count = path.problem.robot, len(q)
    free = path.self_motions(q)
    along = np.einsum("kij,kj->ki", free, rng.normal(size=(count, free.shape[2])))
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    q, along = np.concatenate([q, q]), np.concatenate([along, -along])
    limits = np.where(along > 0.0, robot.upper, robot.lower)
    room = np.abs(limits - q)
    room[:, turning] %= TURN
    far = room / np.maximum(np.abs(along), ON_LIMIT)
    joint = far.argmin(axis=1)
    each = np.arange(2 * count)
    starts = q + (far[each, joint] + BEYOND)[:, None] * along
    starts[each, joint] = limits[each, joint]
    is_on = np.zeros(starts.shape, dtype=bool)
    is_on[each, joint] = True
    near = far[each, joint] < NEAR_LIMIT
    starts, is_on = starts[near], is_on[near]
    return starts[_thinned(starts, is_on, density)]


def _at_limits(path: PathArrays, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The configurations (M, n) with joints that are on a limit but for whole turns at a turn in which it limits.

    And which joints (M, n) are on a limit, turns or not.
    """
    robot = path.problem.robot
    there, are_on = q.copy(), (q < robot.lower + ON_LIMIT) | (q > robot.upper - ON_LIMIT)
    for i in _with_turns(path):
        at_lower, at_upper = _at_limits_of(path, q, i, ON_LIMIT)
        at = np.where(np.isfinite(at_lower), at_lower, at_upper)
        are_on[:, i] = np.isfinite(at)
        there[:, i] = np.where(are_on[:, i], at, q[:, i])
    return there, are_on


def _with_turns(path: PathArrays) -> list[int]:
    """Joints with limits, and all angles between them."""
    turns = path.problem.turns
    return np.flatnonzero(turns.everywhere & np.isfinite(turns.robot.upper - turns.robot.lower)).tolist()


def _at_limits_of(path: PathArrays, q: np.ndarray, joint: int, near: float) -> tuple[np.ndarray, np.ndarray]:
    """Where a joint of configurations (M, n) is, (M,) and (M,), in the turns that its lower and its upper limit end.

    NaN: it is farther from there than so much [rad].
    """
    robot, angles = path.problem.robot, q[:, joint]
    lower, upper = robot.lower[joint], robot.upper[joint]
    above, below = (room - TURN * np.round(room / TURN) for room in (angles - lower, upper - angles))
    at_lower, at_upper = lower + np.maximum(above, 0.0), upper - np.maximum(below, 0.0)
    is_lower, is_upper = (above >= -ON_LIMIT) & (above < near), (below >= -ON_LIMIT) & (below < near)
    return np.where(is_lower, at_lower, np.nan), np.where(is_upper, at_upper, np.nan)


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


def _thinned(q: np.ndarray, on_limits: np.ndarray, density: Density) -> np.ndarray:
    """Indices of one of the configurations (M, n) of each cell and set of joints (M, n) on limits."""
    cell, kept, keys = density.cell, np.empty(len(q), np.int64), np.empty(len(q), np.uint64)
    table = np.empty(1 << (2 * len(q) + 1).bit_length(), np.int64)
    while (count := thin(q, on_limits, cell, table, keys, kept)) > density.most:
        cell *= max(WIDER, np.sqrt(count / density.most))
    return kept[:count]
