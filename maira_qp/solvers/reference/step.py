"""One control tick: the hierarchy's QPs at the configuration of now, with limits on position, speed and acceleration.

The levels are quadratic models of the true costs, those of `solvers.reference.step_models`. What each level adds is
shortened until it is safe, see `solvers.reference.safe_steps`.

Limits with rows that are broken at the beginning are undone first, by a level above the others; a joint outside its own
limits comes back because its box says so.

With limits on the acceleration a joint that runs at full speed passes its goal, however well it can brake. So the tick
first looks where the levels would go if there were no time, and then goes that way only so fast that every joint could
still stop where it ends. The way ends where each level's true cost falls, too: far from the nearest point to a target
out of reach the models ask for whole turns. And each joint keeps to its own part of the way: to make up for others that
brake too slowly it would gather a speed from which it passes its end, and the arm would swing about the nearest point.

Where limits keep the first level from its motion it does what is nearest by least squares, which may be in another
direction. To keep the direction instead, the first level becomes two: nothing across the motion that the tasks ask
for, and below that as much along it as the limits allow, up to all of it: `W J dq = s W e`, s in [0, 1] as large as
possible.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from maira_qp.problem.limits.joint import Bounds, Tick, stopping_displacement
from maira_qp.problem.objectives import Posture
from maira_qp.problem.qp.costs import LevelObjective, TaskCost
from maira_qp.problem.qp.hierarchy import Level, solve_each_level
from maira_qp.problem.redundancy import Strict, Weighted
from maira_qp.problem.tasks.joints import DampingTask
from maira_qp.problem.tasks.limit import LimitTask
from maira_qp.problem.tasks.objective import ObjectiveTask
from maira_qp.problem.tasks.task import Task
from maira_qp.results.status import StepStatus
from maira_qp.robots.model.configuration import Configuration
from maira_qp.robots.model.robot import Robot
from maira_qp.solvers.reference.context import Context
from maira_qp.solvers.reference.safe_steps import TickLevel, safe_step
from maira_qp.solvers.reference.step_models import (
    LEAST_DAMPING,
    Reach,
    TickModel,
    are_reached,
    is_near,
    tick_models,
)
from maira_qp.solvers.reference.stopping import violations_ahead, with_a_way_to_stop

SLOWINGS = 8
"""Times that the pull of a level is reduced which moves the tool too fast."""

CLOSE = 1e-3
"""A motion that is too fast by no more than this share is scaled, and not sought again."""

FAINT = 1e-6
"""What a displacement counts against the limits that it brings the arm back into."""

AT_REST = 1e-6
"""A joint stands if its speed is at most this share of its limit, or of 1 rad/s or 1 m/s where it has none."""


def tick(
    cost: TaskCost,
    redundancy: Weighted | Strict | None,
    at: Configuration,
    context: Context,
    now: Tick,
    deadline: float | None = None,
    keep_direction: bool = False,
) -> tuple[np.ndarray, np.ndarray, StepStatus]:
    """Configuration (n,) after a tick, the velocity (n,) that leads to it, and what the arm is doing.

    From inside the position limits the next configuration is inside them to the bit, and the velocity within the
    velocity limits to the bit always. A backend that fails leaves the arm where it is, as far as the limits allow; a
    `deadline` [s] that passes leaves out the levels that are not solved by then. `keep_direction` scales the motion of
    the first level to what the limits allow.
    """
    end = None if deadline is None else time.monotonic() + deadline
    if isinstance(redundancy, Weighted) and redundancy.fading:
        redundancy = redundancy.faded(cost.gradient(at), redundancy.objective.gradient(at))
    robot, bounds = context.robot, with_a_way_to_stop(context.bounds(at, now), at, context, now)
    models = _models(cost, redundancy, at, context, now, bounds)
    if keep_direction:
        first = _paced(LevelObjective(cost, _weighted(redundancy)), now.dt)
        count = len(split_equalities(first))
        models = [*_directed(first, models[:count], at, now), *models[count:]]
    models = _bent_along_wishes(_bent_along_limits(models, at, context), cost, at, context)
    models = [*_back_inside(at, context, bounds), *models]
    levels = [model.level for model in models]
    if np.isfinite(robot.acceleration_limit).any():
        levels, bounds = _slowed(models, at, context, now, bounds)
    displacements, solved = _in_pace(levels, bounds, at, context, now, end)
    dq = np.clip(safe_step(models, at, displacements, context, bounds, now), bounds.lower, bounds.upper)
    q, velocity = _moved(at, dq, robot, now.dt)
    wanted = displacements[-1] if solved else np.full(at.n, np.inf)
    tasks = [task for model in models for task in model.tasks]
    status = _status(tasks, robot.at(q), velocity, wanted / now.dt, context)
    return q, velocity, status


def _in_pace(
    levels: Sequence[Level], bounds: Bounds, at: Configuration, context: Context, now: Tick, end: float | None
) -> tuple[list[np.ndarray], bool]:
    """The displacements (n,) of the levels, the pull of each reduced until they are as slow as limits on speed ask.

    And whether all levels could be solved. A level that is too fast moves in the same direction, but for what joint
    limits hold up of it.
    """
    levels = list(levels)
    displacements, solved = solve_each_level(levels, bounds, context.backend, end)
    for _ in range(SLOWINGS if context.is_paced else 0):
        paces = [context.pace(at, dq, now) for dq in displacements]
        fast = next((k for k, pace in enumerate(paces) if pace > 1.0 + CLOSE and levels[k].c.any()), None)
        if fast is None:
            break
        levels[fast] = replace(levels[fast], c=levels[fast].c / paces[fast])
        displacements, solved = solve_each_level(levels, bounds, context.backend, end)
    return displacements, solved


def brake(at: Configuration, context: Context, now: Tick) -> tuple[np.ndarray, np.ndarray]:
    """Configuration (n,) and velocity (n,) after a tick in which every joint stops, or slows as much as limits allow.

    A joint outside its limits comes back.
    """
    return _moved(at, context.bounds(at, now).rest, context.robot, now.dt)


def _moved(at: Configuration, dq: np.ndarray, robot: Robot, dt: float) -> tuple[np.ndarray, np.ndarray]:
    """Configuration (n,) after a displacement (n,) in a tick of dt [s], and the velocity (n,), both within the limits.

    A joint that began outside its limits may still be there.
    """
    inside = (at.q >= robot.lower) & (at.q <= robot.upper)
    q = robot.kinematics.integrate(at.q, dq)
    q = np.where(inside, np.clip(q, robot.lower, robot.upper), q)
    return q, np.clip(dq / dt, -robot.velocity_limit, robot.velocity_limit)


def _status(
    tasks: Sequence[Task],
    at: Configuration,
    velocity: np.ndarray,
    wanted: np.ndarray,
    context: Context,
) -> StepStatus:
    """What the arm is doing; `wanted` (n,) is the velocity that the QPs ask for: none at a stationary point."""
    slow = resting_speed(context.robot)
    moves = bool((np.abs(velocity) > slow).any())
    if are_reached(tasks, at, context.options) and not (moves and any(task.is_of_ticks for task in tasks)):
        return StepStatus.ARRIVED
    if moves:
        return StepStatus.MOVING
    if (np.abs(wanted) > slow).any():
        return StepStatus.STUCK
    least = min((task.gain for task in tasks), default=1.0)
    return StepStatus.MOVING if (np.abs(wanted) > least * slow).any() else StepStatus.NEAREST


def resting_speed(robot: Robot) -> np.ndarray:
    """The speeds (n,) [rad/s or m/s] up to which joints count as at rest."""
    return AT_REST * np.where(np.isfinite(robot.velocity_limit), robot.velocity_limit, 1.0)


def keeps_further_limits(
    context: Context, q: np.ndarray, ahead: np.ndarray, dt: float, velocity: np.ndarray | None
) -> bool:
    """Whether a tick from q to ahead (n,), found without the limits beside those of the joints, keeps these as well.

    Then it is the tick with them, too: what is best among more is best among fewer, and limits that are not near hold
    nothing.
    """
    if not context.further:
        return True
    at, step = context.robot.at(q), context.robot.velocity_limit * dt
    dq = context.robot.kinematics.difference(q, ahead)
    now = Tick(dt, np.zeros_like(q) if velocity is None else velocity)
    for limit in context.further:
        box, rows = limit.box(at, now), limit.rows(at, now)
        if limit.pace(at, dq, now) > 1.0:
            return False
        if box is not None and not ((box[0] <= dq).all() and (dq <= box[1]).all()):
            return False
        if rows is not None and (is_near(rows, step).any() or not (rows[0] @ dq <= rows[1]).all()):
            return False
    return not context.is_watched or any(
        not broken.any() for broken in violations_ahead(context.robot.at(ahead), dq, context, now)
    )


def _back_inside(at: Configuration, context: Context, bounds: Bounds) -> list[TickLevel]:
    """A level above all others that undoes what is broken of the limits with rows, if anything is."""
    if bounds.broken is None:
        return []
    still = Level(FAINT * np.eye(at.n), np.zeros(at.n), np.empty((0, at.n)), wishes=bounds.broken)
    return [TickLevel(context.breach, (), TickModel(still, np.empty(0), 0))]


def _models(
    cost: TaskCost,
    redundancy: Weighted | Strict | None,
    at: Configuration,
    context: Context,
    now: Tick,
    bounds: Bounds,
) -> list[TickLevel]:
    """The levels in falling priority."""
    levels = levels_of(cost, redundancy, at, now.dt)
    reach = Reach.of(bounds, context.bounds(at), context.robot.velocity_limit * now.dt)
    models = tick_models([each.without_wishes() for each in levels], at, reach, context.options)
    wished = [
        replace(model.level, wishes=each.tasks.wishes(at, now)) for each, model in zip(levels, models, strict=True)
    ]
    parts = zip(levels, models, wished, strict=True)
    return [TickLevel(each.cost, each.tasks.tasks, replace(model, level=level)) for each, model, level in parts]


def levels_of(
    cost: TaskCost, redundancy: Weighted | Strict | None, at: Configuration, dt: float
) -> list[LevelObjective]:
    """The levels of a tick of dt [s] in falling priority, equalities before the other tasks of theirs."""
    objectives = redundancy.objectives if isinstance(redundancy, Strict) else ()
    levels = [LevelObjective(cost, _weighted(redundancy))]
    for each in objectives:
        alone = LevelObjective(TaskCost(()), (ObjectiveTask(each),))
        levels.append(each if isinstance(each, LevelObjective) else alone)
    first, *others = [part for level in levels for part in split_equalities(_paced(level, dt))]
    return [first, *(_staying(part, at) for part in others)]


def _staying(level: LevelObjective, at: Configuration) -> LevelObjective:
    """The level; of motion alone, so that its tasks cost nothing wherever the arm is, as the posture of now."""
    if level.objectives or not is_of_motion_alone(level.tasks.tasks):
        return level
    W = level.tasks.rows(at)[0]
    return LevelObjective(TaskCost(()), (ObjectiveTask(Posture(at.q, W.T @ W)),))


def is_of_motion_alone(tasks: Sequence[Task]) -> bool:
    """Whether tasks are there, and all of them ask for no more than that joints stand still."""
    return bool(tasks) and all(type(task) is DampingTask for task in tasks)


def _paced(level: LevelObjective, dt: float) -> LevelObjective:
    """The level in a tick of dt [s]: its objectives take the share of their steps that their gains [1/s] allow."""
    paced = [replace(each, gain=each.gain * each.objective.share(dt)) for each in level.objectives]
    return replace(level, objectives=tuple(paced))


def _bent_along_limits(models: list[TickLevel], at: Configuration, context: Context) -> list[TickLevel]:
    """The models, with the curvature of limits near by that hold a level up, as far as these know it by a formula."""
    if not context.bends_by_formula:
        return models
    above, bent = np.empty((0, at.n)), []
    for model in models:
        bent.append(model.bent_by(context.curvature(at, model.level.c, above, by_formula=True)))
        above = np.vstack([above, model.level.rows])
    return bent


def _bent_along_wishes(models: list[TickLevel], cost: TaskCost, at: Configuration, context: Context) -> list[TickLevel]:
    """The models, with the curvature of limits that are wishes of the first level where these hold up a lower one."""
    limits = tuple(task.limit for task in cost.tasks if isinstance(task, LimitTask))
    if not limits:
        return models
    wished = context.with_limits(limits)
    return [models[0], *(model.bent_by(wished.curvature(at, model.level.c)) for model in models[1:])]


def _weighted(redundancy: Weighted | Strict | None) -> tuple[ObjectiveTask, ...]:
    """The objective beside the tasks of the first level, if there is one."""
    return (ObjectiveTask(redundancy.objective, redundancy.weight),) if isinstance(redundancy, Weighted) else ()


def _directed(first: LevelObjective, models: Sequence[TickLevel], at: Configuration, now: Tick) -> list[TickLevel]:
    """The first level as two: nothing across the motion that its tasks ask for, and below that what is along it.

    Their rows A (m, n) and errors r (m,), each times its gain, give the direction `u = r / |r|`: the upper level keeps
    `(I - u u^T) A dq` at zero, the lower one brings `u^T A dq` to |r|. No motion is across none, so only what is forced
    upon the joints (to brake, to come back within limits) can leave the direction.
    """
    tasks = first.tasks.without_wishes().tasks
    rows = [(A, task.gain * r) for task in tasks for A, r in (task.rows(at),)] or [(np.empty((0, at.n)), np.empty(0))]
    A, r = np.vstack([A for A, _ in rows]), np.concatenate([r for _, r in rows])
    size = float(np.linalg.norm(r))
    u = r / size if size > 0 else np.zeros_like(r)
    along = u @ A
    across = A - np.outer(u, along)
    mu = LEAST_DAMPING * float(np.abs(A.T @ A).max(initial=1e-3))
    H, c = np.outer(along, along), -size * along
    for each in first.objectives:
        H = H + each.weight * each.objective.hessian(at)
        c = c + each.gain * each.weight * each.objective.gradient(at)
    upper = Level(across.T @ across, np.zeros(at.n), across).damped(mu)
    lower = Level(H, c, along[None], wishes=first.tasks.wishes(at, now)).damped(mu)
    nothing = np.empty(0)
    below = TickLevel(first.cost, first.tasks.tasks, TickModel(lower, nothing, 0), tuple(models))

    def left_across(there: Configuration) -> float:
        return 0.5 * float((there.q - at.q) @ upper.H @ (there.q - at.q))

    return [TickLevel(left_across, (), TickModel(upper, nothing, 0), to_first_order=True), below]


def _slowed(
    models: Sequence[TickLevel], at: Configuration, context: Context, now: Tick, bounds: Bounds
) -> tuple[list[Level], Bounds]:
    """The levels with their pull reduced, and the bounds narrowed, until every joint can stop where the levels end."""
    levels, timeless = [model.level for model in models], context.bounds(at)
    way = safe_step(models, at, solve_each_level(levels, timeless, context.backend)[0], context, timeless)
    change, moves = context.robot.acceleration_limit * now.dt**2, way != 0
    share = np.min(stopping_displacement(way, change)[moves] / way[moves], initial=1.0)
    return [replace(level, c=share * level.c) for level in levels], bounds.along(way, change)


def split_equalities(level: LevelObjective) -> tuple[LevelObjective, ...]:
    """The level, or, if some of its tasks are equalities, these, and below them the others with its objectives."""
    equalities = tuple(task for task in level.tasks.tasks if task.equality)
    others = tuple(task for task in level.tasks.tasks if not task.equality)
    if not equalities or not (others or level.objectives):
        return (level,)
    return LevelObjective(TaskCost(equalities)), LevelObjective(TaskCost(others), level.objectives)
