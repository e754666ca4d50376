"""What an iteration makes small at a configuration: its value, and its quadratic model as a level of the hierarchy.

The pose's model is Gauss-Newton's: `H = J^T W^2 J`, `c = -J^T W^2 e`. Where a pose cannot be reached its error stays
large at the optimum and Gauss-Newton converges slowly or not at all; for that case there is the exact Hessian.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
import pinocchio as pin

from maira_qp.problem.limits.joint import Tick
from maira_qp.problem.objectives import Objective
from maira_qp.problem.qp.hierarchy import RANK_THRESHOLD, Level, convexified, largest_row
from maira_qp.problem.tasks.objective import ObjectiveTask
from maira_qp.problem.tasks.task import Task
from maira_qp.robots.model.configuration import Configuration
from maira_qp.robots.model.robot import Robot

HESSIAN_RANK_THRESHOLD = 1e-6
"""As `RANK_THRESHOLD`, for the Hessian of an objective, which may be known by differences alone."""


class Cost(Protocol):
    """A smooth function of the configuration to be minimised."""

    def value(self, at: Configuration) -> float:
        """The cost."""
        ...

    def gradient(self, at: Configuration) -> np.ndarray:
        """Its gradient (n,)."""
        ...

    def level(self, at: Configuration) -> Level:
        """Its convex quadratic model."""
        ...


@dataclass(frozen=True)
class TaskCost:
    """The tasks alone: `1/2 sum |W e|^2`."""

    tasks: tuple[Task, ...]

    def value(self, at: Configuration) -> float:
        """Half of the squared weighted error."""
        return 0.5 * sum(float(r @ r) for r in (task.weighted_error(at) for task in self.tasks))

    def gradient(self, at: Configuration) -> np.ndarray:
        """Gradient (n,)."""
        A, r = self.rows(at)
        return -(A.T @ r)

    def level(self, at: Configuration) -> Level:
        """Gauss-Newton."""
        A, r = self.rows(at)
        return Level(A.T @ A, -(A.T @ r), A, 0.5 * float(r @ r), float(r @ r))

    def rows(self, at: Configuration) -> tuple[np.ndarray, np.ndarray]:
        """The weighted Jacobian W J (m, n) and the weighted error W e (m,)."""
        rows = [task.rows(at) for task in self.tasks] or [(np.empty((0, at.n)), np.empty(0))]
        return rows[0] if len(rows) == 1 else (np.vstack([A for A, _ in rows]), np.concatenate([r for _, r in rows]))

    def pull(self, at: Configuration) -> np.ndarray:
        """The gradient (n,), each task's part times its gain."""
        g = np.zeros(at.n)
        for task in self.tasks:
            A, r = task.rows(at)
            g -= task.gain * (r @ A)
        return g

    def without_wishes(self) -> TaskCost:
        """The same without the tasks that a control tick takes as inequalities."""
        return self if self.wishless else TaskCost(tuple(task for task in self.tasks if not task.is_wish))

    @property
    def wishless(self) -> bool:
        """No task is an inequality."""
        return not any(task.is_wish for task in self.tasks)

    def damping(self, at: Configuration) -> float:
        """The Levenberg-Marquardt damping that the tasks ask for."""
        asking = [task for task in self.tasks if task.damping > 0]
        return sum(task.damping * 2 * TaskCost((task,)).value(at) for task in asking)

    def wishes(self, at: Configuration, tick: Tick) -> tuple[np.ndarray, np.ndarray] | None:
        """G (m, n) and h (m,) of the inequalities among the tasks, if there are any."""
        rows = [task.wishes(at, tick) for task in self.tasks if task.is_wish]
        return (np.vstack([G for G, _ in rows]), np.concatenate([h for _, h in rows])) if rows else None

    def curvature(self, at: Configuration, multipliers: np.ndarray) -> np.ndarray:
        """`sum_k multipliers_k d(W J)_k/dq` (n, n), symmetric: how the rows bend; multipliers (m,)."""
        C, start = np.zeros((at.n, at.n)), 0
        for task in self.tasks:
            stop = start + len(task.error(at)) if len(self.tasks) > 1 else len(multipliers)
            C += task.curvature(at, multipliers[start:stop])
            start = stop
        return C


@dataclass(frozen=True)
class ExactTaskCost:
    """The tasks alone, with the exact Hessian where they know it."""

    tasks: TaskCost

    def value(self, at: Configuration) -> float:
        """That of the tasks."""
        return self.tasks.value(at)

    def gradient(self, at: Configuration) -> np.ndarray:
        """That of the tasks (n,)."""
        return self.tasks.gradient(at)

    def level(self, at: Configuration) -> Level:
        """Newton, its Hessian made positive by the size of its eigenvalues."""
        model = self.tasks.level(at)
        return replace(model, H=convexified(self.hessian(at)))

    def hessian(self, at: Configuration) -> np.ndarray:
        """The Hessian (n, n), of any definiteness."""
        return sum((task.hessian(at) for task in self.tasks.tasks), np.zeros((at.n, at.n)))


@dataclass(frozen=True)
class LevelObjective(Objective):
    """A priority level below the first: tasks and weighted objectives, `1/2 sum |W e|^2 + sum w_i objective_i`."""

    tasks: TaskCost
    objectives: tuple[ObjectiveTask, ...] = ()

    def of(self, robot: Robot) -> LevelObjective:
        """Its parts are already made for the robot."""
        return self

    def cost(self, at: Configuration) -> float:
        """The sum."""
        return self.tasks.value(at) + sum(each.weight * each.objective.cost(at) for each in self.objectives)

    def gradient(self, at: Configuration) -> np.ndarray:
        """Gradient (n,) of the sum."""
        g = np.zeros(at.n)
        for task in self.tasks.tasks:
            A, r = task.rows(at)
            g -= r @ A
        for each in self.objectives:
            g += each.weight * each.objective.gradient(at)
        return g

    def pull(self, at: Configuration) -> np.ndarray:
        """The gradient (n,), each part times its gain."""
        g = self.tasks.pull(at)
        for each in self.objectives:
            g += each.gain * each.weight * each.objective.gradient(at)
        return g

    def hessian(self, at: Configuration) -> np.ndarray:
        """Hessian (n, n) of the sum."""
        return ExactTaskCost(self.tasks).hessian(at) + self.objective_hessian(at)

    def objective_hessian(self, at: Configuration) -> np.ndarray:
        """Hessian (n, n) of the objectives alone."""
        H = np.zeros((at.n, at.n))
        return sum((each.weight * each.objective.hessian(at) for each in self.objectives), H)

    def without_wishes(self) -> LevelObjective:
        """The same without the tasks that a control tick takes as inequalities."""
        return replace(self, tasks=self.tasks.without_wishes())


@dataclass(frozen=True)
class WeightedCost:
    """The tasks and an objective in one cost: `1/2 sum |W e|^2 + weight objective`."""

    tasks: TaskCost
    objective: Objective
    weight: float

    def value(self, at: Configuration) -> float:
        """The sum."""
        return self.tasks.value(at) + self.weight * self.objective.cost(at)

    def gradient(self, at: Configuration) -> np.ndarray:
        """Gradient (n,) of the sum."""
        return self.tasks.gradient(at) + self.weight * self.objective.gradient(at)

    def level(self, at: Configuration) -> Level:
        """One QP, the objective's rows beside the pose's.

        Its Hessian is exact: at the optimum the pose's curvature, times the error that is left, is as large as the
        objective's own.
        """
        pose = self.tasks.level(at)
        H = ExactTaskCost(self.tasks).hessian(at) + self.weight * self.objective.hessian(at)
        return Level(
            convexified(H),
            pose.c + self.weight * self.objective.gradient(at),
            pose.rows,
            pose.cost + self.weight * self.objective.cost(at),
            pose.squared_error,
        )


def strict_levels(
    first: Level, cost: TaskCost, objectives: Sequence[Objective], at: Configuration, held: np.ndarray
) -> tuple[Level, ...]:
    """The tasks as level 1, `first` their model, the objectives as the levels below it.

    `held` (n,) marks the joints that a limit holds. The Hessian of a lower level is that of its Lagrangian, its own
    plus the curvature of the rows above times their multipliers: on a curved self-motion the objective bends with the
    path.
    """
    levels, above, rows = [first], cost, first.rows
    for objective in objectives:
        gradient, H = objective.gradient(at), objective.hessian(at)
        H = H + above.curvature(at, multipliers(rows, gradient, held))
        level = Level(H, gradient, H, objective.cost(at), rank_threshold=HESSIAN_RANK_THRESHOLD)
        if isinstance(objective, LevelObjective) and not objective.objectives:
            A, r = objective.tasks.rows(at)
            level = replace(level, rows=A, squared_error=float(r @ r), rank_threshold=RANK_THRESHOLD)
            above, rows = TaskCost((*above.tasks, *objective.tasks.tasks)), np.vstack([rows, A])
        levels.append(level)
    return tuple(levels)


def multipliers(rows: np.ndarray, gradient: np.ndarray, held: np.ndarray) -> np.ndarray:
    """Multipliers (m,) of the rows (m, n) that balance a gradient (n,) on the joints that no limit holds."""
    U, s, Vt = np.linalg.svd(rows[:, ~held], full_matrices=False)
    kept = s > HESSIAN_RANK_THRESHOLD * max(s[0] if len(s) else 0.0, largest_row(rows))
    return -U[:, kept] @ ((Vt[kept] @ gradient[~held]) / s[kept])


def tasks_toward(tasks: Sequence[Task], targets: Mapping[str, pin.SE3]) -> TaskCost:
    """The tasks with their targets filled in where they have none."""
    return TaskCost(tuple(task.toward(targets) for task in tasks))
