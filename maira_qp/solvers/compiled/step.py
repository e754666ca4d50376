"""The compiled control tick: which problems it takes, and the arrays that it needs of them.

It takes all tasks that are errors of frames or of joints (`task_arrays.py`), equalities too, at any levels of a robot
without mimic joints, and objectives that are a posture: below the tasks, alone in their level, or weighted beside the
tasks of the only one. The rest, such as soft limits, other objectives and classes of one's own, is for the reference
engine, `solvers.reference.step`, with which it agrees to rounding. It does not know limits beside those of the joints:
its answer counts where they do not bind.
"""

from __future__ import annotations

from collections.abc import Mapping
from copy import copy
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pinocchio as pin

from maira_qp.arrays import is_native
from maira_qp.kernels.control.step import tick
from maira_qp.kernels.control.step_workspace import STEP_WORK
from maira_qp.kernels.layout import Level, Step, TaskRow
from maira_qp.kernels.spatial.pose_validation import FINE
from maira_qp.orientation import ORTHONORMAL_WITHIN
from maira_qp.problem.limits.joint import FEASIBILITY
from maira_qp.problem.objectives import LimitDistance, Objective, Posture, share_of
from maira_qp.problem.problem import Problem
from maira_qp.problem.qp.costs import LevelObjective, TaskCost
from maira_qp.problem.redundancy import FADING, Strict, Weighted
from maira_qp.problem.targets import FARTHEST
from maira_qp.problem.tasks.objective import ObjectiveTask
from maira_qp.problem.tasks.task import Task
from maira_qp.results.status import StepStatus
from maira_qp.solvers.compiled.task_arrays import all_arrays, known
from maira_qp.solvers.reference.safe_steps import HALVINGS
from maira_qp.solvers.reference.step import is_of_motion_alone, resting_speed, split_equalities
from maira_qp.solvers.reference.step_models import LEAST_DAMPING

STATUSES = tuple(StepStatus)

Ticked = tuple[np.ndarray, np.ndarray, float, float, StepStatus]


@dataclass(frozen=True)
class CompiledTick:
    """The arrays of one problem, see `maira_qp.kernels`: `tree`, `task_rows`, `levels`, `tick`."""

    problem: Problem
    """What they are made of"""
    n: int
    keys: tuple[str, ...]
    """The keys of the targets that a call needs to give"""
    needs_velocity: bool
    """Some acceleration is limited"""
    tree: np.ndarray
    """(n, 19)"""
    parents: np.ndarray
    """(n,)"""
    tasks: np.ndarray
    """(T, 60 + n)"""
    places: np.ndarray
    """(T, 7)"""
    objectives: np.ndarray
    """(L, 2 + 2 n)"""
    gains: tuple[float | None, ...]
    """Of the postures of the L levels [1/s]"""
    staying: tuple[bool, ...]
    """Which of the postures are those of now"""
    numbers: np.ndarray
    """(15,)"""
    still: np.ndarray
    """(n,) no velocity"""
    sizes: tuple[int, int]
    """How many numbers, and of int64, a tick works in"""
    count: int
    """How many parts of the problem are no limits"""
    task_rows: dict[int, slice]
    """The rows of `tasks` by the places of the problem's parts"""
    moving: tuple[tuple[int, slice], ...]
    """The places of parts that ask for motion, and their rows of `tasks`"""
    objective_rows: dict[int, int]
    """The rows of `objectives` by the places of the problem's parts"""

    @staticmethod
    def build(problem: Problem) -> CompiledTick:
        """The arrays of a problem that is not `unsupported`."""
        robot, levels = problem.robot, _levels(problem)
        assert levels is not None
        tree = robot.tree
        ordered = [
            (k, task) for k, level in enumerate(levels) for task in sorted(level.tasks, key=lambda one: one.is_of_ticks)
        ]
        each, rows_of = [], {}
        for k, task in ordered:
            begin = len(each)
            each += all_arrays(tree, problem.target_keys, task, k)
            rows_of[id(task)] = slice(begin, len(each))
        places = {id(part): i for i, part in enumerate(problem.parts)}
        rows = sum(count for _, _, count in each) + robot.n * (len(levels) - 1)
        return CompiledTick(
            problem=problem,
            n=robot.n,
            keys=problem.target_keys,
            needs_velocity=bool(np.isfinite(robot.acceleration_limit).any()),
            tree=tree.joints,
            parents=tree.parents,
            tasks=np.array([row for row, _, _ in each]),
            places=np.array([place for _, place, _ in each], np.int64),
            objectives=np.array([_objective_row(robot.n, level) for level in levels]),
            gains=tuple(None if level.posture is None else level.posture.gain for level in levels),
            staying=tuple(level.stays for level in levels),
            numbers=_numbers(problem, rows),
            still=np.zeros(robot.n),
            sizes=STEP_WORK.sizes(robot.n, len(each), rows, len(levels)),
            count=len(problem.parts) - len(problem.additional_limits),
            task_rows={places[id(task)]: rows_of[id(task)] for _, task in ordered},
            moving=tuple((places[id(task)], rows_of[id(task)]) for _, task in ordered if task.is_of_ticks),
            objective_rows={places[id(level.part)]: k for k, level in enumerate(levels) if level.part is not None},
        )

    def with_problem(self, problem: Problem) -> CompiledTick:
        """The same for a problem with the same parts, of which some have other data: their rows are made anew."""
        arrays = {"tasks": self.tasks, "objectives": self.objectives}
        for i, (part, before) in enumerate(zip(problem.parts, self.problem.parts, strict=True)):
            if part is before:
                continue
            name, rows = ("tasks", self.task_rows) if i in self.task_rows else ("objectives", self.objective_rows)
            if part.is_off or i >= self.count:
                continue
            if i not in rows:  # one of several that are a row together
                return CompiledTick.build(problem)
            if arrays[name] is getattr(self, name):
                arrays[name] = arrays[name].copy()
            if name == "tasks":
                made = all_arrays(problem.robot.tree, self.keys, part, 0)
                arrays[name][rows[i]] = [row for row, _, _ in made]
            else:
                level = _level_of(part)
                assert level is not None
                arrays[name][rows[i]] = _objective_row(self.n, level)
        changed = copy(self)
        changed.__dict__.update(arrays, problem=problem)
        return changed

    def tick(self, target: Any, q: Any, dt: float, velocity: Any) -> Ticked | None:
        """q (n,), velocity (n,), errors [m] and [rad], and status after a tick of dt [s].

        None for what is no target, configuration or velocity, or none that the kernel takes.
        """
        n, T = self.n, self._poses(target)
        if velocity is None and not self.needs_velocity:
            velocity = self.still
        if T is None or not is_native(q, (n,)) or not is_native(velocity, (n,)):
            return None
        floats, integers = self.sizes
        out = np.empty(2 * n + 3)
        fault = tick(
            self.tree,
            self.parents,
            self._tasks_of(q, dt),
            self.places,
            self._objectives_of(q, dt),
            self.numbers,
            dt,
            T,
            q,
            velocity,
            np.empty(floats),
            np.empty(integers, np.int64),
            out,
        )
        if fault != FINE:
            return None
        position, orientation, status = out[2 * n :].tolist()
        ahead, speed, ended = out[:n], out[n : 2 * n], STATUSES[int(status)]
        if self.moving and ended is StepStatus.ARRIVED and (np.abs(speed) > resting_speed(self.problem.robot)).any():
            ended = StepStatus.MOVING
        return ahead, speed, position, orientation, ended

    def _tasks_of(self, q: np.ndarray, dt: float) -> np.ndarray:
        """The tasks (T, 60 + n) at q (n,), with the goals of those that ask for motion in a tick of dt [s]."""
        if not self.moving:
            return self.tasks
        tasks = self.tasks.copy()
        for i, rows in self.moving:
            tasks[rows, TaskRow.VALUE] = self.problem.parts[i].goal(q, dt)
        return tasks

    def _objectives_of(self, q: np.ndarray, dt: float) -> np.ndarray:
        """The objectives (L, 2 + 2 n) at q (n,), their gains as shares of their steps in a tick of dt [s]."""
        if not any(self.staying) and self.gains.count(None) == len(self.gains):
            return self.objectives
        objectives = self.objectives.copy()
        objectives[:, Level.GAIN] *= [share_of(gain, dt) for gain in self.gains]
        objectives[self.staying, Level.REFERENCE : Level.REFERENCE + self.n] = q
        return objectives

    def _poses(self, target: Any) -> np.ndarray | None:
        """The targets of a call below each other (4 K, 4), unchecked; None for what is none."""
        keys = self.keys
        if not isinstance(target, Mapping):
            return _matrix(target) if len(keys) == 1 else np.empty((0, 4)) if target is None and not keys else None
        if len(target) != len(keys):
            return None
        T = np.empty((4 * len(keys), 4))
        for k, key in enumerate(keys):
            pose = _matrix(target.get(key))
            if pose is None:
                return None
            T[4 * k : 4 * k + 4] = pose
        return T


def _numbers(problem: Problem, rows: int) -> np.ndarray:
    """The numbers (15,) of a problem whose tasks can have so many rows, see `kernels.layout.Step`."""
    robot, options, redundancy = problem.robot, problem.options, problem.redundancy
    return Step.row(
        DAMPING=options.damping,
        LEAST_DAMPING=LEAST_DAMPING,
        HALVINGS=HALVINGS,
        WITHIN=ORTHONORMAL_WITHIN,
        FARTHEST=FARTHEST * robot.length,
        FEASIBILITY=FEASIBILITY,
        IS_SLOW=bool(np.isfinite(robot.acceleration_limit).any()),
        FIRST=sum(not task.is_of_ticks for task in problem.tasks),
        ROWS=rows,
        POSITION_LOSS=options.level_position_tolerance,
        ORIENTATION_LOSS=options.level_orientation_tolerance,
        POSITION_WITHIN=options.position_tolerance,
        ORIENTATION_WITHIN=options.orientation_tolerance,
        STATIONARITY=options.stationarity_tolerance,
        FADING=FADING if isinstance(redundancy, Weighted) and redundancy.fading else 0.0,
    )


def _matrix(target: Any) -> np.ndarray | None:
    """A pose (4, 4) as it is; None for what is none that the kernel takes."""
    if isinstance(target, pin.SE3):
        return np.ascontiguousarray(target.homogeneous)
    return target if is_native(target, (4, 4)) else None


@dataclass(frozen=True)
class _Level:
    """A level that the kernel takes: tasks, or an objective that is a posture, or, in the first, both."""

    tasks: tuple[Task, ...] = ()
    posture: Posture | None = None
    weight: float = 1.0
    gain: float = 1.0
    stays: bool = False
    """The posture is that of now"""
    part: Any = None
    """What of the problem the posture is of"""


def unsupported(problem: Problem) -> str:
    """Why the compiled engine cannot take control ticks of a problem, its additional limits aside; empty: it can."""
    if problem.robot.kinematics.has_mimic:
        return "a joint mimics another"
    levels = _levels(problem)
    if levels is not None:
        return "" if any(level.tasks for level in levels) else "all its tasks are switched off"
    if problem.posture is not None and not problem.posture.is_diagonal:
        return "the weights of a posture are a matrix"
    return "a task, objective or level is of a kind that it does not know"


def _levels(problem: Problem) -> list[_Level] | None:
    """The levels in falling priority, as in `solvers.reference.step`; None if the kernel does not know one of them."""
    redundancy = problem.redundancy
    weighted = redundancy if isinstance(redundancy, Weighted) else None
    strict = redundancy.objectives if isinstance(redundancy, Strict) else ()
    beside = () if weighted is None else (ObjectiveTask(weighted.objective, weighted.weight),)
    top, *soft = split_equalities(LevelObjective(TaskCost(problem.tasks), beside))
    if soft and weighted is not None and weighted.fading:
        return None  # it fades a posture of the first level alone
    below = [part for level in problem.hierarchy.lower for part in split_equalities(level)]
    levels = [_level(LevelObjective(top.tasks)), *map(_lower_level, (*soft, *below))]
    if weighted is not None:
        place = 1 if soft else 0
        level, at_place = _level_of(weighted), levels[place]
        levels[place] = None if level is None or at_place is None else replace(level, tasks=at_place.tasks)
    levels += [_level_of(objective) for objective in strict]
    if any(level is None for level in levels):
        return None
    return [level for level in levels if level is not None and (level.tasks or level.posture)]


def _lower_level(level: LevelObjective) -> _Level | None:
    """The same of a level below the first: of motion alone it is the posture of now."""
    made = _level(level)
    if made is None or level.objectives or not is_of_motion_alone(level.tasks.tasks):
        return made
    square = sum(np.square(task.weights) for task in level.tasks.tasks)
    return _Level(posture=Posture(np.zeros_like(square), square), stays=True)


def _level(level: LevelObjective) -> _Level | None:
    """A level of tasks alone, or of an objective alone."""
    if not level.objectives:
        return _Level(level.tasks.tasks) if known(level.tasks.tasks) else None
    first, *others = level.objectives
    return None if others or level.tasks.tasks else _level_of(first)


def _level_of(part: Any) -> _Level | None:
    """A level of an objective, with its weight if it has one; None for one that is no posture."""
    is_alone = isinstance(part, Objective)
    posture = _posture(part if is_alone else part.objective)
    if posture is None:
        return None
    if is_alone:
        return _Level(posture=posture, part=part)
    return _Level(posture=posture, weight=part.weight, gain=getattr(part, "gain", 1.0), part=part)


def _posture(objective: Objective) -> Posture | None:
    """The posture with a weight for each joint that an objective is, if it is one."""
    if isinstance(objective, LimitDistance):
        return objective.as_posture
    return objective if isinstance(objective, Posture) and objective.is_diagonal else None


def _objective_row(n: int, level: _Level) -> np.ndarray:
    """A level's row (2 + 2 n,) of `kernels.control.level_models`."""
    row = np.zeros(Level.REFERENCE + 2 * n)
    row[Level.GAIN] = level.gain
    if level.posture is not None:
        row[Level.WEIGHT] = level.weight
        row[Level.REFERENCE :] = np.concatenate([level.posture.q_ref, level.posture.weights])
    return row
