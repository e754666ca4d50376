"""Reach the pose: descents from the caller's start and then from random ones, until one arrives.

Attempt 0 starts at q0, and its answer stands unless there is a better one elsewhere: see `neighbourhood`. Every other
start is the best of a few random configurations by its cost, which costs as little
as forward kinematics and saves whole descents (multi-start local search; compare Beeson and Ames, "TRAC-IK", Humanoids
2015). An attempt that stalls is left early: many short attempts find more than few long ones.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from maira_qp.problem.qp.costs import Cost, ExactTaskCost, TaskCost
from maira_qp.problem.qp.hierarchy import Level, convexified, projected_gradient
from maira_qp.problem.qp.qp import QP
from maira_qp.robots.model.configuration import Configuration
from maira_qp.robots.model.robot import Robot
from maira_qp.solvers.neighbourhood import (
    NEAR,
    NEAR_BY_ERROR,
    SHORT_STEP,
    displacement,
    is_closer,
    starts_beside,
    turned,
)
from maira_qp.solvers.reference.context import Context
from maira_qp.solvers.reference.levenberg_marquardt import Budget, Descent, Stall, descend

log = logging.getLogger(__name__)

Reached = Callable[[Configuration], bool]
"""Whether a configuration is what a search looks for."""

HEAD = 64
"""After so many restarts without success it is worth a few milliseconds to see whether the target is out of reach."""

PLACING = 1e-9
"""Regularisation of the problem that places slides, relative to its Hessian."""

DRAWS = 5
"""Times that candidates for a start are drawn before one outside limits that are not linear is taken."""


@dataclass(frozen=True)
class Search:
    """The best that was found, and after how many restarts."""

    best: Descent
    restarts: int
    proved: bool = False
    """That nothing reaches the target is proved."""
    left: bool = False
    """It is from another start than the one that was given."""
    near: Descent | None = None
    """Where what it left had ended, if that is known."""


def found_by_kernel(robot: Robot, q: np.ndarray, outcome: Sequence[float]) -> Search:
    """What `kernels.search.multi_start` left in q (n,) and outcome (9,)."""
    best = Descent(robot.at(q), float(outcome[3]), outcome[0] > 0.0)
    return Search(best, int(outcome[1]), outcome[0] < 0.0, outcome[8] > 0.0)


def search(
    cost: TaskCost,
    q0: np.ndarray | None,
    context: Context,
    budget: Budget,
    rng: Callable[[], np.random.Generator],
    reached: Callable[[Configuration], bool],
    max_restarts: int | None = None,
    is_hopeless: Callable[[], bool] | None = None,
) -> Search:
    """Descend from q0 (None: from a random start) and from random starts until `reached` or out of restarts or time.

    `rng` makes the target's random stream when it is first needed. `max_restarts` None: that of the options.
    `is_hopeless` is asked once, after `HEAD` restarts or the last: whether the target is proved to be out of reach.
    """
    options = context.options
    last = options.max_restarts if max_restarts is None else min(max_restarts, options.max_restarts)
    near = None if q0 is None else follow(cost, context.robot.at(q0), context, budget, reached)
    found = None
    if near is not None and last > 0 and (near.wandered or not near.reached) and not budget.late():
        found = _search_beside(cost, near.start, context, budget, reached, last)
        if near.reached:
            if found is not None and near.is_beyond(found.best):
                return Search(found.best, 0)
            return Search(near.end, 0, False, near.left, near.steady)
    if found is None and (near is None or not (near.reached or last == 0 or budget.late())):
        found = _search_anywhere(cost, near is not None, last, context, budget, rng, reached, is_hopeless)
    if near is None:
        assert found is not None
        return found
    if found is None:
        proved = not (near.reached or budget.late()) and is_hopeless is not None and is_hopeless()
        return Search(near.end, 0, proved, near.left, near.steady)
    return better_of(near, found, cost, context, budget, reached)


def _search_anywhere(
    cost: TaskCost,
    begun: bool,
    last: int,
    context: Context,
    budget: Budget,
    rng: Callable[[], np.random.Generator],
    reached: Callable[[Configuration], bool],
    is_hopeless: Callable[[], bool] | None,
) -> Search:
    """Descents from random starts, the attempts 0, ..., last; 1, ... where the search has `begun`."""
    stream, best, attempt = rng(), None, int(begun)
    while True:
        descent = attempt_from(random_start(cost, context, stream, budget), cost, context, budget, reached)
        if descent.is_better_than(best):
            best = descent
        late = budget.late()
        shut_out = descent.broken > 0.0  # no random start could be brought within
        over = attempt == last or late or shut_out
        asks = not (descent.reached or late) and (attempt == HEAD or (over and attempt < HEAD))
        proved = asks and is_hopeless is not None and is_hopeless()
        if descent.reached or over or proved:
            assert best is not None
            log.debug("search: reached=%s after %d restarts, cost %.3g", best.reached, attempt, best.cost)
            return Search(best, attempt, proved)
        attempt += 1


def _search_beside(
    cost: TaskCost,
    start: Configuration,
    context: Context,
    budget: Budget,
    reached: Callable[[Configuration], bool],
    last: int,
) -> Search | None:
    """Of what descents from around a start reach the nearest to it; None where none of them arrives."""
    found, moves = None, context.sampling_range[0] < context.sampling_range[1]
    for k, beside in enumerate(starts_beside(context.robot, start.q[None])[0]):
        if budget.late():
            break
        q = np.where(moves, beside, start.q)
        end = attempt_from(context.robot.at(context.admitted(q)), cost, context, budget, reached)
        end = replace(end, at=turned(end.at, start.q, context, [cost.value]))
        nearer = found is None or displacement(end.at.q, start.q) < displacement(found.best.at.q, start.q)
        if end.reached and nearer:
            found = Search(end, min(k + 1, last))
    return found


@dataclass(frozen=True)
class Followed:
    """Where the descent from a start leads."""

    start: Configuration
    end: Descent
    wandered: bool
    """It moved a joint further than its first error asks for."""
    steady: Descent | None = None
    """Where it ends in short steps, if it ends elsewhere, where it is better by more than the tolerances"""

    @property
    def left(self) -> bool:
        """It ends elsewhere than in short steps."""
        return self.steady is not None

    def is_beyond(self, other: Descent) -> bool:
        """It ends further away than another one."""
        return displacement(self.end.at.q, self.start.q) > displacement(other.at.q, self.start.q)

    @property
    def reached(self) -> bool:
        """To the pose."""
        return self.end.reached


def follow(
    cost: TaskCost,
    start: Configuration,
    context: Context,
    budget: Budget,
    reached: Callable[[Configuration], bool],
) -> Followed:
    """From a start to the pose or a nearest point; where that wanders, in short steps if they end nearer, as well."""
    end, _ = _followed(cost, start, context, budget, reached, np.inf)
    far = displacement(end.at.q, start.q)
    expected = NEAR_BY_ERROR * (2 * cost.value(start)) ** 0.25 if end.reached else 0.0
    if far <= max(NEAR, expected) or end.broken or budget.late():
        return Followed(start, end, far > NEAR and not end.reached)
    steady, is_stationary = _followed(cost, start, context, budget, reached, SHORT_STEP)
    nearer = displacement(steady.at.q, start.q) < far
    if steady.reached and (nearer or not end.reached):
        return Followed(start, steady, displacement(steady.at.q, start.q) > NEAR)
    closer = is_closer(end.cost, steady.cost, cost, context.options)
    leaves = end.reached or closer
    taken = end if leaves or not is_stationary else steady
    return Followed(start, taken, True, steady if leaves and is_stationary else None)


def _followed(
    cost: TaskCost,
    start: Configuration,
    context: Context,
    budget: Budget,
    reached: Callable[[Configuration], bool],
    longest: float,
) -> tuple[Descent, bool]:
    """The descent from a start in steps of at most `longest`, to a nearest point, and whether that is stationary."""
    stalls = longest == np.inf
    end = attempt_from(start, cost, context, budget, reached, longest, stalls)
    is_stationary = False
    if not (end.reached or end.broken):
        near = nearest(cost, end, context, budget, longest)
        end, is_stationary = replace(near, reached=reached(near.at)), near.reached
    at = turned(end.at, start.q, context, [cost.value])
    return replace(end, at=at), is_stationary


def better_of(
    near: Followed,
    found: Search,
    cost: TaskCost,
    context: Context,
    budget: Budget,
    reached: Callable[[Configuration], bool],
) -> Search:
    """Where the descent from a start ended short of the pose, unless what was found elsewhere is worth leaving for."""
    best = found.best
    if not (best.reached or best.broken):
        end = nearest(cost, best, context, budget)
        best = replace(end, reached=reached(end.at))
    if near.end.broken or best.broken:
        leaves = best.is_better_than(near.end)
    else:
        leaves = best.reached or is_closer(best.cost, near.end.cost, cost, context.options)
    if leaves:
        at = turned(best.at, near.start.q, context, [cost.value])
        return Search(replace(best, at=at), found.restarts, found.proved, True, near.end)
    return Search(near.end, found.restarts, found.proved, near.left, near.steady)


def attempt_from(
    start: Configuration,
    cost: TaskCost,
    context: Context,
    budget: Budget,
    reached: Callable[[Configuration], bool],
    longest: float = np.inf,
    stalls: bool = True,
) -> Descent:
    """One descent in steps of at most `longest` [rad or m], given up where it stalls.

    None from outside the limits, where nothing is near that keeps them.
    """
    broken = context.broken(start)
    if broken:
        return Descent(start, cost.value(start), False, broken)
    options = context.options
    return descend(
        cost,
        start,
        context,
        budget,
        reached=reached,
        max_iterations=options.max_iterations,
        stall=Stall(options.stall_steps, options.stall_ratio if stalls else 0.0),
        longest=longest,
    )


def random_start(cost: TaskCost, context: Context, stream: np.random.Generator, budget: Budget) -> Configuration:
    """The best by cost of a few random configurations within the limits.

    What is drawn outside limits that are not linear is brought within them only where nothing is drawn inside, one
    after the other and the best by cost first; where so many draws lead to none, what breaks them least is taken.
    """
    robot, least = context.robot, None
    for _ in range(DRAWS if context.is_bent else 1):
        drawn = [placed(cost, context, context.random_start(stream)) for _ in range(context.options.start_candidates)]
        if not context.is_bent:
            return min((robot.at(context.admitted(q)) for q in drawn), key=cost.value)
        candidates = [robot.at(q) for q in drawn]
        within = [at for at in candidates if not context.broken(at)]
        if within:
            return min(within, key=cost.value)
        for outside in sorted(candidates, key=cost.value):
            at = robot.at(context.admitted(outside.q))
            if not context.broken(at):
                return at
            least = at if least is None else min(least, at, key=context.broken)
            if budget.late():
                return least
    assert least is not None
    return least


def placed(cost: TaskCost, context: Context, q: np.ndarray) -> np.ndarray:
    """The configuration (n,) with its long slides where the cost is least, see `kernels.search.seeds.place_slides`."""
    slides = context.long_slides
    if not slides.any():
        return q
    robot, level = context.robot, cost.level(context.robot.at(q))
    H, c, k = level.H[np.ix_(slides, slides)], level.c[slides], int(slides.sum())
    size = max(float(np.abs(H).max()), np.finfo(float).tiny)
    box = robot.lower[slides] - q[slides], robot.upper[slides] - q[slides]
    step = context.backend.solve(QP(H / size + PLACING * np.eye(k), c / size, *box, np.empty((0, k)), np.empty(0)))
    q = q.copy()
    q[slides] += step.x if step.found else 0.0
    return robot.clip(q)


def nearest(cost: TaskCost, descent: Descent, context: Context, budget: Budget, longest: float = np.inf) -> Descent:
    """From where a search ended short of the pose, Newton's method to the stationary point of the true error.

    `reached` of the result says that it is stationary: the projected gradient is below its tolerance.
    """
    return descend(
        _WithinLimits(cost, context),
        descent.at,
        context,
        budget,
        reached=lambda at: stationarity(cost, at, context) <= context.options.stationarity_tolerance,
        max_iterations=context.options.max_settling,
        longest=longest,
    )


@dataclass(frozen=True)
class _WithinLimits:
    """The tasks alone, with the exact Hessian of their Lagrangian where limits that are not linear hold them up."""

    tasks: TaskCost
    context: Context

    def value(self, at: Configuration) -> float:
        """That of the tasks."""
        return self.tasks.value(at)

    def gradient(self, at: Configuration) -> np.ndarray:
        """That of the tasks (n,)."""
        return self.tasks.gradient(at)

    def level(self, at: Configuration) -> Level:
        """Newton, its Hessian made positive by the size of its eigenvalues."""
        model = self.tasks.level(at)
        H = ExactTaskCost(self.tasks).hessian(at) + self.context.curvature(at, model.c)
        return replace(model, H=convexified(H))


def stationarity(cost: Cost, at: Configuration, context: Context) -> float:
    """Largest entry of the cost's gradient that no limit holds up, relative to the error where that is large."""
    level = cost.level(at)
    left = projected_gradient(level.c, (), context.standing(at), context.backend)
    return left / max(1.0, float(np.sqrt(level.squared_error)))
