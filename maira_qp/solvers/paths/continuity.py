"""Whether an arm goes from one configuration of a path to the next along the path, and does not jump between branches.

Two configurations that are near each other may belong to different branches. Halfway between two poses, from halfway
between their configurations, a descent ends near where it begins if one branch leads from one to the other; if not it
ends near one of the two. Where it ends neither here nor there the halves are looked at in turn. Between poses the tool
may be off by `DEVIATION`, as a path is a line between them by convention alone.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from maira_qp.solvers.paths.descents import PathArrays

DEVIATION = 1e-3, 1e-2
"""How far the tool may be from the poses between two of a path [m, rad]."""
HALVINGS = 6
"""How often a step is halved; what is not decided then is no motion along the path."""
NEAR_MIDDLE = 0.25
"""A descent that ends nearer to the middle than by this share of the step is on the same branch as both ends."""


def is_continuous(path: PathArrays, q: np.ndarray) -> np.ndarray:
    """Whether each step (N - 1,) of configurations (N, n), which reach their poses, leads along the path."""
    path = path.within(*DEVIATION)
    continuous = np.ones(len(q) - 1, dtype=bool)
    owner, a, b, A, B = np.arange(len(q) - 1), q[:-1], q[1:], path.rows[:-1], path.rows[1:]
    for _ in range(HALVINGS):
        M = halfway(A, B)
        m, arrived = path.descend_to(M, 0.5 * (a + b))
        continuous[owner[~arrived]] = False
        strayed = np.abs(m - 0.5 * (a + b)).max(axis=1) > NEAR_MIDDLE * np.abs(b - a).max(axis=1) + 1e-6
        open_ones = np.flatnonzero(strayed & continuous[owner])
        if not len(open_ones):
            return continuous
        k = np.concatenate([open_ones, open_ones])
        owner = owner[k]
        half = len(open_ones)
        a, b = np.concatenate([a[k[:half]], m[k[half:]]]), np.concatenate([m[k[:half]], b[k[half:]]])
        A, B = np.concatenate([A[k[:half]], M[k[half:]]]), np.concatenate([M[k[:half]], B[k[half:]]])
    continuous[owner] = False
    return continuous


def halfway(A: np.ndarray, B: np.ndarray) -> np.ndarray:
    """Poses (M, 12) halfway between poses (M, 12) and (M, 12): positions on a line, rotations about one axis."""
    first, second = Rotation.from_matrix(A[:, :9].reshape(-1, 3, 3)), Rotation.from_matrix(B[:, :9].reshape(-1, 3, 3))
    middle = first * Rotation.from_rotvec(0.5 * (first.inv() * second).as_rotvec())
    return np.concatenate([middle.as_matrix().reshape(-1, 9), 0.5 * (A[:, 9:] + B[:, 9:])], axis=1)
