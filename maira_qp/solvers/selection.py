"""Calls that ask for more than one solve: several starts, the closest solution, a box about the start, a test.

For each start the box is laid about it, the closest or the usual answer is found, and the test is asked; of the answers
from several starts the best counts, see `best_of`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from maira_qp.arrays import check_callable, is_listing, real_array
from maira_qp.errors import ConfigurationError, OptionError
from maira_qp.problem.box import checked_change
from maira_qp.problem.objectives import Posture
from maira_qp.problem.problem import Problem
from maira_qp.problem.qp.costs import WeightedCost
from maira_qp.problem.redundancy import Strict, Weighted
from maira_qp.problem.targets import Targets, poses_of
from maira_qp.results.batch import BatchSolution
from maira_qp.results.solution import Solution
from maira_qp.results.status import Status
from maira_qp.robots.model.robot import Robot
from maira_qp.solvers.acceptance import Accept, accepted
from maira_qp.solvers.dispatch import Engines, Progress
from maira_qp.solvers.enumeration.closest import check_preference, posture_at

SAME = 1e-9
"""Answers whose values differ by a smaller share are as good, and the one nearest to its start counts."""

RANKS = {Status.CONVERGED: 0, Status.REJECTED: 1, Status.LIMITS_BROKEN: 3}
"""Of the statuses, the best first; all others have 2."""


@dataclass(frozen=True)
class Demands:
    """What a call asks for beside the target and the start."""

    accept: Accept | None
    change: np.ndarray | None
    """Largest changes (n,) [rad or m]"""
    is_closest: bool
    metric: Any
    kept: dict[bytes, Engines] = field(default_factory=dict)
    """The engines of the box about the last start"""

    @staticmethod
    def checked(
        robot: Robot, q0: Any, *, accept: Any, max_joint_change: Any, prefer: Any, metric: Any, observe: Any = None
    ) -> Demands | None:
        """The demands of a call; None: there are none. Raises `OptionError`."""
        check_callable(accept, "accept", OptionError)
        if prefer is not None or metric is not None:
            check_preference(prefer, q0, observe)
        if accept is not None and observe is not None:
            raise OptionError("accept cannot be observed; leave out accept, or observe")
        if max_joint_change is not None and q0 is None:
            raise OptionError("max_joint_change needs q0: a change from where?")
        if accept is None and max_joint_change is None and prefer is None:
            return None
        change = None if max_joint_change is None else checked_change(max_joint_change, robot)
        return Demands(accept, change, prefer is not None, metric)

    def posture(self, start: np.ndarray, robot: Robot) -> Posture:
        """What is closest to a start (n,) is nearest to."""
        return posture_at(start, self.metric, robot)

    def engines_at(self, engines: Engines, start: np.ndarray | None) -> Engines:
        """The engines of the box about a start (n,)."""
        if self.change is None or start is None:
            return engines
        key = start.tobytes()
        if key not in self.kept:
            self.kept.clear()
            self.kept[key] = engines.within(start, self.change)
        return self.kept[key]


def starts_of(q0: Any, problem: Problem) -> np.ndarray | None:
    """Several starts (K, n) for one target, or mappings by joint; None: it is none, or one.

    Raises `ConfigurationError`.
    """
    if isinstance(q0, np.ndarray):
        is_several = q0.ndim == 2
    else:
        is_several = isinstance(q0, (list, tuple)) and len(q0) > 0 and (is_listing(q0[0]) or isinstance(q0[0], Mapping))
    if not is_several:
        return None
    if not len(q0):
        raise ConfigurationError(
            f"q0 must hold a start (n,), or several (K, n) with n = {problem.robot.n}, and is empty"
        )
    if any(isinstance(each, Mapping) for each in q0):
        return problem.starts(q0, len(q0))
    return real_array(q0, (None, problem.robot.n), "q0", ConfigurationError)


def answer(
    engines: Engines,
    targets: Targets,
    start: np.ndarray | None,
    seed: np.ndarray,
    demands: Demands | None,
    observe: Callable[[np.ndarray], object] | None = None,
) -> Solution:
    """The answer to one target, from a start (n,) or without."""
    deviation = float(targets.deviations[0])
    if demands is None:
        return replace(engines.solve(targets.poses() or None, start, seed, observe), target_deviation=deviation)
    engines, wishing = demands.engines_at(engines, start), None
    if demands.is_closest and start is not None:
        posture = demands.posture(start, engines.problem.robot)
        wishing = engines.with_problem(engines.problem.with_redundancy(Strict(posture)))
        usual = closest(wishing, targets, posture, seed)
    else:
        usual = engines.solve(targets.poses() or None, start, seed, observe)
    if demands.accept is not None:
        usual = accepted(wishing or engines, targets, start, seed, demands.accept, usual)
    return replace(usual, target_deviation=deviation)


def closest(by_distance: Engines, targets: Targets, posture: Posture, seed: np.ndarray) -> Solution:
    """The nearest of all solutions to a posture, settled there, and of what is found from it.

    A list that is not complete may lack what a descent from the posture leads to. `by_distance` has the posture as its
    redundancy.
    """
    from maira_qp.solvers.enumeration.all_solutions import nearest_solution  # heavy: Numba comes with it

    q0, poses, of_tip = posture.q_ref, targets.poses(), by_distance.of_tip
    q = nearest_solution(of_tip.context, of_tip.compiled, targets, posture, seed)
    near = by_distance.solve(poses, q0, seed)
    if q is None:
        return near
    listed = by_distance.solve(poses, q, seed)
    if near.success and not (listed.success and listed.cost < near.cost):
        return near
    return replace(listed, _start=q0, left_q0=near.left_q0, start_projected=near.start_projected)


def best_of(answers: Sequence[Solution]) -> Solution:
    """The best of answers to one target from several starts, with what all of them took.

    By status: success first, then what reaches the pose but is rejected, what keeps the further limits, the others. Of
    the same status by the least value: of what reaches the pose the redundancy's first objective, without one the
    largest joint displacement from its own start; of the others the cost `1/2 |W e|^2`, with `Weighted` always the
    weighted sum; of broken limits the sum of what is broken. Of equal values the nearest to its start.
    """
    ranks = [RANKS.get(one.status, 2) for one in answers]
    leading = [one for one, rank in zip(answers, ranks, strict=True) if rank == min(ranks)]
    values = [_value(one) for one in leading]
    least = min(values)
    equal = [one for one, value in zip(leading, values, strict=True) if value <= least + SAME * (1 + abs(least))]
    best = min(equal, key=lambda one: one.max_joint_change)
    return replace(
        best,
        status=_status(best, answers),
        iterations=sum(one.iterations for one in answers),
        restarts=sum(one.restarts + 1 for one in answers) - 1,
        rejected=sum(one.rejected for one in answers),
    )


def _status(best: Solution, answers: Sequence[Solution]) -> Status:
    """Its status with what other answers have proved: of the joint limits for all starts, of a box for its own."""
    proved = [one.status is Status.UNREACHABLE for one in answers]
    if RANKS.get(best.status, 2) != 2 or not any(proved) or all(proved):
        return best.status
    if not best.scope:
        return Status.UNREACHABLE
    return Status.NEAREST if best.optimal else Status.BUDGET_SPENT


def _value(one: Solution) -> float:
    """What is to be least among answers of a rank."""
    problem = one._origin.problem  # type: ignore[union-attr]
    cost, wish = problem.costs(poses_of(problem.target_keys, one._target))
    at = problem.robot.at(one.q)
    if one.status is Status.LIMITS_BROKEN:
        return sum(one.broken_limits.values())
    if isinstance(wish, Weighted):
        return WeightedCost(cost, wish.objective, wish.weight).value(at)
    if one.success or one.status is Status.REJECTED:
        return one.max_joint_change if wish is None else one.cost
    return cost.value(at)


def answer_each(
    engines: Engines,
    targets: Targets,
    starts: np.ndarray | None,
    seed: np.ndarray,
    threads: int | None,
    progress: Progress | None,
    demands: Demands,
) -> BatchSolution:
    """The answers to N targets, from starts (N, n) or without."""
    whole = engines if demands.change is None else engines.boxed_by(demands.change)
    batch = BatchSolution.blank(whole, engines.name, starts, targets)
    batch.q[:] = engines.problem.robot.middle
    if demands.accept is None and not demands.is_closest and starts is not None:
        return _answer_by_boxes(engines, targets, starts, seed, threads, progress, demands, batch)
    if starts is not None:
        for start in np.unique(starts, axis=0):  # what is wrong with one comes before anything is solved
            if demands.is_closest:
                demands.posture(start, engines.problem.robot)
    for i, is_finite in enumerate(targets.is_finite):
        if is_finite:
            start = None if starts is None else starts[i]
            batch.put(i, answer(engines, targets[i], start, seed, demands))
        if progress is not None:
            progress(i + 1, len(targets))
    batch.refuse(~targets.is_finite)
    return batch


def answer_calls(
    of_each: Sequence[Engines],
    targets: Targets,
    starts: np.ndarray | None,
    seed: np.ndarray,
    progress: Progress | None,
    demands: Demands | None,
) -> BatchSolution:
    """The answers of N calls with engines of their own, from starts (N, n) or without."""
    if demands is not None and demands.change is not None:
        of_each = [engines.boxed_by(demands.change) for engines in of_each]
    first = of_each[0]
    batch = BatchSolution.blank(first, first.name, starts, targets, of_each)
    batch.q[:] = first.problem.robot.middle
    for i, is_finite in enumerate(targets.is_finite):
        if is_finite:
            start = None if starts is None else starts[i]
            own = None if demands is None else replace(demands, kept={})
            batch.put(i, answer(of_each[i], targets[i], start, seed, own))
        if progress is not None:
            progress(i + 1, len(targets))
    batch.refuse(~targets.is_finite)
    return batch


def _answer_by_boxes(
    engines: Engines,
    targets: Targets,
    starts: np.ndarray,
    seed: np.ndarray,
    threads: int | None,
    progress: Progress | None,
    demands: Demands,
    batch: BatchSolution,
) -> BatchSolution:
    """Those from the same start in one go."""
    begun, group = np.unique(starts, axis=0, return_inverse=True)
    boxes = [engines.within(start, demands.change) for start in begun]  # type: ignore[arg-type]
    done = 0
    for k, box in enumerate(boxes):
        some = np.flatnonzero(group.ravel() == k)
        part = box.solve_batch(targets[some], starts[some], seed, threads, _further(progress, done, len(targets)))
        batch.put_some(some, part)
        done += len(some)
    return batch


def _further(progress: Progress | None, done: int, total: int) -> Progress | None:
    """Progress of a part of a batch, when so many of all targets are done."""
    return None if progress is None else lambda count, _: progress(done + count, total)
