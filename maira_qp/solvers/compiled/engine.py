"""The compiled engine: stages on a batch of targets, of which a solve is a batch of one.

Each stage is a function of the problem's arrays and a batch: the search from starts (`near_start.py`) or without
(`anywhere.py`: the closed form, multi-start descents, certificates), then the refinement (`refinement.py`).
"""

from __future__ import annotations

from functools import cached_property
from threading import Event

import numpy as np

from maira_qp.kernels.layout import Outcome
from maira_qp.kernels.search.multi_start import admit
from maira_qp.kernels.spatial.pose_validation import FINE, NOT_RIGID
from maira_qp.orientation import ORTHONORMAL_WITHIN
from maira_qp.problem.targets import SEED_0, streams
from maira_qp.solvers.compiled.anywhere import find_anywhere
from maira_qp.solvers.compiled.batch import Batch
from maira_qp.solvers.compiled.multi_start import attempts, find_in_time
from maira_qp.solvers.compiled.near_start import NearStart
from maira_qp.solvers.compiled.outcomes import Outcomes
from maira_qp.solvers.compiled.problem_arrays import ProblemArrays
from maira_qp.solvers.compiled.refinement import finish
from maira_qp.solvers.compiled.thread_pool import NEVER, Progress, in_shares
from maira_qp.solvers.reference.levenberg_marquardt import Budget
from maira_qp.solvers.reference.multi_start import Search, found_by_kernel

SHARE = 1024
"""Targets of a batch that a thread takes up at a stretch. Long enough that threads seldom meet in Python, short enough
that Ctrl-C is heard."""


class Compiled(ProblemArrays):
    """The compiled engine of one problem: its arrays, and the stages that they go through."""

    NOT_RIGID = NOT_RIGID

    def solve(
        self, T: np.ndarray, q0: np.ndarray | None, seed: np.ndarray
    ) -> tuple[int, np.ndarray, np.ndarray, list[float], list[float]]:
        """Solve for a target T (4, 4), from q0 (n,) or without a start, under a seed (2,).

        Returns what is wrong with T, see `kernels.search.multi_start.admit`; the target (1, 12); q (n,); the outcome of
        the search (9,); and, where there was more to do than to reach the pose, the result of the refinement (6,).
        """
        n = self.n
        row, stream, q = np.empty((1, 12)), np.empty(1, np.uint64), np.empty((1, n))
        outcome = np.empty((1, Outcome.WIDTH))
        starts = self.no_starts if q0 is None else q0.reshape(1, n)
        fault = admit(T, ORTHONORMAL_WITHIN, self.farthest, starts, seed, row, stream)
        if fault != FINE:
            return fault, row, q[0], [], []
        batch, after = Batch(row, starts, stream, seed is not SEED_0 and bool(seed.any())), []
        self.find(batch, q, outcome)
        if self.settles or not outcome[0, Outcome.SUCCESS] > 0.0:
            after = finish(self, batch, q, outcome).ravel().tolist()
        return fault, row, q[0], outcome[0].tolist(), after

    def _starts(self, q0: np.ndarray | None) -> np.ndarray:
        """Starts (N, n) of a search: q0 (n,) or (N, n), or none of them."""
        return self.no_starts if q0 is None else q0.reshape(-1, self.n)

    def find(self, batch: Batch, q: np.ndarray, outcome: np.ndarray, halted: Event = NEVER) -> None:
        """Search for q (N, n) that reach the targets, near their starts if they have any."""
        if not len(batch.starts):
            find_anywhere(self, batch, q, outcome, halted)
        elif attempts(self, batch, 0, 0, q, outcome) > 0:
            self._near_start.search_on(batch, q, outcome, halted)

    @cached_property
    def _near_start(self) -> NearStart:
        return NearStart.of(self)

    def search(
        self, row: np.ndarray, q0: np.ndarray | None, stream: np.ndarray, shuffled: bool, budget: Budget
    ) -> Search:
        """Search for a target (12,) within the time of a budget; with a deadline it is looked up now and then."""
        batch = Batch(row.reshape(1, 12), self._starts(q0), stream, shuffled)
        q, outcome = np.empty((1, self.robot.n)), np.empty((1, Outcome.WIDTH))
        if not budget.has_deadline:
            self.find(batch, q, outcome)
        elif not len(batch.starts):
            find_in_time(self, batch, q, outcome, budget)
        elif attempts(self, batch, 0, 0, q, outcome) > 0:
            self._near_start.search_in_time(batch, q, outcome, budget)
        budget.iterations += int(outcome[0, Outcome.SPENT])
        return found_by_kernel(self.robot, q[0], outcome[0])

    def solve_batch(
        self,
        rows: np.ndarray,
        starts: np.ndarray | None,
        seed: np.ndarray,
        threads: int | None,
        progress: Progress | None,
    ) -> Outcomes:
        """Solve for N targets (N, 12), from starts (N, n) or without, under a seed (2,); on several threads."""
        shuffled = bool(seed.any())
        outcomes = Outcomes.empty(len(rows), self.robot.n)

        def work(part: slice, halted: Event) -> None:
            begin, q, outcome = None if starts is None else starts[part], outcomes.q[part], outcomes.search[part]
            batch = Batch(rows[part], self._starts(begin), streams(rows[part], seed), shuffled)
            self.find(batch, q, outcome, halted)
            if not halted.is_set():
                outcomes.refinement[part] = finish(self, batch, q, outcome)

        in_shares(work, len(rows), SHARE, threads, progress)
        return outcomes
