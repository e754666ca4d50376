"""The problem: a robot, what it is to reach and keep, and how far to go for it.

Everything a solver does is a function of a problem. What changes from call to call, such as targets and starts, is an
argument beside it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from maira_qp.errors import ConfigurationError, OptionError, shown
from maira_qp.problem.box import ChangeBox
from maira_qp.problem.levels import TaskHierarchy
from maira_qp.problem.limits.joint import AccelerationLimit, Limit, PositionLimit, VelocityLimit
from maira_qp.problem.objectives import LimitDistance, Posture
from maira_qp.problem.options import Options
from maira_qp.problem.qp.costs import LevelObjective, TaskCost, tasks_toward
from maira_qp.problem.redundancy import Strict, Weighted
from maira_qp.problem.targets import Poses, Targets, checked_starts, checked_target, checked_targets
from maira_qp.problem.tasks.task import Task
from maira_qp.robots.model.configuration import Configuration
from maira_qp.robots.model.joint_values import joint_array
from maira_qp.robots.model.revolutions import WholeTurns
from maira_qp.robots.model.robot import Robot

ACTIVE_WITHIN = 1e-9
"""A limit nearer than this [rad or m] counts as active."""


@dataclass(frozen=True)
class Problem:
    """What is asked of a robot; its parts are bound to that robot."""

    robot: Robot
    hierarchy: TaskHierarchy
    additional_limits: tuple[Limit, ...]
    """Hard limits beside those of the joints"""
    redundancy: Weighted | Strict | None
    options: Options
    box: ChangeBox | None = None
    """Of a call with `max_joint_change`: the robot's limits are those of the box"""

    @staticmethod
    def build(
        robot: Robot,
        *,
        task: Any = None,
        tasks: Sequence[Any] = (),
        limits: Sequence[Any] = (),
        redundancy: Any = None,
        options: Any = None,
    ) -> Problem:
        """Check the arguments of `Solver`, and bind them to the robot. Raises `OptionError`, `FrameError`."""
        _check_type(robot, Robot, "robot", "mq.Robot.maira() or mq.Robot.from_urdf(...)")
        _check_type(options, (Options, type(None)), "options", "mq.Options(...)")
        _check_type(redundancy, (Weighted, Strict, type(None)), "redundancy", "mq.Strict(mq.Posture())")
        for name, value in (("tasks", tasks), ("limits", limits)):
            _check_type(value, (list, tuple), name, "a list")
        for limit in limits:
            _check_type(limit, Limit, "limit", "mq.LinearLimit(A, b)")
            if getattr(limit, "needs_target", False):
                raise OptionError(f"a {type(limit).__name__} among the limits needs a target of its own")
        hierarchy = TaskHierarchy.build(robot, task, tasks)
        if isinstance(redundancy, Weighted) and hierarchy.lower:
            raise OptionError(
                "Weighted puts its objective into the first level, and there are levels below; "
                "use mq.ObjectiveTask(objective, weight, priority) or Strict(...)"
            )
        return Problem(
            robot,
            hierarchy,
            tuple(limit.of(robot) for limit in limits),
            None if redundancy is None else redundancy.of(robot),
            options or Options(),
        )

    def with_redundancy(self, redundancy: Weighted | Strict | None) -> Problem:
        """The same with another redundancy, bound to the robot."""
        return replace(self, redundancy=redundancy)

    def within(self, start: np.ndarray, change: np.ndarray) -> Problem:
        """The same where no joint may be farther from a start (n,) than a change (n,). Raises `ConfigurationError`."""
        box = ChangeBox(self.robot, start, change)
        return replace(self, robot=box.boxed, box=box)

    def of_first_level(self) -> Problem:
        """The same without a redundancy and without tasks below those of the first level."""
        return replace(self, redundancy=None, hierarchy=replace(self.hierarchy, lower=()))

    def with_options(self, **changes: Any) -> Problem:
        """The same with some options changed."""
        return replace(self, options=replace(self.options, **changes))

    @property
    def tasks(self) -> tuple[Task, ...]:
        """The tasks of the first level: what a solve is to reach."""
        return self.hierarchy.primary

    @property
    def frames(self) -> tuple[str, ...]:
        """The K frames that a call needs a target for."""
        return self.hierarchy.frames

    @cached_property
    def limits(self) -> tuple[Limit, ...]:
        """All hard limits, those of the joints first."""
        robot = self.robot
        return (
            AccelerationLimit(robot.acceleration_limit),
            PositionLimit(robot.lower, robot.upper, robot.acceleration_limit),
            VelocityLimit(robot.velocity_limit),
            *self.additional_limits,
        )

    @cached_property
    def is_pose_alone(self) -> bool:
        """There is nothing below the first level."""
        return not self.hierarchy.lower and self.redundancy is None

    @property
    def posture(self) -> Posture | None:
        """The first posture among the objectives, if any."""
        objectives = () if self.redundancy is None else self.redundancy.objectives
        lower = (each.objective for level in self.hierarchy.lower for each in level.objectives)
        for objective in (*objectives, *lower):
            if isinstance(objective, Posture):
                return objective
            if isinstance(objective, LimitDistance):
                return objective.as_posture
        return None

    @cached_property
    def turns(self) -> WholeTurns:
        """Whole turns of the joints, counted from the reference."""
        return WholeTurns(self.robot, self.reference)

    @property
    def reference(self) -> np.ndarray:
        """Where joints (n,) are by default: at the posture, or in the middle of the limits."""
        return self.robot.middle if self.posture is None else self.posture.q_ref

    def start(self, q0: Any) -> np.ndarray | None:
        """A start (n,), checked; joints that a mapping does not name are at the reference. Raises
        `ConfigurationError`."""
        if q0 is None:
            return None
        return joint_array(q0, self.robot.joint_names, "q0", ConfigurationError, self.reference)

    def starts(self, q0: Any, count: int) -> np.ndarray | None:
        """The starts (count, n) of a batch, checked: see `checked_starts`. Raises `ConfigurationError`."""
        return checked_starts(q0, count, self.robot.joint_names, self.reference)

    def target(self, target: Any) -> Targets:
        """One call's targets, checked: N is 1. Raises `PoseError`, `FrameError`."""
        return checked_target(target, self.frames, self.robot.length)

    def targets(self, targets: Any, name: str = "target") -> Targets:
        """A batch's targets, checked, each called by a name. Raises `PoseError`, `FrameError`."""
        return checked_targets(targets, self.frames, self.robot.length, name)

    def costs(self, poses: Poses) -> tuple[TaskCost, Weighted | Strict | None]:
        """The first level toward its targets, and the secondary objectives: all that is below it."""
        below = [
            LevelObjective(tasks_toward(level.tasks.tasks, poses), level.objectives) if self.frames else level
            for level in self.hierarchy.lower
        ]
        objectives = self.redundancy.objectives if isinstance(self.redundancy, Strict) else ()
        return tasks_toward(self.tasks, poses), Strict(*below, *objectives) if below else self.redundancy

    def is_reached(self, position: Any, orientation: Any) -> Any:
        """Whether errors [m] and [rad], numbers or arrays, are within the tolerances."""
        options = self.options
        return (position <= options.position_tolerance) & (orientation <= options.orientation_tolerance)

    def active_limits(self, q: np.ndarray) -> list[str]:
        """Names of the limits that q (n,) stands on, those of the joints first."""
        robot, names = self.robot, []
        for i, (value, low, high) in enumerate(zip(q, robot.lower, robot.upper, strict=True)):
            if value <= low + ACTIVE_WITHIN:
                names.append(self._end(i, "lower"))
            if value >= high - ACTIVE_WITHIN:
                names.append(self._end(i, "upper"))
        at = robot.at(q)
        return names + [name for limit in self.limits for name in limit.active(at)]

    def _end(self, joint: int, end: str) -> str:
        """What holds a joint at an end of its range: such as "joint4 upper", or "joint4 max_joint_change"."""
        of_box = self.box is not None and self.box.holds_at_end(joint, end, self.robot)
        return f"{self.robot.joint_names[joint]} {'max_joint_change' if of_box else end}"

    def limit_violations(self, at: Configuration) -> dict[str, float]:
        """By how much a configuration breaks the additional limits, by name, the worst first."""
        found: dict[str, float] = {}
        kinds = [limit.name or type(limit).__name__ for limit in self.additional_limits]
        for i, (limit, kind) in enumerate(zip(self.additional_limits, kinds, strict=True)):
            name = kind if kinds.count(kind) == 1 else f"{kind} {kinds[: i + 1].count(kind)}"
            for part, amount in limit.broken(at, name).items():
                found[part] = max(amount, found.get(part, 0.0))
        return dict(sorted(found.items(), key=lambda item: -item[1]))


def _check_type(value: Any, types: Any, name: str, example: str) -> None:
    if not isinstance(value, types):
        raise OptionError(f"{name} must be something like {example}, got {shown(value)}")
