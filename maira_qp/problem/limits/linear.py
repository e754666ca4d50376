"""Linear limits of the joints: of one's own, and those that come with a robot.

Where accelerations are limited a tick leaves room to stop, as it does at the limits of single joints.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar

import numpy as np

from maira_qp.arrays import is_listing, real_array
from maira_qp.errors import OptionError, shown
from maira_qp.problem.limits.joint import KEPT, Limit, Tick, braking_displacement
from maira_qp.problem.naming import check_name
from maira_qp.robots.model.configuration import Configuration
from maira_qp.robots.model.joint_limits import sum_rows
from maira_qp.robots.model.robot import Robot


@dataclass(frozen=True)
class LinearLimit(Limit):
    """`A q <= b`, A (m, n), b (m,): coupled joints, as in a parallelogram arm whose q2 + q3 is limited."""

    A: Any
    b: Any
    names: Sequence[str] | None = None
    """What results call the m rows; None: "LinearLimit row 1" and so on."""
    name: str | None = field(default=None, kw_only=True)
    """What calls and messages call the limit by; None: "linear_limit"."""
    _braking: Any = field(default=None, kw_only=True, repr=False, compare=False)
    """How fast (m,) all joints of each row together can slow it down [1/s^2]; None: at once"""
    is_linear: ClassVar[bool] = True

    def __post_init__(self) -> None:
        A = real_array(self.A, (None, None), "A of a LinearLimit", OptionError)
        b = real_array(self.b, (A.shape[0],), "b of a LinearLimit", OptionError)
        object.__setattr__(self, "A", A)
        object.__setattr__(self, "b", b)
        check_name(self.name, self)
        if self.names is not None:
            names = tuple(self.names) if is_listing(self.names) else ()
            if len(names) != len(b) or not all(isinstance(name, str) for name in names):
                raise OptionError(f"names of a LinearLimit must be {len(b)} texts, one a row, got {shown(self.names)}")
            object.__setattr__(self, "names", names)

    def of(self, robot: Robot) -> LinearLimit:
        """The same, with its columns counted, and for the robot's accelerations."""
        if self.A.shape[1] != robot.n:
            raise OptionError(f"A of a LinearLimit needs {robot.n} columns, one a joint, not {self.A.shape[1]}")
        if np.isinf(robot.acceleration_limit).all():
            return self
        together = (np.abs(self.A) * np.where(self.A != 0, robot.acceleration_limit, 0.0)).sum(axis=1)
        return replace(self, _braking=np.where(together > 0, together, np.inf))

    def rows(self, at: Configuration, tick: Tick | None) -> tuple[Any, Any]:
        """What is left of b, negative where a row is broken; in a tick, what of it may be gone so that it can stop."""
        room = self.b - self.A @ at.q
        if tick is None or self._braking is None:
            return self.A, room
        return self.A, braking_displacement(room, self._braking * tick.dt**2, self.A @ tick.velocity * tick.dt)

    @property
    def has_equation(self) -> bool:
        """Two rows together leave a sum of joints no more than rounding."""
        size = np.abs(self.A).max(axis=1, initial=0.0)
        is_row = size > 0
        A, b = self.A[is_row] / size[is_row, None], self.b[is_row] / size[is_row]
        opposite = (np.abs(A[:, None] + A) <= KEPT).all(axis=2)
        return bool((opposite & (b[:, None] + b <= 2 * KEPT)).any())

    def violations(self, at: Configuration) -> np.ndarray:
        """By how much each row (m,) is broken by more than rounding; >= 0."""
        return np.maximum(-self.rooms(at), 0.0)

    def rooms(self, at: Configuration) -> np.ndarray:
        """What is left of each row (m,), and of what rounding may take."""
        return self.b - self.A @ at.q + KEPT

    def parts(self, at: Configuration) -> np.ndarray:
        """Each row is a part of its own (m,)."""
        return np.arange(len(self.b))

    def broken(self, at: Configuration, name: str) -> dict[str, float]:
        """The rows that are broken, by their names, and by how much."""
        left = self.b - self.A @ at.q
        called = [f"{name} row {i + 1}" if len(left) > 1 else name for i in range(len(left))]
        return {row: -float(amount) for row, amount in zip(self.names or called, left, strict=True) if amount < -KEPT}

    def named_rows(self, count: int) -> list[tuple[str, str]]:
        """What each of `count` rows is called: its name."""
        return super().named_rows(count) if self.names is None else [(name, "") for name in self.names]


def limits_of_robot(robot: Robot) -> tuple[LinearLimit, ...]:
    """The hard limits that a robot brings with it beside those of single joints: one, or none."""
    if not robot.sum_limits:
        return ()
    return (LinearLimit(*sum_rows(robot.sum_limits, robot.joint_names), name="sum_limits").of(robot),)
