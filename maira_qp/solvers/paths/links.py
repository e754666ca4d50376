"""Links between neighbouring layers of a path: which of them jump from one branch to another on the way."""

from __future__ import annotations

import numpy as np

from maira_qp.solvers.paths.continuity import is_continuous
from maira_qp.solvers.paths.descents import PathArrays
from maira_qp.solvers.paths.line import Edge


def misleading(path: PathArrays, at: np.ndarray, layers: list[np.ndarray], layer: int, window: np.ndarray) -> set[Edge]:
    """The links to a layer within a window (n,) that do not lead along the path.

    From straight lines between the two configurations descents to the poses in between have to arrive, without a step
    beyond the path's window and without a jump.
    """
    turns, first = path.problem.turns, sum(map(len, layers[: layer - 1]))
    moved = turns.shortest(layers[layer][None] - layers[layer - 1][:, None])
    k, j = np.nonzero((np.abs(moved) <= window).all(axis=2))
    a, moved = layers[layer - 1][k], moved[k, j]
    a = a + turns.room_for(np.minimum(a, a + moved), np.maximum(a, a + moved))
    poses = np.arange(at[layer - 1], at[layer] + 1)
    share = (path.place[poses] - path.place[poses[0]]) / (path.place[poses[-1]] - path.place[poses[0]])
    q = a[:, None] + share[:, None] * moved[:, None]
    leads = np.ones(len(k), dtype=bool)
    if len(poses) > 2:
        between, arrived = path.descend(np.tile(poses[1:-1], len(k)), q[:, 1:-1].reshape(-1, path.n))
        q[:, 1:-1] = between.reshape(len(k), -1, path.n)
        steps = np.abs(np.diff(q, axis=1)) / path.some(poses).windows
        leads[:] = arrived.reshape(len(k), -1).all(axis=1) & (steps <= 1.0).all(axis=(1, 2))
    begin, count = np.tile(poses[:-1], leads.sum()), len(poses) - 1
    steps = is_continuous(path, begin, q[leads, :-1].reshape(-1, path.n), q[leads, 1:].reshape(-1, path.n))
    leads[leads] = steps.reshape(-1, count).all(axis=1)
    end = first + len(layers[layer - 1])
    return set(zip((first + k[~leads]).tolist(), (end + j[~leads]).tolist(), strict=True))
