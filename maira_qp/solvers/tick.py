"""One control tick: the hierarchy's QP at the configuration of now, limits on position and velocity in one box."""

from __future__ import annotations

import numpy as np

from maira_qp.problem.costs import TaskCost, WeightedCost, strict_levels
from maira_qp.problem.hierarchy import solve_hierarchy
from maira_qp.problem.redundancy import Strict, Weighted
from maira_qp.robots.configuration import Configuration
from maira_qp.solvers.descent import LEAST_DAMPING
from maira_qp.solvers.setting import Setting


def tick(
    cost: TaskCost, redundancy: Weighted | Strict | None, at: Configuration, setting: Setting, dt: float
) -> tuple[np.ndarray, np.ndarray]:
    """Configuration (n,) after a tick of dt [s] and the velocity (n,) that leads to it.

    From inside the position limits the next configuration is inside them to the bit, and the velocity within the
    velocity limits to the bit always. A backend that fails leaves the arm where it is, as far as the limits allow.
    """
    robot, bounds = setting.robot, setting.bounds(at.q, dt)
    if isinstance(redundancy, Weighted):
        first, below = WeightedCost(cost, redundancy.objective, redundancy.weight).level(at), []
    else:
        held = (at.q <= robot.lower) | (at.q >= robot.upper)
        objectives = () if redundancy is None else redundancy.objectives
        first, *below = strict_levels(cost, objectives, at, held)
    mu = setting.options.damping * first.squared_error + LEAST_DAMPING * float(np.abs(first.H).max())
    levels = [first.damped(mu), *below]
    dq = solve_hierarchy(levels, bounds, setting.backend)
    dq = np.clip(np.zeros(robot.n) if dq is None else dq, bounds.lower, bounds.upper)
    inside = (at.q >= robot.lower) & (at.q <= robot.upper)
    q = np.where(inside, np.clip(at.q + dq, robot.lower, robot.upper), at.q + dq)
    return q, np.clip(dq / dt, -robot.velocity_limit, robot.velocity_limit)
