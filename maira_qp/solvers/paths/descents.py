"""Descents along a path of poses: one from each start, none of which looks elsewhere."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from maira_qp.kernels.layout import Outcome, Setting
from maira_qp.solvers.compiled.batch import Batch
from maira_qp.solvers.compiled.multi_start import attempts
from maira_qp.solvers.compiled.problem_arrays import ProblemArrays


@dataclass(frozen=True, eq=False)
class PathArrays:
    """The poses of a path, and the compiled problem that they are targets of."""

    arrays: ProblemArrays
    rows: np.ndarray
    """(N, 12) R by rows, then p"""

    def __len__(self) -> int:
        return len(self.rows)

    @property
    def n(self) -> int:
        """How many joints there are."""
        return self.arrays.n

    def within(self, position: float, orientation: float) -> PathArrays:
        """The same path, at whose poses it is enough to be within these tolerances [m, rad]."""
        settings = self.arrays.settings.copy()
        settings[Setting.POSITION_TOLERANCE], settings[Setting.ORIENTATION_TOLERANCE] = position, orientation
        return replace(self, arrays=replace(self.arrays, settings=settings))

    def descend(self, which: np.ndarray, starts: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Descend to the poses `which` (M,), indices, from starts (M, n): q (M, n), and which of them arrived (M,)."""
        return self.descend_to(self.rows[which], starts)

    def descend_to(self, rows: np.ndarray, starts: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The same to poses (M, 12) that are given. What a start breaks of the limits is clipped."""
        q, outcome = np.empty(starts.shape), np.empty((len(starts), Outcome.WIDTH))
        batch = Batch(np.ascontiguousarray(rows), np.ascontiguousarray(starts), np.zeros(len(starts), np.uint64), False)
        attempts(self.arrays, batch, 0, 0, q, outcome)
        return q, outcome[:, Outcome.SUCCESS] > 0.0

    def jacobians(self, q: np.ndarray) -> np.ndarray:
        """The tool's Jacobians (M, 6, n), without the rows that the task leaves free."""
        return self.arrays.robot.jacobians(q)[:, self.arrays.problem.tasks[0].all_weights > 0.0]
