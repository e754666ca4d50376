"""What every task is: an error e(q) (m,) to be driven to zero, `1/2 |W e|^2` as the cost of its priority level.

A task of one's own is a frozen dataclass with an error and a Jacobian:

```python
from dataclasses import dataclass

import numpy as np

import maira_qp as mq


@dataclass(frozen=True, kw_only=True)
class HeightTask(mq.Task):
    height: float

    def error(self, at):
        return np.array([self.height - at.placement().translation[2]])

    def jacobian(self, at):
        return at.jacobian()[2:3]
```

The error falls by `jacobian @ dq`: the Jacobian is minus the error's derivative, or, where that is easier to write, any
matrix J with the same `J^T W^2 e`, so that the gradient of the cost is exact. The rest has defaults: unit weights,
Gauss-Newton's Hessian, nothing to be made for a robot, no target, and the error's norm as what is reported. With

        def with_value(self, value):
            return replace(self, height=float(value))

a call may give another height, `solver.step(q, {"tool0": pose, "height": 0.4}, dt)`.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping
from copy import copy
from dataclasses import dataclass
from functools import cache, cached_property
from typing import Any

import numpy as np
import pinocchio as pin

from maira_qp.arrays import is_count, is_number, real_array
from maira_qp.errors import OptionError, shown
from maira_qp.problem.limits.joint import Tick
from maira_qp.problem.naming import NO_DATUM, POSE, check_name, word_for
from maira_qp.robots.model.configuration import Configuration
from maira_qp.robots.model.robot import Robot

NUDGE = 1e-5
"""Of the joints, where a Jacobian is differentiated by differences [rad or m]"""

NOISE = 1e-9
"""Of such derivatives, what is smaller as a share of the largest is rounding, about 1e-16 / NUDGE."""

WEIGHTS = ("weight", "position_weight", "orientation_weight")
"""Fields of tasks that hold weights."""


@dataclass(frozen=True, kw_only=True)
class Task(ABC):
    """Rows of a priority level."""

    priority: int = 1
    """Its level: 1 is the first, and no level is felt by those above it; >= 1."""
    gain: float = 1.0
    """Share of the error that a control tick is to take away, in (0, 1]; `solve` goes all the way."""
    damping: float = 0.0
    """Levenberg-Marquardt damping of a control tick, `1/2 damping |W e|^2 |dq|^2`, beside `Options.damping`; >= 0."""
    equality: bool = False
    """A control tick meets it before the other tasks of its priority, in place of weighing it against them."""
    name: str | None = None
    """What calls call it by; None: its frame, or a word for its class, such as "swivel"."""

    def __post_init__(self) -> None:
        """Raises `OptionError`."""
        check_name(self.name, self)
        check_place(self.priority, self.gain)
        if not (is_number(self.damping) and 0 <= self.damping < math.inf):
            raise OptionError(f"damping must be a number >= 0, got {shown(self.damping)}")
        if not isinstance(self.equality, (bool, np.bool_)):
            raise OptionError(f"equality must be True or False, got {shown(self.equality)}")

    def of(self, robot: Robot) -> Task:
        """The task with everything that depends on the robot filled in and checked. Raises `OptionError`."""
        return self

    @property
    def key(self) -> str:
        """What a call calls the task by: its name, else its frame or a word for its class."""
        return word_for(self) if self.name is None else self.name

    @property
    def target_key(self) -> str | None:
        """The key of the target that the task takes from the call; None: it needs none."""
        return None

    @property
    def datum(self) -> str:
        """What it takes from the call that stands in the base, "pose", "point" or "direction"; empty: nothing does."""
        return "" if self.target_key is None else POSE

    def with_value(self, value: Any) -> Task:
        """The task, bound to a robot, with another datum: its target, point, angle ... Raises `OptionError`."""
        raise OptionError(f"{self.key!r}, a {type(self).__name__}, {NO_DATUM}")

    def target_of(self, value: Any) -> Any:
        """The `value` that a call gives as target, or as targets, as poses; vectors too where the task takes some."""
        return value

    def scaled(self, factor: float) -> Task:
        """The task, bound to a robot, with its weights times a factor > 0. Raises `OptionError` if it has none."""
        own = {name: getattr(self, name) for name in WEIGHTS if getattr(self, name, None) is not None}
        if not own:
            raise OptionError(f"{self.key!r}, a {type(self).__name__}, has no field `weight` to be multiplied")
        task = copy(self)
        for name in _cached_properties(type(self)):
            task.__dict__.pop(name, None)
        for name, value in own.items():
            object.__setattr__(task, name, value * factor if is_number(value) else np.asarray(value) * factor)
        return task

    @cached_property
    def is_off(self) -> bool:
        """All its weights are 0: it has no rows, and no say."""
        own = [getattr(self, name) for name in WEIGHTS if hasattr(self, name)]
        return not any(np.any(weight) for weight in own or [self.weights])

    def toward(self, targets: Mapping[str, pin.SE3]) -> Task:
        """The same task with its target out of these, which are not checked again."""
        return self

    @property
    def is_of_ticks(self) -> bool:
        """It asks for motion, in control ticks; `solve` knows nothing of it."""
        return False

    def in_tick(self, at: Configuration, tick: Tick) -> Task:
        """The task in a control tick that begins at a configuration."""
        return self

    @property
    def weights(self) -> np.ndarray | float:
        """What a unit of error counts: (m,), or one for all rows."""
        return 1.0

    @property
    def is_wish(self) -> bool:
        """A control tick takes the task's `wishes` in place of its error."""
        return False

    def wishes(self, at: Configuration, tick: Tick) -> tuple[np.ndarray, np.ndarray]:
        """G (m, n) and h (m,) of inequalities `G dq <= h` that are to be kept in a tick."""
        return np.empty((0, at.n)), np.empty(0)

    @abstractmethod
    def error(self, at: Configuration) -> np.ndarray:
        """Error (m,)."""

    @abstractmethod
    def jacobian(self, at: Configuration) -> np.ndarray:
        """J (m, n): the error falls by J dq."""

    def curvature(self, at: Configuration, multipliers: np.ndarray) -> np.ndarray:
        """How the rows `W J` bend (n, n): `sum_k multipliers_k d(W J)_k/dq`, symmetric; multipliers (m,).

        By central differences of the Jacobian where a task does not know better.
        """
        if not multipliers.any():
            return np.zeros((at.n, at.n))
        pull, nudges = np.asarray(self.weights) * multipliers, NUDGE * np.eye(at.n)
        C = np.array([pull @ (self.jacobian(at.moved(dq)) - self.jacobian(at.moved(-dq))) for dq in nudges])
        return without_noise((C + C.T) / (4 * NUDGE))

    def residual_curvature(self, at: Configuration, residual: np.ndarray) -> np.ndarray:
        """What is left of `hessian(at) - A^T A` (n, n) where only `residual` (m,) of the weighted error W e stays.

        Here the differences of the gradient, times the share of the error that stays.
        """
        A, r = self.rows(at)
        if not residual.any() or not r.any():
            return np.zeros((at.n, at.n))
        ways = [(self.rows(at.moved(dq)), self.rows(at.moved(-dq))) for dq in NUDGE * np.eye(at.n)]
        H = np.array([back[1] @ back[0] - ahead[1] @ ahead[0] for ahead, back in ways]) / (2 * NUDGE)
        return float(np.linalg.norm(residual) / np.linalg.norm(r)) * without_noise(0.5 * (H + H.T) - A.T @ A)

    def hessian(self, at: Configuration) -> np.ndarray:
        """Hessian (n, n) of `1/2 |W e|^2`, of any definiteness; Gauss-Newton's where the exact one is unknown."""
        A, _ = self.rows(at)
        return A.T @ A

    def residual(self, at: Configuration) -> tuple[float, float]:
        """What is left of the error [m] and [rad]: what the tolerances of `Options` are compared with."""
        return 0.0, float(np.linalg.norm(self.error(at)))

    @property
    def measures(self) -> tuple[bool, bool]:
        """Whether the parts of `residual` in metres, and in radians, say something: False for what is left free."""
        return type(self).residual is not Task.residual, True

    def change(self, at: Configuration, before: Configuration, after: Configuration) -> np.ndarray:
        """What a motion changes of the error (m,), as the rows of a configuration near by tell it: `-jacobian @ dq`.

        To first order; the error's own difference, unless the rows are not its derivative.
        """
        return self.error(after) - self.error(before)

    def weighted_change(self, at: Configuration, before: Configuration, after: Configuration) -> np.ndarray:
        """The same, weighted."""
        return self.weights * self.change(at, before, after)

    def weighted_error(self, at: Configuration) -> np.ndarray:
        """W e (m,), computed once for a configuration."""
        kept = at.kept.get((id(self), "error"))
        if kept is None:
            kept = at.kept[id(self), "error"] = (self, self.weights * self.error(at))
        return kept[1]

    def rows(self, at: Configuration) -> tuple[np.ndarray, np.ndarray]:
        """The weighted Jacobian W J (m, n) and the weighted error W e (m,), computed once for a configuration."""
        kept = at.kept.get((id(self), "jacobian"))
        if kept is None:
            weights = np.asarray(self.weights).reshape(-1, 1)
            kept = at.kept[id(self), "jacobian"] = (self, weights * self.jacobian(at))
        return kept[1], self.weighted_error(at)


def without_noise(C: np.ndarray) -> np.ndarray:
    """A derivative (n, n) by differences, 0 where it is rounding: a joint that moves nothing bends nothing."""
    return np.where(np.abs(C) < NOISE * np.abs(C).max(initial=0.0), 0.0, C)


def check_place(priority: object, gain: object) -> None:
    """Raises `OptionError` for a priority or a gain that is none."""
    if not is_count(priority, 1) or isinstance(priority, (float, np.floating)):
        raise OptionError(f"priority must be a whole number >= 1, got {shown(priority)}")
    if not (is_number(gain) and 0 < gain <= 1):  # type: ignore[operator]
        raise OptionError(f"gain must be in (0, 1], got {shown(gain)}")


@cache
def _cached_properties(kind: type) -> tuple[str, ...]:
    """The names of what instances of a class compute once."""
    return tuple(name for each in kind.__mro__ for name, value in vars(each).items() if type(value) is cached_property)


def checked_weights(value: object, name: str, size: int) -> np.ndarray:
    """Weights (size,) from one number for all or one each, >= 0; all 0: switched off. Raises `OptionError`."""
    try:
        shape = () if np.ndim(value) == 0 else (size,)  # type: ignore[arg-type]
        weights = np.array(np.broadcast_to(real_array(value, shape, name, OptionError), (size,)))
    except Exception:  # ragged lists, and whatever a class of the caller's own raises
        weights = np.full(size, -1.0)
    if (weights < 0).any():
        told = "must be a number >= 0" + (f", or {size} of them" if size > 1 else "")
        raise OptionError(f"{name} {told}, got {shown(value)}")
    return weights
