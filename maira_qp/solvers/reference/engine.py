"""The reference engine of a solve: any tasks, any limits, any QP backend; and what the compiled engine leaves to it.

A search over starts reaches the tasks (multi_start.py, constraint_screening.py, levenberg_marquardt.py), the redundancy
is settled on the self-motion (null_space_sqp.py), and the verdict is read off a fresh forward kinematics of the
configuration that is returned.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from maira_qp.problem.problem import Problem
from maira_qp.problem.qp.costs import TaskCost, tasks_toward
from maira_qp.problem.redundancy import Strict, Weighted, trades_off
from maira_qp.problem.targets import Poses, Targets, poses_of, streams
from maira_qp.problem.tasks.limit import LimitTask
from maira_qp.results.solution import Solution
from maira_qp.results.status import status_of
from maira_qp.robots.model.configuration import Configuration
from maira_qp.solvers.limbs import search_limbs
from maira_qp.solvers.neighbourhood import TURNINGS, is_closer, turned
from maira_qp.solvers.reference.context import Context
from maira_qp.solvers.reference.levenberg_marquardt import Budget, Descent
from maira_qp.solvers.reference.multi_start import (
    Reached,
    Search,
    better_of,
    follow,
    found_by_kernel,
    nearest,
    stationarity,
)
from maira_qp.solvers.reference.null_space_sqp import settle

if TYPE_CHECKING:
    from maira_qp.solvers.certificates import Proofs
    from maira_qp.solvers.compiled.engine import Compiled

Accepts = Callable[[np.ndarray], bool] | None
"""A test of configurations (n,) that reach the tasks; None: all are accepted"""

TOGETHER = 30
"""Restarts of the search for a configuration that meets the tasks of all levels at once: then no level has to yield."""


@dataclass(frozen=True)
class ReferenceEngine:
    """The context of a problem, and the compiled engine where it helps."""

    context: Context
    compiled: Compiled | None = None
    """Searches in compiled code, where it can"""
    screening: Compiled | None = None
    """Knows all but the further limits, where that is what is missing"""
    of_tip: Problem | None = None
    """The same problem with an offset as a tool; None: it has no offset"""

    @property
    def problem(self) -> Problem:
        """What is solved."""
        return self.context.problem

    def solve(
        self,
        targets: Targets,
        q0: np.ndarray | None,
        seed: np.ndarray,
        observe: Callable[[np.ndarray], object] | None = None,
    ) -> Solution:
        """Search, then settle and judge."""
        problem, poses, rows = self.problem, targets.poses(), targets.rows
        budget = Budget(problem.options.deadline, observe)
        cost, wish = problem.costs(poses)
        reached = self.reached(cost)
        if q0 is None and not problem.tasks:  # nothing is to be reached: what is left is settled from the middle
            q0 = problem.robot.middle
        start = None if q0 is None else self.context.admitted(q0)
        begin = self._posture_asked_for(cost) if start is None else start
        stream = streams(rows, seed)
        rng = lambda: np.random.default_rng(int(stream[0]))  # noqa: E731
        found, sought = None, cost
        if len(problem.hierarchy.all_tasks) > len(problem.tasks):
            everything = tasks_toward(problem.hierarchy.all_tasks, poses)
            together = search_limbs(everything, begin, self.context, budget, rng, self.reached, TOGETHER)
            if start is not None and together.left and together.best.reached:
                found = self._met_nearby(cost, everything, wish, start, budget)
            if found is None and together.best.reached:
                found, sought = together, everything
        if found is None and self.compiled is not None and observe is None and self.compiled.takes(start):
            found = self.compiled.search(rows[0, 0], start, stream, bool(seed.any()), budget)
        elif found is None and self.screening is not None and observe is None:
            found = self._screened(cost, start, rows[0, 0], budget, rng(), reached)
        elif found is None:
            hopeless = lambda: self._is_hopeless(poses)  # noqa: E731
            found = search_limbs(cost, begin, self.context, budget, rng, self.reached, is_hopeless=hopeless)
        if start is None:
            found = replace(found, left=False)
        is_felt_below = sought is cost and bool(problem.hierarchy.lower)
        if start is None and (problem.posture is not None or not is_felt_below):
            found = replace(found, best=self._unwound(found.best, sought))
        return self._finish(found, cost, wish, reached, budget, rows[0], q0, start)

    def _posture_asked_for(self, cost: TaskCost) -> np.ndarray | None:
        """Where to begin without a start (n,), if all configurations within limits are as good: at the posture."""
        posture = self.problem.posture
        if posture is None or not all(task.is_wish for task in cost.tasks):
            return None
        return self.context.admitted(posture.q_ref)

    def _met_nearby(
        self, cost: TaskCost, everything: TaskCost, wish: Weighted | Strict | None, start: np.ndarray, budget: Budget
    ) -> Search | None:
        """From a start to the first level and from there to those below it, if that meets the tasks of all levels."""
        near = follow(cost, self.context.robot.at(start), self.context, budget, self.reached(cost))
        if not near.reached or wish is None:
            return None
        settled = settle(wish, cost, near.end.at, self.context, budget, self.reached(cost))
        return Search(near.end, 0) if self.reached(everything)(settled.at) else None

    def _screened(
        self,
        cost: TaskCost,
        start: np.ndarray | None,
        row: np.ndarray,
        budget: Budget,
        rng: np.random.Generator,
        reached: Reached,
    ) -> Search:
        """Within further limits: from the start, where there is one, and then by screening."""
        from maira_qp.solvers.constraint_screening import screen  # heavy: Numba comes with it

        assert self.screening is not None
        near = None
        if start is not None:
            near = follow(cost, self.context.robot.at(start), self.context, budget, reached)
            if near.reached or budget.late():
                return Search(near.end, 0, False, near.left, near.steady)
        found = screen(self.screening, row, cost, self.context, budget, rng, reached, start)
        return found if near is None else better_of(near, found, cost, self.context, budget, reached)

    def _unwound(self, best: Descent, sought: TaskCost) -> Descent:
        """The same with each joint at the whole turn nearest to the posture, or to the middle, if it reaches what was
        sought there."""
        turns = self.problem.turns
        if not turns.everywhere.any():
            return best
        at = self.context.robot.at(turns.within(best.at.q[None])[0])
        is_there = best.reached and self.reached(sought)(at) and not self.context.broken(at)
        return Descent(at, sought.value(at), True) if is_there else best

    def finish(
        self, q: np.ndarray, outcome: Sequence[float], target: np.ndarray, q0: np.ndarray | None = None
    ) -> Solution:
        """From what the compiled search for a target (K, 12) from q0 left in q (n,) and outcome (9,)."""
        cost, wish = self.problem.costs(poses_of(self.problem.target_keys, target))
        found = found_by_kernel(self.context.robot, q, outcome)
        budget = Budget(None, iterations=int(outcome[2]))
        start = None if q0 is None else self.context.robot.clip(q0)
        return self._finish(found, cost, wish, self.reached(cost), budget, target, q0, start)

    @cached_property
    def _proofs(self) -> Proofs | None:
        from maira_qp.solvers.certificates import Proofs  # heavy: Numba comes with it

        return Proofs.build(self.of_tip or self.problem) if self.compiled is None else self.compiled.proofs

    def _is_hopeless(self, poses: Poses) -> bool:
        """It is proved that the target cannot be reached."""
        return self._proofs is not None and self._proofs.proof(poses) is not None

    def settled_from(self, q: np.ndarray, target: np.ndarray, q0: np.ndarray | None, accepts: Accepts) -> Solution:
        """From q (n,) that reaches a target (K, 12), with steps that stay accepted: the redundancy's optimum."""
        cost, wish = self.problem.costs(poses_of(self.problem.target_keys, target))
        at, start = self.context.robot.at(q), None if q0 is None else self.context.robot.clip(q0)
        found = Search(Descent(at, cost.value(at), True), 0)
        return self._finish(found, cost, wish, self.reached(cost, accepts), Budget(None), target, q0, start)

    def reached(self, cost: TaskCost, accepts: Accepts = None) -> Reached:
        """Whether a configuration counts as there: tasks within their tolerances, limits kept, those of tasks too.

        And `accepts` accepts it, if it is given.
        """
        wishes = [task for task in cost.tasks if isinstance(task, LimitTask)]

        def reached(at: Configuration) -> bool:
            is_there = bool(self.problem.is_reached(*residual(cost, at))) and not self.context.broken(at)
            is_kept = is_there and all(wish.is_kept(at) for wish in wishes)
            return is_kept and (accepts is None or accepts(at.q))

        return reached

    def _refined(
        self, best: Descent, cost: TaskCost, wish: Weighted | Strict | None, reached: Reached, budget: Budget
    ) -> tuple[Configuration, float]:
        """The redundancy's optimum or the nearest point, from the best of a search, and its projected gradient."""
        if best.broken:  # nothing was minimised but what is broken
            return best.at, math.nan
        if not best.reached:
            at = nearest(cost, best, self.context, budget).at
            return at, stationarity(cost, at, self.context)
        if wish is None:
            return best.at, math.nan
        settled = settle(wish, cost, best.at, self.context, budget, reached)
        return settled.at, settled.projected_gradient

    def _refined_at_turns(
        self,
        best: Descent,
        cost: TaskCost,
        wish: Weighted | Strict | None,
        reached: Reached,
        budget: Budget,
        start: np.ndarray | None,
    ) -> tuple[Configuration, float]:
        """The same with joints at the whole turns nearest to a start (n,), or without to the posture wished for."""
        near = self.problem.turns.aim if start is None else start
        costs = [cost.value, *(objective.cost for objective in (() if wish is None else wish.objectives))]
        at, gradient = self._refined(best, cost, wish, reached, budget)
        for _ in range(TURNINGS):
            nearer = turned(at, near, self.context, costs)
            if nearer is at or (reached(at) and not reached(nearer)):
                break
            best = replace(best, at=nearer, cost=cost.value(nearer))  # limits that held joints up may be a turn away
            at, gradient = self._refined(best, cost, wish, reached, budget)
        return at, gradient

    def _finish(
        self,
        found: Search,
        cost: TaskCost,
        wish: Weighted | Strict | None,
        reached: Reached,
        budget: Budget,
        target: np.ndarray,
        q0: np.ndarray | None,
        start: np.ndarray | None,
    ) -> Solution:
        """From what the search found: the redundancy's optimum or the nearest point, and the verdict.

        `start` (n,) is q0 (n,) within the limits.
        """
        context, tolerance = self.context, self.context.options.stationarity_tolerance
        at, gradient = self._refined_at_turns(found.best, cost, wish, reached, budget, start)
        near = found.near if trades_off(wish) else None
        if near is not None and not is_closer(cost.value(at), near.cost, cost, context.options):
            found = replace(found, best=near, left=False)  # what it was left for is no better once traded off
            at, gradient = self._refined_at_turns(near, cost, wish, reached, budget, start)
        fresh = self.context.robot.at(self.context.robot.clip(at.q))
        success = reached(fresh)
        position, orientation = residual(cost, fresh)
        optimal = gradient <= tolerance or (success and wish is None)
        return Solution(
            q=fresh.q.copy(),
            success=success,
            status=status_of(
                reached=success, breaks_limits=context.broken(fresh) > 0, proved=found.proved, stationary=optimal
            ),
            position_error=position,
            orientation_error=orientation,
            iterations=budget.iterations,
            restarts=found.restarts,
            cost=_objective_cost(wish, fresh),
            projected_gradient=gradient,
            optimal=optimal,
            start_projected=start is not None and bool((start != q0).any()),
            target_deviation=0.0,
            left_q0=found.left,
            backend=self.context.backend.name if self.compiled is None else "compiled",
            _start=None if q0 is None else q0.copy(),
            _target=target,
        )


def _objective_cost(wish: Weighted | Strict | None, at: Configuration) -> float:
    return math.nan if wish is None else wish.objectives[0].cost(at)


def residual(cost: TaskCost, at: Configuration) -> tuple[float, float]:
    """The largest position error [m] and orientation error [rad] of all tasks."""
    residuals = [task.residual(at) for task in cost.tasks]
    return max((r[0] for r in residuals), default=0.0), max((r[1] for r in residuals), default=0.0)
