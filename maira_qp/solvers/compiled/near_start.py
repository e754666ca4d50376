"""A compiled search from a start: the pose or the nearest point near it, unless there is something better elsewhere.

What is near, and what is worth leaving for, is said in `neighbourhood`. The descent from the start is followed to the
pose or, by Newton's method, to the nearest point. A descent that moved a joint further than its first error asks for is
made again in short steps, which do not leave the valley that it begins in. What still is short of the pose is looked
for around the start, in closed form near the start where the arm is S-R-S, and then as without a start.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from threading import Event

import numpy as np

from maira_qp.kernels.kinematics.unwrap import unwind
from maira_qp.kernels.layout import Outcome, Refinement, Setting
from maira_qp.solvers.compiled.anywhere import find_anywhere
from maira_qp.solvers.compiled.batch import Batch
from maira_qp.solvers.compiled.closed_form import reach_near_posture
from maira_qp.solvers.compiled.multi_start import attempts, find_in_time
from maira_qp.solvers.compiled.problem_arrays import ProblemArrays
from maira_qp.solvers.compiled.refinement import nearest, references, refine
from maira_qp.solvers.compiled.thread_pool import parts
from maira_qp.solvers.neighbourhood import BESIDE, NEAR, SHORT_STEP, starts_beside
from maira_qp.solvers.reference.levenberg_marquardt import Budget

Found = tuple[np.ndarray, np.ndarray]
"""q (N, n) and outcomes (N, 9) of `kernels.search.multi_start`"""


@dataclass(frozen=True, eq=False)
class NearStart:
    """The search from starts of one problem."""

    arrays: ProblemArrays
    in_short_steps: ProblemArrays
    """The same with descents that follow the valley that they begin in"""
    elsewhere: ProblemArrays | None
    """The same with one attempt less; None: there are no restarts"""

    @staticmethod
    def of(arrays: ProblemArrays) -> NearStart:
        """For a problem."""
        settings, last = arrays.settings.copy(), arrays.last_attempt
        settings[Setting.LONGEST], settings[Setting.STALL_RATIO] = SHORT_STEP, 0.0
        elsewhere = replace(arrays, last_attempt=last - 1) if last > 0 else None
        return NearStart(arrays, replace(arrays, settings=settings), elsewhere)

    def search_on(self, batch: Batch, q: np.ndarray, outcome: np.ndarray, halted: Event) -> None:
        """From where the descents from the starts ended: q (N, n) and outcomes (N, 9) in place."""
        arrived = (outcome[:, Outcome.SUCCESS] > 0.0) & (outcome[:, Outcome.WANDERED] == 0.0)
        for part in parts(
            np.flatnonzero(~arrived & np.isfinite(outcome[:, Outcome.FINAL_COST])), self.arrays.last_attempt + 1, halted
        ):
            some, near, end = batch.some(part), q[part], outcome[part]
            self._follow(some, near, end)
            self._look_nearer(some, near, end)
            left = np.flatnonzero(end[:, Outcome.SUCCESS] == 0.0)
            if len(left) and self.elsewhere is None:
                end[left[self.arrays.proofs.unreachable(some.rows[left])], Outcome.SUCCESS] = Outcome.PROVED
            elif len(left):
                there = self._look_elsewhere(some.some(left), halted)
                near[left], end[left] = self._better(some.some(left), (near[left], end[left]), there)
            q[part], outcome[part] = near, end

    def search_in_time(self, batch: Batch, q: np.ndarray, outcome: np.ndarray, budget: Budget) -> None:
        """The same for one target for which there may be too little time."""
        self._follow(batch, q, outcome)
        self._look_nearer(batch, q, outcome)
        if outcome[0, Outcome.SUCCESS] > 0.0 or self.elsewhere is None or budget.late():
            return
        there = self._look_beside(batch)
        if there[1][0, Outcome.SUCCESS] == 0.0 and not budget.late():
            find_in_time(self.elsewhere, batch.anywhere, *there, budget)
            self._turn_and_approach(batch, *there)
        q[:], outcome[:] = self._better(batch, (q, outcome), there)

    def _follow(self, batch: Batch, q: np.ndarray, outcome: np.ndarray) -> None:
        """To the pose or a nearest point, in place; where a descent wandered, in short steps if that ends nearer."""
        self._approach(self.arrays, batch, q, outcome)
        far = _displacements(q, batch.starts)
        moved = np.where(outcome[:, Outcome.SUCCESS] > 0.0, outcome[:, Outcome.WANDERED] > 0.0, far > NEAR)
        again = np.flatnonzero(moved)
        if not len(again):
            return
        some, steady = batch.some(again), np.zeros(len(again), dtype=bool)
        near, end = np.empty((len(again), q.shape[1])), np.empty((len(again), Outcome.WIDTH))
        attempts(self.in_short_steps, some, 0, 0, near, end)
        steady = self._approach(self.in_short_steps, some, near, end)
        arrived = (outcome[again, Outcome.SUCCESS] > 0.0) & (end[:, Outcome.SUCCESS] > 0.0)
        taken = steady & ~(arrived & (_displacements(near, some.starts) >= far[again]))
        which = again[taken]
        wandered = q[which], outcome[which]
        q[which], outcome[which] = self._better(batch.some(which), (near[taken], end[taken]), wandered)

    def _look_nearer(self, batch: Batch, q: np.ndarray, outcome: np.ndarray) -> None:
        """Where a descent reaches its target, but only far away: what does so near the start, in place."""
        far = _displacements(q, batch.starts)
        which = np.flatnonzero(
            (outcome[:, Outcome.SUCCESS] > 0.0) & (outcome[:, Outcome.WANDERED] > 0.0) & (far > NEAR)
        )
        if not len(which) or self.elsewhere is None:
            return
        some = batch.some(which)
        there, found = self._look_beside(some)
        nearer = (found[:, Outcome.SUCCESS] > 0.0) & (_displacements(there, some.starts) < far[which])
        outcome[which, Outcome.SPENT] += found[:, Outcome.SPENT]
        q[which[nearer]] = there[nearer]
        for column in (Outcome.FINAL_COST, Outcome.POSITION_ERROR, Outcome.ORIENTATION_ERROR):
            outcome[which[nearer], column] = found[nearer, column]

    def _look_elsewhere(self, batch: Batch, halted: Event) -> Found:
        """What is found from other starts: reached near the own one if possible, else anywhere, or nearest points."""
        assert self.elsewhere is not None
        q, outcome = self._look_beside(batch)
        left = np.flatnonzero(outcome[:, Outcome.SUCCESS] == 0.0)
        if len(left):
            some = batch.some(left)
            far, end = np.empty((len(left), q.shape[1])), np.empty((len(left), Outcome.WIDTH))
            find_anywhere(self.elsewhere, some.anywhere, far, end, halted)
            self._turn_and_approach(some, far, end)
            end[:, Outcome.SPENT] += outcome[left, Outcome.SPENT]
            q[left], outcome[left] = far, end
        return q, outcome

    def _look_beside(self, batch: Batch) -> Found:
        """What reaches the targets near the starts; where nothing does the outcome is no success."""
        count, n = batch.starts.shape
        q, outcome = np.zeros((count, n)), np.zeros((count, Outcome.WIDTH))
        if self.arrays.proofs.srs is not None:
            for k in range(count):
                reach_near_posture(
                    self.arrays, batch.rows[k : k + 1], batch.starts[k], np.ones(n), q[k : k + 1], outcome[k : k + 1]
                )
            unwind(self.arrays.chain, batch.starts, outcome[:, Outcome.SUCCESS], q)
        else:
            around = starts_beside(self.arrays.robot, batch.starts).reshape(-1, n)
            many = batch.some(np.repeat(np.arange(count), BESIDE))
            ends, found = np.empty(around.shape), np.empty((len(around), Outcome.WIDTH))
            attempts(self.arrays, many._replace(starts=around), 0, 0, ends, found)
            unwind(self.arrays.chain, many.starts, found[:, Outcome.SUCCESS], ends)
            apart = np.where(found[:, Outcome.SUCCESS] > 0.0, _displacements(ends, many.starts), np.inf).reshape(
                count, BESIDE
            )
            nearest = apart.argmin(axis=1)
            chosen = nearest + BESIDE * np.arange(count)
            q[:], outcome[:] = ends[chosen], found[chosen]
            outcome[:, Outcome.ATTEMPT] = nearest
            outcome[:, Outcome.SPENT] = found[:, Outcome.SPENT].reshape(count, BESIDE).sum(axis=1)
        outcome[:, Outcome.ATTEMPT] = np.minimum(outcome[:, Outcome.ATTEMPT] + 1.0, self.arrays.last_attempt)
        return q, outcome

    def _turn_and_approach(self, batch: Batch, q: np.ndarray, outcome: np.ndarray) -> None:
        """What was found without the starts: turned to them, and where it is short at the nearest point."""
        outcome[:, Outcome.ATTEMPT] += 1.0
        proved = outcome[:, Outcome.SUCCESS] == Outcome.PROVED
        unwind(self.arrays.chain, batch.starts, np.ones(len(q)), q)
        self._approach(self.arrays, batch, q, outcome)
        outcome[proved, Outcome.SUCCESS] = Outcome.PROVED

    def _approach(self, arrays: ProblemArrays, batch: Batch, q: np.ndarray, outcome: np.ndarray) -> np.ndarray:
        """From what does not reach its target to the nearest point, in place.

        Returns which of q (N, n) reach their targets or are stationary, (N,).
        """
        steady = outcome[:, Outcome.SUCCESS] > 0.0
        short = np.flatnonzero(~steady & np.isfinite(outcome[:, Outcome.FINAL_COST]))
        if not len(short):
            return steady
        q[short], end = nearest(arrays, batch.rows[short], references(arrays, batch.some(short)), q[short])
        outcome[short, Outcome.SUCCESS] = end[:, Refinement.REACHED]
        outcome[short, Outcome.SPENT] += end[:, Refinement.ITERATIONS]
        outcome[short, Outcome.POSITION_ERROR] = end[:, Refinement.POSITION_ERROR]
        outcome[short, Outcome.ORIENTATION_ERROR] = end[:, Refinement.ORIENTATION_ERROR]
        outcome[short, Outcome.FINAL_COST] = 0.5 * np.square(self._weighted_errors(outcome[short]))
        steady[short] = (end[:, Refinement.REACHED] > 0.0) | (
            end[:, Refinement.PROJECTED_GRADIENT] <= arrays.stationarity_tolerance
        )
        return steady

    def _better(self, batch: Batch, near: Found, there: Found) -> Found:
        """Of what is near and what is there the former, unless the latter is worth leaving for."""
        (q, end), (other, found) = near, there
        arrived, reached = end[:, Outcome.SUCCESS] > 0.0, found[:, Outcome.SUCCESS] > 0.0
        errors = self._weighted_errors(found)
        if self.arrays.trades_off and reached.any():
            errors[reached] = self._traded_off(batch.some(reached), other[reached])
            reached[:] = False
        leaves = ~arrived & (reached | (self._weighted_errors(end) - errors > self._margin))
        outcome = np.where(leaves[:, None], found, end)
        outcome[:, Outcome.MOVED] = end[:, Outcome.MOVED]
        outcome[:, Outcome.LEFT] = leaves | (end[:, Outcome.LEFT] > 0.0)
        outcome[:, Outcome.ATTEMPT] = found[:, Outcome.ATTEMPT]
        outcome[:, Outcome.SPENT] = end[:, Outcome.SPENT] + found[:, Outcome.SPENT]
        outcome[~arrived & (found[:, Outcome.SUCCESS] == Outcome.PROVED), Outcome.SUCCESS] = Outcome.PROVED
        return np.where(leaves[:, None], other, q), outcome

    def _traded_off(self, batch: Batch, q: np.ndarray) -> np.ndarray:
        """|W e| (N,) that a redundancy by weight leaves of the errors of q (N, n), which reach their targets."""
        q, end = q.copy(), np.empty((len(q), Refinement.WIDTH))
        refine(self.arrays, batch.rows, references(self.arrays, batch), q, end)
        return self._weighted(end[:, [Refinement.POSITION_ERROR, Refinement.ORIENTATION_ERROR]])

    def _weighted_errors(self, outcome: np.ndarray) -> np.ndarray:
        """|W e| (N,) of outcomes (N, 9)."""
        return self._weighted(outcome[:, [Outcome.POSITION_ERROR, Outcome.ORIENTATION_ERROR]])

    def _weighted(self, errors: np.ndarray) -> np.ndarray:
        """|W e| (N,) of errors of position and orientation (N, 2)."""
        weights = self.arrays.settings[[Setting.POSITION_WEIGHT, Setting.ORIENTATION_WEIGHT]]
        return np.asarray(np.linalg.norm(weights * errors, axis=1))

    @property
    def _margin(self) -> float:
        """|W (position tolerance, orientation tolerance)|."""
        return float(
            self._weighted(self.arrays.settings[None, [Setting.POSITION_TOLERANCE, Setting.ORIENTATION_TOLERANCE]])[0]
        )


def _displacements(q: np.ndarray, starts: np.ndarray) -> np.ndarray:
    """How far (N,) the joint that moved most is from its start."""
    return np.abs(q - starts).max(axis=1, initial=0.0)
