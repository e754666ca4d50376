"""Staying near a start: where a solver looks before it goes far, and what is worth leaving for.

With a start q0 the descent from there is followed to its end, the pose or a nearest point. Its answer stands unless
another start leads to a result that is better by more than the tolerances: one that reaches the pose, or a nearest
point whose weighted error |W e| is smaller by more than |W (position tolerance, orientation tolerance)|. Then one of
the two errors, too, is smaller by more than its tolerance. What reaches the pose only to be traded off for the posture,
as with `Weighted`, counts by the error that this leaves. Either way each joint that has a turn or more ends at the
one nearest to q0, unless something that is asked for is worse there.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from maira_qp.problem.options import Options
from maira_qp.problem.qp.costs import TaskCost
from maira_qp.problem.tasks.frame import FrameTask
from maira_qp.problem.tasks.task import Task
from maira_qp.robots.model.configuration import Configuration
from maira_qp.robots.model.revolutions import FARTHEST, WholeTurns
from maira_qp.robots.model.robot import Robot
from maira_qp.solvers.reference.context import Context
from maira_qp.solvers.spread import spread

BESIDE, RADII = 8, (0.3, 0.6, 1.0)
"""Starts around q0 that are tried before any others, and how far from it their joints are at most [rad or m], in turn.
Of those that reach the pose the nearest to q0 is taken."""

NEAR, NEAR_BY_ERROR = 0.3, 3.0
"""A descent has wandered if it moves a joint further than the first [rad or m] and, where it arrives, further than the
second times the root of the weighted error |W e| of its start: so far a stretched arm bends for such an error."""

SHORT_STEP = 0.1
"""Where a descent from q0 wandered, it is made again in steps that move no joint by more [rad or m]."""

TURNINGS = 3
"""Times that joints are turned, and what was refined at other turns is refined again, at most."""

ROUNDING = 1e-9
"""Whole turns change a cost by a smaller share, where nothing feels them."""


def starts_beside(robot: Robot, starts: np.ndarray) -> np.ndarray:
    """Starts (N, BESIDE, n) around starts (N, n), within the limits."""
    offsets = 2 * spread(BESIDE + 1, robot.n)[1:] - 1
    offsets *= np.resize(RADII, BESIDE)[:, None]
    return np.clip(starts[:, None] + offsets, robot.lower, robot.upper)


def displacement(q: np.ndarray, start: np.ndarray) -> float:
    """How far the joint that moved most is from the start [rad or m]; both (n,)."""
    return float(np.abs(q - start).max(initial=0.0))


def is_closer(cost: float, than: float, tasks: TaskCost, options: Options) -> bool:
    """Whether a cost `1/2 |W e|^2` is worth leaving for from another one of the same tasks."""
    margin = np.sqrt(sum(_tolerated(task, options) ** 2 for task in tasks.tasks))
    return bool(np.sqrt(2 * than) - np.sqrt(2 * cost) > margin)


def _tolerated(task: Task, options: Options) -> float:
    """The largest weighted error |W e| of a task within the tolerances."""
    weights = np.atleast_1d(task.all_weights if isinstance(task, FrameTask) else task.weights)
    position, orientation = options.position_tolerance, options.orientation_tolerance
    if len(weights) != 6:
        return float(weights.max(initial=0.0) * max(position, orientation))
    return float(np.hypot(weights[:3].max() * position, weights[3:].max() * orientation))


def turned(
    at: Configuration, start: np.ndarray, context: Context, costs: Sequence[Callable[[Configuration], float]]
) -> Configuration:
    """The configuration with each joint at the whole turn nearest to the start (n,), where no cost is higher for it.

    Where the start is beyond `FARTHEST`, a joint stays at the turn that it has.
    """
    robot = context.robot
    q = WholeTurns(robot, start).within(at.q[None])[0]
    there = np.flatnonzero((np.abs(q - at.q) > 1.0) & (np.abs(start) <= FARTHEST))

    def is_felt(trial: Configuration) -> bool:
        higher = any(cost(trial) > cost(at) + ROUNDING * (abs(cost(at)) + ROUNDING) for cost in costs)
        return higher or context.broken(trial) > context.broken(at) or not context.keeps(trial, at)

    for joints in (there, *there[:, None]) if len(there) > 1 else there[:, None]:  # all at once if that will do
        trial = at.q.copy()
        trial[joints] = q[joints]
        moved = robot.at(trial)
        if not np.array_equal(trial, at.q) and not is_felt(moved):
            at = moved
    return at
