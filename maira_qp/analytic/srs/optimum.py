"""The best of all configurations that put the tip of an S-R-S arm at a pose: the global minimum over its arcs.

Along each arc (`analytic.srs.arcs`) the cost is a function of the swivel angle alone. It is sampled, denser where
the joints turn fast, and each least sample between two others is refined by Brent's minimisation (`brent`), all of them
side by side. A minimum narrower than the samples, `STEP` apart in every joint, can be missed.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio as pin

from maira_qp.analytic.brent import minima
from maira_qp.analytic.srs.arcs import Arc, arcs_near, at_each
from maira_qp.analytic.srs.geometry import SRS
from maira_qp.problem.objectives import LimitDistance, Objective, Posture
from maira_qp.robots.model.revolutions import WholeTurns

STEP = 0.2
"""Samples on an arc are at most this far apart [rad] in every joint, singularities aside."""
_FINEST = 1e-6


@dataclass(frozen=True, eq=False)
class Best:
    """The least cost on an arc, and where it is."""

    q: np.ndarray
    """(7,) [rad], within the limits"""
    cost: float
    psi: float
    """[rad]"""
    arc: Arc


def best(srs: SRS, T: np.ndarray | pin.SE3, objective: Objective) -> Best | None:
    """The configuration of least cost that reaches T (4, 4) within the limits; None where there is none.

    Raises `PoseError`, `OptionError`.
    """
    objective = objective.of(srs.robot)
    if isinstance(objective, Posture):  # of all whole turns the nearest ones are the best
        lower, upper = WholeTurns(srs.robot, objective.q_ref).around(0)
        srs = srs.limited(lower, upper)
    sampled = SampledArcs.of(srs, T, objective)
    if not sampled.arcs:
        return None
    wanted = sampled.bounds <= sampled.costs.min()
    wanted[sampled.which[sampled.costs.argmin()]] = True  # whatever the rounding of its bound
    return min(sampled.refined(wanted), key=lambda one: one.cost)


def best_of_each_arc(srs: SRS, T: np.ndarray | pin.SE3, objective: Objective) -> tuple[list[Best], bool]:
    """The configurations that reach T (4, 4) within the limits, as arcs with the best of each, the lowest cost first.

    And whether these are all: see `analytic.srs.arcs.arcs_near`. Raises `PoseError`, `OptionError`.
    """
    sampled = SampledArcs.of(srs, T, objective.of(srs.robot))
    ranked = sorted(sampled.refined(np.ones(len(sampled.arcs), bool)), key=lambda one: one.cost)
    return ranked, sampled.are_all


def nearest(srs: SRS, T: np.ndarray | pin.SE3, q0: Any, weights: Any = None) -> Best | None:
    """The configuration nearest to q0 (7,) by `sum_i w_i (q_i - q0_i)^2`, w None: 1; see `best`."""
    return best(srs, T, Posture(q0, weights))


@dataclass(frozen=True, eq=False)
class SampledArcs:
    """All arcs for a pose, and the cost at N samples, from end to end of one arc after the other."""

    srs: SRS
    arcs: list[Arc]
    objective: Objective
    which: np.ndarray
    """Number of the arc (N,) that a sample is of, ascending"""
    psi: np.ndarray
    """(N,) [rad]"""
    q: np.ndarray
    """(N, 7) [rad]"""
    costs: np.ndarray
    """(N,)"""
    are_all: bool
    """There are no other arcs, of further whole turns"""

    @staticmethod
    def of(srs: SRS, T: np.ndarray | pin.SE3, objective: Objective) -> SampledArcs:
        """Of an objective that was made for the arm: samples between which no joint turns by more than `STEP`."""
        reference = objective.q_ref if isinstance(objective, Posture) else srs.robot.middle
        found, are_all = arcs_near(srs, T, reference)
        counts = [3 + int(arc.length / STEP) if arc.length > 0 else 1 for arc in found]
        which = np.repeat(np.arange(len(found)), counts)
        ends = zip(found, counts, strict=True)
        psi = np.concatenate([[], *(np.linspace(arc.lower, arc.upper, count) for arc, count in ends)])
        q = at_each(found, which, psi)
        for _ in range(16):
            turned = np.abs(np.diff(q, axis=0)).max(axis=1, initial=0.0)
            wide = np.flatnonzero((turned > STEP) & (np.diff(psi) > _FINEST) & (np.diff(which) == 0))
            if not len(wide):
                break
            between, own = 0.5 * (psi[wide] + psi[wide + 1]), which[wide]
            q = np.insert(q, wide + 1, at_each(found, own, between), axis=0)
            which, psi = np.insert(which, wide + 1, own), np.insert(psi, wide + 1, between)
        q = _on_turns(srs, objective, q)
        return SampledArcs(srs, found, objective, which, psi, q, _costs(srs, objective, q), are_all)

    @property
    def bounds(self) -> np.ndarray:
        """What no cost on an arc (A,) is below; known of a posture alone.

        Its root is a distance: between two samples it falls by no more than these are apart.
        """
        bounds = np.full(len(self.arcs), -np.inf)
        if isinstance(self.objective, Posture):
            for k in range(len(self.arcs)):
                own = self.which == k
                gaps = np.abs(np.diff(self.q[own], axis=0)).max(axis=0, initial=0.0)
                sizes = np.abs(self.objective.weights)
                reach = np.sqrt(0.5 * gaps @ (sizes * gaps if self.objective.is_diagonal else sizes @ gaps))
                bounds[k] = max(np.sqrt(self.costs[own].min()) - reach, 0.0) ** 2
        return bounds

    def refined(self, wanted: np.ndarray) -> list[Best]:
        """The least cost on each of the arcs that are wanted (A,)."""
        at, low, high = self._brackets(wanted)
        own = self.which[at]
        psi, _ = minima(lambda rows, psi: self._evaluated(own[rows], psi)[1], low, high)
        psi = np.where(high > low, psi, self.psi[at])
        # a least sample at an end of its arc may itself be the least
        own, psi = np.concatenate([own, own]), np.concatenate([psi, self.psi[at]])
        q, costs = self._evaluated(own, psi)
        order = np.lexsort([costs, own])
        first = order[np.diff(own[order], prepend=-1) > 0]
        return [Best(q[k], float(costs[k]), float(psi[k]), self.arcs[own[k]]) for k in first]

    def _brackets(self, wanted: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The least samples (m,) of the arcs that are wanted (A,), and psi (m,) [rad] of the samples on either side."""
        begins = np.diff(self.which, prepend=-1) > 0
        ends = np.roll(begins, -1)
        falls = np.diff(self.costs, prepend=np.inf) <= 0
        rises = np.diff(self.costs, append=np.inf) >= 0
        at = np.flatnonzero((begins | falls) & (ends | rises) & wanted[self.which])
        return at, self.psi[np.where(begins[at], at, at - 1)], self.psi[np.where(ends[at], at, at + 1) % len(self.psi)]

    def _evaluated(self, which: np.ndarray, psi: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The configurations (m, 7) [rad] at psi (m,) [rad] of some arcs (m,), and their costs (m,)."""
        q = _on_turns(self.srs, self.objective, at_each(self.arcs, which, psi))
        return q, _costs(self.srs, self.objective, q)


def _on_turns(srs: SRS, objective: Objective, q: np.ndarray) -> np.ndarray:
    """The configurations (N, 7) with continuous joints on the turn that is nearest to the reference of a posture."""
    if not isinstance(objective, Posture):
        return q
    turns = np.round((objective.q_ref - q) / (2 * np.pi))
    return q + np.where(np.isinf(srs.robot.upper), 2 * np.pi * turns, 0.0)


def _costs(srs: SRS, objective: Objective, q: np.ndarray) -> np.ndarray:
    """The costs (N,) of configurations (N, 7)."""
    posture = objective.as_posture if isinstance(objective, LimitDistance) else objective
    if isinstance(posture, Posture):
        return posture.costs(q)
    return np.array([objective.cost(srs.robot.at(each)) for each in q])
