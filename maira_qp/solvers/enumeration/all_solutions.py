"""Every solution for a pose: in closed form where the arm has one, else by exhaustive multi-start.

*S-R-S arms*: arcs of the swivel angle with the best configuration of each (`self_motion`). *Arms of six joints that
EAIK decomposes* (`decomposition`): its branches, each brought onto the pose by a descent, for EAIK rounds what is
nearly parallel or nearly meets. *All others*: `multi_start`. Descents go on to the last digits, so that solutions can
be told apart.

Branches may be lost to rounding, so a list of them is called complete only if each is clearly a solution, and regular,
or clearly none; if they are in balance: forward kinematics is a map of degree zero from the torus of all angles, so the
signs of `det J` over all solutions of a regular pose, limits aside, sum to zero; and if descents from random starts
find no other. A pose without any branch has to be proved out of reach.

Within further limits those of isolated solutions are listed that keep them; of an S-R-S arm's arcs the pieces that do
(`arcs_within`); of other redundant arms, and for other tasks and robots, what the reference engine finds
(`by_reference`).

Where the rank of the Jacobian is the number of joints that move, solutions are isolated, singular poses aside, and each
whole turn of a joint that fits between its limits makes one of its own. Where more move they form a continuum: each
descent is settled at the optimum of the objective that its self-motion leads to, and the list holds these optima; of
those that differ by whole turns alone it holds the one nearest to the posture that is preferred, or to the middle of
the limits. An objective that the kernels do not know takes long to settle: that is done from the optima of `Posture()`
alone.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from maira_qp.analytic.eaik import Decomposition
from maira_qp.analytic.srs.arcs import Arc
from maira_qp.analytic.srs.geometry import SRS
from maira_qp.analytic.srs.optimum import best, best_of_each_arc
from maira_qp.kernels.layout import Outcome
from maira_qp.problem.objectives import Objective, Posture
from maira_qp.problem.problem import Problem
from maira_qp.problem.qp.costs import TaskCost
from maira_qp.problem.redundancy import Strict
from maira_qp.problem.targets import Targets, row_of, streams
from maira_qp.problem.tasks.frame import PoseTask
from maira_qp.results.solution_set import ListedSolution, Solutions
from maira_qp.robots.model.configuration import Configuration
from maira_qp.robots.model.revolutions import WholeTurns
from maira_qp.robots.model.robot import Robot, drawn
from maira_qp.solvers.compiled.multi_start import descend, placed
from maira_qp.solvers.compiled.problem_arrays import ProblemArrays, unsupported
from maira_qp.solvers.compiled.refinement import refined
from maira_qp.solvers.enumeration.arcs_within import APART as APART_ON_ARCS
from maira_qp.solvers.enumeration.arcs_within import best_of_each_piece
from maira_qp.solvers.enumeration.by_reference import ReferenceEnumeration
from maira_qp.solvers.enumeration.exhaustive_multi_start import multi_start, new_among
from maira_qp.solvers.reference.context import Context
from maira_qp.solvers.reference.levenberg_marquardt import Budget
from maira_qp.solvers.reference.null_space_sqp import settle

RANK_SAMPLES, RANK_WITHIN = 8, 1e-9
"""Configurations at which the rank of the Jacobian is looked at, and the ratio of singular values that counts as 0."""
CHECKS = 128
"""Descents from random starts that a list of branches is checked with."""
MOST = 4096
"""Solutions of a list at most, those included that differ by whole turns."""
APART, SETTLED_APART = 1e-5, 1e-2
"""Solutions no joint of which differs by more [rad or m] are the same; and optima, known to their flatness alone."""
ROUNDED = 1e-3
"""A branch beyond a limit by at most this [rad] may be within it: EAIK rounds an arm to one that it can decompose."""
MEETS, MISSES = 1e-6, 1e-3
"""A branch with an error [m, rad] below the first reaches the pose, above the second it does not: else none knows."""
REGULAR = 1e-3
"""Where the Jacobian's singular values have a smaller ratio, a neighbour of a branch may have been lost to rounding."""

NUMERICAL = "descents from random starts prove nothing"
LOST = "descents found solutions that the closed form had lost, and there may be more"
PIECES = f"further limits are looked at at samples, {APART_ON_ARCS:g} rad apart: what is narrower may be missed"
TOO_MANY_TURNS = "of the whole turns within the limits only the nearest are listed"


def all_solutions(
    context: Context,
    engine: ProblemArrays | None,
    targets: Targets,
    objective: Objective,
    seed: np.ndarray,
    start: np.ndarray | None = None,
    most: int = MOST,
) -> Solutions:
    """The solutions for one target, ranked by an objective that was made for the robot.

    seed (2,): of what is random about a list; start (n,): where a numerical one begins; most: how many there may be,
    where whole turns make as many. `engine` None: one is made.
    """
    task, robot = _of_tip(context.problem, targets), context.robot
    if task is None:
        return ReferenceEnumeration(context, targets, objective, seed, most).solutions(start)
    srs = SRS.of(robot)
    if srs is not None and context.further:
        return _on_pieces(srs, task, context, objective)
    if srs is not None:
        ranked, are_all = best_of_each_arc(srs, task.target, objective)
        items = [_listed(task, objective, robot, one.q, one.arc, one.psi) for one in ranked]
        kept = [one for one in items if context.problem.is_reached(one.position_error, one.orientation_error)]
        reason = ""
        if srs.is_singular(task.target.homogeneous) or len(kept) < len(items):
            reason = "at a singular pose joints turn against each other: one way is listed"
        elif not are_all:
            reason = TOO_MANY_TURNS
        ranking = tuple(sorted(kept, key=lambda one: one.cost))
        return Solutions(ranking, "closed form (S-R-S)", not reason, reason=reason)
    ranked_by = context.problem.with_redundancy(Strict(objective))
    ranking_engine = ProblemArrays.build(ranked_by) if engine is None else engine.with_problem(ranked_by)
    enumeration = Enumeration(task, objective, context, ranking_engine, seed, most)
    if context.further and not enumeration.is_isolated:
        return ReferenceEnumeration(context, targets, objective, seed, most).solutions(start)
    decomposition = Decomposition.of(robot) if enumeration.is_isolated else None
    if decomposition is not None:
        return enumeration.by_branches(decomposition)
    return enumeration.by_multi_start(start)


def nearest_solution(
    context: Context,
    engine: ProblemArrays | None,
    targets: Targets,
    posture: Posture,
    seed: np.ndarray,
) -> np.ndarray | None:
    """The configuration (n,) of the first of `all_solutions`, ranked by a posture; None where there is none."""
    srs, task = SRS.of(context.robot), _of_tip(context.problem, targets)
    if srs is not None and task is not None and not context.further:
        found = best(srs, task.target, posture)
        return None if found is None else found.q
    # of whole turns the nearest alone: none is nearer to the posture
    listed = all_solutions(context, engine, targets, posture, seed, posture.q_ref, most=1)
    return listed[0].q if listed else None


def _of_tip(problem: Problem, targets: Targets) -> PoseTask | None:
    """The one task, the whole pose of the tip of a chain, with its target; None: it is another, or there are more."""
    robot, (task, *others) = problem.robot, problem.tasks or (None,)
    if others or not isinstance(task, PoseTask) or problem.hierarchy.lower:
        return None
    if task.target is not None or task.frame != robot.tip or task.offset is not None:
        return None
    if not task.kept.all() or unsupported(problem):
        return None
    return task.toward(targets.poses())  # type: ignore[return-value]


def _on_pieces(srs: SRS, task: PoseTask, context: Context, objective: Objective) -> Solutions:
    """The best of each piece of an arc of an S-R-S arm that keeps the further limits."""
    robot = context.robot
    ranked = best_of_each_piece(srs, task.target, objective, lambda q: context.is_within(robot.at(q)))
    items = [_listed(task, objective, robot, one.q, one.arc, one.psi) for one in ranked]
    kept = [one for one in items if context.problem.is_reached(one.position_error, one.orientation_error)]
    ranking = tuple(sorted(kept, key=lambda one: one.cost))
    return Solutions(ranking, "closed form (S-R-S)", False, reason=PIECES)


def _listed(
    task: PoseTask, objective: Objective, robot: Robot, q: np.ndarray, arc: Arc | None = None, psi: float | None = None
) -> ListedSolution:
    at = robot.at(q)
    position, orientation = task.residual(at)
    return ListedSolution(at.q.copy(), objective.cost(at), position, orientation, arc, psi, robot.joint_names)


@dataclass(frozen=True)
class Enumeration:
    """The solutions of an arm that is not S-R-S."""

    task: PoseTask
    """With its target"""
    objective: Objective
    """What they are ranked by, made for the robot"""
    context: Context
    engine: ProblemArrays
    """With the objective as its redundancy, if the kernels know it"""
    seed: np.ndarray
    """(2,) of what is random"""
    most: int
    """Solutions at most, but one of all that differ by whole turns alone"""

    @cached_property
    def is_isolated(self) -> bool:
        """The joints that move do so in as many directions, singular configurations aside."""
        robot = self.context.robot
        moving = robot.lower < robot.upper
        J = robot.jacobians(drawn(np.random.default_rng(0), *self.turns.window, RANK_SAMPLES))[:, :, moving]
        J[:, :3] /= robot.length
        return not moving.any() or bool((np.linalg.matrix_rank(J, tol=RANK_WITHIN) == moving.sum()).any())

    @cached_property
    def turns(self) -> WholeTurns:
        """Counted to stay near the posture that is preferred, or the middle of the limits."""
        robot, objective = self.context.robot, self.objective
        return WholeTurns(robot, objective.q_ref if isinstance(objective, Posture) else robot.middle)

    @cached_property
    def _row(self) -> np.ndarray:
        """The target (12,)."""
        return row_of(self.task.target)

    def by_branches(self, decomposition: Decomposition) -> Solutions:
        """From the branches of a closed form, checked with descents from random starts."""
        branches = decomposition.branches(self.task.target.homogeneous)
        q, reached = self._descended(self.engine, self.turns.within(branches, ROUNDED))
        q = q[reached][new_among(q[reached], q[:0], self.turns.apart, APART)]
        others = self._arrivals(self._draw(CHECKS))
        new = new_among(others, q, self.turns.apart, APART)
        without_new = CHECKS - 1 - new[-1] if new else CHECKS
        reason = self._doubt(branches, q) or (LOST if new else "")
        return self._ranked(np.concatenate([q, others[new]]), "closed form (EAIK)", reason, CHECKS, without_new)

    def by_multi_start(self, start: np.ndarray | None) -> Solutions:
        """From descents that begin at random configurations, after a given one (n,)."""
        robot, turns = self.context.robot, self.turns
        first = np.empty((0, robot.n)) if start is None else robot.clip(turns.unwound(start))[None]
        resolution = APART if self.is_isolated else SETTLED_APART
        found = multi_start(self._arrivals, self._draw, turns.apart, resolution, first)
        q = found.q if self.is_isolated or self.engine.settles else self._settled(found.q)
        return self._ranked(q, "numerical", NUMERICAL, found.starts, found.without_new)

    @cached_property
    def _rng(self) -> np.random.Generator:
        return np.random.default_rng(int(streams(self._row[None], self.seed)[0]))

    def _draw(self, count: int) -> np.ndarray:
        """Random starts (count, n)."""
        return placed(self.engine, self._row, drawn(self._rng, *self.turns.window, count))

    @cached_property
    def _free_engine(self) -> ProblemArrays:
        """Without the limits of joints that have all angles within them."""
        return self._settling_engine.without_limits(self.turns.everywhere)

    @cached_property
    def _settling_engine(self) -> ProblemArrays:
        if self.engine.settles:
            return self.engine
        problem = self.context.problem
        return self.engine.with_problem(problem.with_redundancy(Strict(Posture().of(problem.robot))))

    def _arrivals(self, starts: np.ndarray) -> np.ndarray:
        """Where starts (N, n) lead, (N, n), within the limits; NaN for those that lead nowhere."""
        q, reached = self._descended(self._free_engine, starts)
        q[~reached] = np.nan
        for k in np.flatnonzero(reached):
            within = self.turns.within(q[k][None])
            q[k] = within[0] if len(within) else np.nan
        if not self.is_isolated:
            ends, optimal = refined(self._settling_engine, self._row, q[reached])
            q[reached] = np.where(optimal[:, None], ends, np.nan)
        return q

    def _descended(self, engine: ProblemArrays, starts: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Where descents from starts (N, n) end, (N, n), and whether they reach the pose (N,): then exactly, if any."""
        errors = [Outcome.POSITION_ERROR, Outcome.ORIENTATION_ERROR]
        q, outcome = descend(engine, self._row, starts)
        reached = self._is_reached(outcome[:, errors])
        q[reached], outcome[reached] = descend(engine.exact, self._row, q[reached])
        return q, self._is_reached(outcome[:, errors])

    def _is_reached(self, errors: np.ndarray) -> np.ndarray:
        """Whether errors (N, 2) [m, rad] are within the tolerances (N,)."""
        return np.asarray(self.context.problem.is_reached(*errors.T))

    def _settled(self, q: np.ndarray) -> np.ndarray:
        """The distinct optima (m, n) of the objective along the self-motions through q (k, n)."""
        cost, wish, robot = TaskCost((self.task,)), Strict(self.objective), self.context.robot
        ends = [settle(wish, cost, robot.at(each), self.context, Budget(None), self._holds).at.q for each in q]
        settled = np.reshape(ends, q.shape)
        return settled[new_among(settled, q[:0], self.turns.apart, SETTLED_APART)]

    def _holds(self, at: Configuration) -> bool:
        return bool(self._is_reached(np.array([self.task.residual(at)]))[0])

    def _doubt(self, branches: np.ndarray, q: np.ndarray) -> str:
        """Why branches (k, 6), and the solutions (m, 6) that are made of them, may not be all; empty: they are."""
        robot, balance = self.context.robot, 0.0
        if not len(branches) and not self.engine.proofs.unreachable(self._row[None])[0]:
            return "the closed form has no solution, and it is not proved that there is none"
        for k, at in enumerate(robot.at(each) for each in (*branches, *q)):
            error, J = max(self.task.residual(at)), at.jacobian(None)
            values = np.linalg.svd(J, compute_uv=False)
            if MEETS <= error <= MISSES or (error < MEETS and values[-1] <= REGULAR * values[0]):
                return "a branch is nearly singular, where others may be lost to rounding"
            balance += np.sign(np.linalg.det(J)) if k < len(branches) and error < MEETS else 0.0
        return "" if balance == 0.0 else "the branches are out of balance, so one of them is missing"

    def _ranked(
        self, q: np.ndarray, method: str, reason: str, starts: int = 0, starts_without_new: int = 0
    ) -> Solutions:
        """The list of solutions q (k, n), the whole turns of isolated ones added; the reason why it may not be all."""
        robot = self.context.robot
        if self.is_isolated:
            q, all_of_them = self.turns.all_within(q, self.most)
            reason = reason or ("" if all_of_them else TOO_MANY_TURNS)
            if self.context.further:
                q = np.reshape([each for each in q if self.context.is_within(robot.at(each))], (-1, robot.n))
        listed = [_listed(self.task, self.objective, robot, each) for each in q]
        ranked = tuple(sorted(listed, key=lambda one: one.cost))
        return Solutions(ranked, method, not reason, starts, starts_without_new, reason)
