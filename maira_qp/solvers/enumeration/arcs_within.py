"""The pieces of an S-R-S arm's arcs that keep limits beside those of the joints, and the best configuration of each.

The limits are looked at at samples, between which no joint turns by more than `APART`; where one is kept and the next
is not, the end of the piece is bisected. On each piece the objective is made least on grids that narrow about the
least of their values. What is narrower than the samples may be missed.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np
import pinocchio as pin

from maira_qp.analytic.srs.arcs import Arc, at_each
from maira_qp.analytic.srs.geometry import SRS
from maira_qp.analytic.srs.optimum import STEP, Best, SampledArcs
from maira_qp.problem.objectives import Objective, Posture

PARTS = 4
"""Parts into which the steps of `SampledArcs` are cut."""
APART = STEP / PARTS
"""How far joints turn between two samples at most [rad]."""
BISECTIONS = 40
GRID, ROUNDS = 17, 7
"""Places of a grid on a piece, and how often it is narrowed, each time by an eighth: to 1e-6 of the piece."""

Keeps = Callable[[np.ndarray], bool]


def best_of_each_piece(srs: SRS, T: pin.SE3, objective: Objective, keeps: Keeps) -> list[Best]:
    """The best of each piece of an arc for a pose on which `keeps` says of configurations (7,) that limits are kept."""
    sampled = SampledArcs.of(srs, T, objective)
    return [
        _best(srs, piece, objective, keeps)
        for k, arc in enumerate(sampled.arcs)
        for piece in _pieces(srs, arc, objective, sampled.psi[sampled.which == k], keeps)
    ]


def _pieces(srs: SRS, arc: Arc, objective: Objective, psi: np.ndarray, keeps: Keeps) -> Iterator[Arc]:
    """The pieces of an arc, from its samples (m,) [rad] and others between them."""
    if len(psi) > 1:
        psi = np.append((psi[:-1, None] + np.arange(PARTS) / PARTS * np.diff(psi)[:, None]).ravel(), psi[-1])
    kept = np.array([keeps(q) for q in _at(srs, arc, objective, psi)])
    ends = np.flatnonzero(np.diff(np.concatenate([[False], kept, [False]])))
    for first, last in zip(ends[::2], ends[1::2] - 1, strict=True):
        low, high = float(psi[first]), float(psi[last])
        if first > 0:
            low = _edge(srs, arc, objective, float(psi[first - 1]), low, keeps)
        if last + 1 < len(psi):
            high = _edge(srs, arc, objective, float(psi[last + 1]), high, keeps)
        yield replace(arc, lower=low, upper=high)


def _edge(srs: SRS, arc: Arc, objective: Objective, out: float, within: float, keeps: Keeps) -> float:
    """The place [rad] next to one outside that is still within."""
    for _ in range(BISECTIONS):
        middle = 0.5 * (out + within)
        if keeps(_at(srs, arc, objective, np.array([middle]))[0]):
            within = middle
        else:
            out = middle
    return within


def _best(srs: SRS, piece: Arc, objective: Objective, keeps: Keeps) -> Best:
    """The least of the objective on a piece."""
    low, high = piece.lower, piece.upper
    found: Best | None = None
    for _ in range(ROUNDS if high > low else 1):
        psi = np.linspace(low, high, GRID if high > low else 1)
        q = _at(srs, piece, objective, psi)
        costs = np.array([objective.cost(srs.robot.at(each)) for each in q])
        for k in np.argsort(costs, kind="stable"):
            if keeps(q[k]):
                if found is None or costs[k] < found.cost:
                    found = Best(q[k], float(costs[k]), float(psi[k]), piece)
                low, high = psi[max(k - 1, 0)], psi[min(k + 1, len(psi) - 1)]
                break
    assert found is not None  # its ends are kept
    return found


def _at(srs: SRS, arc: Arc, objective: Objective, psi: np.ndarray) -> np.ndarray:
    """Configurations (m, 7) at psi (m,) [rad], continuous joints at the turn nearest to the reference of a posture."""
    q = at_each([arc], np.zeros(len(psi), int), psi)
    if isinstance(objective, Posture):
        turns = np.round((objective.q_ref - q) / (2 * np.pi))
        q = q + np.where(np.isinf(srs.robot.upper), 2 * np.pi * turns, 0.0)
    return np.clip(q, srs.robot.lower, srs.robot.upper)
