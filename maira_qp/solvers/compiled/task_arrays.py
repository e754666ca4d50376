"""Tasks as the arrays of `kernels.control.task_jacobians`, for those that the compiled tick knows."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import pinocchio as pin

from maira_qp.kernels.layout import Axes, Kind, Place, TaskRow
from maira_qp.orientation import rotation_between
from maira_qp.problem.targets import row_of
from maira_qp.problem.tasks.axis import AxisTask, LookAtTask
from maira_qp.problem.tasks.frame import FrameTask, OrientationTask, PoseTask, PositionTask, TargetTask
from maira_qp.problem.tasks.joints import DampingTask, JointCouplingTask, JointVelocityTask
from maira_qp.problem.tasks.relative import RelativePoseTask
from maira_qp.problem.tasks.swivel import SwivelTask
from maira_qp.problem.tasks.task import Task
from maira_qp.robots.model.arrays import KinematicTree

KINDS: dict[type[Task], int] = {
    PoseTask: Kind.POSE,
    PositionTask: Kind.POSE,
    OrientationTask: Kind.POSE,
    AxisTask: Kind.AXIS_ALONG,
    LookAtTask: Kind.AXIS_AT,
    RelativePoseTask: Kind.RELATIVE,
    SwivelTask: Kind.SWIVEL,
    JointCouplingTask: Kind.COUPLING,
    DampingTask: Kind.STILL,
}
"""By the very type: a class that is derived from one of them may be another task."""


def known(tasks: Sequence[Task]) -> bool:
    """Whether the kernel knows all of the tasks."""
    return all(map(_is_known, tasks))


def _is_known(task: Task) -> bool:
    if isinstance(task, JointVelocityTask):
        return type(task) is JointVelocityTask and not task.equality
    return type(task) in KINDS and not (isinstance(task, DampingTask) and task.metric is not None)


def task_arrays(
    tree: KinematicTree, frames: Sequence[str], task: Task, level: int
) -> tuple[np.ndarray, np.ndarray, int]:
    """A task's row (60 + n,), its place (7,), how many rows of a level it has: see `kernels.control.task_jacobians`.

    `frames` are those whose targets come with the call.
    """
    row, place = np.zeros(TaskRow.COEFFICIENTS + tree.n), np.full(Place.WIDTH, Place.ABSENT)
    row[TaskRow.WEIGHTS : TaskRow.WEIGHTS + 6] = _six_weights(task)
    row[TaskRow.GAIN], row[TaskRow.DAMPING] = task.gain, task.damping
    place[Place.KIND], place[Place.LEVEL], place[Place.SOURCE] = KINDS[type(task)], level, Place.OWN
    place[Place.AXES] = Axes.BASE
    for k, frame in enumerate(_frames(task)):
        start = TaskRow.PLACEMENTS + 12 * k
        offset = task.offset if k == 0 and isinstance(task, TargetTask) else None
        place[Place.JOINTS + k], row[start : start + 12] = tree.frame(frame, offset)
    if task.target_key is not None:
        place[Place.SOURCE] = frames.index(task.target_key)
    elif isinstance(task, TargetTask):
        row[TaskRow.TARGET : TaskRow.TARGET + 12] = row_of(_own_target(task))
    if isinstance(task, FrameTask) and task.axes == "target" and not task.is_even:
        place[Place.AXES] = Axes.TARGET
    if isinstance(task, (AxisTask, LookAtTask)):
        row[TaskRow.AXIS : TaskRow.AXIS + 3] = task.axis
    if isinstance(task, SwivelTask):
        row[TaskRow.AXIS : TaskRow.AXIS + 3], row[TaskRow.VALUE] = task.reference, math.remainder(task.angle, math.tau)
    if isinstance(task, JointCouplingTask):
        row[TaskRow.COEFFICIENTS :], row[TaskRow.VALUE] = task.row, task.value
    if isinstance(task, DampingTask):
        row[TaskRow.COEFFICIENTS :] = task.weight
    count = int((row[TaskRow.WEIGHTS : TaskRow.WEIGHTS + 6] > 0).sum()) if place[Place.KIND] != Kind.STILL else tree.n
    return row, place, count


def all_arrays(
    tree: KinematicTree, frames: Sequence[str], task: Task, level: int
) -> list[tuple[np.ndarray, np.ndarray, int]]:
    """The arrays of a task; of joints that are to move: as many couplings of one joint, whose values ticks write."""
    if not isinstance(task, JointVelocityTask):
        return [task_arrays(tree, frames, task, level)]
    made = []
    for joint, weight in zip(task.columns, task.weights, strict=True):
        row, place = np.zeros(TaskRow.COEFFICIENTS + tree.n), np.full(Place.WIDTH, Place.ABSENT)
        row[TaskRow.WEIGHTS + 3], row[TaskRow.COEFFICIENTS + joint] = weight, 1.0
        row[TaskRow.GAIN], row[TaskRow.DAMPING] = task.gain, task.damping
        place[Place.KIND], place[Place.LEVEL], place[Place.SOURCE] = Kind.COUPLING, level, Place.OWN
        place[Place.AXES] = Axes.BASE
        made.append((row, place, int(weight > 0)))
    return made


def _six_weights(task: Task) -> np.ndarray:
    """Weights (6,) of the error as it stands in the kernel."""
    if isinstance(task, FrameTask):
        return task.all_weights
    if isinstance(task, RelativePoseTask):
        return task.all_weights
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
