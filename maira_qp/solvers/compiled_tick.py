"""The compiled control tick: which problems it takes, and the arrays that it needs of them.

It takes tasks of frames whose axes count the same, at any levels of a robot without mimic joints, and objectives that
are a posture: below the tasks, alone in their level, or weighted beside the tasks of the only one. The rest is for the
general engine, `tick.py`, to which this is the same to rounding. Limits beside those of the joints it does not know:
its answer counts where they do not bind.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio as pin

from maira_qp.arrays import is_native
from maira_qp.kernels.levels import (
    DAMPED,
    GAIN,
    JOINT,
    LEVEL,
    OBJECTIVE_GAIN,
    OWN,
    PLACEMENT,
    REFERENCE,
    SOURCE,
    TARGET,
    TASK,
    TASK_DAMPING,
    WEIGHT,
)
from maira_qp.kernels.rigid import FINE
from maira_qp.kernels.tick import tick
from maira_qp.kernels.tick_memory import memory_sizes
from maira_qp.orientation import ORTHONORMAL_WITHIN
from maira_qp.problem.costs import LevelObjective
from maira_qp.problem.limits import FEASIBILITY
from maira_qp.problem.objectives import LimitDistance, Objective, Posture
from maira_qp.problem.redundancy import Strict, Weighted
from maira_qp.problem.tasks.frame import FrameTask
from maira_qp.problem.tasks.task import Task
from maira_qp.robots.kinematic_tree import KinematicTree
from maira_qp.robots.robot import Robot
from maira_qp.solvers.descent import LEAST_DAMPING
from maira_qp.solvers.options import Options
from maira_qp.solvers.priorities import FARTHEST, Priorities
from maira_qp.solvers.targets import row_of
from maira_qp.solvers.tick import HALVINGS, SMALL_ERROR


@dataclass(frozen=True)
class CompiledTick:
    """The arrays of one problem, see `maira_qp.kernels`: `tree`, `levels`, `tick`."""

    n: int
    frames: tuple[str, ...]
    """The frames that a call needs a target for"""
    needs_velocity: bool
    """Some acceleration is limited"""
    tree: np.ndarray
    """(n, 19)"""
    parents: np.ndarray
    """(n,)"""
    tasks: np.ndarray
    """(T, 28)"""
    places: np.ndarray
    """(T, 3)"""
    objectives: np.ndarray
    """(L, 3 + 2 n)"""
    numbers: np.ndarray
    """(8,)"""
    still: np.ndarray
    """(n,) no velocity"""
    sizes: tuple[int, int]
    """How many numbers, and of int64, a tick works in"""

    @staticmethod
    def of(priorities: Priorities, options: Options) -> CompiledTick | None:
        """The problem's arrays; None if the kernel cannot take it."""
        robot, levels = priorities.robot, _levels(priorities)
        if robot.kinematics.has_mimic or levels is None:
            return None
        tree = KinematicTree.of(robot)
        rows = [_task_row(tree, priorities.frames, task, k) for k, level in enumerate(levels) for task in level.tasks]
        return CompiledTick(
            n=robot.n,
            frames=priorities.frames,
            needs_velocity=bool(np.isfinite(robot.acceleration_limit).any()),
            tree=tree.joints,
            parents=tree.parents,
            tasks=np.array([row for row, _ in rows]),
            places=np.array([place for _, place in rows], np.int64),
            objectives=np.array([_objective_row(robot, level) for level in levels]),
            numbers=np.array(
                [
                    options.damping,
                    LEAST_DAMPING,
                    SMALL_ERROR,
                    HALVINGS,
                    ORTHONORMAL_WITHIN,
                    FARTHEST * robot.length,
                    FEASIBILITY,
                    np.isfinite(robot.acceleration_limit).any(),
                ]
            ),
            still=np.zeros(robot.n),
            sizes=memory_sizes(robot.n, len(rows), len(levels)),
        )

    def tick(self, target: Any, q: Any, dt: float, velocity: Any) -> tuple[np.ndarray, np.ndarray, float, float] | None:
        """q (n,), velocity (n,), errors [m] and [rad] after a tick of dt [s].

        None for what is no target, configuration or velocity, or none that the kernel takes.
        """
        n, T = self.n, self._poses(target)
        if velocity is None and not self.needs_velocity:
            velocity = self.still
        if T is None or not is_native(q, (n,)) or not is_native(velocity, (n,)):
            return None
        floats, integers = self.sizes
        out = np.empty(2 * n + 2)
        fault = tick(
            self.tree,
            self.parents,
            self.tasks,
            self.places,
            self.objectives,
            self.numbers,
            dt,
            T,
            q,
            velocity,
            np.empty(floats),
            np.empty(integers, np.int64),
            out,
        )
        return (out[:n], out[n:-2], float(out[-2]), float(out[-1])) if fault == FINE else None

    def _poses(self, target: Any) -> np.ndarray | None:
        """The targets of a call below each other (4 K, 4), unchecked; None for what is none."""
        frames = self.frames
        if not isinstance(target, Mapping):
            return _matrix(target) if len(frames) == 1 else np.empty((0, 4)) if target is None and not frames else None
        if len(target) != len(frames):
            return None
        T = np.empty((4 * len(frames), 4))
        for k, frame in enumerate(frames):
            pose = _matrix(target.get(frame))
            if pose is None:
                return None
            T[4 * k : 4 * k + 4] = pose
        return T


def _matrix(target: Any) -> np.ndarray | None:
    """A pose (4, 4) as it is; None for what is none that the kernel takes."""
    if isinstance(target, pin.SE3):
        return np.ascontiguousarray(target.homogeneous)
    return target if is_native(target, (4, 4)) else None


@dataclass(frozen=True)
class _Level:
    """A level that the kernel takes: tasks of frames, or an objective that is a posture, or, in the first, both."""

    tasks: tuple[FrameTask, ...] = ()
    posture: Posture | None = None
    weight: float = 1.0
    gain: float = 1.0
    damped: bool = True


def _levels(priorities: Priorities) -> list[_Level] | None:
    """The levels in falling priority; None if there is one that the kernel does not know."""
    redundancy = priorities.redundancy
    first: list[_Level | None] = [_of_tasks(priorities.first)]
    if isinstance(redundancy, Weighted):
        posture, tasks = _posture(redundancy.objective), first[0]
        first = [None if posture is None or tasks is None else _Level(tasks.tasks, posture, redundancy.weight)]
    below = [_below(level) for level in priorities.below]
    objectives = redundancy.objectives if isinstance(redundancy, Strict) else ()
    strict = [_posture(objective) for objective in objectives]
    last = [None if posture is None else _Level(posture=posture, damped=False) for posture in strict]
    levels = [level for level in (*first, *below, *last) if level is not None]
    return levels if len(levels) == len(first) + len(below) + len(last) else None


def _of_tasks(tasks: Sequence[Task]) -> _Level | None:
    known = tuple(task for task in tasks if isinstance(task, FrameTask) and task.is_even and not task.equality)
    return _Level(known) if len(known) == len(tasks) else None


def _below(level: LevelObjective) -> _Level | None:
    """A level below the first: tasks alone, or an objective alone."""
    if not level.objectives:
        return _of_tasks(level.tasks.tasks)
    each, posture = level.objectives[0], _posture(level.objectives[0].objective)
    if len(level.objectives) > 1 or level.tasks.tasks or posture is None:
        return None
    return _Level(posture=posture, weight=each.weight, gain=each.gain)


def _posture(objective: Objective) -> Posture | None:
    """The posture that an objective is, if it is one."""
    if isinstance(objective, LimitDistance):
        return objective.as_posture
    return objective if isinstance(objective, Posture) else None


def _task_row(
    tree: KinematicTree, frames: tuple[str, ...], task: FrameTask, level: int
) -> tuple[np.ndarray, np.ndarray]:
    """A task's row (28,) and its place (3,), see `kernels.levels`."""
    row, place = np.zeros(TASK), np.empty(3, np.int64)
    joint, placement = tree.frame(task.frame)
    row[[0, 1]] = task.all_weights[[0, 5]]
    row[GAIN], row[TASK_DAMPING] = task.gain, task.damping
    row[PLACEMENT : PLACEMENT + 12] = placement
    place[JOINT], place[LEVEL], place[SOURCE] = joint, level, OWN
    if task.target_frame is None:
        row[TARGET : TARGET + 12] = row_of(task.target)
    else:
        place[SOURCE] = frames.index(task.target_frame)
    return row, place


def _objective_row(robot: Robot, level: _Level) -> np.ndarray:
    """A level's row (3 + 2 n,) of `kernels.levels`."""
    row = np.zeros(REFERENCE + 2 * robot.n)
    row[DAMPED], row[OBJECTIVE_GAIN] = level.damped, level.gain
    if level.posture is not None:
        row[WEIGHT] = level.weight
        row[REFERENCE:] = np.concatenate([level.posture.q_ref, level.posture.weights])
    return row
