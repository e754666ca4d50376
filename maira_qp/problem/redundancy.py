"""The two ways to use the redundancy of an arm: a weighted sum, or a strict hierarchy."""

from __future__ import annotations

import math
from dataclasses import dataclass

from maira_qp.arrays import is_number
from maira_qp.errors import OptionError, shown
from maira_qp.problem.objectives import Objective, check_objective
from maira_qp.robots.model.robot import Robot


@dataclass(frozen=True)
class Weighted:
    """Weighted sum of pose error and objective: minimise `1/2 |W e|^2 + weight * objective`.

    At its optimum a pose error of the order of the weight remains, and is reported.
    """

    objective: Objective
    weight: float = 1e-3
    """Weight of the objective relative to the pose error; > 0."""

    def __post_init__(self) -> None:
        check_objective(self.objective)
        if not (is_number(self.weight) and 0 < self.weight < math.inf):
            raise OptionError(f"the weight of Weighted must be a positive number, got {shown(self.weight)}")

    def of(self, robot: Robot) -> Weighted:
        """Bind the objective to a robot."""
        return Weighted(self.objective.of(robot), self.weight)

    @property
    def objectives(self) -> tuple[Objective]:
        """The objective."""
        return (self.objective,)


@dataclass(frozen=True, init=False)
class Strict:
    """Strict hierarchy: each objective is minimised in the null space of the pose and of the objectives before it.

    Where the pose cannot be reached, the nearest point is returned without regard to the objectives.
    """

    objectives: tuple[Objective, ...]

    def __init__(self, *objectives: Objective) -> None:
        """Objectives in falling priority, at least one."""
        if not objectives:
            raise OptionError("Strict needs an objective, for example Strict(Posture())")
        for objective in objectives:
            check_objective(objective)
        object.__setattr__(self, "objectives", tuple(objectives))

    def of(self, robot: Robot) -> Strict:
        """Bind the objectives to a robot."""
        return Strict(*(objective.of(robot) for objective in self.objectives))
