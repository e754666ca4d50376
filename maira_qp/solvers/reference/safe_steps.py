"""How much of the displacements that the hierarchy of a tick asks for may be taken.

What each level adds is shortened until it is safe: until

- the level's own merit falls enough (Armijo's condition), `f(q) - lambda^T (r_above(q) - r_above)`: its true cost f
  with what it will lose, to first order, once the levels above have made good what the motion costs them (the
  Lagrangian, so that two levels in conflict come to rest);
- no task of a level above is farther from its target than without the levels below it, but for
  `Options.level_position_tolerance` and `Options.level_orientation_tolerance`;
- no limit is broken that the QP knows to first order only, there or while the arm brakes from there.

What a motion takes from the levels above by their curvature is given back first, by the least displacement that their
rows tell (second-order correction: Nocedal and Wright, "Numerical Optimization", 2006, section 18.3), so that a
self-motion is as fast as the joints are. What cannot be made safe is left out.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from maira_qp.problem.limits.joint import FEASIBILITY, Bounds, Tick
from maira_qp.problem.options import Options
from maira_qp.problem.qp.hierarchy import Level
from maira_qp.problem.qp.qp import QP
from maira_qp.problem.tasks.task import Task
from maira_qp.robots.model.configuration import Configuration
from maira_qp.solvers.reference.context import Context
from maira_qp.solvers.reference.step_models import TickModel, dependent
from maira_qp.solvers.reference.stopping import violations_ahead

HALVINGS = 12

ARMIJO = 0.05
"""Share of what the model's slope promises that the merit must fall."""

ROUNDING = 1e-14
"""What a merit may rise for rounding, relative to one more than the cost."""

RETURNS = 2
"""Times that what a step takes from the levels above is given back."""

CORRECTIONS = 2
"""Times that bent limits are linearised anew to correct a step."""

SAME = 1e-10
"""Growth of a violation that counts as none, since distances are known to some rounding [m]."""


@dataclass(frozen=True)
class TickLevel:
    """A level: its true cost, its tasks, and the quadratic model of it that the hierarchy solves."""

    value: Callable[[Configuration], float]
    tasks: tuple[Task, ...]
    model: TickModel
    replaced: tuple[TickLevel, ...] = ()
    """The levels whose rows it stands for, if it has none of its own"""
    to_first_order: bool = False
    """The levels below keep its rows, and what these do not tell may be lost"""

    @property
    def level(self) -> Level:
        """The quadratic model."""
        return self.model.level

    def bent_by(self, C: np.ndarray) -> TickLevel:
        """The same with a curvature C (n, n) added to the quadratic model."""
        level = replace(self.level, H=self.level.H + C)
        return replace(self, model=replace(self.model, level=level))

    @property
    def rows(self) -> np.ndarray:
        """Rows (m, n) that `changes` tells of."""
        if self.replaced:
            return np.vstack([model.rows for model in self.replaced])
        return self.level.rows[:0] if self.to_first_order else self.level.rows

    def changes(self, at: Configuration, before: Configuration, after: Configuration) -> np.ndarray:
        """What a motion changes of the weighted errors (m,) of its rows; nothing of directions in which it bends."""
        if self.replaced:
            return np.concatenate([model.changes(at, before, after) for model in self.replaced])
        changes = [task.weighted_change(at, before, after) for task in self.tasks if not task.is_wish]
        return np.concatenate([*changes, np.zeros(self.model.bent)])

    def shares(self, at: Configuration, options: Options) -> np.ndarray:
        """What is left of the tasks' errors, or of the cost if there is none, by what the levels below may add."""
        position, orientation = options.level_position_tolerance, options.level_orientation_tolerance
        if self.to_first_order:
            return np.empty(0)
        if not self.tasks:
            return np.array([self.value(at) / (0.5 * orientation**2)])
        return np.array([task.residual(at) for task in self.tasks]).ravel() / np.tile(
            [position, orientation], len(self.tasks)
        )


def safe_step(
    models: Sequence[TickLevel],
    at: Configuration,
    displacements: Sequence[np.ndarray],
    context: Context,
    bounds: Bounds,
    now: Tick | None = None,
) -> np.ndarray:
    """The displacement (n,) with each level's part shortened until the true costs and the bent limits allow it.

    Where no time passes, until the level's own cost falls: what the levels above lose there, later ticks make good.
    """
    dq, solved, kept = bounds.rest, bounds.rest, np.empty(0)
    there = at.moved(dq) if dq.any() else at
    broken, most_loss = None, math.inf if now is None else 1.0
    if context.is_watched and now is not None:
        broken = np.maximum(context.violations(at), min(violations_ahead(there, dq, context, now), key=np.sum))
    fastest = 0.0 if now is None else max(1.0, context.pace(at, dq, now))
    for k, displacement in enumerate(displacements):
        model, above, part = models[k], models[:k], displacement - solved
        before, share = model.value(there), bounds.share_inside(dq, part)
        if now is not None:
            share *= context.share_in_pace(at, dq, share * part, fastest, now)
        slope = ARMIJO * min(float((model.level.c + model.level.H @ solved) @ part), 0.0)
        most = before + ROUNDING * (1 + abs(before))
        give_back = None if now is None else _giving_back(above, displacement, bounds)
        trials = _Trials(model, above, at, there, kept, context, bounds, now, broken, fastest, most_loss, give_back)
        solved = displacement
        for _ in range(HALVINGS):
            step, trial, shrink = trials.of(dq + share * part, most + share * slope)
            if step is not None:
                dq, there = step, trial
                break
            share *= shrink
        kept = np.concatenate([kept, model.shares(there, context.options)])
    return dq


@dataclass(frozen=True)
class _Trials:
    """Displacements of a tick, with what a level adds to the levels above it, and how they are judged."""

    model: TickLevel
    above: Sequence[TickLevel]
    at: Configuration
    there: Configuration
    """Where the levels above lead"""
    kept: np.ndarray
    """What these have reached, as their `shares`"""
    context: Context
    bounds: Bounds
    now: Tick | None
    broken: np.ndarray | None
    """What may be broken of limits that the rows alone do not keep"""
    fastest: float
    most_loss: float
    give_back: Callable[[np.ndarray], np.ndarray] | None

    def of(self, step: np.ndarray, most: float) -> tuple[np.ndarray | None, Configuration, float]:
        """The displacement (n,) as it may be taken, where it leads, and by what a part that may not is to be shortened.

        None where it may not: where it breaks a limit, costs the levels above too much, or the level's merit is more
        than `most`. What it takes from the levels above is given back as long as that helps.
        """
        off, given, options = np.inf, 0, self.context.options
        while True:
            if self.broken is not None and self.now is not None:
                back = _brought_back(self.at, step, self.broken, self.context, self.bounds, self.now)
                if back is None:
                    return None, self.there, 0.8 if given else 0.5
                step = back
            if not self._is_allowed(step):
                return None, self.there, 0.8 if given else 0.5
            trial = self.at.moved(step)
            merit, changes = self.model.value(trial), _changes(self.above, self.at, self.there, trial)
            loss = float((_shares(self.above, trial, options) - self.kept).max(initial=0.0))
            if self.now is not None:
                merit -= self.model.model.multipliers @ changes
            is_safe = loss <= self.most_loss and merit <= most
            before, off = off, float(np.linalg.norm(changes))
            clean = is_safe and off <= options.level_orientation_tolerance
            too_long = off > 0.5 * before  # for rows of where it began
            if self.give_back is None or given == RETURNS or clean or too_long:
                shrink = 0.5 if loss <= self.most_loss else max(0.1, min(0.9 / math.sqrt(loss), 0.8))  # of second order
                return (step if is_safe else None), trial, shrink
            step, given = step + self.give_back(changes), given + 1

    def _is_allowed(self, step: np.ndarray) -> bool:
        """A displacement (n,) is within the bounds, and as slow as limits on speed ask."""
        slow = self.now is None or self.context.pace(self.at, step, self.now) <= self.fastest
        return self.bounds.contain(step) and slow


def _giving_back(
    above: Sequence[TickLevel], displacement: np.ndarray, bounds: Bounds
) -> Callable[[np.ndarray], np.ndarray] | None:
    """The least displacement (n,) that takes away what is given of the errors (m,) of the levels above, by their rows.

    In the joints that do not stand at a bound of the tick; None where there are no rows.
    """
    held = (displacement <= bounds.lower + FEASIBILITY) | (displacement >= bounds.upper - FEASIBILITY)
    K = np.vstack([np.empty((0, len(held))), *(model.rows for model in above)])
    if not len(K):
        return None
    K = np.where(held, 0.0, K)
    M = K @ K.T + dependent(K) * np.eye(len(K))
    return lambda errors: K.T @ np.linalg.solve(M, errors)


def _changes(models: Sequence[TickLevel], at: Configuration, before: Configuration, after: Configuration) -> np.ndarray:
    """What a motion changes of the weighted errors (m,) of all rows of some levels."""
    return np.concatenate([np.empty(0), *(model.changes(at, before, after) for model in models)])


def _shares(models: Sequence[TickLevel], at: Configuration, options: Options) -> np.ndarray:
    """The errors of some levels by what the levels below may add to them."""
    return np.concatenate([np.empty(0), *(model.shares(at, options) for model in models)])


def _brought_back(
    at: Configuration, dq: np.ndarray, allowed: np.ndarray, context: Context, bounds: Bounds, now: Tick
) -> np.ndarray | None:
    """The displacement dq (n,) with what corrects the second order by which it breaks bent limits more than `allowed`.

    That is the least further displacement that keeps them as they are linearised where dq leads to (second-order
    correction: Nocedal and Wright, section 18.3). None where it takes too long, or where they are broken while the arm
    brakes from there.
    """
    most = np.where(allowed > 0, allowed + SAME, 0.0)
    for _ in range(CORRECTIONS + 1):
        there = at.moved(dq)
        if (context.violations(there) <= most).all():
            ways = violations_ahead(there, dq, context, now)
            return dq if any((broken <= most).all() for broken in ways) else None
        G, h = context.rows_within(there, allowed)
        G, h = np.vstack([G, bounds.G]), np.concatenate([h - SAME, np.maximum(bounds.h - bounds.G @ dq, 0.0)])
        lower, upper = np.minimum(bounds.lower - dq, 0.0), np.maximum(bounds.upper - dq, 0.0)
        back = context.backend.solve(QP(np.eye(at.n), np.zeros(at.n), lower, upper, G, h))
        if not back.found:
            return None
        dq = np.clip(dq + back.x, bounds.lower, bounds.upper)
    return None
