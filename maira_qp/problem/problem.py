"""The problem: a robot, what it is to reach and keep, and how far to go for it.

Everything a solver does is a function of a problem. What changes from call to call, such as targets and starts, is an
argument beside it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import pinocchio as pin

from maira_qp.errors import ConfigurationError, OptionError, listed, shown
from maira_qp.problem.box import ChangeBox
from maira_qp.problem.levels import TaskHierarchy
from maira_qp.problem.limits.joint import AccelerationLimit, Limit, PositionLimit, Tick, VelocityLimit
from maira_qp.problem.limits.linear import limits_of_robot
from maira_qp.problem.naming import DIRECTION, POINT, Off, are_same, changed, check_known, places_by_key
from maira_qp.problem.objectives import LimitDistance, Posture
from maira_qp.problem.options import Options
from maira_qp.problem.qp.costs import LevelObjective, TaskCost, tasks_toward
from maira_qp.problem.redundancy import Strict, Weighted
from maira_qp.problem.targets import Poses, Targets, checked_starts, checked_target, checked_targets
from maira_qp.problem.tasks.frame import FrameTask
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
    """Hard limits beside those of the joints, those that the robot brings with it first"""
    redundancy: Weighted | Strict | None
    options: Options
    box: ChangeBox | None = None
    """Of a call with `max_joint_change`: the robot's limits are those of the box"""
    wishes: tuple[Any, ...] = ()
    """The parts of the redundancy, those that are switched off too"""

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
        hierarchy = TaskHierarchy.build(robot, task, tasks)
        if isinstance(redundancy, Weighted) and hierarchy.lower:
            raise OptionError(
                "Weighted puts its objective into the first level, and there are levels below; "
                "use mq.ObjectiveTask(objective, weight, priority) or Strict(...)"
            )
        further, options = tuple(limit.of(robot) for limit in limits), options or Options()
        problem = Problem(robot, hierarchy, further, None, options)
        problem = problem if redundancy is None else problem.with_redundancy(redundancy.of(robot))
        problem.places  # noqa: B018  (names that are given twice are refused)
        return problem

    def with_limits_of_robot(self) -> Problem:
        """The same with the limits that its robot brings with it. Raises `OptionError` for their name, given twice."""
        if not self.robot.sum_limits:
            return self
        problem = replace(self, additional_limits=(*limits_of_robot(self.robot), *self.additional_limits))
        problem.places  # noqa: B018
        return problem

    def with_redundancy(self, redundancy: Weighted | Strict | None) -> Problem:
        """The same with another redundancy, bound to the robot."""
        if redundancy is None:
            return replace(self, redundancy=None, wishes=())
        return replace(self, redundancy=redundancy.of_parts(redundancy.parts), wishes=redundancy.parts)

    def within(self, start: np.ndarray, change: np.ndarray) -> Problem:
        """The same where no joint may be farther from a start (n,) than a change (n,). Raises `ConfigurationError`."""
        box = ChangeBox(self.robot, start, change)
        return replace(self, robot=box.boxed, box=box)

    @cached_property
    def tool(self) -> pin.SE3 | None:
        """Where in the tip of the chain the only task of the first level is about; None: it is the tip, or another."""
        task = self.tasks[0] if len(self.tasks) == 1 else None
        if not isinstance(task, FrameTask) or not self.robot.is_chain or task.frame != self.robot.tip:
            return None
        return task.offset  # type: ignore[no-any-return]

    def of_tool(self, robot: Robot) -> Problem:
        """The same problem of the same arm with the `tool`: its only task is that of the tip, with no offset."""
        (task,) = self.tasks
        of_tip = replace(task, name=task.key, frame=robot.tip, offset=None)  # type: ignore[call-arg]
        parts = [of_tip if each is task else each for each in self.hierarchy.parts]
        return replace(self, robot=robot, hierarchy=TaskHierarchy.of_parts(parts))

    def of_first_level(self) -> Problem:
        """The same without a redundancy and without tasks below those of the first level."""
        return replace(self, hierarchy=TaskHierarchy.of_parts(self.tasks), redundancy=None, wishes=())

    @cached_property
    def parts(self) -> tuple[Any, ...]:
        """All that a call can speak of by a key: tasks and objectives, the redundancy's objectives, limits."""
        return (*self.hierarchy.parts, *self.wishes, *self.additional_limits)

    @cached_property
    def places(self) -> dict[str, tuple[int, ...]]:
        """Where the parts are that a key speaks of."""
        return places_by_key(self.parts)

    @cached_property
    def data(self) -> dict[str, str]:
        """What the data of a call by these keys are, as far as they stand in the base: pose, point or direction."""
        return {key: datum for key, where in self.places.items() for i in where if (datum := self.parts[i].datum)}

    @cached_property
    def is_active(self) -> tuple[bool, ...]:
        """Which of the parts count: problems in which the same ones do differ in numbers alone."""
        return tuple(not part.is_off for part in self.parts)

    def differs_in_limits_alone(self, other: Problem) -> bool:
        """Whether the other problem has the very same tasks and redundancy."""
        same = self.hierarchy is other.hierarchy and self.redundancy is other.redundancy
        return same and self.options is other.options and self.robot is other.robot and self.box is other.box

    def has_parts_of(self, other: Problem) -> bool:
        """Whether the other problem has the same parts, switched off or not, and its own have at most other data."""
        if self.is_active != other.is_active or type(self.redundancy) is not type(other.redundancy):
            return False
        return all(type(one) is type(part) for one, part in zip(self.parts, other.parts, strict=True))

    def of_call(self, target: Any, weights: Mapping[str, Any] | None = None) -> tuple[Problem, Any]:
        """The problem of a call with a target and factors for weights, and what of the target is left for it: poses.

        Raises `FrameError` for a key that is none, and what the parts raise.
        """
        poses, values = self.split(target)
        if weights is not None and not isinstance(weights, Mapping):
            raise OptionError(f"weights must be a mapping such as {{'posture': 0.5}}, got {shown(weights)}")
        problem = self.with_values(values, weights) if values or weights else self
        if isinstance(target, Mapping):
            return problem, {key: pose for key, pose in poses.items() if key in problem.target_keys} or None
        return problem, poses if problem.target_keys or not self.target_keys else None

    def split(self, target: Any) -> tuple[Any, dict[str, Any]]:
        """The poses that a call needs to give, out of its target, and the other data.

        Raises `FrameError`, `PoseError`.
        """
        keys = self.target_keys
        if not isinstance(target, Mapping):
            return self.takers[keys[0]].target_of(target) if len(keys) == 1 and self.takers else target, {}
        check_known(target, self.places)
        poses = {key: value for key, value in target.items() if key in keys}
        for key in self.takers.keys() & poses.keys():
            poses[key] = self.takers[key].target_of(poses[key])
        return poses, {key: value for key, value in target.items() if key not in poses}

    @cached_property
    def takers(self) -> dict[str, Any]:
        """The parts that take a target from the call in another form than a pose, none that share it, by their keys."""
        of_keys = {key: [self.parts[i] for i in self.places[key]] for key in self.target_keys}
        return {
            key: parts[0] for key, parts in of_keys.items() if len(parts) == 1 and parts[0].datum in (POINT, DIRECTION)
        }

    @cached_property
    def aims(self) -> dict[str, Any]:
        """Of the takers those whose frame points at what they take, or along it, and does not follow it."""
        return {key: part for key, part in self.takers.items() if not isinstance(part, FrameTask)}

    def with_values(self, values: Mapping[str, Any], weights: Mapping[str, Any] | None = None) -> Problem:
        """The problem of a call: some parts with other data, and with their weights times factors; 0: switched off.

        Raises `FrameError` for a key that is none, and what the parts raise.
        """
        weights = {} if weights is None else weights
        check_known((*values, *weights), self.places)
        limits = len(self.parts) - len(self.additional_limits)
        for key, factor in weights.items():
            if self.places[key][-1] >= limits:
                self.parts[self.places[key][-1]].scaled(factor)  # refused: a hard limit is not switched off either
        return self._with_parts(changed(self.parts, self.places, values, weights))

    def _with_parts(self, parts: tuple[Any, ...]) -> Problem:
        """The problem with others in place of its parts."""
        count = len(self.hierarchy.parts)
        tasks, wishes = parts[:count], parts[count : count + len(self.wishes)]
        hierarchy, redundancy = self.hierarchy, self.redundancy
        if not are_same(tasks, hierarchy.parts):
            hierarchy = TaskHierarchy.of_parts(tasks)
        if redundancy is not None and not are_same(wishes, self.wishes):
            redundancy = redundancy.of_parts(wishes)
        limits = parts[count + len(self.wishes) :]
        return Problem(self.robot, hierarchy, limits, redundancy, self.options, self.box, wishes)

    def with_obstacles(self, poses: Mapping[str, Any]) -> Problem:
        """The problem of a call in which obstacles stand elsewhere: poses by their names.

        Raises `OptionError` for a name that no obstacle of a `CollisionLimit` has, and `PoseError`.
        """
        if not isinstance(poses, Mapping):
            raise OptionError(f"obstacles of a call must be a mapping {{name: pose}}, got {shown(poses)}")
        known, parts = self.obstacle_places, list(self.parts)
        for name in poses:
            if name not in known:
                there = listed(tuple(known), name) if known else "no CollisionLimit has any"
                raise OptionError(f"no obstacle {shown(name)}; {there}")
        for i in {i for name in poses for i in known[name]}:
            parts[i] = parts[i].with_obstacles({name: pose for name, pose in poses.items() if i in known[name]})
        problem = self._with_parts(tuple(parts))
        for i in {i for each in known.values() for i in each}:
            parts[i].check_placed()
        return problem

    def check_placed(self) -> None:
        """Check that each obstacle of a call that gives none has a pose. Raises `OptionError`."""
        for i in {i for each in self.obstacle_places.values() for i in each}:
            self.parts[i].check_placed()

    @cached_property
    def obstacle_places(self) -> dict[str, tuple[int, ...]]:
        """Which of the parts know an obstacle, by the names of all obstacles."""
        names = [getattr(part, "obstacle_names", ()) for part in self.parts]
        known = dict.fromkeys(name for each in names for name in each)
        return {name: tuple(i for i, each in enumerate(names) if name in each) for name in known}

    def toward(self, poses: Poses) -> Problem:
        """The problem with its hard limits about the targets of a call, as far as they need some."""
        if not self.limits_need_targets:
            return self
        return replace(self, additional_limits=tuple(limit.toward(poses) for limit in self.additional_limits))

    @cached_property
    def limits_need_targets(self) -> bool:
        """Some hard limit is about a target of the call."""
        return any(limit.target_key is not None for limit in self.additional_limits)

    def with_options(self, **changes: Any) -> Problem:
        """The same with some options changed."""
        return replace(self, options=replace(self.options, **changes))

    @property
    def tasks(self) -> tuple[Task, ...]:
        """The tasks of the first level: what a solve is to reach."""
        return self.hierarchy.primary

    @cached_property
    def target_keys(self) -> tuple[str, ...]:
        """The K keys of the targets that a call needs to give: names of tasks, or of their frames."""
        own = (limit.target_key for limit in self.additional_limits)
        return tuple(dict.fromkeys((*self.hierarchy.target_keys, *(key for key in own if key is not None))))

    def followers(self, at: Configuration) -> dict[str, pin.SE3]:
        """The poses that are to be the targets, or near them: of the first task or limit of each of the K keys."""
        parts = [part for part in (*self.hierarchy.parts, *self.additional_limits) if not part.is_off]
        first = {part.target_key: part for part in reversed(parts) if isinstance(part, (Task, Limit))}
        return {key: first[key].actual(at) for key in self.target_keys}

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
        return checked_target(target, self.target_keys, self.robot.length)

    def targets(self, targets: Any, name: str = "target") -> Targets:
        """A batch's targets, checked, each called by a name. Raises `PoseError`, `FrameError`."""
        return checked_targets(targets, self.target_keys, self.robot.length, name)

    def costs(self, poses: Poses) -> tuple[TaskCost, Weighted | Strict | None]:
        """The first level toward its targets, and the secondary objectives: all that is below it."""
        below = [
            LevelObjective(tasks_toward(level.tasks.tasks, poses), level.objectives) if self.target_keys else level
            for level in self.hierarchy.lower
        ]
        objectives = self.redundancy.objectives if isinstance(self.redundancy, Strict) else ()
        return tasks_toward(self.tasks, poses), Strict(*below, *objectives) if below else self.redundancy

    @cached_property
    def of_ticks(self) -> tuple[Task, ...]:
        """The tasks that ask for motion in control ticks."""
        return tuple(part for part in self.hierarchy.parts if isinstance(part, Task) and part.is_of_ticks)

    @cached_property
    def of_solves(self) -> Problem:
        """The problem of a solve, which knows nothing of tasks that ask for motion."""
        if not self.of_ticks:
            return self
        parts = tuple(Off(part) if part in self.of_ticks else part for part in self.hierarchy.parts)
        return replace(self, hierarchy=TaskHierarchy.of_parts(parts))

    def costs_of_tick(self, poses: Poses, at: Configuration, tick: Tick) -> tuple[TaskCost, Weighted | Strict | None]:
        """The same in a control tick that begins at a configuration."""
        cost, below = self.costs(poses)
        if not self.of_ticks:
            return cost, below

        def in_tick(tasks: TaskCost) -> TaskCost:
            return TaskCost(tuple(task.in_tick(at, tick) for task in tasks.tasks))

        if isinstance(below, Strict):
            levels = (
                replace(level, tasks=in_tick(level.tasks)) if isinstance(level, LevelObjective) else level
                for level in below.objectives
            )
            below = Strict(*levels)
        return in_tick(cost), below

    @cached_property
    def left_free(self) -> tuple[str, ...]:
        """Which of "position" and "orientation" no task of the first level measures an error of."""
        measured = [task.measures for task in self.tasks]
        both = zip(("position", "orientation"), zip(*measured, strict=True), strict=True)
        return tuple(name for name, each in both if not any(each)) if measured else ()

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
        return names + [self.numbered(limit, name) for limit in self.limits for name in limit.active(at)]

    def _end(self, joint: int, end: str) -> str:
        """What holds a joint at an end of its range: such as "joint4 upper", or "joint4 max_joint_change"."""
        of_box = self.box is not None and self.box.holds_at_end(joint, end, self.robot)
        return f"{self.robot.joint_names[joint]} {'max_joint_change' if of_box else end}"

    def numbered(self, limit: Limit, name: str) -> str:
        """What a limit, or a row of it, of that name is called: with its number where others of its kind have no name
        either, such as "LinearLimit 2 row 1"."""
        kind = _kind(limit)
        if not name.startswith(kind):
            return name
        alike = [other for other in self.additional_limits if _kind(other) == kind]
        if len(alike) < 2:
            return name
        return f"{kind} {1 + next(i for i, other in enumerate(alike) if other is limit)}{name.removeprefix(kind)}"

    def limit_violations(self, at: Configuration) -> dict[str, float]:
        """By how much a configuration breaks the additional limits, by name, the worst first."""
        found: dict[str, float] = {}
        for limit in self.additional_limits:
            for part, amount in limit.broken(at, self.numbered(limit, _kind(limit))).items():
                found[part] = max(amount, found.get(part, 0.0))
        return dict(sorted(found.items(), key=lambda item: -item[1]))


def _kind(limit: Limit) -> str:
    """What a limit is called where there is no other of its kind: by its name, or by its class."""
    return limit.name or type(limit).__name__


def _check_type(value: Any, types: Any, name: str, example: str) -> None:
    if not isinstance(value, types):
        raise OptionError(f"{name} must be something like {example}, got {shown(value)}")
