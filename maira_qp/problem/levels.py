"""The tasks of a problem in the order of their priorities."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
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

    parts: tuple[Any, ...]
    """All tasks and objectives in the order in which they were given, those that are switched off too."""
    primary: tuple[Task, ...]
    """The first level: what a solve is to reach. Empty where it is switched off and objectives are next."""
    lower: tuple[LevelObjective, ...]
    """The levels below it, in falling priority."""

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
        first = min((each.priority for each in made), default=1)
        highest = {isinstance(each, Task) for each in made if each.priority == first}
        if highest != {True}:
            raise OptionError(f"the first level needs a task, such as {EXAMPLES}")
        return TaskHierarchy.of_parts(made)

    @staticmethod
    def of_parts(parts: Sequence[Any]) -> TaskHierarchy:
        """Bound tasks and objectives by priority. Where all of a level is switched off, those below it close up."""
        active = [each for each in parts if not each.is_off]
        priorities = sorted({each.priority for each in active})
        levels = [_level([each for each in active if each.priority == priority]) for priority in priorities]
        begins = bool(levels) and not levels[0].objectives
        return TaskHierarchy(tuple(parts), levels[0].tasks.tasks if begins else (), tuple(levels[begins:]))

    @cached_property
    def target_keys(self) -> tuple[str, ...]:
        """The keys of the targets that a call needs to give."""
        keys = {each.target_key: None for each in self.parts if not each.is_off and isinstance(each, Task)}
        return tuple(key for key in keys if key is not None)

    @property
    def all_tasks(self) -> tuple[Task, ...]:
        """The first level's tasks and those of the levels below that hold nothing else."""
        lower = [level.tasks.tasks for level in self.lower if not level.objectives]
        return sum(lower, self.primary)


def _level(tasks: Sequence[Task | ObjectiveTask]) -> LevelObjective:
    plain = tuple(each for each in tasks if isinstance(each, Task))
    return LevelObjective(TaskCost(plain), tuple(each for each in tasks if isinstance(each, ObjectiveTask)))
