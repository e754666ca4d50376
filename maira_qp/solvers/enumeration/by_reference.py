"""Solutions of any tasks of any robot, within any limits: descents of the reference engine from random starts.

As `exhaustive_multi_start`, with less patience, since each descent takes milliseconds. Where the tasks fix all joints,
solutions are isolated, and their whole turns are further ones; else each descent is settled at the optimum of the
objective, below the tasks of lower levels, and the list holds these.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from maira_qp.problem.objectives import Objective, Posture
from maira_qp.problem.qp.costs import TaskCost
from maira_qp.problem.redundancy import Strict
from maira_qp.problem.targets import Targets, streams
from maira_qp.results.solution_set import ListedSolution, Solutions
from maira_qp.robots.model.configuration import Configuration
from maira_qp.robots.model.revolutions import WholeTurns
from maira_qp.robots.model.robot import drawn
from maira_qp.solvers.enumeration.exhaustive_multi_start import multi_start
from maira_qp.solvers.reference.context import Context
from maira_qp.solvers.reference.engine import ReferenceEngine, residual
from maira_qp.solvers.reference.levenberg_marquardt import Budget
from maira_qp.solvers.reference.multi_start import attempt_from, random_start
from maira_qp.solvers.reference.null_space_sqp import settle

BATCH, PATIENCE, PATIENCE_EACH, MOST_STARTS = 16, 48, 6, 768
"""As those of `exhaustive_multi_start`."""
APART, SETTLED_APART = 1e-5, 1e-2
"""As those of `all_solutions`."""
EXACT = 1e-10
"""Errors [m, rad] at which descents end, so that solutions can be told apart."""
SAMPLES, WITHIN = 8, 1e-9
"""Configurations at which the rank of the tasks is looked at, and the ratio of singular values that counts as 0."""
NUMERICAL = "descents from random starts prove nothing"


@dataclass(frozen=True)
class ReferenceEnumeration:
    """The solutions for one target."""

    context: Context
    targets: Targets
    objective: Objective
    """What they are ranked by, made for the robot"""
    seed: np.ndarray
    """(2,) of what is random"""
    most: int
    """Solutions at most, but one of all that differ by whole turns alone"""

    def solutions(self, start: np.ndarray | None) -> Solutions:
        """The list, from a start (n,) and random ones."""
        robot, turns = self.context.robot, self.turns
        first = np.empty((0, robot.n)) if start is None else robot.clip(start)[None]
        resolution = APART if self.is_isolated else SETTLED_APART
        patience = BATCH, PATIENCE, PATIENCE_EACH, MOST_STARTS
        found = multi_start(self._arrivals, self._draw, turns.apart, resolution, first, *patience)
        q = found.q
        if self.is_isolated:
            q = turns.all_within(q, self.most)[0] if len(q) else q
            q = np.reshape([each for each in q if self._reached(robot.at(each))], (-1, robot.n))
        listed = [self._listed(each) for each in q]
        ranked = tuple(sorted(listed, key=lambda one: one.cost))
        return Solutions(ranked, "numerical", False, found.starts, found.without_new, NUMERICAL)

    @cached_property
    def _cost(self) -> TaskCost:
        return self.context.problem.costs(self.targets.poses())[0]

    @cached_property
    def _wish(self) -> Strict:
        """The levels below the first, the objective the last of them."""
        wish = self.context.problem.with_redundancy(Strict(self.objective)).costs(self.targets.poses())[1]
        assert isinstance(wish, Strict)
        return wish

    @cached_property
    def _exact(self) -> Context:
        options = {"position_tolerance": EXACT, "orientation_tolerance": EXACT}
        return replace(self.context, problem=self.context.problem.with_options(**options))

    @cached_property
    def turns(self) -> WholeTurns:
        """Counted to stay near the posture that is preferred, or the middle of the limits."""
        robot, objective = self.context.robot, self.objective
        return WholeTurns(robot, objective.q_ref if isinstance(objective, Posture) else robot.middle)

    @cached_property
    def is_isolated(self) -> bool:
        """The tasks fix all joints that move, singular configurations aside."""
        robot = self.context.robot
        moving = robot.lower < robot.upper
        for q in drawn(np.random.default_rng(0), *self.turns.window, SAMPLES):
            A = self._cost.rows(robot.at(q))[0][:, moving]
            if np.linalg.matrix_rank(A, tol=WITHIN * max(float(np.abs(A).max(initial=0.0)), 1e-300)) == moving.sum():
                return True
        return False

    @cached_property
    def _rng(self) -> np.random.Generator:
        return np.random.default_rng(int(streams(self.targets.rows, self.seed)[0]))

    def _draw(self, count: int) -> np.ndarray:
        """Random starts (count, n)."""
        budget = Budget(None)
        return np.array([random_start(self._cost, self.context, self._rng, budget).q for _ in range(count)])

    def _reached(self, at: Configuration) -> bool:
        return ReferenceEngine(self.context).reached(self._cost)(at)

    def _arrivals(self, starts: np.ndarray) -> np.ndarray:
        """Where starts (N, n) lead, (N, n); NaN for those that lead nowhere."""
        return np.reshape([self._arrival(start) for start in starts], starts.shape)

    def _arrival(self, start: np.ndarray) -> np.ndarray:
        context, budget, nowhere = self._exact, Budget(None), np.full(len(start), np.nan)
        exactly = ReferenceEngine(context).reached(self._cost)
        begin = context.robot.at(context.admitted(start))
        at = attempt_from(begin, self._cost, context, budget, exactly).at
        if not self._reached(at):
            return nowhere
        turned = self.turns.within(at.q[None])
        if len(turned) and self._reached(context.robot.at(turned[0])):
            at = context.robot.at(turned[0])
        if self.is_isolated:
            return at.q
        return settle(self._wish, self._cost, at, self.context, budget, self._reached).at.q

    def _listed(self, q: np.ndarray) -> ListedSolution:
        at = self.context.robot.at(q)
        names, free = self.context.robot.joint_names, self.context.problem.left_free
        errors = residual(self._cost, at)
        return ListedSolution(at.q.copy(), self.objective.cost(at), *errors, joint_names=names, left_free=free)
