"""What an iteration makes small at a configuration: its value, and its quadratic model as a level of the hierarchy.

The pose's model is Gauss-Newton's: `H = J^T W^2 J`, `c = -J^T W^2 e`. Where a pose cannot be reached its error stays
large at the optimum and Gauss-Newton converges slowly or not at all; for that case there is the exact Hessian.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from maira_qp.problem.hierarchy import Level, positive_part
from maira_qp.problem.objectives import Objective
from maira_qp.problem.tasks import FrameTask
from maira_qp.robots.configuration import Configuration

HESSIAN_RANK_THRESHOLD = 1e-6
"""As `RANK_THRESHOLD`, for the Hessian of an objective, which may be known by differences alone."""


class Cost(Protocol):
    """A smooth function of the configuration to be minimised."""

    def value(self, at: Configuration) -> float:
        """The cost."""
        ...

    def level(self, at: Configuration) -> Level:
        """Its convex quadratic model."""
        ...


@dataclass(frozen=True)
class TaskCost:
    """The tasks alone: `1/2 sum |W e|^2`."""

    tasks: tuple[FrameTask, ...]

    def value(self, at: Configuration) -> float:
        """Half of the squared weighted error."""
        return 0.5 * sum(float(r @ r) for r in (task.weights * task.error(at) for task in self.tasks))

    def level(self, at: Configuration) -> Level:
        """Gauss-Newton."""
        A, r = self.rows(at)
        return Level(A.T @ A, -(A.T @ r), A, 0.5 * float(r @ r), float(r @ r))

    def rows(self, at: Configuration) -> tuple[np.ndarray, np.ndarray]:
        """The weighted Jacobian W J (m, n) and the weighted error W e (m,)."""
        A = [task.weights[:, None] * task.jacobian(at) for task in self.tasks]
        r = [task.weights * task.error(at) for task in self.tasks]
        return (A[0], r[0]) if len(A) == 1 else (np.vstack(A), np.concatenate(r))

    def curvature(self, at: Configuration, multipliers: np.ndarray) -> np.ndarray:
        """`sum_k multipliers_k d2(W f)_k/dq2` (n, n), f the frames' poses: how the rows bend; multipliers (m,)."""
        n = at.n
        C, start = np.zeros((n, n)), 0
        for task in self.tasks:
            weights = np.zeros(6)
            stop = start + len(task.weights)
            weights[task.rows] = task.weights * multipliers[start:stop]
            C += at.kinematic_hessian_product(task.frame, weights)
            start = stop
        return C


@dataclass(frozen=True)
class ExactTaskCost:
    """The tasks alone, with the exact Hessian `J^T W A(phi) W J - sum_k (W e)_k d2(W f)_k/dq2`.

    A is the symmetric part of the inverse left Jacobian of SO(3) at phi, `I + k [phi]x^2`, which enters since a turn
    of R across phi changes phi by less than itself (Sola et al., 2018, appendix B); for the linear rows A = I.
    """

    tasks: TaskCost

    def value(self, at: Configuration) -> float:
        """That of the tasks."""
        return self.tasks.value(at)

    def level(self, at: Configuration) -> Level:
        """Newton, its Hessian made positive by the size of its eigenvalues."""
        model = self.tasks.level(at)
        return replace(model, H=positive_part(self.hessian(at)))

    def hessian(self, at: Configuration) -> np.ndarray:
        """The Hessian (n, n), of any definiteness."""
        A, r = self.tasks.rows(at)
        H = A.T @ A - self.tasks.curvature(at, r)
        for task in self.tasks.tasks:
            e, weights = np.zeros(6), np.zeros(6)
            e[task.rows], weights[task.rows] = task.error(at), task.weights
            turn = weights[5] * np.cross(e[3:], at.jacobian(task.frame)[3:], axisb=0).T
            H -= _flattening(float(np.linalg.norm(e[3:]))) * turn.T @ turn
        return H


def _flattening(angle: float) -> float:
    """k of `I + k [phi]x^2`: `1/angle^2 - (1 + cos angle) / (2 angle sin angle)`, 1/12 at 0."""
    if angle < 1e-2:
        return 1 / 12 + angle**2 / 720
    return (1 - 0.5 * angle / np.tan(0.5 * angle)) / angle**2


@dataclass(frozen=True)
class WeightedCost:
    """The tasks and an objective in one cost: `1/2 sum |W e|^2 + weight objective`."""

    tasks: TaskCost
    objective: Objective
    weight: float

    def value(self, at: Configuration) -> float:
        """The sum."""
        return self.tasks.value(at) + self.weight * self.objective.cost(at)

    def level(self, at: Configuration) -> Level:
        """One QP, the objective's rows beside the pose's.

        Its Hessian is exact: at the optimum the pose's curvature, times the error that is left, is as large as the
        objective's own.
        """
        pose = self.tasks.level(at)
        H = ExactTaskCost(self.tasks).hessian(at) + self.weight * self.objective.hessian(at)
        return Level(
            positive_part(H),
            pose.c + self.weight * self.objective.gradient(at),
            pose.rows,
            pose.cost + self.weight * self.objective.cost(at),
            pose.squared_error,
        )


def strict_levels(
    cost: TaskCost, objectives: Sequence[Objective], at: Configuration, held: np.ndarray
) -> tuple[Level, ...]:
    """The tasks as level 1, the objectives as the levels below it; `held` (n,) marks the joints that a limit holds.

    The Hessian of a lower level is that of its Lagrangian, its own plus the curvature of the tasks' rows times their
    multipliers: on a curved self-motion the objective bends with the path.
    """
    pose = cost.level(at)
    levels = [pose]
    for objective in objectives:
        gradient, H = objective.gradient(at), objective.hessian(at)
        H = H + cost.curvature(at, multipliers(pose.rows, gradient, held))
        levels.append(Level(H, gradient, H, objective.cost(at), rank_threshold=HESSIAN_RANK_THRESHOLD))
    return tuple(levels)


def multipliers(rows: np.ndarray, gradient: np.ndarray, held: np.ndarray) -> np.ndarray:
    """Multipliers (m,) of the rows (m, n) that balance a gradient (n,) on the joints that no limit holds."""
    return np.linalg.lstsq(rows[:, ~held].T, -gradient[~held], rcond=1e-6)[0]


def tasks_toward(tasks: Sequence[FrameTask], target) -> TaskCost:
    """The tasks with the target filled in where they have none."""
    return TaskCost(tuple(task.toward(target) for task in tasks))
