"""Tasks as the arrays of `kernels.control.task_jacobians`, for those that the compiled tick knows."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import pinocchio as pin

from maira_qp.kernels.control.task_jacobians import (
    ABSENT,
    AXES,
    AXIS,
    AXIS_ALONG,
    AXIS_AT,
    BASE_AXES,
    COEFFICIENTS,
    COUPLING,
    GAIN,
    JOINTS,
    KIND,
    LEVEL,
    OWN,
    PLACE,
    PLACEMENTS,
    POSE,
    RELATIVE,
    SOURCE,
    STILL,
    SWIVEL,
    TARGET,
    TARGET_AXES,
    TASK_DAMPING,
    VALUE,
    WEIGHTS,
)
from maira_qp.problem.targets import row_of
from maira_qp.problem.tasks.axis import AxisTask, LookAtTask, rotation_between
from maira_qp.problem.tasks.frame import FrameTask, OrientationTask, PoseTask, PositionTask, TargetTask
from maira_qp.problem.tasks.joints import DampingTask, JointCouplingTask
from maira_qp.problem.tasks.relative import RelativePoseTask
from maira_qp.problem.tasks.swivel import SwivelTask
from maira_qp.problem.tasks.task import Task
from maira_qp.robots.model.arrays import KinematicTree

KINDS: dict[type[Task], int] = {
    PoseTask: POSE,
    PositionTask: POSE,
    OrientationTask: POSE,
    AxisTask: AXIS_ALONG,
    LookAtTask: AXIS_AT,
    RelativePoseTask: RELATIVE,
    SwivelTask: SWIVEL,
    JointCouplingTask: COUPLING,
    DampingTask: STILL,
}
"""By the very type: a class that is derived from one of them may be another task."""


def known(tasks: Sequence[Task]) -> bool:
    """Whether the kernel knows all of the tasks."""
    return all(type(task) in KINDS for task in tasks)


def task_arrays(
    tree: KinematicTree, frames: Sequence[str], task: Task, level: int
) -> tuple[np.ndarray, np.ndarray, int]:
    """A task's row (60 + n,), its place (7,), how many rows of a level it has: see `kernels.control.task_jacobians`.

    `frames` are those whose targets come with the call.
    """
    row, place = np.zeros(COEFFICIENTS + tree.n), np.full(PLACE, ABSENT)
    row[WEIGHTS : WEIGHTS + 6] = _six_weights(task)
    row[GAIN], row[TASK_DAMPING] = task.gain, task.damping
    place[KIND], place[LEVEL], place[SOURCE], place[AXES] = KINDS[type(task)], level, OWN, BASE_AXES
    for k, frame in enumerate(_frames(task)):
        start = PLACEMENTS + 12 * k
        place[JOINTS + k], row[start : start + 12] = tree.frame(frame)
    if task.target_frame is not None:
        place[SOURCE] = frames.index(task.target_frame)
    elif isinstance(task, TargetTask):
        row[TARGET : TARGET + 12] = row_of(_own_target(task))
    if isinstance(task, FrameTask) and task.axes == "target" and not task.is_even:
        place[AXES] = TARGET_AXES
    if isinstance(task, (AxisTask, LookAtTask)):
        row[AXIS : AXIS + 3] = task.axis
    if isinstance(task, SwivelTask):
        row[AXIS : AXIS + 3], row[VALUE] = task.reference, math.remainder(task.angle, math.tau)
    if isinstance(task, JointCouplingTask):
        row[COEFFICIENTS:], row[VALUE] = task.row, task.value
    if isinstance(task, DampingTask):
        row[COEFFICIENTS:] = task.weight
    count = int((row[WEIGHTS : WEIGHTS + 6] > 0).sum()) if place[KIND] != STILL else tree.n
    return row, place, count


def _six_weights(task: Task) -> np.ndarray:
    """Weights (6,) of the error as it stands in the kernel."""
    if isinstance(task, FrameTask):
        return task.all_weights
    if isinstance(task, RelativePoseTask):
        return task.weights
    count = 2 if isinstance(task, (AxisTask, LookAtTask)) else 0 if isinstance(task, DampingTask) else 1
    return np.array([0, 0, 0, *(task.weights,) * count, *(0,) * (3 - count)], dtype=float)


def _frames(task: Task) -> tuple[str | None, ...]:
    """The frames that the task is about."""
    if isinstance(task, SwivelTask):
        return task.shoulder, task.elbow, task.wrist
    if isinstance(task, RelativePoseTask):
        return task.frame, task.reference
    return (task.frame,) if isinstance(task, TargetTask) else ()


def _own_target(task: TargetTask) -> pin.SE3:
    """The task's own target; for a direction a pose whose axis is along it, for a point one that stands there."""
    if isinstance(task, AxisTask) and task.direction is not None:
        return pin.SE3(pin.exp3(rotation_between(task.axis, task.direction)), np.zeros(3))
    if isinstance(task, LookAtTask) and task.point is not None:
        return pin.SE3(np.eye(3), task.point)
    return task.target
