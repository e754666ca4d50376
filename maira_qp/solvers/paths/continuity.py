"""Whether an arm goes from one configuration of a path to the next along the path, and does not jump between branches.

Two configurations that are near each other may belong to different branches. Halfway between two poses, from halfway
between their configurations, a descent ends near where it begins if one branch leads from one to the other; if not it
ends near one of the two. Where it ends neither here nor there the halves are looked at in turn. That a path is a line
between two poses is a convention: halfway the tool may be off by `DEVIATION`, and by some of what the poses are apart.
Where an arm cannot reach the middle, as one with few joints, the nearest point counts if it is no further off.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from maira_qp.solvers.paths.descents import PathArrays
from maira_qp.solvers.paths.line import Edge

DEVIATION, SHARE = (1e-3, 1e-2), 0.25
"""How far the tool may be from the middle of two poses [m, rad], and by what share of what these are apart."""
HALVINGS = 6
"""How often a step is halved; what is not decided then is no motion along the path."""
NEAR_MIDDLE = 0.25
"""A descent that ends nearer to the middle than by this share of the step is on the same branch as both ends."""


def is_continuous(path: PathArrays, begin: np.ndarray, a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Whether steps (M,) from configurations (M, n) to (M, n) lead along the path; both reach their poses.

    A step leads from the pose `begin` (M,), an index, to the next one.
    """
    middle = 0.5 * (a + b)
    continuous, poses = path.keeps_limits(middle), quaternion_poses(path.rows)
    owner, A, B = np.arange(len(begin)), poses[begin], poses[begin + 1]
    for _ in range(HALVINGS):
        M = halfway(A, B)
        rows = pose_rows(M)
        allowed = DEVIATION + SHARE * apart(A, B)
        off = (path.errors(rows, middle) > allowed).any(axis=1)
        owner, rows, allowed = owner[off], rows[off], allowed[off]
        a, b, A, B, M, middle = (each[off] for each in (a, b, A, B, M, middle))
        if not len(owner):
            return continuous
        m, arrived = path.descend_to(rows, middle)
        strayed = np.abs(m - middle).max(axis=1) > NEAR_MIDDLE * np.abs(b - a).max(axis=1)
        strayed |= ~arrived & (path.errors(rows, m) > allowed).any(axis=1)
        on = strayed & continuous[owner]
        if not on.any():
            return continuous
        owner = np.concatenate([owner[on], owner[on]])
        a, m, b, A, M, B = (each[on] for each in (a, m, b, A, M, B))
        a, b, A, B = np.concatenate([a, m]), np.concatenate([m, b]), np.concatenate([A, M]), np.concatenate([M, B])
        middle = 0.5 * (a + b)
    continuous[owner] = False
    return continuous


def misleading(
    path: PathArrays, at: np.ndarray, layers: list[np.ndarray], layer: int, window: np.ndarray, near: np.ndarray
) -> set[Edge]:
    """The links from one layer to the next, within a window (n,), that do not lead along the path.

    From straight lines between the two configurations descents to the poses in between have to arrive, without a step
    beyond the path's window and without a jump; joints are at the turns of one configuration `near` (n,).
    """
    turns, first = path.problem.turns, sum(map(len, layers[: layer - 1]))
    moved = turns.shortest(layers[layer][None] - layers[layer - 1][:, None])
    k, j = np.nonzero((np.abs(moved) <= window).all(axis=2))
    a, moved = layers[layer - 1][k], moved[k, j]
    a = a + turns.room_near(np.minimum(a, a + moved), np.maximum(a, a + moved), near - a)
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


def quaternion_poses(rows: np.ndarray) -> np.ndarray:
    """Poses (M, 7), quaternion (x, y, z, w) and position, of poses (M, 12), R by rows and position."""
    quaternions = Rotation.from_matrix(rows[:, :9].reshape(-1, 3, 3)).as_quat()
    return np.concatenate([quaternions, rows[:, 9:]], axis=1)


def pose_rows(poses: np.ndarray) -> np.ndarray:
    """The inverse of `quaternion_poses`."""
    return np.concatenate([Rotation.from_quat(poses[:, :4]).as_matrix().reshape(-1, 9), poses[:, 4:]], axis=1)


def halfway(A: np.ndarray, B: np.ndarray) -> np.ndarray:
    """Poses (M, 7) halfway between poses (M, 7) and (M, 7): positions on a line, rotations about one axis."""
    middle = 0.5 * (A + B)
    middle[:, :4] = A[:, :4] + _same_side(A, B)
    middle[:, :4] /= np.linalg.norm(middle[:, :4], axis=1, keepdims=True)
    return middle


def apart(A: np.ndarray, B: np.ndarray) -> np.ndarray:
    """How far (M, 2) poses (M, 7) and (M, 7) are apart [m, rad]."""
    a, b = A[:, :4], _same_side(A, B)
    angle = 4.0 * np.arctan2(np.linalg.norm(b - a, axis=1), np.linalg.norm(b + a, axis=1))
    return np.stack([np.linalg.norm(B[:, 4:] - A[:, 4:], axis=1), angle], axis=1)


def _same_side(A: np.ndarray, B: np.ndarray) -> np.ndarray:
    """The quaternions (M, 4) of poses B, or their negatives: those nearer to that of A."""
    return B[:, :4] * np.where(np.einsum("ij,ij->i", A[:, :4], B[:, :4]) < 0.0, -1.0, 1.0)[:, None]
