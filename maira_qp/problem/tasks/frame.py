"""Pose tasks: a frame is to take a target pose, or a part of it.

The error of a frame against its target in base axes is `e = [p_d - p; phi]`, with phi the rotation vector
`2 log(quat(R_d R^T))`. The task's cost `1/2 |W e|^2` has the exact gradient `-J^T W^2 e` with the geometric Jacobian J,
since the logarithm's own derivative leaves phi where it is (Sola, Deray and Atchuthan, "A micro Lie theory for state
estimation in robotics", 2018, section 3.3). Hence a stationary point of the iteration is one of the true error. Where
the three axes of the orientation count differently, that derivative enters: `J^-1_r(phi)`, their equation (144).
"""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Mapping
from copy import copy
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import pinocchio as pin

from maira_qp.errors import OptionError, shown
from maira_qp.orientation import orientation_error, skew
from maira_qp.problem.aims import as_point, at_point, posed
from maira_qp.problem.limits.placement import as_offset
from maira_qp.problem.naming import POINT, POSE
from maira_qp.problem.pose import as_pose
from maira_qp.problem.tasks.task import Task, checked_weights
from maira_qp.robots.model.configuration import Configuration
from maira_qp.robots.model.robot import Robot

METRE = 4.0
"""What an error of the arm's whole length counts unless a weight is given [rad]: 2 rad/m for an arm of 2 m."""


@dataclass(frozen=True, kw_only=True)
class TargetTask(Task):
    """A task with a target pose for a frame: its own, or the one that the solver is called with."""

    frame: str | None = None
    """The frame's name; None: the robot's tip."""
    target: Any = None
    """Its pose in the base: `pin.SE3` or (4, 4) array; None: the target that the solver is called with."""
    offset: Any = None
    """What the task is about: a point (3,) [m] in the frame, or a pose there, `pin.SE3` or (4, 4); None: the frame."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.target is not None:
            object.__setattr__(self, "target", as_pose(self.target))
        if self.offset is not None:
            object.__setattr__(self, "offset", as_offset(self.offset, "offset"))

    def of(self, robot: Robot) -> TargetTask:
        """With the frame's name. Raises `FrameError` for a frame that the robot does not have."""
        robot.frame_id(self.frame)
        return replace(self, frame=robot.tip if self.frame is None else self.frame)

    @property
    def key(self) -> str:
        """What a call calls the task by: its name, else its frame."""
        return str(self.frame) if self.name is None else self.name

    @property
    def target_key(self) -> str | None:
        """The key, unless the task has a target of its own."""
        return self.key if self.target is None else None

    def toward(self, targets: Mapping[str, pin.SE3]) -> TargetTask:
        """The same task with the target of its key, unless it has one of its own."""
        return self if self.target is not None else self._aimed(target=targets[self.key])

    @property
    def datum(self) -> str:
        """Its target."""
        return POSE

    def with_value(self, value: Any) -> TargetTask:
        """The same task with another target, a pose. Raises `PoseError`."""
        return self._aimed(target=as_pose(value, f"target of {self.key!r}"))

    def actual(self, at: Configuration) -> pin.SE3:
        """The pose that is to be the target."""
        return at.placement(self.frame, self.offset)

    def _aimed(self, **datum: Any) -> TargetTask:
        """The same task with another datum, unchecked."""
        task = copy(self)
        for name, value in datum.items():
            object.__setattr__(task, name, value)
        return task


@dataclass(frozen=True, kw_only=True)
class FrameTask(TargetTask):
    """A frame of the robot is to take a target pose, or a part of it."""

    axes: str = "base"
    """Whose axes the weights of single rows belong to: "base", or "target", those of the target (and, once it is
    reached, of the frame)."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if not isinstance(self.axes, str) or self.axes not in ("base", "target"):
            raise OptionError(f"axes must be 'base' or 'target', got {shown(self.axes)}")
        for name in ("position_weight", "orientation_weight"):
            value = getattr(self, name, None)
            if value is not None:
                checked_weights(value, name, 3)

    def of(self, robot: Robot) -> FrameTask:
        """The task with weights made for the robot's size. Raises `FrameError` for a frame that it does not have."""
        task = super().of(robot)
        if getattr(task, "position_weight", 0.0) is None:
            task = replace(task, position_weight=METRE / robot.length)  # type: ignore[call-arg]
        assert isinstance(task, FrameTask)
        return task

    @abstractmethod
    def six_weights(self) -> np.ndarray:
        """Weights (6,) of the linear and angular rows, 0 for what is left free."""

    @cached_property
    def all_weights(self) -> np.ndarray:
        """`six_weights`, read-only."""
        weights = self.six_weights()
        weights.setflags(write=False)
        return weights

    @cached_property
    def is_even(self) -> bool:
        """The linear rows count the same each, and so do the angular rows: the axes do not matter."""
        w = self.all_weights
        return bool((w[:3] == w[0]).all() and (w[3:] == w[3]).all())

    @cached_property
    def _turns_evenly(self) -> bool:
        """The angular rows count the same each, so that the logarithm's own derivative cancels in the gradient."""
        return bool((self.all_weights[3:] == self.all_weights[3]).all())

    @cached_property
    def kept(self) -> np.ndarray:
        """Which of the six rows (6,) count at all."""
        return self.all_weights > 0

    @property
    def weights(self) -> np.ndarray:
        """Weights (m,) of the rows that count."""
        return self._kept_weights

    @cached_property
    def _kept_weights(self) -> np.ndarray:
        return self.all_weights[self.kept]

    def error(self, at: Configuration) -> np.ndarray:
        """Error (m,) [m, rad] of the frame against the target, the rows that count."""
        return self._rows_of(frame_error(at.placement(self.frame, self.offset), self.target))

    def change(self, at: Configuration, before: Configuration, after: Configuration) -> np.ndarray:
        """What a motion changes of the error (m,); for even weights of the turn, how the frame has turned."""
        if not self._turns_evenly:
            return super().change(at, before, after)
        here, there = (each.placement(self.frame, self.offset) for each in (before, after))
        return self._rows_of(frame_error(there, here))

    def _rows_of(self, e: np.ndarray) -> np.ndarray:
        """The rows that count (m,) of an error (6,) in base axes, in the axes of the task."""
        return (e if self.axes == "base" else (e.reshape(2, 3) @ self.target.rotation).ravel())[self.kept]

    def jacobian(self, at: Configuration) -> np.ndarray:
        """Jacobian (m, n): the error falls by J dq. Even weights: the geometric Jacobian in base axes."""
        return self._in_task_axes(at.jacobian(self.frame, self.offset)) if self._turns_evenly else self._derivative(at)

    def target_jacobian(self, at: Configuration) -> np.ndarray:
        """Derivative (m, 6) of the error by a twist of the target: linear [m], then angular [rad], in base axes.

        A turn w of R_d adds `J^-1_l(phi) w` to phi, `J_l(phi) = J_r(-phi)`; where the error is in the target's axes, it
        carries these with it.
        """
        D, e = np.eye(6), self._error_in_base(at)
        D[3:, 3:] = inverse_right_jacobian(-e[3:])
        if self.axes == "target":
            D[:3, 3:] += skew(e[:3])
            D[3:, 3:] += skew(e[3:])
        return self._in_task_axes(D)

    def curvature(self, at: Configuration, multipliers: np.ndarray) -> np.ndarray:
        """That of the frame's pose (n, n), as its Jacobian is; of the error where angular rows count differently."""
        if self._turns_evenly:
            return at.kinematic_hessian_product(self.frame, self._in_base(self.weights * multipliers), self.offset)
        return self.error_curvature(at, multipliers)

    def residual_curvature(self, at: Configuration, residual: np.ndarray) -> np.ndarray:
        """That of the error (n, n); for even weights with what the logarithm flattens, as its rows are the pose's."""
        if not self._turns_evenly:
            return self.error_curvature(at, -residual)
        pull = self._in_base(self.weights * residual)
        C, weight = at.kinematic_hessian_product(self.frame, -pull, self.offset), float(self.all_weights[3])
        if weight > 0:
            phi, J = pull[3:] / weight**2, at.jacobian(self.frame, self.offset)[3:]
            across = skew(phi) @ J
            C = C - _flattening(float(np.linalg.norm(phi))) * weight**2 * (across.T @ across)
        return C

    def error_curvature(self, at: Configuration, multipliers: np.ndarray) -> np.ndarray:
        """`-sum_k multipliers_k d2(W e)_k/dq2` (n, n), of the logarithm too where the orientation is off."""
        pull = self._in_base(self.weights * multipliers)
        if not pull[3:].any():
            return at.kinematic_hessian_product(self.frame, pull, self.offset)
        phi, J = self._error_in_base(at)[3:], at.jacobian(self.frame, self.offset)[3:]
        pull[3:], G = pull_of_logarithm(phi, pull[3:])
        bend = J.T @ G @ inverse_right_jacobian(phi) @ J
        return at.kinematic_hessian_product(self.frame, pull, self.offset) - 0.5 * (bend + bend.T)

    def target_curvature(self, at: Configuration, multipliers: np.ndarray) -> np.ndarray:
        """`-sum_k multipliers_k d2(W e)_k/dq dtarget` (n, 6): how the rows bend as the target moves."""
        pull, J = self._in_base(self.weights * multipliers), at.jacobian(self.frame, self.offset)
        phi = self._error_in_base(at)[3:]
        _, G = pull_of_logarithm(phi, pull[3:])
        bend = np.zeros((at.n, 6))
        bend[:, 3:] = J[3:].T @ G @ inverse_right_jacobian(-phi)
        if self.axes == "target":
            bend[:, 3:] -= J[:3].T @ skew(pull[:3]) + J[3:].T @ inverse_right_jacobian(-phi) @ skew(pull[3:])
        return bend

    def hessian(self, at: Configuration) -> np.ndarray:
        """The exact Hessian `A^T A - sum_k (W e)_k d2(W e)_k/dq2` (n, n), `A = -d(W e)/dq`."""
        A, r = self.weights[:, None] * self._derivative(at), self.weighted_error(at)
        return A.T @ A + self.error_curvature(at, -r)

    def target_hessian(self, at: Configuration) -> np.ndarray:
        """How the gradient of `1/2 |W e|^2` changes with the target (n, 6), exact as well."""
        A, r = self.weights[:, None] * self._derivative(at), self.weighted_error(at)
        return -A.T @ (self.weights[:, None] * self.target_jacobian(at)) + self.target_curvature(at, -r)

    def _derivative(self, at: Configuration) -> np.ndarray:
        """`-de/dq` (m, n)."""
        J = at.jacobian(self.frame, self.offset).copy()
        J[3:] = inverse_right_jacobian(self._error_in_base(at)[3:]) @ J[3:]
        return self._in_task_axes(J)

    def _error_in_base(self, at: Configuration) -> np.ndarray:
        """All six rows (6,)."""
        return frame_error(at.placement(self.frame, self.offset), self.target)

    def _in_task_axes(self, rows: np.ndarray) -> np.ndarray:
        """The rows that count (m, k) of six in base axes (6, k)."""
        if self.axes == "target":
            rows = (self.target.rotation.T @ rows.reshape(2, 3, -1)).reshape(6, -1)
        return rows[self.kept]

    def _in_base(self, values: np.ndarray) -> np.ndarray:
        """Values (m,) of the rows that count as (6,) in base axes."""
        six = np.zeros(6)
        six[self.kept] = values
        if self.axes == "target":
            six = (six.reshape(2, 3) @ self.target.rotation.T).ravel()
        return six

    def residual(self, at: Configuration) -> tuple[float, float]:
        """Norms of the position error [m] and the orientation error [rad]; 0 for what the task leaves free."""
        e = np.zeros(6)
        e[self.kept] = self.error(at)
        return math.hypot(*e[:3]), math.hypot(*e[3:])

    @property
    def measures(self) -> tuple[bool, bool]:
        """Whether the position, and the orientation, count at all."""
        return bool(self.kept[:3].any()), bool(self.kept[3:].any())


def frame_error(actual: pin.SE3, target: pin.SE3) -> np.ndarray:
    """Error (6,) [m, rad] in base axes: `pose_error` of two `pin.SE3`."""
    e = np.empty(6)
    e[:3] = target.translation - actual.translation
    e[3:] = orientation_error(actual.rotation, target.rotation)
    return e


def inverse_right_jacobian(phi: np.ndarray) -> np.ndarray:
    """`J^-1_r` (3, 3) of SO(3) at a rotation vector phi (3,) [rad]: `I + [phi]x / 2 + k [phi]x^2`."""
    K = skew(phi)
    return np.eye(3) + 0.5 * K + _flattening(float(np.linalg.norm(phi))) * (K @ K)


def pull_of_logarithm(phi: np.ndarray, u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """`J^-T_r(phi) u` (3,), the gradient of `u . phi` by a turn of what phi leads away from, and its derivative by phi.

    `u - 1/2 phi x u + k phi x (phi x u)`; phi (3,) is a rotation vector [rad], u (3,).
    """
    angle, K = math.hypot(*phi.tolist()), skew(phi)
    k, across = _flattening(angle), K @ u
    twice = K @ across
    G = 0.5 * skew(u) + k * ((phi @ u) * np.eye(3) + np.outer(phi, u) - 2 * np.outer(u, phi))
    return u - 0.5 * across + k * twice, G + _flattening_slope(angle) * np.outer(twice, phi)


def _flattening(angle: float) -> float:
    """k of `I + k [phi]x^2`: `1/angle^2 - (1 + cos angle) / (2 angle sin angle)`, 1/12 at 0."""
    if angle < 1e-2:
        return 1 / 12 + angle**2 / 720
    return (1 - 0.5 * angle / np.tan(0.5 * angle)) / angle**2


def _flattening_slope(angle: float) -> float:
    """`dk/dangle / angle`, 1/360 at 0; with h half of the angle, `(h cot h + (h / sin h)^2 - 2) / angle^4`."""
    if angle < 0.1:
        return 1 / 360 + angle**2 / 7560
    h = 0.5 * angle
    return (h / np.tan(h) + (h / np.sin(h)) ** 2 - 2) / angle**4


def _linear(weight: Any) -> np.ndarray:
    if weight is None:
        raise OptionError("the task has no position weight yet: task.of(robot) gives it one")
    return checked_weights(weight, "position_weight", 3)


@dataclass(frozen=True, kw_only=True)
class PoseTask(FrameTask):
    """Position and orientation of a frame (six rows, fewer where single weights are 0)."""

    position_weight: Any = None
    """What an error of 1 m counts in rad [rad/m], > 0, or (3,) one an axis, 0: free; None: 4 rad for the arm's length,
    2 rad/m for one of 2 m."""
    orientation_weight: Any = 1.0
    """What an error of 1 rad counts, > 0, or (3,) one an axis, 0: free."""

    def six_weights(self) -> np.ndarray:
        """Weights (6,)."""
        return np.concatenate([_linear(self.position_weight), np.broadcast_to(self.orientation_weight, 3)])


@dataclass(frozen=True, kw_only=True)
class PositionTask(FrameTask):
    """Position of a frame alone; its orientation is free (three rows, fewer where single weights are 0).

    Its target is a point (3,) [m], or a pose of which the origin counts.
    """

    position_weight: Any = None
    """What an error of 1 m counts [rad/m], > 0, or (3,) one an axis, 0: free; None: 4 rad for the arm's length."""

    def __post_init__(self) -> None:
        if self.target is not None:
            object.__setattr__(self, "target", as_point(self.target, "target"))
        super().__post_init__()

    @property
    def datum(self) -> str:
        """Its target: a point, or a pose, of which the origin counts."""
        return POINT

    def with_value(self, value: Any) -> TargetTask:
        """The same task with another target, a point (3,) or a pose. Raises `PoseError`."""
        return self._aimed(target=as_point(value, f"target of {self.key!r}"))

    def target_of(self, value: Any) -> Any:
        """The `value` of a call as a pose: a pose, or a point (3,). Raises `PoseError`."""
        return posed(value, lambda point: at_point(point, f"target of {self.key!r}"))

    def six_weights(self) -> np.ndarray:
        """Weights (6,)."""
        return np.concatenate([_linear(self.position_weight), np.zeros(3)])


@dataclass(frozen=True, kw_only=True)
class OrientationTask(FrameTask):
    """Orientation of a frame alone; its position is free (three rows, fewer where single weights are 0)."""

    orientation_weight: Any = 1.0
    """What an error of 1 rad counts, > 0, or (3,) one an axis, 0: free."""

    def six_weights(self) -> np.ndarray:
        """Weights (6,)."""
        return np.concatenate([np.zeros(3), np.broadcast_to(self.orientation_weight, 3)]).astype(float)
