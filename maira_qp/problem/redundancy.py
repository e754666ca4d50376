"""The two ways to use the redundancy of an arm: a weighted sum, or a strict hierarchy."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, TypeGuard

import numpy as np

from maira_qp.arrays import is_number
from maira_qp.errors import OptionError, shown
from maira_qp.problem.objectives import Objective, check_objective
from maira_qp.robots.model.robot import Robot

if TYPE_CHECKING:
    from typing import Self  # not in Python 3.10

FADING = 0.1
"""Gradient of the pose's cost, the weighted error in rad, below which a weight that fades does so."""


def trades_off(redundancy: Any) -> TypeGuard[Weighted]:
    """Whether a redundancy costs the pose something: `Weighted` whose weight does not fade."""
    return isinstance(redundancy, Weighted) and not redundancy.fading


@dataclass(frozen=True)
class WeightedObjective:
    """What a frozen class with an `objective` and its `weight` shares: to calls it is the objective."""

    objective: Objective
    weight: float

    def of(self, robot: Robot) -> Self:
        """The same with its objective made for this robot."""
        return replace(self, objective=self.objective.of(robot))

    @property
    def key(self) -> str:
        """That of the objective."""
        return self.objective.key

    @property
    def is_off(self) -> bool:
        """The weight is 0."""
        return self.weight == 0

    @property
    def datum(self) -> str:
        """That of the objective."""
        return self.objective.datum

    def with_value(self, value: Any) -> Self:
        """The same with another datum of the objective. Raises what that raises."""
        return replace(self, objective=self.objective.with_value(value))

    def scaled(self, factor: float) -> Self:
        """The same with the weight times a factor > 0."""
        return replace(self, weight=self.weight * factor)


@dataclass(frozen=True)
class Weighted(WeightedObjective):
    """Weighted sum of pose error and objective: minimise `1/2 |W e|^2 + weight * objective`.

    At its optimum a pose error of the order of the weight remains, and is reported.

    With `fading` the weight fades as the pose is reached, so that the objective steers the way and the pose is exact at
    the end: see `faded`. A solve descends from the weighted optimum to the pose alone. What is given up is the
    objective's optimum along the self-motion, which `Strict` finds.
    """

    objective: Objective
    weight: float = 1e-3
    """Weight of the objective relative to the pose error; >= 0, 0: nothing."""
    fading: bool = False
    """The weight fades with the pose error."""

    def __post_init__(self) -> None:
        if not isinstance(self.fading, (bool, np.bool_)):
            raise OptionError(f"fading must be True or False, got {shown(self.fading)}")
        check_objective(self.objective)
        if not (is_number(self.weight) and 0 <= self.weight < math.inf):
            raise OptionError(f"the weight of Weighted must be a number >= 0, got {shown(self.weight)}")

    @property
    def objectives(self) -> tuple[Objective]:
        """The objective."""
        return (self.objective,)

    def faded(self, slope: np.ndarray, pull: np.ndarray) -> Weighted | None:
        """The same with the weight where the pose's gradient is `slope` (n,) and the objective's `pull` (n,).

        `weight |slope|^2 / (|slope|^2 + s^2)` with `s = max(FADING, weight |pull|)`: so faded, the objective's gradient
        is at most half of the pose's, and balances it nowhere but where the pose's is zero. None: no weight is left.
        """
        square = float(slope @ slope)
        weight = self.weight * square / (square + max(FADING, self.weight * float(np.linalg.norm(pull))) ** 2)
        return Weighted(self.objective, weight) if weight > 0.0 else None

    @property
    def parts(self) -> tuple[Weighted]:
        """What calls have a key for: the objective with its weight."""
        return (self,)

    @property
    def name(self) -> str | None:
        """That of the objective."""
        return self.objective.name

    @staticmethod
    def of_parts(parts: Sequence[Any]) -> Weighted | None:
        """What is left of it where parts that are off do not count."""
        return next((part for part in parts if not part.is_off), None)


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

    @property
    def parts(self) -> tuple[Objective, ...]:
        """What calls have a key for: the objectives."""
        return self.objectives

    @staticmethod
    def of_parts(parts: Sequence[Any]) -> Strict | None:
        """What is left of it where parts that are off do not count."""
        left = [part for part in parts if not part.is_off]
        return Strict(*left) if left else None
