"""The tasks of a problem in the order of their priorities."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from maira_qp.errors import OptionError, shown
from maira_qp.problem.qp.costs import LevelObjective, TaskCost
from maira_qp.problem.tasks.frame import PoseTask
from maira_qp.problem.tasks.objective import ObjectiveTask
from maira_qp.problem.tasks.task import Task
from maira_qp.robots.model.robot import Robot

EXAMPLES = "mq.PoseTask(), mq.PositionTask(), mq.LookAtTask(point=[1, 0, 1])"


@dataclass(frozen=True)
class TaskHierarchy:
    """Tasks and objectives by level, bound to a robot."""

    primary: tuple[Task, ...]
    """The first level: what a solve is to reach."""
    lower: tuple[LevelObjective, ...]
    """The levels below it, in falling priority."""
    frames: tuple[str, ...]
    """The frames that a call needs a target for."""

    @staticmethod
    def build(robot: Robot, task: Any, tasks: Sequence[Any]) -> TaskHierarchy:
        """Check tasks and sort them by priority; `task` None: `PoseTask()` of each tip.

        Raises `OptionError`, `FrameError`.
        """
        given = [PoseTask(frame=tip) for tip in robot.tips] if task is None else task
        given = (*(given if isinstance(given, (list, tuple)) else [given]), *tasks)
        for each in given:
            if not isinstance(each, (Task, ObjectiveTask)):
                raise OptionError(f"task must be something like {EXAMPLES}, got {shown(each)}")
        made = [each.of(robot) for each in given]
        priorities = sorted({each.priority for each in made})
        levels = [_level([each for each in made if each.priority == priority]) for priority in priorities]
        if not levels or not levels[0].tasks.tasks or levels[0].objectives:
            raise OptionError(f"the first level needs a task, such as {EXAMPLES}")
        frames = {each.target_frame: None for each in made if isinstance(each, Task)}
        return TaskHierarchy(
            primary=levels[0].tasks.tasks,
            lower=tuple(levels[1:]),
            frames=tuple(frame for frame in frames if frame is not None),
        )

    @property
    def all_tasks(self) -> tuple[Task, ...]:
        """The first level's tasks and those of the levels below that hold nothing else."""
        lower = [level.tasks.tasks for level in self.lower if not level.objectives]
        return sum(lower, self.primary)


def _level(tasks: Sequence[Task | ObjectiveTask]) -> LevelObjective:
    plain = tuple(each for each in tasks if isinstance(each, Task))
    return LevelObjective(TaskCost(plain), tuple(each for each in tasks if isinstance(each, ObjectiveTask)))
