"""Reach a pose within further limits than those of the joints: many solutions without them, then a few with.

The compiled search finds a configuration that reaches the pose in microseconds, but knows the limits of the joints
alone. So it solves from many random starts, and each solution is looked at, those nearest to the posture that is wished
for first: the first that keeps the further limits is the answer. If none does, descents within all limits begin at what
is near the solutions that break them least and keeps them; and, where nothing is, at random configurations that do.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from maira_qp.kernels.kinematics.unwrap import unwind
from maira_qp.kernels.layout import Outcome
from maira_qp.problem.qp.costs import TaskCost
from maira_qp.robots.model.configuration import Configuration
from maira_qp.solvers.compiled.multi_start import descend, placed
from maira_qp.solvers.compiled.problem_arrays import ProblemArrays
from maira_qp.solvers.reference.context import Context
from maira_qp.solvers.reference.levenberg_marquardt import Budget, Descent
from maira_qp.solvers.reference.multi_start import Search, attempt_from, search

DESCENTS = 8
"""Descents within all limits, at most."""


def screen(
    engine: ProblemArrays,
    row: np.ndarray,
    cost: TaskCost,
    context: Context,
    budget: Budget,
    rng: np.random.Generator,
    reached: Callable[[Configuration], bool],
    start: np.ndarray | None = None,
) -> Search:
    """Search for a target (12,) with an engine that does not know the further limits of the context.

    Without them it is solved once from as many random starts as there may be attempts. Of the solutions those
    nearest to a start (n,), if there is one, are looked at first.
    """
    robot, options = context.robot, context.options
    starts = np.array([context.random_start(rng) for _ in range(options.max_restarts + 1)])
    q, outcome = descend(engine, row, placed(engine, row, starts))
    budget.iterations += int(outcome[:, Outcome.SPENT].sum())
    breaches = np.full(len(q), np.inf)
    arrived = np.flatnonzero(outcome[:, Outcome.SUCCESS] > 0.0)
    if start is not None:
        unwind(engine.chain, start[None], outcome[:, Outcome.SUCCESS], q)
    rank = engine.wish(q[arrived]) if start is None else np.square(q[arrived] - start).sum(axis=1)
    for k in arrived[np.argsort(rank, kind="stable")]:
        at = robot.at(q[k])
        breaches[k] = context.broken(at)
        if breaches[k] == 0.0 and reached(at):
            return Search(Descent(at, cost.value(at), True), int(k))
        if budget.late():
            break
    proved = not np.isfinite(breaches).any() and bool(engine.proofs.unreachable(row[None])[0])
    # where nothing reaches the pose: from where it is nearest
    order = np.lexsort((outcome[:, Outcome.FINAL_COST], breaches))
    is_nearest = proved and not context.broken(robot.at(q[order[0]]))
    order = order[: 1 if is_nearest else DESCENTS]
    best: Descent | None = None
    for k in order:
        descent = attempt_from(robot.at(context.admitted(q[k])), cost, context, budget, reached)
        if descent.is_better_than(best):
            best = descent
        if descent.reached or budget.late():
            break
    assert best is not None
    if best.broken and not budget.late():
        elsewhere = search(cost, None, context, budget, lambda: rng, reached, max_restarts=DESCENTS).best
        best = elsewhere if elsewhere.is_better_than(best) else best
    return Search(best, len(q) - 1, proved)
