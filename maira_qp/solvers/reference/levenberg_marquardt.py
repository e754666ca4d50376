"""Damped Gauss-Newton descent of a cost within limits, one QP per iteration: the inner loop of every solve.

    q <- clip(q + dq),   dq = argmin  c^T dq + 1/2 dq^T (H + mu I) dq   subject to   lower - q <= dq <= upper - q

H and c are the cost's quadratic model at q (for the pose: `H = J^T W^2 J`, `c = -J^T W^2 e`). A step counts only if the
true cost falls and no limit is broken that the QP knows to first order only. The damping is mu = factor * damping *
|W e|^2, which keeps the fast convergence of Gauss-Newton near a solution and gives safe steps far away (Sugihara,
"Solvability-unconcerned inverse kinematics by the Levenberg-Marquardt method", IEEE T-RO 2011). Accepted steps shrink
the factor, refused ones raise it (Marquardt, 1963).
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from maira_qp.problem.qp.costs import Cost
from maira_qp.problem.qp.hierarchy import Level, solve_hierarchy
from maira_qp.robots.model.configuration import Configuration
from maira_qp.solvers.reference.context import Context

ACCEPTED, REFUSED = 0.3, 8.0
"""What an accepted and a refused step do to the damping factor."""

ALONG = 1e-9
"""A step that leaves no more of a row of the linearised limits goes along it."""

CORRECTIONS = 2
"""Second-order corrections of a step along limits: in a flat valley what one leaves is worth more than the step."""

FACTOR_RANGE = (1e-6, 1e12)
LEAST_DAMPING = 1e-9
"""Floor of mu as a share of the largest entry of H: below it backends take H for singular."""


class Budget:
    """What a solve has spent, and who watches it."""

    def __init__(
        self, deadline: float | None, observe: Callable[[np.ndarray], object] | None = None, iterations: int = 0
    ) -> None:
        """A deadline [s] from now, or None; `observe` is called with every configuration (n,) that is visited."""
        self.iterations = iterations
        self._end = None if deadline is None else time.monotonic() + deadline
        self._observe = observe

    @property
    def has_deadline(self) -> bool:
        """There is a clock to look at."""
        return self._end is not None

    def visit(self, at: Configuration) -> None:
        """The solve has moved here."""
        if self._observe is not None:
            self._observe(at.q.copy())

    def late(self) -> bool:
        """The deadline has passed."""
        return self._end is not None and time.monotonic() >= self._end


@dataclass(frozen=True)
class Descent:
    """Where a descent ended."""

    at: Configuration
    cost: float
    reached: bool
    """The caller's criterion was met."""
    broken: float = 0.0
    """Half the sum of squares of what it breaks of further limits; 0 where they are kept"""

    def is_better_than(self, other: Descent | None) -> bool:
        """It is what the caller looks for, or else breaks limits less, or else costs less."""
        return other is None or self._rank < other._rank

    @property
    def _rank(self) -> tuple[bool, float, float]:
        return not self.reached, self.broken, self.cost


class Stall:
    """Counts accepted steps in a row that improve the cost by less than a share."""

    def __init__(self, steps: int, ratio: float) -> None:
        """Stalled after `steps` of them; `ratio` is the share."""
        self._left = self._steps = steps
        self._ratio = ratio

    def after(self, before: float, now: float) -> bool:
        """Whether the descent has stalled with this step."""
        self._left = self._steps if now < (1 - self._ratio) * before else self._left - 1
        return self._left <= 0


def descend(
    cost: Cost,
    start: Configuration,
    context: Context,
    budget: Budget,
    *,
    reached: Callable[[Configuration], bool],
    max_iterations: int,
    stall: Stall | None = None,
    longest: float = np.inf,
) -> Descent:
    """Lower the cost from a start until `reached`, or stalled, or out of iterations or time, or at a fixed point.

    No step breaks a limit, or breaks one further; to come back within limits is `Context.admitted`'s. No step moves a
    joint by more than `longest` [rad or m].
    """
    at, factor = start, 1.0
    level = cost.level(at)
    budget.visit(at)
    for _ in range(max_iterations):
        if reached(at):
            return Descent(at, level.cost, True, context.broken(at))
        if budget.late():
            break
        budget.iterations += 1
        trial = _trial(cost, level, factor, at, context, longest)
        value = np.inf if trial is None else cost.value(trial)
        if trial is not None and value - level.cost < _recovered(level, trial, at, context):
            before, at = level.cost, trial
            level = cost.level(at)
            budget.visit(at)
            factor = max(factor * ACCEPTED, FACTOR_RANGE[0])
            if stall is not None and stall.after(before, value):
                break
        else:
            if trial is not None and np.array_equal(trial.q, at.q):
                break  # the step is below the resolution of q
            factor *= REFUSED
            if factor > FACTOR_RANGE[1]:
                break
    return Descent(at, level.cost, reached(at), context.broken(at))


def _recovered(level: Level, trial: Configuration, at: Configuration, context: Context) -> float:
    """What a trial may cost as it gives back of the limits' reserve: the exact penalty of what is taken of it.

    A configuration in the reserve would else cost less than any that keeps it. (Nocedal and Wright, section 15.4.)
    """
    if not context.is_bent:
        return 0.0
    taken = context.encroachment(at) - context.encroachment(trial)
    return 2.0 * float(np.linalg.norm(level.c)) * taken


def _trial(
    cost: Cost, level: Level, factor: float, at: Configuration, context: Context, longest: float
) -> Configuration | None:
    """The configuration after one QP step, inside the limits; None if there is none."""
    least = LEAST_DAMPING * float(np.abs(level.H).max())
    mu = factor * context.options.damping * level.squared_error + max(1.0, factor) * least
    model = level.damped(mu)
    bounds = context.bounds(at) if longest == np.inf else context.bounds(at).within(longest)
    dq = solve_hierarchy([model], bounds, context.backend)
    if dq is None:
        return None
    trial = context.moved(at, dq)
    if context.is_bent and (bounds.G @ dq >= bounds.h - ALONG).any():
        # second-order corrections: along a curved limit a step leaves it, to either side, and may cost more than it
        # gains (the Maratos effect: Nocedal and Wright, section 18.3)
        for _ in range(CORRECTIONS):
            trial = context.best_within(model.H, cost.gradient(trial), trial) or trial
    if not context.keeps(trial, at):  # a bent limit: along it, and back onto it
        trial = context.robot.at(context.admitted(trial.q))
    return trial if context.keeps(trial, at) else None
