"""A limit as a wish: inequalities at a priority level, in place of the hard limits that hold above all levels."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from maira_qp.errors import OptionError, shown
from maira_qp.problem.limits.joint import Limit, Tick
from maira_qp.problem.tasks.task import Task, checked_weights
from maira_qp.robots.model.configuration import Configuration
from maira_qp.robots.model.robot import Robot


@dataclass(frozen=True, kw_only=True)
class LimitTask(Task):
    """A limit is to be kept as well as the levels above allow; the levels below may not spoil what was reached.

    Its error is what breaks the limit: one row for each of the limit's rows, 0 where that is kept.
    """

    limit: Limit
    """Any with rows, such as `LinearLimit(A, b)` or `CollisionLimit(...)`."""
    weight: float = 1.0
    """What it counts to break a row by one unit; > 0."""

    def __post_init__(self) -> None:
        super().__post_init__()
        checked_weights(self.weight, "weight", 1)
        if not isinstance(self.limit, Limit):
            raise OptionError(
                f"limit of LimitTask must be a limit such as mq.LinearLimit(A, b), got {shown(self.limit)}"
            )

    def of(self, robot: Robot) -> LimitTask:
        """With the limit made for the robot."""
        return replace(self, limit=self.limit.of(robot))

    @property
    def weights(self) -> float:
        """One for all rows."""
        return float(self.weight)

    @property
    def is_wish(self) -> bool:
        """Yes."""
        return True

    def error(self, at: Configuration) -> np.ndarray:
        """By how much each row is broken (m,)."""
        return np.maximum(-self._rows(at, None)[1], 0.0)

    def jacobian(self, at: Configuration) -> np.ndarray:
        """`-G` (m, n) of the rows that are broken, 0 of the others."""
        G, h = self._rows(at, None)
        return np.where(h[:, None] < 0, -G, 0.0)

    def wishes(self, at: Configuration, tick: Tick) -> tuple[np.ndarray, np.ndarray]:
        """The rows of a tick, weighted."""
        G, h = self._rows(at, tick)
        return self.weight * G, self.weight * h

    def _rows(self, at: Configuration, tick: Tick | None) -> tuple[np.ndarray, np.ndarray]:
        rows = self.limit.rows(at, tick)
        return (np.empty((0, at.n)), np.empty(0)) if rows is None else rows
