"""What takes longer than a tick has time for: a verdict on a target, why it is so, all solutions, a solver for
other obstacles.

Functions of what they are given, so that they may run in any thread.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from maira_qp.apps.viewer.branches import names_of
from maira_qp.apps.viewer.drawing.surroundings import collision_limit
from maira_qp.apps.viewer.targets import Targets, as_asked
from maira_qp.errors import MairaError
from maira_qp.problem.limits.collision import CollisionLimit
from maira_qp.problem.options import Options
from maira_qp.problem.redundancy import Strict, Weighted
from maira_qp.results.solution import Solution
from maira_qp.results.solution_set import ListedSolution, Solutions
from maira_qp.robots.collision.shapes import Shape
from maira_qp.robots.model.revolutions import WholeTurns
from maira_qp.robots.model.robot import Robot
from maira_qp.solvers.analysis.explanation import Explanation
from maira_qp.solvers.solver import Solver

PATIENCE = 0.25
"""What a verdict among obstacles, or on a tree, may take [s]."""
APART = 0.5
"""Solutions nearer to each other in every joint [rad, or m], whole turns aside, are shown as one."""
MOST_GHOSTS = 16


class Job(NamedTuple):
    """Something to find out, in any thread, and what to do with the answer between two ticks."""

    think: Callable[[], Any]
    write: Callable[[Any], None]


@dataclass(frozen=True, eq=False)
class Verdict:
    """What `solve` says of targets."""

    targets: Targets
    solution: Solution
    seconds: float
    """What the solve took [s]"""
    reason: Explanation | None = None
    """Why the target is not reached, if that is known yet"""

    @property
    def lacks_reason(self) -> bool:
        """The target is not reached, and it is not known why."""
        return not self.solution.success and self.reason is None


def options_for(robot: Robot) -> Options:
    """A search over a tree takes seconds where it fails: it is cut short."""
    return Options(deadline=PATIENCE) if len(robot.tips) > 1 else Options()


def verdict_on(solver: Solver, plain: Solver, targets: Targets, q0: np.ndarray) -> Verdict:
    """Solve from q0 (n,). What the plain solver, without obstacles, cannot reach is not sought among them for long."""
    if any(isinstance(limit, CollisionLimit) for limit in solver.limits):
        verdict = _timed(plain, targets, q0)
        if not verdict.solution.success:
            return verdict
    return _timed(solver, targets, q0)


def explained(verdict: Verdict) -> Verdict:
    """With its reason: this takes some ten milliseconds, among obstacles more."""
    return replace(verdict, reason=verdict.solution.explain())


def _timed(solver: Solver, targets: Targets, q0: np.ndarray) -> Verdict:
    begin = time.perf_counter()
    solution = solver.solve(as_asked(targets), q0=q0)
    return Verdict(targets, solution, time.perf_counter() - begin)


@dataclass(frozen=True, eq=False)
class Ghosts:
    """Solutions for targets, the best first, alike ones as one."""

    targets: Targets
    shown: tuple[ListedSolution, ...]
    names: tuple[str, ...]
    """What each that is shown is called"""
    found: Solutions
    """With those that are alike"""
    note: str = ""
    """Why there are none"""

    @cached_property
    def q(self) -> np.ndarray:
        """(k, n) of those that are shown"""
        return np.array([one.q for one in self.shown])

    @cached_property
    def ranks(self) -> np.ndarray:
        """(k,) from 0, the least cost of those that are shown, to 1, the largest"""
        costs = np.array([one.cost for one in self.shown])
        span = float(np.ptp(costs)) if len(costs) else 0.0
        return (costs - costs.min()) / span if span > 0 else np.zeros(len(costs))


def ghosts_of(solver: Solver, targets: Targets) -> Ghosts:
    """All solutions for targets that are known, the best first."""
    found = solver.solutions(as_asked(targets))
    turns = WholeTurns(solver.robot, solver.robot.middle)
    shown: list[ListedSolution] = []
    known = np.empty((0, solver.robot.n))
    for one in found:
        if len(shown) < MOST_GHOSTS and (turns.apart(one.q, known) >= APART).all():
            shown.append(one)
            known = np.vstack([known, one.q])
    note = "" if found else "no configuration within the joint limits reaches the target"
    return Ghosts(targets, tuple(shown), names_of(solver.robot, shown), found, note)


class Fitted(NamedTuple):
    """A solver for what is in the way."""

    solver: Solver
    limit: CollisionLimit | None
    """The arm against the obstacles; None: there are none, or distances are not known."""
    notice: str
    """Why obstacles are not minded, if so"""


def fitted(
    robot: Robot,
    redundancy: Strict | Weighted | None,
    obstacles: Mapping[str, Shape],
    directories: Sequence[str],
    is_avoiding: bool,
) -> Fitted:
    """A solver that keeps clear of the obstacles if it is to, and knows their distances if it can."""
    without = Solver(robot, redundancy=redundancy, options=options_for(robot))
    if not obstacles:
        return Fitted(without, None, "")
    limit = collision_limit(obstacles, directories)
    try:
        if is_avoiding:
            options = Options(deadline=PATIENCE)
            solver = Solver(robot, redundancy=redundancy, limits=[limit], options=options)
            return Fitted(solver, solver.limits[-1], "")  # type: ignore[arg-type]
        return Fitted(without, limit.of(robot), "")
    except MairaError as reason:
        return Fitted(without, None, str(reason))
