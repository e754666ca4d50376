"""One control tick: the hierarchy's QP at the configuration of now, limits on position and velocity in one box.

Level 1 is Newton's model of the true error, which near the target is that of Gauss-Newton, and where the target cannot
be reached still comes to rest. What each level adds is halved until it is safe: level 1 until the true error does not
rise, the levels below until the objective falls and level 1 keeps half of its gain, or an error below `SMALL_ERROR`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from maira_qp.problem.costs import Cost, ExactTaskCost, TaskCost, WeightedCost, strict_levels
from maira_qp.problem.hierarchy import solve_each_level
from maira_qp.problem.limits import Tick
from maira_qp.problem.objectives import Objective
from maira_qp.problem.redundancy import Strict, Weighted
from maira_qp.robots.configuration import Configuration
from maira_qp.solvers.descent import LEAST_DAMPING
from maira_qp.solvers.setting import Setting

SMALL_ERROR = 1e-3
"""|W e| below which the motion of lower levels may cost some of it again until the next tick [rad]."""

HALVINGS = 12


def tick(
    cost: TaskCost, redundancy: Weighted | Strict | None, at: Configuration, setting: Setting, dt: float
) -> tuple[np.ndarray, np.ndarray]:
    """Configuration (n,) after a tick of dt [s] and the velocity (n,) that leads to it.

    From inside the position limits the next configuration is inside them to the bit, and the velocity within the
    velocity limits to the bit always. A backend that fails leaves the arm where it is, as far as the limits allow.
    """
    robot, bounds = setting.robot, setting.bounds(at, Tick(dt, np.zeros(at.n)))
    objectives = redundancy.objectives if isinstance(redundancy, Strict) else ()
    merit: Cost = cost
    if isinstance(redundancy, Weighted):
        merit = WeightedCost(cost, redundancy.objective, redundancy.weight)
        first, below = merit.level(at), []
    else:
        _, *below = strict_levels(cost, objectives, at, bounds.held)
        first = ExactTaskCost(cost).level(at)
    mu = setting.options.damping * min(first.squared_error, 1.0) + LEAST_DAMPING * float(np.abs(first.H).max())
    displacements = solve_each_level([first.damped(mu), *below], bounds, setting.backend)
    dq = np.clip(_safe(merit, objectives, at, displacements), bounds.lower, bounds.upper)
    inside = (at.q >= robot.lower) & (at.q <= robot.upper)
    q = np.where(inside, np.clip(at.q + dq, robot.lower, robot.upper), at.q + dq)
    return q, np.clip(dq / dt, -robot.velocity_limit, robot.velocity_limit)


def _safe(
    merit: Cost, objectives: Sequence[Objective], at: Configuration, displacements: list[np.ndarray]
) -> np.ndarray:
    """The displacement (n,) of the lowest level, each part shortened until the true costs allow it."""
    still = np.zeros_like(at.q)
    if not displacements:
        return still
    now = merit.value(at)
    dq = _halved(at, still, displacements[0], lambda trial: merit.value(trial) <= now)
    if len(displacements) == 1:
        return dq
    there = at.moved(dq)
    most = max(0.5 * (now + merit.value(there)), 0.5 * SMALL_ERROR**2)
    before = objectives[0].cost(there)

    def allowed(trial: Configuration) -> bool:
        return merit.value(trial) <= most and objectives[0].cost(trial) <= before + 1e-9 * (1 + abs(before))

    return _halved(at, dq, displacements[-1] - displacements[0], allowed)


def _halved(
    at: Configuration, start: np.ndarray, part: np.ndarray, allowed: Callable[[Configuration], bool]
) -> np.ndarray:
    """start + share part (n,), the share halved until it is allowed; start if it never is."""
    for _ in range(HALVINGS):
        if allowed(at.moved(start + part)):
            return start + part
        part = 0.5 * part
    return start
