"""Relative pose: one frame of the robot is to stand at a pose in another, as two hands that carry one thing."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import pinocchio as pin

from maira_qp.errors import FrameError, OptionError
from maira_qp.orientation import skew
from maira_qp.problem.tasks.frame import METRE, TargetTask, frame_error, inverse_right_jacobian
from maira_qp.problem.tasks.task import checked_weights
from maira_qp.robots.model.configuration import Configuration
from maira_qp.robots.model.robot import Robot


@dataclass(frozen=True, kw_only=True)
class RelativePoseTask(TargetTask):
    """The pose of `frame` in `reference` is to be the target, a pose there: six rows, fewer where some are free.

    With T = T_reference^-1 T_frame the error is `[p_d - p; 2 log(quat(R_d R^T))]` in the axes of the reference.
    """

    reference: str = ""
    """The frame that the pose is relative to; it may move as well."""
    position_weight: Any = None
    """What an error of 1 m counts [rad/m], >= 0, or (3,) one an axis of the reference, 0: free; None: 4 rad for the
    arm's length."""
    orientation_weight: Any = 1.0
    """What an error of 1 rad counts, >= 0, or (3,) one an axis of the reference, 0: free."""

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in ("position_weight", "orientation_weight"):
            if (value := getattr(self, name)) is not None:
                checked_weights(value, name, 3)

    def of(self, robot: Robot) -> RelativePoseTask:
        """With the frames' names and weights. Raises `FrameError`."""
        task = super().of(robot)
        assert isinstance(task, RelativePoseTask)
        robot.frame_id(task.reference)
        if task.reference == task.frame:
            raise FrameError(f"a RelativePoseTask needs two frames, got {task.frame!r} twice")
        weight = METRE / robot.length if task.position_weight is None else task.position_weight
        return replace(task, position_weight=weight)

    @cached_property
    def all_weights(self) -> np.ndarray:
        """Weights (6,), 0 for what is left free."""
        if self.position_weight is None:
            raise OptionError("the task has no position weight yet: task.of(robot) gives it one")
        both = self.position_weight, self.orientation_weight
        return np.concatenate([np.broadcast_to(np.asarray(weight, dtype=float), 3) for weight in both])

    @cached_property
    def kept(self) -> np.ndarray:
        """Which of the six rows (6,) count at all."""
        return self.all_weights > 0

    @property
    def weights(self) -> np.ndarray:
        """Weights (m,) of the rows that count."""
        return self.all_weights[self.kept]

    def error(self, at: Configuration) -> np.ndarray:
        """Error (m,) [m, rad] in the axes of the reference, the rows that count."""
        return frame_error(self.actual(at), self.target)[self.kept]

    def change(self, at: Configuration, before: Configuration, after: Configuration) -> np.ndarray:
        """What a motion changes of the error (m,); for even weights of the turn, how the frame has turned."""
        if (self.all_weights[3:] != self.all_weights[3]).any():
            return super().change(at, before, after)
        return frame_error(self.actual(after), self.actual(before))[self.kept]

    def jacobian(self, at: Configuration) -> np.ndarray:
        """Jacobian (m, n): how the frame moves as seen from the reference; of uneven turns how the error falls."""
        frame, reference = at.placement(self.frame, self.offset), at.placement(self.reference)
        J, moving = at.jacobian(self.frame, self.offset), at.jacobian(self.reference)
        difference = J - moving
        difference[:3] += skew(frame.translation - reference.translation) @ moving[3:]
        rows = (reference.rotation.T @ difference.reshape(2, 3, -1)).reshape(6, -1)
        if (self.all_weights[3:] != self.all_weights[3]).any():
            phi = frame_error(reference.actInv(frame), self.target)[3:]
            rows[3:] = inverse_right_jacobian(phi) @ rows[3:]
        return rows[self.kept]

    def actual(self, at: Configuration) -> pin.SE3:
        """The pose of the frame, or of its offset, in the reference."""
        return at.placement(self.reference).actInv(at.placement(self.frame, self.offset))

    @property
    def datum(self) -> str:
        """None: its target stands in the reference."""
        return ""

    def residual(self, at: Configuration) -> tuple[float, float]:
        """Norms of the position error [m] and the orientation error [rad]; 0 for what the task leaves free."""
        e = np.zeros(6)
        e[self.kept] = self.error(at)
        return math.hypot(*e[:3]), math.hypot(*e[3:])

    @property
    def measures(self) -> tuple[bool, bool]:
        """Whether the position, and the orientation, count at all."""
        return bool(self.kept[:3].any()), bool(self.kept[3:].any())

    def toward(self, targets: Any) -> RelativePoseTask:
        """With its target."""
        task = super().toward(targets)
        assert isinstance(task, RelativePoseTask)
        return task
