"""What the compiled engine writes for a batch of targets, and how it reads as the fields of an answer."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from maira_qp.kernels.layout import Outcome, Refinement
from maira_qp.results.status import statuses_of


class Outcomes(NamedTuple):
    """Configurations and outcomes of N targets."""

    q: np.ndarray
    """(N, n)"""
    search: np.ndarray
    """(N, 9), see `kernels.layout.Outcome`"""
    refinement: np.ndarray
    """(N, 6), see `kernels.layout.Refinement`; NaN where the search did it all"""

    @staticmethod
    def empty(count: int, n: int) -> Outcomes:
        """For so many targets of n joints."""
        return Outcomes(np.empty((count, n)), np.empty((count, Outcome.WIDTH)), np.empty((count, Refinement.WIDTH)))

    def fields(self, tolerance: float) -> dict[str, np.ndarray]:
        """Fields of `BatchSolution`; a refinement whose projected gradient is within the tolerance is optimal."""
        columns = self.search
        is_refined = ~np.isnan(self.refinement[:, Refinement.REACHED])
        gradient = self.refinement[:, Refinement.PROJECTED_GRADIENT]
        reached = np.where(is_refined, self.refinement[:, Refinement.REACHED] > 0, columns[:, Outcome.SUCCESS] > 0)
        optimal = np.where(is_refined, gradient <= tolerance, reached)
        more = np.where(is_refined, self.refinement[:, Refinement.ITERATIONS], 0.0)

        def last(name: str) -> np.ndarray:
            return np.where(
                is_refined, self.refinement[:, getattr(Refinement, name)], columns[:, getattr(Outcome, name)]
            )

        return {
            "q": self.q,
            "success": reached,
            "status": statuses_of(
                reached=reached,
                breaks_limits=np.zeros(len(reached), dtype=bool),
                proved=is_refined & (columns[:, Outcome.SUCCESS] < 0),
                stationary=optimal,
            ),
            "position_error": last("POSITION_ERROR"),
            "orientation_error": last("ORIENTATION_ERROR"),
            "iterations": columns[:, Outcome.SPENT] + more,
            "restarts": columns[:, Outcome.ATTEMPT],
            "cost": self.refinement[:, Refinement.OBJECTIVE],
            "projected_gradient": gradient,
            "optimal": optimal,
            "start_projected": columns[:, Outcome.MOVED] > 0,
            "left_q0": columns[:, Outcome.LEFT] > 0,
        }


def none_open(outcome: np.ndarray) -> bool:
    """Whether each of N outcomes (N, 9) of a search says that its target is reached, or certified unreachable."""
    return bool(outcome[0, Outcome.SUCCESS] != 0.0 if len(outcome) == 1 else outcome[:, Outcome.SUCCESS].all())


def all_reached(outcome: np.ndarray) -> bool:
    """Whether each of N outcomes (N, 9) of a search says that its target is reached."""
    return bool(outcome[0, Outcome.SUCCESS] > 0.0 if len(outcome) == 1 else outcome[:, Outcome.SUCCESS].min() > 0.0)


def unsettled(refinement: np.ndarray, tolerance: float) -> list[int]:
    """Which of N refinements (N, 6) did not end at a projected gradient within the tolerance."""
    gradients = refinement[:, Refinement.PROJECTED_GRADIENT].tolist()
    return [k for k, gradient in enumerate(gradients) if not gradient <= tolerance]
