"""The arrays that a control step works in."""

from __future__ import annotations

from maira_qp.kernels.jit.arena import Arena
from maira_qp.kernels.qp.null_space_qp import ROW_QP

_WIDE = "max(rows, n) + n"

STEP_WORK = Arena(
    "StepWork",
    "n tasks rows levels",
    floats={
        **{"poses": "n, 12", "tools": "tasks, 3, 12", "targets": "tasks, 12"},  # joints, up to three frames a task
        **{"e": "tasks, 6", "pull": "6", "off": "6", "levers": "3, 6, 6", "J": "tasks, n, 6"},
        **{"inverse": "3, 3", "S": "3, 3"},  # of a rotation vector
        **{"H": "levels, n, n", **dict.fromkeys(("curvature", "C", "A", "V", "Z", "M"), "n, n")},
        **{"c": "levels, n", "displacements": "levels, n", "rows": "rows, n"},  # rows of a task
        **dict.fromkeys(("lower", "upper", "low", "high", "dq", "step", "part", "trial", "g", "y", "z", "b"), "n"),
        **{"F": f"max(rows, n), {_WIDE}", **dict.fromkeys(("tau", "x", "multipliers"), _WIDE)},  # of factored rows
        **dict.fromkeys(("mu", "values", "trial_values", "highest"), "levels"),
        **dict.fromkeys(("gram", "factor", "own_factor"), "rows, rows"),  # of rows above, and of a level's own
        "AZ": "rows, n",  # a level's own rows in what is left to it
        **{"balances": "levels, rows", **dict.fromkeys(("errors", "changes", "left", "weights"), "rows")},
        **{"near_poses": "n, 12", "near_tools": "3, 12", "near_rows": "6, n", "near_J": "n, 6"},  # near q
        **{
            "tools_here": "tasks, 12",
            "tools_there": "tasks, 3, 12",
            "e_there": "tasks, 6",
        },  # before any level moves, before one does
        **{"kept": "tasks, 2", "way": "n"},  # of errors; where the levels would go if there were no time
        **dict.fromkeys(("saddle", "gradients", "left_norms", "flat", "still"), "levels"),
        "friction": "3",  # the damping of a step by it, the one before, and how slow that step was
        "unsolved": "1",  # 1 where the QP of some level was not solved
        "fade": "1",  # what the weight of the first level's posture is multiplied by
        "row_qp": ROW_QP.floats,
    },
    integers={
        "paths": "tasks, n",  # the joints that carry a task
        **dict.fromkeys(("free", "side", "held", "locked", "joints"), "n"),
        "leaning": "levels, n",  # joints that a level presses against the limit that they stand on
        "order": _WIDE,  # of factored rows
        "counts": "tasks",  # how long a task's path is
        "ends": "levels",  # where a level's rows end
        "row_qp_index": ROW_QP.integers,
    },
)
"""For n joints; `rows` are those of all tasks together."""
StepWork, carve_step_work = STEP_WORK.Arrays, STEP_WORK.carve
