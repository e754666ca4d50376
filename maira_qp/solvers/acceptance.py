"""A test of the caller's own: answers that reach the pose count only where it accepts them.

The usual answer is asked about first. Where it is rejected, others are looked for, in rounds: for an S-R-S arm samples
of all arcs of the swivel angle, between which no joint turns by more than some degrees; then, for all that the compiled
search knows, where descents from random starts end, spread over branches and self-motions, and whole turns of these. A
round's candidates are asked about in the order of the redundancy's objective, without one of their distance from the
start, and a round in which some are accepted is the last. Other problems are searched by the reference engine, whose
descents end where a configuration is accepted. From an accepted one the redundancy is settled along the self-motion
with steps that stay accepted: to the edge of what is accepted, where the optimum is beyond it. What `Weighted` makes of
that counts if it is accepted, too.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from maira_qp.errors import OptionError, shown
from maira_qp.problem.redundancy import Strict, Weighted
from maira_qp.problem.targets import Targets, streams
from maira_qp.problem.tasks.frame import PoseTask
from maira_qp.results.solution import Solution
from maira_qp.results.status import Status
from maira_qp.robots.model.revolutions import WholeTurns
from maira_qp.solvers.reference.levenberg_marquardt import Budget

if TYPE_CHECKING:
    from maira_qp.solvers.compiled.engine import Compiled
    from maira_qp.solvers.dispatch import Engines

Accept = Callable[[np.ndarray], Any]

ROUNDS = 4
"""Rounds of descents from random starts, each of as many as a search has at most."""
MOST = 4096
"""Candidates of a round, those included that differ by whole turns."""
SETTLED = 3
"""Accepted candidates from which the redundancy is settled, at most; the best end counts."""
APART = 1e-5
"""Candidates no joint of which differs by more [rad or m] are the same."""


@dataclass
class Test:
    """The caller's test with what it has said; each configuration is asked about once."""

    accept: Accept
    known: dict[bytes, bool] = field(default_factory=dict)
    starts: int = 0
    """From so many further starts configurations to be asked about were looked for"""

    def __call__(self, q: np.ndarray) -> bool:
        """Whether a configuration (n,) is accepted. Raises `OptionError` where it says no bool, and what it raises."""
        key = q.tobytes()
        if key not in self.known:
            given = q.copy()
            given.setflags(write=False)
            said = self.accept(given)
            if not isinstance(said, (bool, np.bool_)):
                raise OptionError(f"accept must return True or False, got {shown(said)}")
            self.known[key] = bool(said)
        return self.known[key]

    @property
    def rejected(self) -> int:
        """How many configurations it has rejected."""
        return sum(not accepted for accepted in self.known.values())


def accepted(
    engines: Engines, targets: Targets, start: np.ndarray | None, seed: np.ndarray, accept: Accept, usual: Solution
) -> Solution:
    """The usual answer where it is accepted, else the best other one that is, else the usual one as `REJECTED`.

    What does not reach the pose is not asked about, and returned as it is; with `Weighted`, whose answers are off the
    pose, all answers are asked about.
    """
    budget = Budget(engines.problem.options.deadline)
    search = _Search(engines, targets, start, seed, Test(accept), usual, budget)
    if not (usual.success or search.weighs) or search.test(usual.q):
        return usual
    found = search.other()
    if found is None:
        found = replace(usual, success=False, status=Status.REJECTED)
    else:
        found = replace(found, left_q0=start is not None, iterations=usual.iterations + found.iterations)
    return replace(
        found,
        rejected=search.test.rejected,
        iterations=found.iterations + budget.iterations,
        restarts=usual.restarts + search.test.starts,
        start_projected=usual.start_projected,
        _start=usual._start,
    )


@dataclass(frozen=True, eq=False)
class _Search:
    """For an answer to one target that a test accepts."""

    engines: Engines
    targets: Targets
    start: np.ndarray | None
    seed: np.ndarray
    test: Test
    usual: Solution
    budget: Budget

    @property
    def weighs(self) -> bool:
        """The redundancy is traded off against the pose."""
        return isinstance(self.engines.problem.redundancy, Weighted)

    @property
    def reference(self) -> np.ndarray:
        """What configurations are to be near to where there is no objective (n,)."""
        return self.engines.problem.turns.aim if self.start is None else self.start

    def other(self) -> Solution | None:
        """The best that is found and accepted."""
        if self.engines.compiled is None:
            return self._by_reference()
        for q in self._rounds(self.engines.compiled):
            found = self._best_among(q)
            if found is not None or self.budget.late():
                return found
        return None

    def _rounds(self, arrays: Compiled) -> Iterator[np.ndarray]:
        """Configurations (k, n) that reach the first level's target, without regard to further limits."""
        from maira_qp.kernels.layout import Outcome
        from maira_qp.solvers.compiled.multi_start import descend, placed  # heavy: Numba comes with it
        from maira_qp.solvers.enumeration.exhaustive_multi_start import new_among

        arcs = self._on_arcs()
        if arcs is not None:
            yield arcs
        row, context = self.targets.rows[0, 0], self.engines.reference.context
        rng = np.random.default_rng(int(streams(self.targets.rows, self.seed)[0]))
        turns = WholeTurns(context.robot, self.reference)
        known = np.empty((0, context.robot.n))
        for _ in range(ROUNDS):
            starts = np.array([context.random_start(rng) for _ in range(context.options.max_restarts + 1)])
            q, outcome = descend(arrays, row, placed(arrays, row, starts))
            self.test.starts += len(starts)
            self.budget.iterations += int(outcome[:, Outcome.SPENT].sum())
            q = q[outcome[:, Outcome.SUCCESS] > 0.0]
            q = q[new_among(q, known, turns.apart, APART)]
            known = np.concatenate([known, q])
            yield turns.all_within(q, MOST)[0] if len(q) else q

    def _on_arcs(self) -> np.ndarray | None:
        """Samples (k, 7) of all arcs of an S-R-S arm whose whole pose is wanted; None for others."""
        from maira_qp.analytic.srs.geometry import SRS
        from maira_qp.analytic.srs.optimum import SampledArcs
        from maira_qp.problem.objectives import Posture

        problem = self.engines.of_tip.problem
        robot, task = problem.robot, problem.tasks[0].toward(self.targets.poses())
        srs = SRS.of(robot) if isinstance(task, PoseTask) and task.kept.all() else None
        if srs is None:
            return None
        sampled = SampledArcs.of(srs, task.target, Posture(self.reference).of(robot))
        return np.clip(sampled.q, robot.lower, robot.upper)

    def _value(self, q: np.ndarray) -> float:
        """What is to be least of candidates: the redundancy's objective, else the squared distance from the start."""
        wish = self.engines.problem.redundancy
        if wish is None:
            return float(np.square(q - self.reference).sum())
        return wish.objectives[0].cost(self.engines.problem.robot.at(q))

    def _best_among(self, q: np.ndarray) -> Solution | None:
        """The best of what accepted candidates among q (k, n) lead to."""
        q = q[np.abs(q - self.usual.q).max(axis=1, initial=0.0) > APART]
        engine, found, count = self.engines.reference, None, 0
        cost, wish = self.engines.problem.costs(self.targets.poses())
        reached = engine.reached(cost)
        for k in np.argsort([self._value(each) for each in q], kind="stable"):
            if self.budget.late() or count == SETTLED:
                break
            if not (reached(engine.context.robot.at(q[k])) and self.test(q[k])):
                continue
            count, one = count + 1, self._settled(q[k])
            found = one if found is None or one.cost < found.cost else found
            if wish is None:
                break
        return found

    def _settled(self, q: np.ndarray) -> Solution:
        """What the redundancy makes of a configuration q (n,) that reaches the pose and is accepted."""
        row, problem = self.targets.rows[0], self.engines.problem
        if not isinstance(problem.redundancy, Weighted):
            return self.engines.from_here(self.engines.reference.settled_from(q, row, self.start, self.test))
        strict = self.engines.with_problem(problem.with_redundancy(Strict(problem.redundancy.objective)))
        kept = strict.reference.settled_from(q, row, self.start, self.test)
        traded = self.engines.reference.settled_from(kept.q, row, self.start, None)
        return self.engines.from_here(traded if self.test(traded.q) else kept)

    def _by_reference(self) -> Solution | None:
        """By descents of the reference engine that end where they are accepted."""
        from maira_qp.solvers.reference.multi_start import search

        engine, rng = self.engines.reference, np.random.default_rng(int(streams(self.targets.rows, self.seed)[0]))
        cost, _ = self.engines.problem.costs(self.targets.poses())
        reached = engine.reached(cost, self.test)
        found = search(cost, None, engine.context, self.budget, lambda: rng, reached)
        self.test.starts += found.restarts + 1
        return self._settled(found.best.at.q) if found.best.reached else None
