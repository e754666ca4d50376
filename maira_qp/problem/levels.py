"""The tasks of a solver in the order of their priorities, and the targets that they are called with."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio as pin

from maira_qp.errors import FrameError, OptionError, PoseError, listed, shown
from maira_qp.problem.objectives import LimitDistance, Posture
from maira_qp.problem.pose import as_pose
from maira_qp.problem.qp.costs import LevelObjective, TaskCost, tasks_toward
from maira_qp.problem.redundancy import Strict, Weighted
from maira_qp.problem.targets import pose_of, poses_of_batch, rows_of
from maira_qp.problem.tasks.frame import PoseTask
from maira_qp.problem.tasks.objective import ObjectiveTask
from maira_qp.problem.tasks.task import Task
from maira_qp.robots.model.revolutions import WholeTurns
from maira_qp.robots.model.robot import Robot

FARTHEST = 1e9
"""Targets farther away than this many lengths of the arm are a mistake, and beyond the numbers."""

EXAMPLES = "mq.PoseTask(), mq.PositionTask(), mq.LookAtTask(point=[1, 0, 1])"

Targets = Mapping[str, pin.SE3]


@dataclass(frozen=True)
class Priorities:
    """Tasks and objectives by level, made for a robot."""

    robot: Robot
    first: tuple[Task, ...]
    """The first level: what a solve is to reach."""
    below: tuple[LevelObjective, ...]
    """The levels below it, in falling priority."""
    redundancy: Weighted | Strict | None
    """What was asked for beside the tasks."""
    frames: tuple[str, ...]
    """The frames that a call needs a target for."""

    @staticmethod
    def of(robot: Robot, task: Any, tasks: Sequence[Any], redundancy: Weighted | Strict | None) -> Priorities:
        """Raises `OptionError`, `FrameError`."""
        given = [PoseTask(frame=tip) for tip in robot.tips] if task is None else task
        given = (*(given if isinstance(given, (list, tuple)) else [given]), *tasks)
        for each in given:
            if not isinstance(each, (Task, ObjectiveTask)):
                raise OptionError(f"task must be something like {EXAMPLES}, got {shown(each)}")
        made = [each.of(robot) for each in given]
        levels = sorted({each.priority for each in made})
        sums = [_level([each for each in made if each.priority == level]) for level in levels]
        if not sums or not sums[0].tasks.tasks or sums[0].objectives:
            raise OptionError(f"the first level needs a task, such as {EXAMPLES}")
        if isinstance(redundancy, Weighted) and len(sums) > 1:
            raise OptionError(
                "Weighted puts its objective into the first level, and there are levels below; "
                "use mq.ObjectiveTask(objective, weight, priority) or Strict(...)"
            )
        frames = {each.target_frame: None for each in made if isinstance(each, Task)}
        return Priorities(
            robot=robot,
            first=sums[0].tasks.tasks,
            below=tuple(sums[1:]),
            redundancy=None if redundancy is None else redundancy.of(robot),
            frames=tuple(frame for frame in frames if frame is not None),
        )

    def costs(self, targets: Targets) -> tuple[TaskCost, Weighted | Strict | None]:
        """The first level toward its targets, and what is to be made of the redundancy: all that is below it."""
        below = [
            LevelObjective(tasks_toward(level.tasks.tasks, targets), level.objectives) if self.frames else level
            for level in self.below
        ]
        objectives = self.redundancy.objectives if isinstance(self.redundancy, Strict) else ()
        wish = Strict(*below, *objectives) if below else self.redundancy
        return tasks_toward(self.first, targets), wish

    def targets(self, target: Any) -> dict[str, pin.SE3]:
        """One call's targets by frame, checked. Raises `PoseError`, `FrameError`."""
        if not isinstance(target, Mapping):
            if target is None and not self.frames:
                return {}
            if target is None or len(self.frames) != 1:
                needed = (
                    ("no target", "a target")[len(self.frames)] if len(self.frames) < 2 else "a mapping {frame: pose}"
                )
                raise PoseError(self._instead(needed))
            target = {self.frames[0]: target}
        for name in target:
            if name not in self.frames:
                raise FrameError(
                    f"no task takes its target from the call for {shown(name)}; {listed(self.frames, name)}"
                )
        if len(target) < len(self.frames):
            missing = ", ".join(repr(frame) for frame in self.frames if frame not in target)
            raise PoseError(self._instead(f"a mapping {{frame: pose}}, in which {missing} is missing"))
        poses = {frame: as_pose(target[frame]) for frame in self.frames}
        for frame, pose in poses.items():
            check_distance(pose.translation, self.robot.length, "target" if len(poses) == 1 else f"target of {frame!r}")
        return poses

    def rows(self, targets: Any) -> tuple[np.ndarray, np.ndarray]:
        """A batch's targets (N, K, 12), K the frames that need one; checked, NaN for one with NaN or inf in it.

        And how far each (N,) was from rotations, see `rounding_of`.
        They come as (N, 4, 4) for one frame, else as {frame: (N, 4, 4)}, or as N mappings {frame: pose}.
        Raises `PoseError`, `FrameError`.
        """
        if not self.frames:
            raise PoseError("the tasks take no target from the call, so there is nothing to make a batch of")
        if isinstance(targets, Sequence) and targets and all(isinstance(each, Mapping) for each in targets):
            for each in targets:
                if set(each) != set(self.frames):
                    self.targets(each)  # which says what is wrong
            targets = {frame: [each[frame] for each in targets] for frame in self.frames}
        if not isinstance(targets, Mapping):
            if len(self.frames) != 1:
                raise PoseError(self._instead("a mapping {frame: poses}"))
            targets = {self.frames[0]: targets}
        if set(targets) != set(self.frames):
            raise PoseError(self._instead("a mapping {frame: poses} of just these frames"))
        made = [rows_of(poses_of_batch(targets[frame])) for frame in self.frames]
        each, deviations = [rows for rows, _ in made], [deviation for _, deviation in made]
        if len({len(rows) for rows in each}) > 1:
            raise PoseError(f"as many poses for each frame, not {[len(rows) for rows in each]}")
        rows = np.stack(each, axis=1) if len(each) > 1 else each[0][:, None]
        far = np.abs(rows[:, :, 9:]) > FARTHEST * self.robot.length
        for i in np.flatnonzero(far.any(axis=(1, 2))) if far.any() else ():
            check_distance(rows[i, :, 9:], self.robot.length, f"target {i}")
        rows[np.isnan(rows[:, :, 0]).any(axis=1)] = np.nan
        return rows, np.max(deviations, axis=0)

    def of_row(self, row: np.ndarray) -> dict[str, pin.SE3]:
        """The targets of a row (K, 12)."""
        return {frame: pose_of(each) for frame, each in zip(self.frames, row, strict=True)}

    @property
    def posture(self) -> Posture | None:
        """The first posture that is wished for beside the tasks or below them, if any."""
        wishes = () if self.redundancy is None else self.redundancy.objectives
        for wish in (*wishes, *(each.objective for level in self.below for each in level.objectives)):
            if isinstance(wish, Posture):
                return wish
            if isinstance(wish, LimitDistance):
                return wish.as_posture
        return None

    @property
    def turns(self) -> WholeTurns:
        """Whole turns of the joints, counted to stay near the posture, or the middle of the limits."""
        return WholeTurns(self.robot, self.robot.middle if self.posture is None else self.posture.q_ref)

    @property
    def all_tasks(self) -> tuple[Task, ...]:
        """The first level's tasks and those of the levels below that hold nothing else."""
        lower = [level.tasks.tasks for level in self.below if not level.objectives]
        return sum(lower, self.first)

    @property
    def is_done_by_search(self) -> bool:
        """There is nothing below the first level."""
        return not self.below and self.redundancy is None

    def _instead(self, needed: str) -> str:
        frames = ", ".join(map(repr, self.frames)) or "none"
        return f"the tasks need {needed} (frames without a target of their own: {frames})"


def _level(tasks: Sequence[Task | ObjectiveTask]) -> LevelObjective:
    plain = tuple(each for each in tasks if isinstance(each, Task))
    return LevelObjective(TaskCost(plain), tuple(each for each in tasks if isinstance(each, ObjectiveTask)))


def check_distance(p: np.ndarray, length: float, name: str) -> None:
    """Raises `PoseError` for a position (..., 3) [m] that cannot be meant for an arm of that length [m]."""
    if np.abs(p).max() > FARTHEST * length:
        raise PoseError(f"the {name} is {np.abs(p).max():.3g} m away, more than {FARTHEST:g} times the arm's length")
