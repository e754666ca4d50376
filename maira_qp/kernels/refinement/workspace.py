"""The arrays that a refinement works in, made once a call, and once for a whole batch."""

from __future__ import annotations

from maira_qp.kernels.jit.arena import Arena
from maira_qp.kernels.qp.null_space_qp import ROW_QP

WORKSPACE = Arena(
    "Workspace",
    "n",
    floats={
        **{"axes": "n, 3", "origins": "n, 3", "tool": "12", "e": "6", "J": "n, 6"},  # of the last configuration
        **{"At": "n, 6", "tau": "6"},  # the factored rows of the task
        **dict.fromkeys(("multipliers", "weighted", "before"), "6"),  # of the task's rows
        **dict.fromkeys(("x", "g", "c", "diagonal", "lower", "upper", "dq", "y", "z"), "n"),
        **dict.fromkeys(("trial", "ahead", "safe"), "n"),  # configurations
        **dict.fromkeys(("H", "A", "Z", "M", "V"), "n, n"),
        "row_qp": ROW_QP.floats,
    },
    integers={
        **{"order": "6", "joints": "n"},  # of the factored rows, and of which joints they are
        **dict.fromkeys(("free", "side"), "n"),  # of a QP with a box
        **dict.fromkeys(("locked", "held"), "n"),  # 1 for joints that are, else 0
        "row_qp_index": ROW_QP.integers,
    },
)
"""Of a chain of n joints."""
Workspace, make_workspace = WORKSPACE.Arrays, WORKSPACE.make
