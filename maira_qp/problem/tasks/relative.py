"""Relative pose: one frame of the robot is to stand at a pose in another, as two hands that carry one thing."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pinocchio as pin

from maira_qp.errors import FrameError, OptionError
from maira_qp.orientation import skew
from maira_qp.problem.tasks.frame import METRE, TargetTask, frame_error
from maira_qp.problem.tasks.task import checked_weights
from maira_qp.robots.model.configuration import Configuration
from maira_qp.robots.model.robot import Robot


@dataclass(frozen=True, kw_only=True)
class RelativePoseTask(TargetTask):
    """The pose of `frame` in `reference` is to be the target, which is a pose in `reference` (six rows).

    With T = T_reference^-1 T_frame the error is `[p_d - p; 2 log(quat(R_d R^T))]` in the axes of the reference.
    """

    reference: str = ""
    """The frame that the pose is relative to; it may move as well."""
    position_weight: float | None = None
    """What an error of 1 m counts [rad/m]; > 0; None: 4 rad for the arm's length."""
    orientation_weight: float = 1.0
    """What an error of 1 rad counts; > 0."""

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in ("position_weight", "orientation_weight"):
            if (value := getattr(self, name)) is not None:
                checked_weights(value, name, 1)

    def of(self, robot: Robot) -> RelativePoseTask:
        """With the frames' names and weights. Raises `FrameError`."""
        task = super().of(robot)
        assert isinstance(task, RelativePoseTask)
        robot.frame_id(task.reference)
        if task.reference == task.frame:
            raise FrameError(f"a RelativePoseTask needs two frames, got {task.frame!r} twice")
        weight = METRE / robot.length if task.position_weight is None else task.position_weight
        return replace(task, position_weight=weight)

    @property
    def weights(self) -> np.ndarray:
        """Weights (6,)."""
        if self.position_weight is None:
            raise OptionError("the task has no position weight yet: task.of(robot) gives it one")
        return np.repeat([float(self.position_weight), float(self.orientation_weight)], 3)

    def error(self, at: Configuration) -> np.ndarray:
        """Error (6,) [m, rad] in the axes of the reference."""
        return frame_error(self._actual(at), self.target)

    def jacobian(self, at: Configuration) -> np.ndarray:
        """Jacobian (6, n): how the frame moves as seen from the reference."""
        frame, reference = at.placement(self.frame), at.placement(self.reference)
        J, moving = at.jacobian(self.frame), at.jacobian(self.reference)
        across = skew(frame.translation - reference.translation)
        difference = J - moving
        difference[:3] += across @ moving[3:]
        return (reference.rotation.T @ difference.reshape(2, 3, -1)).reshape(6, -1)

    def _actual(self, at: Configuration) -> pin.SE3:
        return at.placement(self.reference).actInv(at.placement(self.frame))

    def residual(self, at: Configuration) -> tuple[float, float]:
        """Norms of the position error [m] and the orientation error [rad]."""
        e = self.error(at)
        return math.hypot(*e[:3]), math.hypot(*e[3:])

    def toward(self, targets: Any) -> RelativePoseTask:
        """With its target."""
        task = super().toward(targets)
        assert isinstance(task, RelativePoseTask)
        return task
