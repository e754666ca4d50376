"""Per-solve context of the reference engine: a problem, its limits as one set, and the QP backend."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.optimize import brentq, nnls

from maira_qp.errors import OptionError
from maira_qp.problem.limits.joint import (
    FEASIBILITY,
    KEPT,
    Bounds,
    Limit,
    Tick,
    merge,
)
from maira_qp.problem.options import Options
from maira_qp.problem.problem import Problem
from maira_qp.problem.qp.backends import Backend
from maira_qp.problem.qp.hierarchy import Level, null_space, solve_hierarchy
from maira_qp.problem.qp.qp import QP
from maira_qp.robots.model.configuration import Configuration
from maira_qp.robots.model.robot import Robot, drawn

RESTORING = 40
"""Steps at most that bring a configuration back within limits that are not linear."""

RESERVE = 1e-8
"""What a solve keeps from limits that are not linear [in the unit of their rows], so that neither rounding nor the
tolerance to which distances are found puts an answer outside."""

STANDING = 1e-7
"""A configuration as near to such a limit stands on it."""

NEAR = 1e-3
"""A limit as near may bend the way along it."""

FAINT = 1e-6
"""Least damping of a restoring step, as a share of the largest entry of `G^T G`."""

PACED = 1e-13
"""To which a share of a motion is found that a limit on speed allows."""

IMPROVING = 0.999
"""A restoration goes on while a step leaves less than this share of the sum of squares."""


@dataclass(frozen=True)
class Context:
    """A problem with who solves its QPs: what one solve shares, and its limits as one set."""

    problem: Problem
    backend: Backend
    narrowed: tuple[np.ndarray, np.ndarray] | None = None
    """What starts of a search are drawn from, (n,) and (n,) [rad or m]; None: the problem's own"""

    @property
    def robot(self) -> Robot:
        """The problem's robot."""
        return self.problem.robot

    @property
    def options(self) -> Options:
        """The problem's options."""
        return self.problem.options

    @property
    def further(self) -> tuple[Limit, ...]:
        """The problem's limits beside those of the joints."""
        return self.problem.additional_limits

    def with_limits(self, limits: tuple[Limit, ...]) -> Context:
        """The same with other limits beside those of the joints."""
        return replace(self, problem=replace(self.problem, additional_limits=limits))

    @cached_property
    def sampling_range(self) -> tuple[np.ndarray, np.ndarray]:
        """What starts of a search are drawn from, (n,) and (n,) [rad or m]."""
        return self.problem.turns.window if self.narrowed is None else self.narrowed

    @cached_property
    def long_slides(self) -> np.ndarray:
        """Slides (n,) that are sampled in part only."""
        first, last = self.sampling_range
        return self.robot.slides & ((first > self.robot.lower) | (last < self.robot.upper))

    def random_start(self, rng: np.random.Generator) -> np.ndarray:
        """A configuration (n,) to start from, uniform within the range."""
        return drawn(rng, *self.sampling_range)

    def bounds(self, at: Configuration, tick: Tick | None = None) -> Bounds:
        """All limits on a displacement from a configuration, in a tick if given."""
        return merge(self.problem.limits, at, tick, RESERVE if tick is None else 0.0)

    def standing(self, at: Configuration) -> Bounds:
        """The same where no time passes, with limits that the configuration stands on at no distance."""
        bounds = self.bounds(at)
        return replace(bounds, h=np.where(bounds.h <= STANDING, 0.0, bounds.h)) if self.is_bent else bounds

    @cached_property
    def is_bent(self) -> bool:
        """Some limits are known by their rows to first order only."""
        return bool(self._bent)

    @cached_property
    def _bent(self) -> tuple[Limit, ...]:
        """Limits that are known by their rows to first order only."""
        return tuple(limit for limit in self.further if _is_bent(limit))

    @cached_property
    def _watched(self) -> tuple[Limit, ...]:
        """Limits that the rows of a tick alone do not keep: bent ones, and, where joints cannot stop at once, all."""
        if np.isinf(self.robot.acceleration_limit).all():
            return self._bent
        return tuple(limit for limit in self.further if limit.is_linear or _is_bent(limit))

    @property
    def is_watched(self) -> bool:
        """A tick must look at limits, where it leads to and while the arm brakes from there."""
        return bool(self._watched)

    @cached_property
    def _paced(self) -> tuple[Limit, ...]:
        """Limits on speeds that are neither boxes nor rows."""
        return tuple(limit for limit in self.further if type(limit).pace is not Limit.pace)

    @property
    def is_paced(self) -> bool:
        """There are such limits."""
        return bool(self._paced)

    def pace(self, at: Configuration, dq: np.ndarray, now: Tick) -> float:
        """How fast a displacement dq (n,) of a tick is, as a share of what such limits allow."""
        return max((limit.pace(at, dq, now) for limit in self._paced), default=0.0)

    def share_in_pace(self, at: Configuration, dq: np.ndarray, part: np.ndarray, most: float, now: Tick) -> float:
        """The share in [0, 1] of a part (n,) that may be added to a displacement dq (n,) with a pace up to `most`."""
        if not self._paced or self.pace(at, dq + part, now) <= most:
            return 1.0
        too_fast = lambda share: self.pace(at, dq + share * part, now) - most  # noqa: E731
        if too_fast(0.0) >= 0.0:
            return 0.0
        return max(0.0, float(brentq(too_fast, 0.0, 1.0, xtol=PACED)) - 2 * PACED)  # type: ignore[arg-type]

    def rows(self, at: Configuration) -> tuple[np.ndarray, np.ndarray]:
        """G (m, n) and h (m,) of all limits with rows, h negative where one is broken."""
        rows = self._rows_of_each(at)
        if not rows:
            return np.empty((0, at.n)), np.empty(0)
        return np.vstack([G for _, G, _ in rows]), np.concatenate([h for _, _, h in rows])

    def _rows_of_each(self, at: Configuration) -> list[tuple[Limit, np.ndarray, np.ndarray]]:
        """The limits that have rows, and these, computed once for a configuration."""
        kept = at.kept.get((id(self), "rows"))
        if kept is None:
            rows = [(limit, *row) for limit in self.further if (row := limit.rows(at, None)) is not None]
            kept = at.kept[id(self), "rows"] = (self, rows)
        return kept[1]

    def violation(self, at: Configuration) -> float:
        """By how much a configuration breaks one of the limits that are not linear; >= 0."""
        return max((limit.violation(at) for limit in self._bent), default=0.0)

    def violations(self, at: Configuration) -> np.ndarray:
        """By how much a configuration breaks each part (k,) of the limits that a tick must look at; >= 0."""
        return np.concatenate([limit.violations(at) for limit in self._watched])

    def rooms(self, at: Configuration) -> np.ndarray:
        """What is left of each part of them (k,), negative where it is broken; inf where none is near."""
        return np.concatenate([limit.rooms(at) for limit in self._watched])

    def rows_within(self, at: Configuration, allowed: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """G (m, n) and h (m,) of bent limits that keep each part (k,) broken by at most what is `allowed`, to first
        order; parts of linear limits are among the k, and have no rows."""
        G, h, start = [np.empty((0, at.n))], [np.empty(0)], 0
        for limit in self._watched:
            if not limit.is_linear and (rows := limit.rows(at, None)) is not None:
                G.append(rows[0])
                h.append(rows[1] + allowed[start + limit.parts(at)])
            start += len(limit.violations(at))
        return np.vstack(G), np.concatenate(h)

    def breach(self, at: Configuration) -> float:
        """Half the sum of squares of what is broken of all limits with rows."""
        return _half_squares(self.rows(at)[1])

    def broken(self, at: Configuration) -> float:
        """The breach, or the violation where that is larger; 0 where all limits are kept to rounding."""
        if not self.further:
            return 0.0
        h, violation = self.rows(at)[1], self.violation(at)
        is_kept = violation <= KEPT and not (h < -KEPT).any()
        return 0.0 if is_kept else max(_half_squares(h), 0.5 * violation**2)

    def is_within(self, at: Configuration) -> bool:
        """Whether all further limits are kept, without the tolerance for rounding that `broken` has."""
        return not self.further or (self.violation(at) <= 0.0 and not (self.rows(at)[1] < 0.0).any())

    def keeps(self, trial: Configuration, at: Configuration) -> bool:
        """A trial breaks no bent limit more than a configuration did."""
        return not self.is_bent or self.violation(trial) <= self.violation(at)

    def encroachment(self, at: Configuration) -> float:
        """How deep a configuration is in the reserve of limits that are not linear, as a motion [rad or m]; >= 0."""
        depth = 0.0
        for limit, G, h in self._rows_of_each(at):
            if not limit.is_linear and (h < RESERVE).any():
                steep = np.maximum(np.linalg.norm(G[h < RESERVE], axis=1), FAINT)
                depth += float(((RESERVE - h[h < RESERVE]) / steep).sum())
        return depth

    @cached_property
    def bends_by_formula(self) -> bool:
        """Some bent limits know their curvature by a formula."""
        return any(limit.knows_curvature for limit in self._bent)

    def curvature(
        self, at: Configuration, gradient: np.ndarray, above: np.ndarray | None = None, by_formula: bool = False
    ) -> np.ndarray:
        """What limits that are not linear add to the Hessian (n, n) of a cost with a gradient (n,) that they hold up.

        Rows and joint limits that the configuration stands on hold it up by multipliers >= 0, those that balance it
        best in the null space of the rows `above` (m, n), if there are any; the rows' second derivatives, so weighted,
        are what the Lagrangian bends by beside the cost. `by_formula`: of the limits alone that know it by one.
        """
        C = np.zeros((at.n, at.n))
        rows = self._rows_of_each(at)
        near = [h <= NEAR for _, _, h in rows]
        if not self.is_bent or not any(each.any() for each in near):
            return C
        eye = np.eye(at.n)
        faces = [-eye[at.q <= self.robot.lower], eye[at.q >= self.robot.upper]]
        G = np.vstack([*(G[each] for (_, G, _), each in zip(rows, near, strict=True)), *faces])
        Z = eye if above is None or not len(above) else null_space(above)
        size = float(np.abs(gradient).max()) or 1.0
        held, start = size * nnls((G @ Z).T, -(gradient / size) @ Z)[0] if Z.shape[1] else np.zeros(len(G)), 0
        for (limit, _, h), each in zip(rows, near, strict=True):
            multipliers, stop = np.zeros(len(h)), start + int(each.sum())
            multipliers[each], start = held[start:stop], stop
            counts = limit.knows_curvature if by_formula else not limit.is_linear
            if counts and multipliers.any():
                C += limit.curvature(at, multipliers)
        return C

    def moved(self, at: Configuration, dq: np.ndarray) -> Configuration:
        """The configuration after a displacement dq (n,), inside the joint limits exactly."""
        return self.robot.at(self.robot.clip(self.robot.kinematics.integrate(at.q, dq)))

    def check(self) -> None:
        """Raises `OptionError` if the linear limits leave nothing."""
        linear = tuple(limit for limit in self.further if limit.is_linear)
        self.with_limits(linear).admitted(self.robot.middle)

    def admitted(self, q: np.ndarray) -> np.ndarray:
        """The configuration (n,) within all limits that is nearest to q (n,); of bent limits one that is near.

        Raises `OptionError` if limits that are linear leave none; where bent ones seem to, what breaks them least
        around: of the steps that bring it there each is the nearest that linearised limits allow, or, where they allow
        none, the damped Gauss-Newton step of the sum of squares of what is broken (elastic mode of sequential quadratic
        programming: Nocedal and Wright, section 18.2).
        """
        at = self.robot.at(self.robot.clip(q))
        if not self.further or not self._misses(at):
            return at.q.copy()
        if not self.is_bent:
            nearest = self._nearest(at, q)
            if nearest is None:
                raise OptionError("no configuration satisfies the limits together")
            return nearest.q.copy()
        missing, damping = self._shortfall(at), FAINT
        for _ in range(RESTORING):
            trial = self._nearest(at, q)
            left = np.inf if trial is None else self._shortfall(trial)
            if trial is None or left > 0.5 * missing:
                elastic = self._pulled_in(at, damping)
                if elastic is not None and (after := self._shortfall(elastic)) < left:
                    trial, left = elastic, after
            if trial is None or left >= missing:
                damping *= 10.0
                if damping > 1e3:
                    break
                continue
            improves, at, missing, damping = left < IMPROVING * missing, trial, left, max(FAINT, 0.1 * damping)
            if not (improves and self._misses(at)):
                break
        return at.q.copy()

    def _misses(self, at: Configuration) -> bool:
        """A configuration is not within some limit."""
        rows = self._rows_of_each(at)
        return any(bool((h < (-FEASIBILITY if limit.is_linear else 0.0)).any()) for limit, _, h in rows)

    def _shortfall(self, at: Configuration) -> float:
        """Half the sum of squares of what is missing of the limits with their reserve."""
        return _half_squares(self._reserved(at)[1])

    def _reserved(self, at: Configuration) -> tuple[np.ndarray, np.ndarray]:
        """G (m, n) and h (m,) of all limits with rows, what is kept in reserve taken off."""
        G, h = self.rows(at)
        linear = [np.full(len(each), limit.is_linear) for limit, _, each in self._rows_of_each(at)]
        return G, h - np.where(np.concatenate([np.empty(0, bool), *linear]), 0.0, RESERVE)

    def _nearest(self, at: Configuration, q: np.ndarray) -> Configuration | None:
        """Within the limits linearised at a configuration, the one nearest to q (n,); None if there is none."""
        return self.best_within(np.eye(at.n), at.displacement(q), at)

    def best_within(self, H: np.ndarray, c: np.ndarray, at: Configuration) -> Configuration | None:
        """After the dq (n,) with the least `c^T dq + 1/2 dq^T H dq` within the limits linearised at a configuration.

        Rows that are broken must be kept there; None if that cannot be.
        """
        G, h = self._reserved(at)
        best = self.backend.solve(QP(H, c, self.robot.lower - at.q, self.robot.upper - at.q, G, h))
        return self.moved(at, best.x) if best.found else None

    def _pulled_in(self, at: Configuration, damping: float) -> Configuration | None:
        """After the damped step that leaves the least sum of squares of what is missing of linearised limits."""
        G, h = self._reserved(at)
        bounds = Bounds(self.robot.lower - at.q, self.robot.upper - at.q, np.empty((0, at.n)), np.empty(0))
        mu = damping * max(float((G**2).sum(axis=0).max(initial=0.0)), 1e-12)
        level = Level(mu * np.eye(at.n), np.zeros(at.n), np.empty((0, at.n)), wishes=(G, h))
        dq = solve_hierarchy([level], bounds, self.backend)
        return None if dq is None else self.moved(at, dq)


def _is_bent(limit: Limit) -> bool:
    """Whether a limit is known by its rows to first order only."""
    kind = type(limit)
    return not limit.is_linear and (kind.rows is not Limit.rows or kind.violation is not Limit.violation)


def _half_squares(h: np.ndarray) -> float:
    """Half the sum of squares of what is negative of h (m,)."""
    return 0.5 * float((np.minimum(h, 0.0) ** 2).sum())
