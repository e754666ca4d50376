"""Whether a loop ends at the pose where it begins."""

from __future__ import annotations

from typing import Any

import numpy as np

from maira_qp.errors import PoseError
from maira_qp.orientation import pose_error
from maira_qp.problem.problem import Problem


def check_closed(problem: Problem, first: Any, last: Any) -> None:
    """Compare the ends of a loop, `pin.SE3` or (4, 4). Raises `PoseError` if they are apart by more than the
    tolerances, what the task of the path leaves free aside."""
    task: Any = problem.tasks[0]
    error = pose_error(first, last)
    if task.axes == "target":
        R = last[:3, :3] if isinstance(last, np.ndarray) else last.rotation
        error = (error.reshape(2, 3) @ R).ravel()
    error[task.all_weights == 0.0] = 0.0
    position, orientation = np.linalg.norm(error[:3]), np.linalg.norm(error[3:])
    if not problem.is_reached(position, orientation):
        raise PoseError(
            f"a loop ends at the pose where it begins, and the last one is {position:.3g} m and {orientation:.3g} "
            "rad from the first; repeat the first pose at the end"
        )
