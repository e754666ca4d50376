"""An objective among the tasks: its place in the order of priorities, and what it counts there."""

from __future__ import annotations

from dataclasses import dataclass, field

from maira_qp.errors import OptionError
from maira_qp.problem.naming import check_name
from maira_qp.problem.objectives import Objective, check_objective
from maira_qp.problem.redundancy import WeightedObjective
from maira_qp.problem.tasks.task import check_place, checked_weights


@dataclass(frozen=True)
class ObjectiveTask(WeightedObjective):
    """An objective at a priority below the first, beside the tasks there or alone: `weight objective` of the cost.

    `Strict(objective)` puts it below all tasks, `Weighted(objective, weight)` into the first level.
    """

    objective: Objective
    weight: float = 1.0
    """What the objective counts against the tasks of its priority; >= 0, 0: nothing."""
    priority: int = 2
    """Its level; >= 2."""
    gain: float = 1.0
    """Share of Newton's step that a control tick takes, in (0, 1]."""
    name: str | None = field(default=None, kw_only=True)
    """What calls call it by; None: the name of the objective, or a word for its class, such as "posture"."""

    def __post_init__(self) -> None:
        """Raises `OptionError`."""
        check_objective(self.objective)
        check_name(self.name, self)
        checked_weights(self.weight, "weight", 1)
        check_place(self.priority, self.gain)
        if self.priority < 2:
            raise OptionError(
                "an ObjectiveTask has priority 2 or lower down; in the first level: redundancy=Weighted(...)"
            )

    @property
    def key(self) -> str:
        """What a call calls it by."""
        return self.objective.key if self.name is None else self.name
