"""Tasks of the joints themselves: coupled joints, and joints that are to stand still."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from maira_qp.arrays import real_array, semidefinite_matrix
from maira_qp.errors import OptionError, listed, shown
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
