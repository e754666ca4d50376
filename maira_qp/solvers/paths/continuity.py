"""Whether an arm goes from one configuration of a path to the next along the path, and does not jump between branches.

Two configurations that are near each other may belong to different branches. Halfway between two poses, from halfway
between their configurations, a descent ends near where it begins if one branch leads from one to the other; if not it
ends near one of the two. Where it ends neither here nor there the halves are looked at in turn. That a path is a line
between two poses is a convention: halfway the tool may be off by `DEVIATION`, and by some of what the poses are apart.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from maira_qp.solvers.paths.descents import PathArrays

DEVIATION, SHARE = (1e-3, 1e-2), 0.25
"""How far the tool may be from the middle of two poses [m, rad], and by what share of what these are apart."""
HALVINGS = 6
"""How often a step is halved; what is not decided then is no motion along the path."""
NEAR_MIDDLE = 0.25
"""A descent that ends nearer to the middle than by this share of the step is on the same branch as both ends."""


def is_continuous(path: PathArrays, q: np.ndarray) -> np.ndarray:
    """Whether each step (N - 1,) of configurations (N, n), which reach their poses, leads along the path."""
    continuous = np.ones(len(q) - 1, dtype=bool)
    owner, a, b, A, B = np.arange(len(q) - 1), q[:-1], q[1:], path.rows[:-1], path.rows[1:]
    for _ in range(HALVINGS):
        M, middle = halfway(A, B), 0.5 * (a + b)
        off = (path.errors(M, middle) > DEVIATION + SHARE * apart(A, B)).any(axis=1)
        owner = owner[off]
        a, b, A, B, M, middle = (each[off] for each in (a, b, A, B, M, middle))
        m, arrived = path.descend_to(M, middle)
        strayed = np.abs(m - middle).max(axis=1) > NEAR_MIDDLE * np.abs(b - a).max(axis=1)
        continuous[owner[~arrived]] = False
        on = strayed & continuous[owner]
        if not on.any():
            return continuous
        owner = np.concatenate([owner[on], owner[on]])
        a, m, b, A, M, B = (each[on] for each in (a, m, b, A, M, B))
        a, b, A, B = np.concatenate([a, m]), np.concatenate([m, b]), np.concatenate([A, M]), np.concatenate([M, B])
    continuous[owner] = False
    return continuous


def apart(A: np.ndarray, B: np.ndarray) -> np.ndarray:
    """How far (M, 2) poses (M, 12) and (M, 12) are apart [m, rad]."""
    first, second = Rotation.from_matrix(A[:, :9].reshape(-1, 3, 3)), Rotation.from_matrix(B[:, :9].reshape(-1, 3, 3))
    return np.stack([np.linalg.norm(B[:, 9:] - A[:, 9:], axis=1), (first.inv() * second).magnitude()], axis=1)


def halfway(A: np.ndarray, B: np.ndarray) -> np.ndarray:
    """Poses (M, 12) halfway between poses (M, 12) and (M, 12): positions on a line, rotations about one axis."""
    first, second = Rotation.from_matrix(A[:, :9].reshape(-1, 3, 3)), Rotation.from_matrix(B[:, :9].reshape(-1, 3, 3))
    middle = first * Rotation.from_rotvec(0.5 * (first.inv() * second).as_rotvec())
    return np.concatenate([middle.as_matrix().reshape(-1, 9), 0.5 * (A[:, 9:] + B[:, 9:])], axis=1)
