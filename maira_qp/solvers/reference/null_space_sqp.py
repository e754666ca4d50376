"""Optimise the redundancy once the pose is reached.

*Strict*: walk along the self-motion manifold. Each step is the hierarchy's: level 1 holds the pose, level 2 (3, ...)
moves in its null space by a Newton step of the objective, inside the limits and a trust region. The Hessian of level 2
is that of the Lagrangian, the objective's plus the pose's curvature times the multipliers, so that the walk converges
quadratically along a curved manifold too. After the step a few descents of the pose alone bring the arm back onto the
manifold; the step counts if the pose is within tolerance and the objective fell. The walk ends when the projected
gradient vanishes. (A feasible sequential quadratic programming method: Nocedal and Wright, "Numerical Optimization",
2006, chapter 18; for the manifold Luenberger, "The gradient projection method along geodesics", 1972.)

Levels of tasks are settled one by one: one that can be met joins the pose in what is held, one that cannot stays an
objective above those that follow.

*Weighted*: the optimum of `1/2 |W e|^2 + weight objective` lies within the order of the weight of the strict one, at
the end of a valley as narrow as the weight is small. So the arm first walks along the self-motion as above, and then
descends the weighted sum from there.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from maira_qp.problem.limits.joint import FEASIBILITY, Bounds, Limit, Tick
from maira_qp.problem.objectives import Objective
from maira_qp.problem.qp.costs import LevelObjective, TaskCost, WeightedCost, multipliers, strict_levels
from maira_qp.problem.qp.hierarchy import projected_gradient, solve_hierarchy
from maira_qp.problem.redundancy import Strict, Weighted
from maira_qp.problem.tasks.limit import LimitTask
from maira_qp.robots.model.configuration import Configuration
from maira_qp.solvers.reference.context import Context
from maira_qp.solvers.reference.levenberg_marquardt import Budget, descend
from maira_qp.solvers.reference.multi_start import stationarity

FIRST_RADIUS = 0.5
"""Trust region of the first step [rad or m]."""

LEAST_RADIUS = 1e-9
"""A walk whose steps must be shorter than this has stopped [rad or m]."""

RESTORING = 6
"""Iterations that a step may take to come back to the pose."""

REGAINING = 4
"""Times that a step may be brought back within bent limits, and from there onto the pose."""

RESTORED = 0.5e-22
"""The pose counts as regained when its cost `1/2 |W e|^2` is below this: an error of 1e-11."""

MET = 1e-12
"""A level of tasks whose cost is below this, errors of 1e-6, is met, and is held from there on as the pose is."""

SAME = 1e-12
"""Two values of a higher objective this near to each other leave the word to the next one."""

RESOLUTION = 1e-14
"""Two values of the last objective this near to each other cannot be told from rounding."""


@dataclass(frozen=True)
class Settled:
    """Where the redundancy was settled."""

    at: Configuration
    projected_gradient: float


def settle(
    redundancy: Weighted | Strict,
    cost: TaskCost,
    at: Configuration,
    context: Context,
    budget: Budget,
    reached: Callable[[Configuration], bool],
) -> Settled:
    """From a configuration that reaches the pose to the optimum of the redundancy near it."""
    objectives: tuple[Objective, ...] = redundancy.objectives
    settled = Settled(at, 0.0)
    cost, context = _wishes_held(cost, context)
    while objectives:
        met = _tasks_alone(objectives[0])
        settled = _Walk(cost, objectives if met is None else objectives[:1], context, budget, reached).run(settled.at)
        if met is None:
            break
        if met.value(settled.at) > MET:  # it stays an objective, and so do those below it
            settled = _Walk(cost, objectives, context, budget, reached).run(settled.at)
            break
        met, context = _wishes_held(met, context)
        cost, objectives = TaskCost((*cost.tasks, *met.tasks)), objectives[1:]
        settled = replace(settled, at=_restored(cost, settled.at, context, budget, reached) or settled.at)
    if not isinstance(redundancy, Weighted):
        return settled
    traded = _trade_off(WeightedCost(cost, redundancy.objective, redundancy.weight), settled.at, context, budget)
    if not redundancy.fading:
        return traded
    exact = _restored(cost, traded.at, context, budget, reached)
    return settled if exact is None else replace(traded, at=exact)


@dataclass(frozen=True)
class _Held(Limit):
    """A limit that was a wish, held to rounding: as a wish it has a tolerance, by far larger."""

    limit: Limit

    def rows(self, at: Configuration, tick: Tick | None) -> tuple[np.ndarray, np.ndarray] | None:
        """Those of the limit."""
        return self.limit.rows(at, tick)

    def violation(self, at: Configuration) -> float:
        """That of the limit, where it is more than rounding."""
        return max(0.0, self.limit.violation(at) - FEASIBILITY)

    @property
    def knows_curvature(self) -> bool:  # type: ignore[override]
        """If the limit does."""
        return self.limit.knows_curvature

    def curvature(self, at: Configuration, multipliers: np.ndarray) -> np.ndarray:
        """That of the limit (n, n)."""
        return self.limit.curvature(at, multipliers)


def _tasks_alone(objective: Objective) -> TaskCost | None:
    """The tasks of a level that has no objectives; None for what is no such level."""
    return objective.tasks if isinstance(objective, LevelObjective) and not objective.objectives else None


def _wishes_held(cost: TaskCost, context: Context) -> tuple[TaskCost, Context]:
    """The tasks without the limits among them, which are kept, and a context in which they are limits."""
    wishes = tuple(_Held(task.limit) for task in cost.tasks if isinstance(task, LimitTask))
    return (cost.without_wishes(), context.with_limits((*context.further, *wishes))) if wishes else (cost, context)


def _restored(
    cost: TaskCost, at: Configuration, context: Context, budget: Budget, reached: Callable[[Configuration], bool]
) -> Configuration | None:
    """The configuration brought back onto the pose; None where that fails."""
    end = descend(cost, at, context, budget, reached=lambda at: cost.value(at) <= RESTORED, max_iterations=RESTORING)
    return end.at if reached(end.at) else None


def _trade_off(cost: WeightedCost, at: Configuration, context: Context, budget: Budget) -> Settled:
    """Descend the weighted sum to where its gradient, in units of the objective, vanishes."""
    tolerance = context.options.stationarity_tolerance * min(1.0, cost.weight)
    end = descend(
        cost,
        at,
        context,
        budget,
        reached=lambda at: stationarity(cost, at, context) <= tolerance,
        max_iterations=context.options.max_settling,
    )
    return Settled(end.at, stationarity(cost, end.at, context))


@dataclass(frozen=True)
class _Walk:
    """A walk along the self-motion to the optimum of the objectives, in falling priority."""

    cost: TaskCost
    objectives: tuple[Objective, ...]
    context: Context
    budget: Budget
    reached: Callable[[Configuration], bool]

    def run(self, at: Configuration) -> Settled:
        """Steps until no objective can fall any more."""
        at = self._restored(at) or at
        radius = FIRST_RADIUS
        for _ in range(self.context.options.max_settling):
            if self._is_optimal(at) or self.budget.late():
                break
            dq = self._step(at, radius)
            trial = self._regained(self.context.moved(at, dq), at)
            if trial is not None and self._better(trial, at):
                radius = 2 * radius if np.abs(dq).max() > 0.9 * radius else radius
                at = trial
            else:
                radius = 0.25 * min(radius, float(np.abs(dq).max()))
                if radius < LEAST_RADIUS:
                    break
        return Settled(at, self._projected_gradient(at, 0))

    def _step(self, at: Configuration, radius: float) -> np.ndarray:
        """The hierarchy's displacement (n,) within the trust region.

        The multipliers depend on which limits hold the arm, and these on the step: it is taken twice where they differ.
        """
        limits = self.context.bounds(at)
        held = limits.held
        dq = self._step_with(held, at, limits.within(radius))
        holding = (dq <= limits.lower) | (dq >= limits.upper)
        return dq if np.array_equal(holding, held) else self._step_with(holding, at, limits.within(radius))

    def _step_with(self, held: np.ndarray, at: Configuration, bounds: Bounds) -> np.ndarray:
        """The displacement (n,) with the curvature that belongs to the joints `held` (n,) by their limits."""
        self.budget.iterations += 1
        pose, *below = strict_levels(self.cost.level(at), self.cost, self.objectives, at, held)
        if self.context.bends_by_formula:
            bend = self.context.curvature(at, below[0].c, pose.rows, by_formula=True)
            below[0] = replace(below[0], H=below[0].H + bend)
        regained = replace(pose, c=np.zeros_like(pose.c))  # to 1e-11: what is left is not worth a displacement
        dq = solve_hierarchy([regained, *below], bounds, self.context.backend)
        return np.zeros_like(at.q) if dq is None else dq

    def _regained(self, trial: Configuration, at: Configuration) -> Configuration | None:
        """A trial brought back onto the pose and within bent limits, kept as well as at a configuration; or None.

        Along a bent limit every step leaves it by the second order.
        """
        for _ in range(REGAINING):
            within = trial if self.context.keeps(trial, at) else self.context.robot.at(self.context.admitted(trial.q))
            back = self._restored(within)
            if back is None or self.context.keeps(back, at):
                return back
            trial = back
        return None

    def _restored(self, at: Configuration) -> Configuration | None:
        return _restored(self.cost, at, self.context, self.budget, self.reached)

    def _better(self, trial: Configuration, at: Configuration) -> bool:
        """The first objective to differ by more than rounding is lower in the trial, or, if none, its gradient is.

        Objectives are compared by their Lagrangians, so that what is left of the pose error does not count as gain.
        """
        rows, error = self.cost.rows(at)
        regained = self.cost.rows(trial)[1] - error
        held = self.context.bounds(trial).held
        last = len(self.objectives) - 1
        for k, objective in enumerate(self.objectives):
            before = objective.cost(at)
            gain = before - objective.cost(trial) + multipliers(rows, objective.gradient(at), held) @ regained
            if abs(gain) > (RESOLUTION if k == last else SAME) * (1 + abs(before)):
                return bool(gain > 0)
        return self._projected_gradient(trial, last) < self._projected_gradient(at, last)

    def _projected_gradient(self, at: Configuration, priority: int) -> float:
        """Largest entry of an objective's gradient that the limits, the pose and the objectives above leave free."""
        bounds = self.context.standing(at)
        above = strict_levels(self.cost.level(at), self.cost, self.objectives[:priority], at, bounds.held)
        return projected_gradient(self.objectives[priority].gradient(at), above, bounds, self.context.backend)

    def _is_optimal(self, at: Configuration) -> bool:
        tolerance = self.context.options.stationarity_tolerance
        return all(self._projected_gradient(at, k) <= tolerance for k in range(len(self.objectives)))
