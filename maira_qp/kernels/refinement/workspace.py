"""The arrays that settling works in, made once a call, and once for a whole batch."""

from __future__ import annotations

from collections import namedtuple

import numpy as np

from maira_qp.kernels.jit.decorators import kernel

Workspace = namedtuple(
    "Workspace",
    (
        *("axes", "origins", "tool", "e", "J"),  # kinematics of the configuration that was looked at last
        *("At", "tau", "order", "joints"),  # the factored rows of the task, and of which joints they are
        *("multipliers", "weighted", "before"),  # (6,): of the task's rows
        *("x", "g", "c", "diagonal", "lower", "upper", "dq", "y", "z"),  # (n,)
        *("trial", "ahead", "safe"),  # (n,): configurations
        *("H", "A", "Z", "M", "V"),  # (n, n)
        *("free", "side", "locked", "held"),  # (n,), of int64 and, the last two, of booleans
        *("memory", "index"),  # of a QP in the null space
    ),
)
"""A kernel takes what it needs into local names first: it is slow to ask for a field in a loop."""


@kernel
def make_workspace(n):
    """For a chain of n joints."""
    six, line, square, index = np.empty((5, 6)), np.empty((12, n)), np.empty((5, n, n)), np.empty((3, n), np.int64)
    joints = np.empty((2, n), np.bool_)
    return Workspace(
        np.empty((n, 3)),
        np.empty((n, 3)),
        np.empty(12),
        six[0],
        np.empty((n, 6)),
        np.empty((n, 6)),
        six[1],
        np.empty(6, np.int64),
        index[0],
        six[2],
        six[3],
        six[4],
        line[0],
        line[1],
        line[2],
        line[3],
        line[4],
        line[5],
        line[6],
        line[7],
        line[8],
        line[9],
        line[10],
        line[11],
        square[0],
        square[1],
        square[2],
        square[3],
        square[4],
        index[1],
        index[2],
        joints[0],
        joints[1],
        np.empty((4 * n + 4, n)),
        np.empty((3, n), np.int64),
    )
