"""Pose tasks: an error to be driven to zero, its Jacobian, and the weights that make the two comparable.

The error of a frame against its target in base axes is `e = [p_d - p; phi]`, with phi the rotation vector
`2 log(quat(R_d R^T))`. The task's cost `1/2 |W e|^2` has the exact gradient `-J^T W^2 e` with the geometric Jacobian J,
since the logarithm's own derivative leaves phi where it is (Sola, Deray and Atchuthan, "A micro Lie theory for state
estimation in robotics", 2018, section 3.3). Hence a stationary point of the iteration is one of the true error.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from copy import copy
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pinocchio as pin

from maira_qp.errors import OptionError
from maira_qp.orientation import orientation_error
from maira_qp.problem.pose import as_pose
from maira_qp.robots.configuration import Configuration
from maira_qp.robots.robot import Robot


@dataclass(frozen=True, kw_only=True)
class FrameTask(ABC):
    """A frame of the robot is to take a target pose, or a part of it."""

    frame: str | None = None
    """The frame's name; None: the robot's tip."""
    target: Any = None
    """Its pose in the base: `pin.SE3` or (4, 4) array; None: the target that the solver is called with."""

    def __post_init__(self) -> None:
        if self.target is not None:
            object.__setattr__(self, "target", as_pose(self.target))

    def of(self, robot: Robot) -> FrameTask:
        """The task with weights made for the robot's size. Raises `FrameError` for a frame that it does not have."""
        robot.frame_id(self.frame)
        if getattr(self, "position_weight", 0.0) is None:
            return replace(self, position_weight=4.0 / robot.length)  # type: ignore[call-arg]
        return self

    def toward(self, target: pin.SE3) -> FrameTask:
        """The same task with this target, which is not checked again, unless it has one of its own."""
        if self.target is not None:
            return self
        bound = copy(self)
        object.__setattr__(bound, "target", target)
        return bound

    @property
    @abstractmethod
    def weights(self) -> np.ndarray:
        """Weights (m,) of the m rows: what one unit of error counts."""

    @property
    @abstractmethod
    def rows(self) -> slice:
        """Which of the six rows (linear, then angular) the task uses."""

    def error(self, at: Configuration) -> np.ndarray:
        """Error (m,) [m, rad] of the frame against the target."""
        return frame_error(at.placement(self.frame), self.target)[self.rows]

    def jacobian(self, at: Configuration) -> np.ndarray:
        """Geometric Jacobian (m, n) in base axes: how the frame moves, so that the error falls by J dq."""
        return at.jacobian(self.frame)[self.rows]

    def residual(self, at: Configuration) -> tuple[float, float]:
        """Norms of the position error [m] and the orientation error [rad]; 0 for a part that the task leaves free."""
        e = np.zeros(6)
        e[self.rows] = self.error(at)
        return math.hypot(*e[:3]), math.hypot(*e[3:])


def frame_error(actual: pin.SE3, target: pin.SE3) -> np.ndarray:
    """Error (6,) [m, rad] in base axes: `pose_error` of two `pin.SE3`."""
    e = np.empty(6)
    e[:3] = target.translation - actual.translation
    e[3:] = orientation_error(actual.rotation, target.rotation)
    return e


def _known(weight: float | None) -> float:
    if weight is None:
        raise OptionError("the task has no position weight yet: task.of(robot) gives it one")
    return float(weight)


def _positive(**weights: float | None) -> None:
    for name, value in weights.items():
        if value is None and name == "position_weight":
            continue
        if isinstance(value, bool) or not (isinstance(value, (int, float, np.number)) and 0 < value < math.inf):
            raise OptionError(f"{name} must be a positive number, got {value!r}")


@dataclass(frozen=True, kw_only=True)
class PoseTask(FrameTask):
    """Position and orientation of a frame (six rows)."""

    position_weight: float | None = None
    """What an error of 1 m counts in rad; > 0 [rad/m]; None: 4 rad for the arm's length, 2 rad/m for one of 2 m."""
    orientation_weight: float = 1.0
    """What an error of 1 rad counts; > 0."""

    def __post_init__(self) -> None:
        super().__post_init__()
        _positive(position_weight=self.position_weight, orientation_weight=self.orientation_weight)

    @property
    def weights(self) -> np.ndarray:
        """Weights (6,)."""
        return np.repeat([_known(self.position_weight), float(self.orientation_weight)], 3)

    @property
    def rows(self) -> slice:
        """All six."""
        return slice(0, 6)


@dataclass(frozen=True, kw_only=True)
class PositionTask(FrameTask):
    """Position of a frame alone; its orientation is free (three rows)."""

    position_weight: float | None = None
    """What an error of 1 m counts; > 0 [rad/m]; None: 4 rad for the arm's length."""

    def __post_init__(self) -> None:
        super().__post_init__()
        _positive(position_weight=self.position_weight)

    @property
    def weights(self) -> np.ndarray:
        """Weights (3,)."""
        return np.repeat(_known(self.position_weight), 3)

    @property
    def rows(self) -> slice:
        """The linear three."""
        return slice(0, 3)


@dataclass(frozen=True, kw_only=True)
class OrientationTask(FrameTask):
    """Orientation of a frame alone; its position is free (three rows)."""

    orientation_weight: float = 1.0
    """What an error of 1 rad counts; > 0."""

    def __post_init__(self) -> None:
        super().__post_init__()
        _positive(orientation_weight=self.orientation_weight)

    @property
    def weights(self) -> np.ndarray:
        """Weights (3,)."""
        return np.repeat(float(self.orientation_weight), 3)

    @property
    def rows(self) -> slice:
        """The angular three."""
        return slice(3, 6)
