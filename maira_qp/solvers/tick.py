"""One control tick: the hierarchy's QP at the configuration of now, limits on position and velocity in one box.

Level 1 is Newton's model of the true error, which near the target is that of Gauss-Newton, and where the target cannot
be reached still comes to rest. What each level adds is halved until it is safe: level 1 until the true error does not
rise, the levels below until they leave level 1 half of its gain, or the error below `SMALL_ERROR`.
"""

from __future__ import annotations

import numpy as np

from maira_qp.problem.costs import Cost, ExactTaskCost, TaskCost, WeightedCost, strict_levels
from maira_qp.problem.hierarchy import solve_each_level
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
    robot, bounds = setting.robot, setting.bounds(at.q, dt)
    merit: Cost
    if isinstance(redundancy, Weighted):
        merit = WeightedCost(cost, redundancy.objective, redundancy.weight)
        first, below = merit.level(at), []
    else:
        merit, held = cost, (at.q <= robot.lower) | (at.q >= robot.upper)
        _, *below = strict_levels(cost, () if redundancy is None else redundancy.objectives, at, held)
        first = ExactTaskCost(cost).level(at)
    mu = setting.options.damping * first.squared_error + LEAST_DAMPING * float(np.abs(first.H).max())
    displacements = solve_each_level([first.damped(mu), *below], bounds, setting.backend)
    dq = np.clip(_safe(merit, at, first.cost, displacements), bounds.lower, bounds.upper)
    inside = (at.q >= robot.lower) & (at.q <= robot.upper)
    q = np.where(inside, np.clip(at.q + dq, robot.lower, robot.upper), at.q + dq)
    return q, np.clip(dq / dt, -robot.velocity_limit, robot.velocity_limit)


def _safe(merit: Cost, at: Configuration, now: float, displacements: list[np.ndarray]) -> np.ndarray:
    """The displacement (n,) of the lowest level, each part shortened until the true cost allows it."""
    if not displacements:
        return np.zeros_like(at.q)
    dq, value = _halved(merit, at, np.zeros_like(at.q), displacements[0], now)
    if len(displacements) == 1:
        return dq
    allowed = max(0.5 * (now + value), 0.5 * SMALL_ERROR**2)
    return _halved(merit, at, dq, displacements[-1] - displacements[0], allowed)[0]


def _halved(
    merit: Cost, at: Configuration, start: np.ndarray, part: np.ndarray, most: float
) -> tuple[np.ndarray, float]:
    """start + share part (n,), the share halved until the cost is at most `most`, and that cost; 0 if it never is."""
    for _ in range(HALVINGS):
        value = merit.value(at.moved(start + part))
        if value <= most:
            return start + part, value
        part = 0.5 * part
    return start, most
