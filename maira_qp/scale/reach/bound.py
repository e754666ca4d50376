"""A bound on where the tip of a robot can be."""

from __future__ import annotations

import numpy as np

from maira_qp.robots.model.robot import Robot

ROUNDING = 1e-9
"""Share by which the bound is wider than was computed."""


def reach_bound(robot: Robot) -> tuple[np.ndarray, float | None]:
    """A centre (3,) and the distance [m] from it that the tip never exceeds; None: there is no such distance."""
    from maira_qp.evaluation.judge import Judge
    from maira_qp.evaluation.reach import reach  # not at the top: SciPy's minimisers take a while to load

    if not np.isfinite(robot.upper - robot.lower)[robot.slides].all():
        return np.zeros(3), None
    judge = Judge(robot.urdf, robot.base, robot.tip, robot.joint_names)
    centre, radius = reach(judge.path, *robot.drawn_range)
    return centre, float(radius) * (1.0 + ROUNDING)
