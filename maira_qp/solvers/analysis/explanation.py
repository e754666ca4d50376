"""Why a solve ended as it did: what is left of the pose error, and which limits, which bodies are in the way.

At a stationary point the gradient of what was minimised is held up by limits alone; what a limit holds up, its
multiplier, is what the cost would fall by, per rad or m, if the limit gave way (Nocedal and Wright, "Numerical
Optimization", 2006, section 12.8). That is the first order, so the limits are then released in earnest, and the target
solved again: from where the solve had ended, and then from as many starts as any solve. That a target is not reached
without its limits is called a fact only where it is proved; else the number of starts that failed is given.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from scipy.optimize import nnls

from maira_qp.problem.limits.collision import CollisionLimit
from maira_qp.problem.limits.joint import Limit
from maira_qp.problem.objectives import Posture
from maira_qp.problem.options import Options
from maira_qp.problem.problem import ACTIVE_WITHIN, Problem
from maira_qp.problem.qp.costs import multipliers
from maira_qp.problem.redundancy import Strict, trades_off
from maira_qp.problem.targets import Poses
from maira_qp.problem.tasks.frame import FrameTask, PoseTask, PositionTask, frame_error
from maira_qp.results.explanation import ActiveLimit, ActivePair, ActiveRow, BrokenLimit, Explanation
from maira_qp.results.solution import Solution
from maira_qp.results.status import Status
from maira_qp.robots.model.configuration import Configuration
from maira_qp.solvers.reference.context import Context

if TYPE_CHECKING:
    pass

STRAIGHT = 0.99
"""Cosine of the angle between the arm and the way to the target, from which on both are in line."""

FEW_STARTS = 4
"""Further starts from which the position alone is looked for, where limits beside those of the joints hold."""

OTHERS_COUNT = 1e-3
"""What the motion of joints whose limits hold counts against that of a released one, as it goes no further than it
must."""


Resolve = Callable[[Problem, Poses, np.ndarray], Solution]
"""Solves a problem for a target from a start (n,)"""


def explain(solution: Solution, poses: Poses, context: Context, resolve: Resolve) -> Explanation:
    """Of a solution of the context's problem for a target."""
    problem = context.problem
    if solution.status is Status.LIMITS_BROKEN:
        return _of_broken_limits(solution, context)
    robot, question = context.robot, _Question(problem, poses, context, solution.q, resolve)
    at = robot.at(solution.q)
    force = _force(problem, poses, at, solution)
    least = 10 * context.options.stationarity_tolerance
    pairs, rows, force = _standing(poses, context, solution, force, least)
    standing = []
    for end, stands, forces in (
        ("lower", solution.q <= robot.lower + ACTIVE_WITHIN, force),
        ("upper", solution.q >= robot.upper - ACTIVE_WITHIN, -force),
    ):
        for i in np.flatnonzero(stands):
            multiplier = float(forces[i]) if forces[i] > least else 0.0
            unit = "m" if robot.slides[i] else "rad"
            standing.append(ActiveLimit(f"{robot.joint_names[i]} {end}", multiplier, 0.0, 0.0, None, unit))
    blocking = [limit.name for limit in standing if limit.multiplier > 0]
    costly = {one.name for one in (*pairs, *rows) if one.multiplier > 0}
    touching = any(pair.multiplier > 0 for pair in pairs)
    gone = tuple(
        limit
        for limit in context.further
        if (
            touching
            if isinstance(limit, CollisionLimit)
            else any(name in costly for name, _ in _rows(problem, limit, at)[0])
        )
    )
    blocked, free, alone = np.zeros(6), None, {}
    if not solution.success and (blocking or gone or solution.status is not Status.UNREACHABLE):
        free = question.solved_without(blocking, gone)
        blocked = question.way_to(free.q) if blocking or gone else blocked
        # one limit alone is of use only if all together are
        alone = {name: question.solved_without([name], everywhere=free.success) for name in blocking}
    limits = [
        replace(
            limit,
            position=solution.position_error - alone[limit.name].position_error,
            orientation=solution.orientation_error - alone[limit.name].orientation_error,
            further=question.beyond(limit.name, alone[limit.name]),
        )
        if limit.name in alone
        else limit
        for limit in sorted(standing, key=lambda limit: -limit.multiplier)
    ]
    position, is_stretched = (None, False) if solution.success else question.position_alone()
    weighs = trades_off(problem.redundancy) and not solution.success
    found = [one for one in (free, *alone.values()) if one is not None and one.success]
    return Explanation(
        status=solution.status,
        position_error=solution.position_error,
        orientation_error=solution.orientation_error,
        limits=tuple(limits),
        pairs=pairs,
        blocked=blocked,
        is_reached_without=free is not None and free.success,
        is_unreachable_without=free is not None and free.status is Status.UNREACHABLE,
        starts_without=0 if free is None else free.restarts + 1,
        is_reached_within=any(question.is_within(one.q) for one in found) and not weighs,
        proof=solution.proof,
        is_compromise=weighs and question.solved_without([]).success,
        hints=solution.hints,
        scope=solution.scope,
        rows=rows,
        position_alone=position,
        is_stretched=is_stretched,
    )


def _of_broken_limits(solution: Solution, context: Context) -> Explanation:
    """Where no configuration keeps the limits nothing was minimised that others could hold up."""
    at = context.robot.at(solution.q)
    collisions = [(limit, limit.broken(at, "")) for limit in context.further if isinstance(limit, CollisionLimit)]
    broken = [
        BrokenLimit(name, amount, "m" if any(name in pairs for _, pairs in collisions) else "")
        for name, amount in solution.broken_limits.items()
    ]
    return Explanation(
        status=solution.status,
        position_error=solution.position_error,
        orientation_error=solution.orientation_error,
        limits=(),
        pairs=(),
        blocked=np.zeros(6),
        is_reached_without=False,
        is_unreachable_without=False,
        starts_without=0,
        is_reached_within=False,
        proof=None,
        is_compromise=False,
        hints=tuple(_touching_by_design(collisions, context)),
        broken=tuple(broken),
    )


def _touching_by_design(collisions: Sequence[tuple[CollisionLimit, dict[str, float]]], context: Context) -> list[str]:
    """What is behind pairs of links that are too near, and so in the middle of all joint ranges, if there are any."""
    at = context.robot.at(context.robot.middle)
    names = [
        name
        for limit, pairs in collisions
        for name in pairs.keys() & limit.broken(at, "").keys()
        if name.rpartition(" - ")[2] not in limit.obstacle_names
    ]
    if not names:
        return []
    pair, told = tuple(min(names).split(" - ")), " and ".join(sorted(names))
    return [
        f"{told} touch in the middle of all joint ranges too: if their shapes overlap by design, "
        f'allow it: by an SRDF (robot.with_srdf), CollisionLimit(allowed="sampled") or allowed=[{pair}].'
    ]


def _force(problem: Problem, poses: Poses, at: Configuration, solution: Solution) -> np.ndarray:
    """The gradient (n,) of what was minimised that limits hold up: at a lower one it is positive."""
    cost, wish = problem.costs(poses)
    if trades_off(wish):
        return cost.level(at).c + wish.weight * wish.objective.gradient(at)
    if not solution.success:
        return cost.level(at).c
    if wish is None:
        return np.zeros(at.n)
    robot, gradient, rows = problem.robot, wish.objectives[0].gradient(at), cost.rows(at)[0]
    held = (at.q <= robot.lower + ACTIVE_WITHIN) | (at.q >= robot.upper - ACTIVE_WITHIN)
    return gradient + rows.T @ multipliers(rows, gradient, held)


def _standing(
    poses: Poses, context: Context, solution: Solution, force: np.ndarray, least: float
) -> tuple[tuple[ActivePair, ...], tuple[ActiveRow, ...], np.ndarray]:
    """The pairs at their margin and the rows of other limits without room, the most costly first.

    And what they leave of the force (n,) to the joint limits. The multipliers are those, none negative, of pairs, rows
    and joint limits together that balance the force best; where the target is reached, of what of it is along the
    self-motion. Of pairs, or rows, that share a name the sum counts.
    """
    at = context.robot.at(solution.q)
    touching = [limit.touching(at) for limit in context.further if isinstance(limit, CollisionLimit)]
    further = [limit for limit in context.further if not isinstance(limit, CollisionLimit)]
    standing = [_rows(context.problem, limit, at) for limit in further]
    near = [pair for pairs, _ in touching for pair in pairs]
    named = [row for rows, _ in standing for row in rows]
    if not near and not named:
        return (), (), force
    gradients = np.vstack([gradients for _, gradients in (*touching, *standing)])
    held = _multipliers(gradients, poses, context, solution, force)
    costs: dict[str, float] = {}
    for (name, _), multiplier in zip((*near, *named), held, strict=True):
        costs[name] = costs.get(name, 0.0) + float(multiplier)
    costs = {name: cost if cost > least else 0.0 for name, cost in costs.items()}
    distances = {name: min(far for other, far in near if other == name) for name, _ in near}
    pairs = [ActivePair(name, distance, costs[name]) for name, distance in distances.items()]
    rows = [ActiveRow(name, costs[name], unit) for name, unit in dict(named).items()]
    by_cost = lambda one: -one.multiplier  # noqa: E731
    return tuple(sorted(pairs, key=by_cost)), tuple(sorted(rows, key=by_cost)), force - held @ gradients


def _rows(problem: Problem, limit: Limit, at: Configuration) -> tuple[list[tuple[str, str]], np.ndarray]:
    """`Limit.standing`, its rows called as the problem calls them."""
    rows, gradients = limit.standing(at)
    return [(problem.numbered(limit, name), unit) for name, unit in rows], gradients


def _multipliers(
    gradients: np.ndarray, poses: Poses, context: Context, solution: Solution, force: np.ndarray
) -> np.ndarray:
    """What of a force (n,) rows with gradients (k, n) hold up (k,), beside the joint limits."""
    robot, at = context.robot, context.robot.at(solution.q)
    lower, upper = at.q <= robot.lower + ACTIVE_WITHIN, at.q >= robot.upper - ACTIVE_WITHIN
    slopes = np.vstack([gradients, np.eye(at.n)[lower], -np.eye(at.n)[upper]])
    kept = np.eye(at.n)
    if solution.success:
        rows = context.problem.costs(poses)[0].rows(at)[0]
        kept -= np.linalg.pinv(rows) @ rows
    size = max(1.0, float(np.abs(force).max()))
    return nnls((slopes @ kept).T, kept @ force / size)[0][: len(gradients)] * size


@dataclass(frozen=True)
class _Question:
    """What was asked, to be asked again from where the solve had ended."""

    problem: Problem
    poses: Poses
    context: Context
    q: np.ndarray
    resolve: Resolve

    def solved_without(self, limits: list[str], gone: tuple[Limit, ...] = (), everywhere: bool = True) -> Solution:
        """The tasks solved from q (n,), without these joint limits; past them joints go no further than they must.

        Of the others without those that are `gone`. `everywhere`: where that fails, from as many starts as a solve.
        """
        robot, held = self.context.robot, np.full(len(self.q), OTHERS_COUNT)
        options = self.context.options
        restarts = max(options.max_restarts, Options().max_restarts)
        for name in limits:
            held[robot.joint_names.index(name.rsplit(" ", 1)[0])] = 1.0
        problem = Problem.build(
            robot.released(limits) if limits else robot,
            task=self.problem.tasks,
            limits=[limit for limit in self.context.further if not any(limit is one for one in gone)],
            redundancy=Strict(Posture(self.q, held)),
            options=replace(options, max_restarts=restarts if everywhere else 0, deadline=None),
        )
        return self.resolve(problem, {key: self.poses[key] for key in problem.target_keys}, self.q)

    def position_alone(self) -> tuple[float | None, bool]:
        """What is left of the position [m], 0 within its tolerance, where the orientation is free, and whether the arm
        is stretched out there: straight from a joint to the tool to the target. None for a task that is none of both.
        """
        task, robot = self.problem.tasks[0], self.context.robot
        if len(self.problem.tasks) > 1 or not isinstance(task, PoseTask) or not task.kept.all():
            return None, False
        target, options = task.toward(self.poses).target, self.context.options
        if self.context.further:  # each start takes milliseconds
            options = replace(options, max_restarts=min(options.max_restarts, FEW_STARTS))
        problem = Problem.build(
            robot,
            task=PositionTask(frame=task.frame, offset=task.offset),
            limits=self.context.further,
            options=replace(options, deadline=None),
        )
        (key,) = {task.key for task in problem.tasks}
        aims = {**self.poses, key: target}
        found = self.resolve(problem, {each: aims[each] for each in problem.target_keys}, self.q)
        if found.success:
            return 0.0, False
        straight = _is_straight(robot.at(found.q), task, target.translation, robot.moved_links)
        return found.position_error, straight

    def is_within(self, q: np.ndarray) -> bool:
        """Whether q (n,), which solves the tasks without some limits, keeps all of them."""
        robot, at = self.context.robot, self.context.robot.at(q)
        return bool(((robot.lower <= q) & (q <= robot.upper)).all()) and not self.context.broken(at)

    def beyond(self, limit: str, free: Solution) -> float | None:
        """How far beyond a limit [rad or m] the target is reached without it; None: it is not, or that far not."""
        joint, end = limit.rsplit(" ", 1)
        i, robot = self.context.robot.joint_names.index(joint), self.context.robot
        further = float(free.q[i] - robot.upper[i] if end == "upper" else robot.lower[i] - free.q[i])
        return further if free.success and further > 0 else None

    def way_to(self, q: np.ndarray) -> np.ndarray:
        """From the answer to q (n,), the frame's displacement (6,) in its own axes, for a task of a pose; else zero."""
        task, robot = self.problem.tasks[0], self.context.robot
        if len(self.problem.tasks) > 1 or not isinstance(task, FrameTask):
            return np.zeros(6)
        here = task.actual(robot.at(self.q))
        way = frame_error(here, task.actual(robot.at(q))).reshape(2, 3) @ here.rotation
        return (way * [[task.kept[:3].any()], [task.kept[3:].any()]]).ravel()


def _is_straight(at: Configuration, task: PoseTask, target: np.ndarray, joints: Sequence[str]) -> bool:
    """Whether the tool is as far as it can be from one of the joints, given by their links, and the target (3,) beyond.

    Tool and target are in line, as seen from there, and no joint brings the tool nearer, to first order.
    """
    tool = task.actual(at).translation
    way = (target - tool) / np.linalg.norm(target - tool)
    rates = way @ at.jacobian(task.frame, task.offset)[:3]
    seen = np.array([tool - at.placement(link).translation for link in joints])
    sizes = np.linalg.norm(seen, axis=1)
    return bool((seen @ way > STRAIGHT * sizes).any() and np.abs(rates).max() < (1 - STRAIGHT) * sizes.max())
