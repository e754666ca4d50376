"""What the compiled engine writes for a batch of targets, and how it reads as the fields of an answer."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from maira_qp.kernels.refinement import stabilized_sqp_simd as refined
from maira_qp.kernels.search import multi_start as searched
from maira_qp.results.status import statuses_of


class Outcomes(NamedTuple):
    """Configurations and outcomes of N targets."""

    q: np.ndarray
    """(N, n)"""
    search: np.ndarray
    """(N, 9), see `kernels.search.multi_start`"""
    refinement: np.ndarray
    """(N, 6), see `kernels.refinement.stabilized_sqp_simd`; NaN where the search did it all"""

    @staticmethod
    def empty(count: int, n: int) -> Outcomes:
        """For so many targets of n joints."""
        return Outcomes(np.empty((count, n)), np.empty((count, searched.OUTCOME)), np.empty((count, refined.OUTCOME)))

    def fields(self, tolerance: float) -> dict[str, np.ndarray]:
        """Fields of `BatchSolution`; a refinement whose projected gradient is within the tolerance is optimal."""
        columns = self.search
        is_refined = ~np.isnan(self.refinement[:, refined.REACHED])
        gradient = self.refinement[:, refined.PROJECTED_GRADIENT]
        reached = np.where(is_refined, self.refinement[:, refined.REACHED] > 0, columns[:, searched.SUCCESS] > 0)
        optimal = np.where(is_refined, gradient <= tolerance, reached)
        more = np.where(is_refined, self.refinement[:, refined.ITERATIONS], 0.0)

        def last(name: str) -> np.ndarray:
            return np.where(is_refined, self.refinement[:, getattr(refined, name)], columns[:, getattr(searched, name)])

        return {
            "q": self.q,
            "success": reached,
            "status": statuses_of(
                reached=reached,
                breaks_limits=np.zeros(len(reached), dtype=bool),
                proved=is_refined & (columns[:, searched.SUCCESS] < 0),
                stationary=optimal,
            ),
            "position_error": last("POSITION_ERROR"),
            "orientation_error": last("ORIENTATION_ERROR"),
            "iterations": columns[:, searched.SPENT] + more,
            "restarts": columns[:, searched.ATTEMPT],
            "cost": self.refinement[:, refined.OBJECTIVE],
            "projected_gradient": gradient,
            "optimal": optimal,
            "start_projected": columns[:, searched.MOVED] > 0,
            "left_q0": columns[:, searched.LEFT] > 0,
        }
