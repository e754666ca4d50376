"""The best of all configurations that put the tip of an S-R-S arm at a pose: the global minimum over its arcs.

Along each arc (`maira_qp.robots.arcs`) the cost is a function of the swivel angle alone. It is sampled, denser where
the joints turn fast, and each least sample between two others is refined by bounded scalar minimisation (Brent,
"Algorithms for minimization without derivatives", 1973, chapter 5). A minimum narrower than the samples, `STEP` apart
in every joint, can be missed.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio as pin
from scipy.optimize import minimize_scalar

from maira_qp.problem.objectives import Objective, Posture
from maira_qp.robots.arcs import Arc, arcs
from maira_qp.robots.srs import SRS, Branch

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
    least: Best | None = None
    for sampled in sorted(_sampled(srs, T, objective.of(srs.robot)), key=lambda each: each.costs.min()):
        if least is None or sampled.bound < least.cost:
            refined = sampled.refined()
            least = refined if least is None or refined.cost < least.cost else least
    return least


def best_of_each_arc(srs: SRS, T: np.ndarray | pin.SE3, objective: Objective) -> list[Best]:
    """All configurations that reach T (4, 4) within the limits, as arcs with the best of each, the lowest cost first.

    Raises `PoseError`, `OptionError`.
    """
    refined = [sampled.refined() for sampled in _sampled(srs, T, objective.of(srs.robot))]
    return sorted(refined, key=lambda one: one.cost)


def nearest(srs: SRS, T: np.ndarray | pin.SE3, q0: Any, weights: Any = None) -> Best | None:
    """The configuration nearest to q0 (7,) by `sum_i w_i (q_i - q0_i)^2`, w None: 1; see `best`."""
    return best(srs, T, Posture(q0, weights))


@dataclass(frozen=True, eq=False)
class _Sampled:
    """An arc, and the cost at samples of it."""

    arc: Arc
    objective: Objective
    psi: np.ndarray
    """(k,) [rad]"""
    q: np.ndarray
    """(k, 7) [rad]"""
    costs: np.ndarray
    """(k,)"""

    @property
    def bound(self) -> float:
        """No cost on the arc is lower; known of a posture alone.

        Its root is a distance: between two samples it falls by no more than these are apart.
        """
        if not isinstance(self.objective, Posture):
            return -np.inf
        gaps = np.abs(np.diff(self.q, axis=0)).max(axis=0, initial=0.0)
        reach = np.sqrt(0.5 * gaps @ (self.objective.weights * gaps))
        return float(max(np.sqrt(self.costs.min()) - reach, 0.0) ** 2)

    def refined(self) -> Best:
        """The least cost on the arc."""

        def cost(psi: float) -> float:
            return float(_evaluated(self.arc, self.objective, np.array([psi]))[1][0])

        psi, costs = self.psi, self.costs
        found = [(float(costs.min()), float(psi[costs.argmin()]))]
        for i in _least(costs):
            low, high = psi[max(i - 1, 0)], psi[min(i + 1, len(psi) - 1)]
            if high > low:
                result: Any = minimize_scalar(cost, bounds=(low, high), method="bounded", options={"xatol": 1e-9})
                found.append((float(result.fun), float(result.x)))
        least, at = min(found)
        return Best(_evaluated(self.arc, self.objective, np.array([at]))[0][0], least, at, self.arc)


def _sampled(srs: SRS, T: np.ndarray | pin.SE3, objective: Objective) -> list[_Sampled]:
    """All arcs, sampled; those that differ by whole turns alone at the same angles."""
    samples: dict[tuple[Branch, float, float], np.ndarray] = {}
    sampled = []
    for arc in arcs(srs, T):
        key = (arc.branch, arc.lower, arc.upper)
        if key not in samples:
            samples[key] = _samples(arc)
        sampled.append(_Sampled(arc, objective, samples[key], *_evaluated(arc, objective, samples[key])))
    return sampled


def _evaluated(arc: Arc, objective: Objective, psi: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The configurations (k, 7) [rad] at psi (k,) [rad], and their costs (k,).

    With a posture, a continuous joint takes the turn that is nearest to the reference.
    """
    robot, q = arc.robot, arc.at(psi)
    if isinstance(objective, Posture):
        turns = np.round((objective.q_ref - q) / (2 * np.pi))
        q = q + np.where(np.isinf(robot.upper), 2 * np.pi * turns, 0.0)
    return q, np.array([objective.cost(robot.at(each)) for each in q])


def _least(costs: np.ndarray) -> np.ndarray:
    """Which samples (k,) are no higher than their neighbours."""
    padded = np.concatenate([[np.inf], costs, [np.inf]])
    return np.flatnonzero((costs <= padded[:-2]) & (costs <= padded[2:]))


def _samples(arc: Arc) -> np.ndarray:
    """Angles psi (k,) [rad] from end to end of an arc, between which no joint turns by more than `STEP`."""
    psi = np.unique(np.linspace(arc.lower, arc.upper, 3 + int(arc.length / STEP)))
    for _ in range(16):
        turned = np.abs(np.diff(arc.at(psi), axis=0)).max(axis=1, initial=0.0)
        wide = (turned > STEP) & (np.diff(psi) > _FINEST)
        if not wide.any():
            break
        psi = np.sort(np.concatenate([psi, 0.5 * (psi[:-1] + psi[1:])[wide]]))
    return psi
