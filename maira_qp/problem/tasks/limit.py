"""A limit as a wish: inequalities at a priority level, in place of the hard limits that hold above all levels."""

from __future__ import annotations

from collections.abc import Mapping
from copy import copy
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pinocchio as pin

from maira_qp.errors import OptionError, shown
from maira_qp.problem.limits.joint import FEASIBILITY, Limit, Tick
from maira_qp.problem.tasks.task import Task, checked_weights
from maira_qp.robots.model.configuration import Configuration
from maira_qp.robots.model.robot import Robot

INSIDE = 1e-8
"""How far within a limit that is not linear a solve aims, so that what comes from outside ends inside."""


@dataclass(frozen=True, kw_only=True)
class LimitTask(Task):
    """A limit is to be kept as well as the levels above allow; the levels below may not spoil what was reached.

    Its error is what breaks the limit: one row for each of the limit's rows, 0 where that is kept. A solve counts it as
    reached where the limit is kept, without a tolerance. In the first level, with a posture below, it asks for any
    configuration within the limit, and of these for the one in that posture.
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
    def key(self) -> str:
        """What a call calls it by: its name, else that of its limit."""
        return self.limit.key if self.name is None else self.name

    @property
    def target_key(self) -> str | None:
        """The key of the target that the limit takes from the call, if it needs one."""
        return None if self.limit.target_key is None else self.key

    def target_of(self, value: Any) -> Any:
        """The `value` of a call as the limit takes it. Raises `PoseError`."""
        return self.limit.target_of(value)

    def toward(self, targets: Mapping[str, pin.SE3]) -> LimitTask:
        """The same with the limit's target."""
        if self.limit.target_key is None:
            return self
        return self._limited(self.limit.toward({self.limit.key: targets[self.key]}))

    def actual(self, at: Configuration) -> pin.SE3:
        """The pose that is to be near the target that the limit takes from the call."""
        return self.limit.actual(at)  # type: ignore[attr-defined,no-any-return]

    @property
    def datum(self) -> str:
        """That of its limit."""
        return self.limit.datum

    def with_value(self, value: Any) -> LimitTask:
        """The same with another datum of its limit. Raises what that raises."""
        return self._limited(self.limit.with_value(value))

    @property
    def obstacle_names(self) -> tuple[str, ...]:
        """Those of the limit."""
        return self.limit.obstacle_names

    def check_placed(self) -> None:
        """As its limit does."""
        self.limit.check_placed()

    def with_obstacles(self, poses: Mapping[str, Any]) -> LimitTask:
        """The same with obstacles of its limit elsewhere. Raises what that raises."""
        return self._limited(self.limit.with_obstacles(poses))

    def _limited(self, limit: Limit) -> LimitTask:
        task = copy(self)
        object.__setattr__(task, "limit", limit)
        return task

    @property
    def weights(self) -> float:
        """One for all rows."""
        return float(self.weight)

    @property
    def is_wish(self) -> bool:
        """Yes."""
        return True

    def error(self, at: Configuration) -> np.ndarray:
        """By how much each row is broken (m,); of a limit that is not linear, what is missing of `INSIDE`."""
        h = self._rows(at, None)[1]
        return np.maximum(-h if self.limit.is_linear else INSIDE - h, 0.0)

    def jacobian(self, at: Configuration) -> np.ndarray:
        """`-G` (m, n) of the rows that are broken, 0 of the others."""
        return np.where(self.error(at)[:, None] > 0, -self._rows(at, None)[0], 0.0)

    def hessian(self, at: Configuration) -> np.ndarray:
        """Gauss-Newton's (n, n), and the curvature of the rows that are broken."""
        e, A = self.error(at), self.rows(at)[0]
        return A.T @ A + self.weight**2 * self.limit.curvature(at, e) if e.any() else A.T @ A

    def residual(self, at: Configuration) -> tuple[float, float]:
        """Norms of what is broken of rows in metres [m], and of the others."""
        return self.limit.residual(at)

    def is_kept(self, at: Configuration) -> bool:
        """Whether a configuration keeps the limit; a linear one to rounding."""
        return bool((self._rows(at, None)[1] >= (-FEASIBILITY if self.limit.is_linear else 0.0)).all())

    def wishes(self, at: Configuration, tick: Tick) -> tuple[np.ndarray, np.ndarray]:
        """The rows of a tick, weighted."""
        G, h = self._rows(at, tick)
        return self.weight * G, self.weight * h

    def _rows(self, at: Configuration, tick: Tick | None) -> tuple[np.ndarray, np.ndarray]:
        rows = self.limit.rows(at, tick)
        return (np.empty((0, at.n)), np.empty(0)) if rows is None else rows
