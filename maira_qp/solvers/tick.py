"""One control tick: the hierarchy's QPs at the configuration of now, with limits on position, speed and acceleration.

The levels are Newton's models of the true costs, which near the target are those of Gauss-Newton, and where the target
cannot be reached still come to rest; the curvature counts where the tasks feel a motion, not along a self-motion. What
each level adds is halved until it is safe: until its own true cost does not rise, no level above loses more than half
of what it has just gained (or an error below `SMALL_ERROR`), and no limit is broken that the QP knows to first order
only, there or while the arm brakes from there. What cannot be made safe is left out.

Limits with rows that are broken at the beginning are undone first, by a level above the others; a joint outside its own
limits comes back because its box says so. With limits on the acceleration a joint that runs at full speed passes its
goal, however well it can brake. So the tick first looks where the levels would go if there were no time, and then goes
that way only so fast that every joint could still stop where it ends.

Where limits keep the first level from its motion it does what is nearest by least squares, which may be in another
direction. To keep the direction instead, the first level becomes two: nothing across the motion that the tasks ask
for, and below that as much along it as the limits allow, up to all of it: `W J dq = s W e`, s in [0, 1] as large as
possible.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import chain

import numpy as np

from maira_qp.problem.costs import ExactTaskCost, LevelObjective, TaskCost, WeightedCost, strict_levels
from maira_qp.problem.hierarchy import Level, null_space, positive_part, solve_each_level
from maira_qp.problem.limits import Bounds, Tick, braking_displacement
from maira_qp.problem.qp import QP
from maira_qp.problem.redundancy import Strict, Weighted
from maira_qp.problem.tasks.limit import LimitTask
from maira_qp.problem.tasks.objective import ObjectiveTask
from maira_qp.robots.configuration import Configuration
from maira_qp.solvers.descent import LEAST_DAMPING
from maira_qp.solvers.setting import Setting

SMALL_ERROR = 1e-3
"""|W e| below which the motion of lower levels may cost some of it again until the next tick [rad]."""

HALVINGS = 12

CORRECTIONS = 2
"""Times that bent limits are linearised anew to correct a step."""

ROW_SPACE = 1e-6
"""Directions that a task feels by less than this share of what it feels most are self-motion."""

GLANCES = 8
"""Configurations on the way to a stop at which bent limits are looked at."""

SAME = 1e-10
"""Growth of a violation that counts as none, since distances are known to some rounding [m]."""

FAINT = 1e-6
"""What a displacement counts against the limits that it brings the arm back into."""


@dataclass(frozen=True)
class _Model:
    """A level: its true cost, and the quadratic model of it that the hierarchy solves."""

    value: Callable[[Configuration], float]
    level: Level


def tick(
    cost: TaskCost,
    redundancy: Weighted | Strict | None,
    at: Configuration,
    setting: Setting,
    now: Tick,
    deadline: float | None = None,
    keep_direction: bool = False,
) -> tuple[np.ndarray, np.ndarray]:
    """Configuration (n,) after a tick and the velocity (n,) that leads to it.

    From inside the position limits the next configuration is inside them to the bit, and the velocity within the
    velocity limits to the bit always. A backend that fails leaves the arm where it is, as far as the limits allow; a
    `deadline` [s] that passes leaves out the levels that are not solved by then. `keep_direction` scales the motion of
    the first level to what the limits allow.
    """
    end = None if deadline is None else time.monotonic() + deadline
    robot, bounds = setting.robot, setting.bounds(at, now)
    models = _models(cost, redundancy, at, setting, now, bounds)
    if keep_direction:
        first = LevelObjective(cost, _weighted(redundancy))
        models = [*_directed(first, at, now), *models[len(split_equalities(first)) :]]
    models = [*_back_inside(at, setting, bounds), *_bent_along_wishes(models, cost, at, setting)]
    levels = [model.level for model in models]
    if np.isfinite(robot.acceleration_limit).any():
        levels = _slowed(levels, at, setting, now)
    displacements = solve_each_level(levels, bounds, setting.backend, end)
    dq = np.clip(_safe(models, at, displacements, setting, bounds, now), bounds.lower, bounds.upper)
    inside = (at.q >= robot.lower) & (at.q <= robot.upper)
    q = np.where(inside, np.clip(at.q + dq, robot.lower, robot.upper), at.q + dq)
    return q, np.clip(dq / now.dt, -robot.velocity_limit, robot.velocity_limit)


def keeps_further_limits(
    setting: Setting, q: np.ndarray, ahead: np.ndarray, dt: float, velocity: np.ndarray | None
) -> bool:
    """Whether a tick from q to ahead (n,), found without the limits beside those of the joints, keeps these as well.

    Then it is the tick with them, too: what is best among more is best among fewer.
    """
    if not setting.further:
        return True
    at, dq = setting.robot.at(q), ahead - q
    now = Tick(dt, np.zeros_like(q) if velocity is None else velocity)
    for limit in setting.further:
        box, rows = limit.box(at, now), limit.rows(at, now)
        if box is not None and not ((box[0] <= dq).all() and (dq <= box[1]).all()):
            return False
        if rows is not None and not (rows[0] @ dq <= rows[1]).all():
            return False
    return not setting.is_bent or any(
        not broken.any() for broken in _violations_ahead(setting.robot.at(ahead), dq, setting, now)
    )


def _back_inside(at: Configuration, setting: Setting, bounds: Bounds) -> list[_Model]:
    """A level above all others that undoes what is broken of the limits with rows, if anything is."""
    if bounds.broken is None:
        return []
    still = Level(FAINT * np.eye(at.n), np.zeros(at.n), np.empty((0, at.n)), wishes=bounds.broken)
    return [_Model(setting.breach, still)]


def _models(
    cost: TaskCost,
    redundancy: Weighted | Strict | None,
    at: Configuration,
    setting: Setting,
    now: Tick,
    bounds: Bounds,
) -> list[_Model]:
    """The levels in falling priority."""
    objectives = redundancy.objectives if isinstance(redundancy, Strict) else ()
    weighted = _weighted(redundancy)
    top, *soft = split_equalities(LevelObjective(cost, weighted))
    cost, first = top.tasks, top.tasks.without_wishes()
    if weighted and not soft:
        objective, weight = weighted[0].objective, weighted[0].weight
        level = _newton(first, at, weight * objective.hessian(at))
        pull = first.pull(at) + weight * objective.gradient(at)
        value = WeightedCost(cost, objective, weight).value
        return [_Model(value, _of_tasks(level, pull, cost, at, setting, now))]
    further = [split_equalities(each) if isinstance(each, LevelObjective) else (each,) for each in objectives]
    below = (*soft, *chain.from_iterable(further))
    plain = [each.without_wishes() if isinstance(each, LevelObjective) else each for each in below]
    levels = strict_levels(_newton(first, at, np.zeros((at.n, at.n))), first, plain, at, bounds.held)
    models = [_Model(cost.value, _of_tasks(levels[0], first.pull(at), cost, at, setting, now))]
    for objective, model, level in zip(below, plain, levels[1:], strict=True):
        if isinstance(objective, LevelObjective) and isinstance(model, LevelObjective):
            if not model.objectives:
                level = replace(level, H=_bent_along_rows(level.H, level.rows, np.zeros_like(level.H)))
            level = _of_tasks(level, model.pull(at), objective.tasks, at, setting, now)
        models.append(_Model(objective.cost, level))
    return models


def _bent_along_wishes(models: list[_Model], cost: TaskCost, at: Configuration, setting: Setting) -> list[_Model]:
    """The models, with the curvature of limits that are wishes of the first level where these hold up a lower one."""
    limits = tuple(task.limit for task in cost.tasks if isinstance(task, LimitTask))
    if not limits:
        return models
    wished = replace(setting, further=limits)
    bent = [replace(m.level, H=m.level.H + wished.curvature(at, m.level.c)) for m in models[1:]]
    return [models[0], *(replace(m, level=level) for m, level in zip(models[1:], bent, strict=True))]


def _weighted(redundancy: Weighted | Strict | None) -> tuple[ObjectiveTask, ...]:
    """The objective beside the tasks of the first level, if there is one."""
    return (ObjectiveTask(redundancy.objective, redundancy.weight),) if isinstance(redundancy, Weighted) else ()


def _directed(first: LevelObjective, at: Configuration, now: Tick) -> list[_Model]:
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
        c = c + each.weight * each.objective.gradient(at)
    upper = Level(across.T @ across, np.zeros(at.n), across).damped(mu)
    lower = Level(H, c, along[None], wishes=first.tasks.wishes(at, now)).damped(mu)
    return [_Model(lambda at: 0.0, upper), _Model(first.cost, lower)]


def _newton(cost: TaskCost, at: Configuration, own: np.ndarray) -> Level:
    """Newton's model of the tasks and of what counts beside them with the Hessian `own` (n, n)."""
    A, r = cost.rows(at)
    H = _bent_along_rows(ExactTaskCost(cost).hessian(at) + own, A, own)
    return Level(positive_part(H), -(A.T @ r), A, 0.5 * float(r @ r), float(r @ r))


def _bent_along_rows(H: np.ndarray, A: np.ndarray, own: np.ndarray) -> np.ndarray:
    """The Hessian H (n, n) of tasks with the rows A (m, n), their curvature kept to what these feel.

    Of a self-motion the error knows no better or worse, and its curvature there, which is that of the way that is left
    in this tick, would only set the arm adrift. `own` (n, n) is what else is in H, and stays.
    """
    G, Z = A.T @ A, null_space(A, ROW_SPACE)
    S = H - own - G
    S = S - Z @ (Z.T @ S)
    return own + G + S - (S @ Z) @ Z.T


def _of_tasks(level: Level, pull: np.ndarray, cost: TaskCost, at: Configuration, setting: Setting, now: Tick) -> Level:
    """A level's model with the gains, the inequalities and the damping of its tasks."""
    return _damped(replace(level, c=pull, wishes=cost.wishes(at, now)), cost, at, setting)


def _damped(level: Level, cost: TaskCost, at: Configuration, setting: Setting) -> Level:
    """The level with Levenberg-Marquardt damping by the error, the solver's and the tasks' own."""
    mu = setting.options.damping * min(level.squared_error, 1.0) + LEAST_DAMPING * float(np.abs(level.H).max())
    return level.damped(mu + cost.damping(at))


def _slowed(levels: list[Level], at: Configuration, setting: Setting, now: Tick) -> list[Level]:
    """The levels with their pull reduced until every joint can stop where they end."""
    ends = solve_each_level(levels, setting.bounds(at), setting.backend)
    if not ends:
        return levels
    way = np.abs(ends[-1])
    change = setting.robot.acceleration_limit * now.dt**2
    share = np.min(braking_displacement(way, change)[way > 0] / way[way > 0], initial=1.0)
    return [replace(level, c=share * level.c) for level in levels]


def _safe(
    models: Sequence[_Model],
    at: Configuration,
    displacements: Sequence[np.ndarray],
    setting: Setting,
    bounds: Bounds,
    now: Tick,
) -> np.ndarray:
    """The displacement (n,) with each level's part shortened until the true costs and the bent limits allow it."""
    dq = solved = bounds.rest
    there = at.moved(dq) if dq.any() else at
    broken = None
    if setting.is_bent:
        broken = np.maximum(setting.violations(at), min(_violations_ahead(there, dq, setting, now), key=np.sum))
    highest: list[float] = []  # what the levels so far may cost
    for k, displacement in enumerate(displacements):
        before = models[k].value(there)
        allowed = [*highest, before + (1e-9 * (1 + abs(before)) if k else 0.0)]
        part, solved, after = displacement - solved, displacement, before
        for _ in range(HALVINGS):
            step = dq + part if broken is None else _brought_back(at, dq + part, broken, setting, bounds, now)
            if step is not None and bounds.contain(step):
                trial = at.moved(step)
                after = models[k].value(trial)
                above = zip(models[:k], highest, strict=True)
                if after <= allowed[k] and all(model.value(trial) <= most for model, most in above):
                    dq, there = step, trial
                    break
            part, after = 0.5 * part, before
        highest.append(max(0.5 * (before + after), 0.5 * SMALL_ERROR**2))
    return dq


def _brought_back(
    at: Configuration, dq: np.ndarray, allowed: np.ndarray, setting: Setting, bounds: Bounds, now: Tick
) -> np.ndarray | None:
    """The displacement dq (n,) with what corrects the second order by which it breaks bent limits more than `allowed`.

    That is the least further displacement that keeps them as they are linearised where dq leads to (second-order
    correction: Nocedal and Wright, section 18.3). None where it takes too long, or where they are broken while the arm
    brakes from there.
    """
    most = np.where(allowed > 0, allowed + SAME, 0.0)
    for _ in range(CORRECTIONS + 1):
        there = at.moved(dq)
        if (setting.violations(there) <= most).all():
            ways = _violations_ahead(there, dq, setting, now)
            return dq if any((broken <= most).all() for broken in ways) else None
        G, h = setting.rows_within(there, allowed)
        G, h = np.vstack([G, bounds.G]), np.concatenate([h - SAME, np.maximum(bounds.h - bounds.G @ dq, 0.0)])
        lower, upper = np.minimum(bounds.lower - dq, 0.0), np.maximum(bounds.upper - dq, 0.0)
        back = setting.backend.solve(QP(np.eye(at.n), np.zeros(at.n), lower, upper, G, h))
        if not back.found:
            return None
        dq = np.clip(dq + back.x, bounds.lower, bounds.upper)
    return None


def _violations_ahead(at: Configuration, dq: np.ndarray, setting: Setting, now: Tick) -> Iterator[np.ndarray]:
    """By how much each part (k,) of the bent limits is broken where dq (n,) led to, and while the arm then brakes.

    First if each joint brakes as hard as it can, then if all slow down together, in a straight line of joint space: a
    pair of bodies that one joint drives together and another apart does not come nearer if both slow down alike. So a
    tick that is allowed leaves a way to stop that is allowed, and one of these is always there to be chosen next.
    """
    change, size = setting.robot.acceleration_limit * now.dt**2, np.abs(dq)
    stop = size / change  # in ticks
    ticks, whole = int(np.max(stop, initial=0.0)), np.floor(stop)
    here = setting.violations(at)
    if ticks == 0:
        yield here
        return
    glances = np.unique(np.linspace(0, ticks, GLANCES + 1).astype(int).clip(min=1))
    change = np.where(whole > 0, change, 0.0)
    braking = [np.minimum(i, whole) for i in glances]
    apart = [np.sign(dq) * np.where(k > 0, k * (size - 0.5 * change * (k + 1)), 0.0) for k in braking]
    yield np.max([here, *(setting.violations(at.moved(way)) for way in apart)], axis=0)
    together = [dq * (i - i * (i + 1) / (2 * np.max(stop))) for i in glances]
    q = at.q + together[-1]
    if (setting.robot.lower <= q).all() and (q <= setting.robot.upper).all():
        yield np.max([here, *(setting.violations(at.moved(way)) for way in together)], axis=0)


def split_equalities(level: LevelObjective) -> tuple[LevelObjective, ...]:
    """The level, or, if some of its tasks are equalities, these, and below them the others with its objectives."""
    equalities = tuple(task for task in level.tasks.tasks if task.equality)
    others = tuple(task for task in level.tasks.tasks if not task.equality)
    if not equalities or not (others or level.objectives):
        return (level,)
    return LevelObjective(TaskCost(equalities)), LevelObjective(TaskCost(others), level.objectives)
