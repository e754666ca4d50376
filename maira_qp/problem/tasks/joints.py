"""Tasks of the joints themselves: coupled joints, and joints that are to stand still or to move at a velocity."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from maira_qp.arrays import is_listing, real_array, semidefinite_matrix
from maira_qp.errors import OptionError, listed, shown
from maira_qp.problem.limits.joint import RESERVE, Tick
from maira_qp.problem.tasks.task import Task, checked_weights
from maira_qp.robots.model.configuration import Configuration
from maira_qp.robots.model.robot import Robot


@dataclass(frozen=True, kw_only=True)
class JointCouplingTask(Task):
    """Joints are to keep a linear relation, `sum_i a_i q_i = value`, as the fingers of a gripper: one row.

    (A joint that mimics another in the URDF needs no task: it is no joint of its own.)
    """

    coefficients: Mapping[str, float]
    """a_i by the names of the joints, not all 0; joints that are not named do not count."""
    value: float = 0.0
    """[rad or m]"""
    weight: float = 1.0
    """What an error of 1 rad or m counts; > 0."""
    _row: Any = None

    def __post_init__(self) -> None:
        super().__post_init__()
        checked_weights(self.weight, "weight", 1)
        real_array(self.value, (), "value of JointCouplingTask", OptionError)
        if not isinstance(self.coefficients, Mapping) or not self.coefficients:
            raise OptionError(
                "coefficients of JointCouplingTask must be a mapping such as {'finger1': 1, 'finger2': -1}"
            )
        numbers = real_array(
            list(self.coefficients.values()), (None,), "coefficients of JointCouplingTask", OptionError
        )
        if not numbers.any():
            raise OptionError("coefficients of JointCouplingTask are all 0")
        object.__setattr__(self, "coefficients", dict(self.coefficients))

    def of(self, robot: Robot) -> JointCouplingTask:
        """With the row (1, n). Raises `OptionError` for a joint that the robot does not have."""
        row = np.zeros((1, robot.n))
        for name, coefficient in self.coefficients.items():
            if name not in robot.joint_names:
                raise OptionError(f"{shown(name)} is not a joint of {robot.name}; {listed(robot.joint_names, name)}")
            row[0, robot.joint_names.index(name)] = coefficient
        return replace(self, _row=row)

    def with_value(self, value: Any) -> JointCouplingTask:
        """The same task with another value [rad or m]. Raises `OptionError`."""
        task = copy(self)
        object.__setattr__(task, "value", float(real_array(value, (), f"value of {self.key!r}", OptionError)))
        return task

    @property
    def row(self) -> np.ndarray:
        """The coefficients (1, n) in the order of the robot's joints."""
        return self._row

    @property
    def weights(self) -> float:
        """That of the row."""
        return float(self.weight)

    def error(self, at: Configuration) -> np.ndarray:
        """What is missing of the value (1,)."""
        return self.value - self.row @ at.q

    def jacobian(self, at: Configuration) -> np.ndarray:
        """The coefficients (1, n)."""
        return self.row


@dataclass(frozen=True, kw_only=True)
class DampingTask(Task):
    """Joints are to stand still where nothing above or beside it moves them: a control tick's `1/2 |w dq|^2`."""

    weight: Any = 1.0
    """What a displacement of 1 rad or m counts, one for all joints or (n,); >= 0."""
    metric: Any = None
    """A symmetric positive semidefinite matrix M (n, n), such as a mass matrix, for `1/2 (w dq)^T M (w dq)`, by the
    reference engine; None: the identity."""
    priority: int = 2

    def of(self, robot: Robot) -> DampingTask:
        """With weights (n,)."""
        weight, metric = checked_weights(self.weight, "weight of DampingTask", robot.n), self.metric
        if metric is not None:
            metric = semidefinite_matrix(metric, robot.n, "metric of DampingTask", OptionError)
        return replace(self, weight=weight, metric=metric)

    @property
    def weights(self) -> np.ndarray | float:
        """Weights (n,); with a metric they are part of the rows."""
        return self.weight if self.metric is None else 1.0

    def error(self, at: Configuration) -> np.ndarray:
        """Zeros (n,): where the joints are is as good as anywhere."""
        return np.zeros(at.n)

    def jacobian(self, at: Configuration) -> np.ndarray:
        """The identity (n, n), or the root of the metric, times the weights."""
        if self.metric is None:
            return np.eye(at.n)
        values, V = np.linalg.eigh(self.metric)
        return (V * np.sqrt(np.maximum(values, 0.0))) @ V.T * self.weight


@dataclass(frozen=True, kw_only=True)
class JointVelocityTask(Task):
    """Joints are to move at a velocity: a control tick moves them by velocity dt as far as the levels above allow.

    `solve` knows nothing of it. Where accelerations are limited, a tick aims as far ahead as a joint at that velocity
    needs to stop.
    """

    velocity: Any
    """(n,) [rad/s or m/s], or one for each of the `joints`; or by name, {joint: velocity}."""
    joints: Sequence[str] | None = None
    """The names of the joints; None: all, or those that the velocity names."""
    weight: Any = 1.0
    """What a displacement of 1 rad or m too little counts, one for all of the joints or one each; >= 0."""
    _columns: Any = None
    _acceleration: Any = None
    _goal: Any = None

    def of(self, robot: Robot) -> JointVelocityTask:
        """With the joints' places and arrays (k,). Raises `OptionError`."""
        names = self.joints
        if names is None:
            names = tuple(self.velocity) if isinstance(self.velocity, Mapping) else robot.joint_names
        if not is_listing(names) or not names:
            raise OptionError(f"joints of JointVelocityTask must be a list of names, got {shown(names)}")
        for name in names:
            if name not in robot.joint_names:
                raise OptionError(f"{shown(name)} is not a joint of {robot.name}; {listed(robot.joint_names, name)}")
        columns = np.array([robot.joint_names.index(name) for name in names])
        weight = checked_weights(self.weight, "weight of JointVelocityTask", len(columns))
        limits = robot.acceleration_limit[columns]
        task = replace(self, joints=tuple(names), weight=weight, _columns=columns, _acceleration=limits)
        return task.with_value(self.velocity)

    def with_value(self, value: Any) -> JointVelocityTask:
        """The same task with another velocity, (k,) or by name. Raises `OptionError`."""
        names = tuple(self.joints or ())
        if isinstance(value, Mapping):
            if set(value) != set(names):
                raise OptionError(f"the velocity of {self.key!r} must name each of {', '.join(names)}, and no others")
            value = [value[name] for name in names]
        velocity = real_array(value, (len(names),), f"velocity of {self.key!r}", OptionError)
        return self._with(velocity=velocity)

    def _with(self, **values: Any) -> JointVelocityTask:
        task = copy(self)
        for name, value in values.items():
            object.__setattr__(task, name, value)
        return task

    @property
    def columns(self) -> np.ndarray:
        """Which of the robot's joints (k,) they are."""
        return self._columns

    def goal(self, q: np.ndarray, dt: float) -> np.ndarray:
        """Where the joints (k,) are to go from q (n,) in a tick of dt [s], or further on, so that they could stop.

        A tick goes the share of its way after which all joints can stop where it ends (`stopping_displacement`). Of
        this way that is `velocity dt`, by the joint that takes longest to stop.
        """
        way = self.velocity * dt
        ahead = np.max(np.abs(way) / (2.0 * RESERVE * self._acceleration * dt**2), initial=0.0)
        return q[self._columns] + (1.0 + ahead) * way

    @property
    def is_of_ticks(self) -> bool:
        """Yes."""
        return True

    def in_tick(self, at: Configuration, tick: Tick) -> JointVelocityTask:
        """With the goal of a tick."""
        return self._with(_goal=self.goal(at.q, tick.dt))

    @property
    def weights(self) -> np.ndarray:
        """Weights (k,)."""
        return self.weight

    def error(self, at: Configuration) -> np.ndarray:
        """What is missing of the way (k,) [rad or m]; nothing where no tick goes."""
        return np.zeros(len(self._columns)) if self._goal is None else self._goal - at.q[self._columns]

    def jacobian(self, at: Configuration) -> np.ndarray:
        """The rows of these joints in the identity (k, n)."""
        return np.eye(at.n)[self._columns]

    def residual(self, at: Configuration) -> tuple[float, float]:
        """What is missing of the way of the joints that count [rad or m]."""
        return 0.0, float(np.linalg.norm(self.error(at)[self.weight > 0]))

    def curvature(self, at: Configuration, multipliers: np.ndarray) -> np.ndarray:
        """Zero (n, n)."""
        return np.zeros((at.n, at.n))

    def residual_curvature(self, at: Configuration, residual: np.ndarray) -> np.ndarray:
        """Zero (n, n)."""
        return np.zeros((at.n, at.n))
