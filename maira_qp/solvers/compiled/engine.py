"""The compiled engine: the search of `search.py` and `descent.py`, and the settling of `settling.py`, by kernels."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property, lru_cache
from threading import Event
from typing import NamedTuple

import numpy as np

from maira_qp.kernels.jit.simd import LANES
from maira_qp.kernels.kinematics.unwrap import TURN, has_free_turn, unwind, unwind_free
from maira_qp.kernels.refinement.nearest_pose import nearest_points
from maira_qp.kernels.refinement.null_space_sqp import settle, trade_off_each
from maira_qp.kernels.refinement.stabilized_sqp_simd import (
    ITERATIONS,
    MAX_SETTLING,
    OBJECTIVE,
    PROJECTED_GRADIENT,
    REACHED,
    STATIONARITY_TOLERANCE,
)
from maira_qp.kernels.refinement.stabilized_sqp_simd import OUTCOME as SETTLED
from maira_qp.kernels.search.levenberg_marquardt import lanes_memory
from maira_qp.kernels.search.multi_start import (
    ATTEMPT,
    FINAL_COST,
    OUTCOME,
    PROVED,
    SPENT,
    SUCCESS,
    admit,
    memory_sizes,
    search,
)
from maira_qp.kernels.search.seeds import has_long_slides, place_all
from maira_qp.kernels.spatial.pose_validation import FINE, NOT_RIGID
from maira_qp.kernels.srs.nearest_pose import nearest_in_closed_form
from maira_qp.kernels.srs.posture_seed import ROWS, reach_near_posture
from maira_qp.kernels.srs.reach import reach_in_closed_form
from maira_qp.kernels.srs.swivel_intervals import FLOATS, INTEGERS, PIECES
from maira_qp.orientation import ORTHONORMAL_WITHIN
from maira_qp.problem.targets import SEED_0, streams
from maira_qp.robots.model.revolutions import WITHIN
from maira_qp.solvers.compiled.near_start import NearStart
from maira_qp.solvers.compiled.outcomes import Outcomes
from maira_qp.solvers.compiled.problem_arrays import KIND, WEIGHT, WEIGHTED, ProblemArrays
from maira_qp.solvers.compiled.thread_pool import NEVER, Progress, in_shares, parts
from maira_qp.solvers.neighbourhood import TURNINGS
from maira_qp.solvers.reference.levenberg_marquardt import Budget
from maira_qp.solvers.reference.multi_start import HEAD, Search, found_by_kernel

SHARE = 1024
"""Targets of a batch that a thread takes up at a stretch. Long enough that threads seldom meet in Python, short enough
that Ctrl-C is heard."""


ELSEWHERE, WORTH = 6, 1.02
"""Other ways to the pose from which the redundancy is settled where it was not at first, at most; and how much larger
its objective may be there. In a fold of the self-motion the tolerances of the pose are worth a percent of it."""


sizes_of = lru_cache(memory_sizes)


class Asked(NamedTuple):
    """Targets, and where the search for each begins."""

    rows: np.ndarray
    """(N, 12) R by rows, then p"""
    starts: np.ndarray
    """(N, n) or (0, n): there are none"""
    streams: np.ndarray
    """(N,) of uint64: what is random about each"""
    shuffled: bool
    """Attempts begin in another order than that of the library"""

    def some(self, which: slice | np.ndarray) -> Asked:
        """Some of them."""
        starts = self.starts[which] if len(self.starts) else self.starts
        return Asked(self.rows[which], starts, self.streams[which], self.shuffled)

    @property
    def anywhere(self) -> Asked:
        """The same targets without starts."""
        return self._replace(starts=self.starts[:0])


class Compiled(ProblemArrays):
    """The search and the settling of one problem in compiled code."""

    NOT_RIGID = NOT_RIGID

    def solve(
        self, T: np.ndarray, q0: np.ndarray | None, seed: np.ndarray
    ) -> tuple[int, np.ndarray, np.ndarray, list[float], list[float]]:
        """What is wrong with a target T (4, 4), see `kernels.search.multi_start.admit`; and from q0 (n,), if any:

        the target (1, 12), q (n,), the outcome of the search (9,), and, where more was to be done than to reach the
        pose, that of the refinement (6,), see `_finish`.
        """
        n = self.n
        row, stream, q, outcome = np.empty((1, 12)), np.empty(1, np.uint64), np.empty((1, n)), np.empty((1, OUTCOME))
        starts = self.no_starts if q0 is None else q0.reshape(1, n)
        fault = admit(T, ORTHONORMAL_WITHIN, self.farthest, starts, seed, row, stream)
        if fault != FINE:
            return fault, row, q[0], [], []
        asked, after = Asked(row, starts, stream, seed is not SEED_0 and bool(seed.any())), []
        self.find(asked, q, outcome)
        if self.settles or not outcome[0, SUCCESS] > 0.0:
            after = self._finish(asked, q, outcome).ravel().tolist()
        return fault, row, q[0], outcome[0].tolist(), after

    def _starts(self, q0: np.ndarray | None) -> np.ndarray:
        """Starts (N, n) of a search: q0 (n,) or (N, n), or none of them."""
        return self.no_starts if q0 is None else q0.reshape(-1, self.n)

    def find(self, asked: Asked, q: np.ndarray, outcome: np.ndarray, halted: Event = NEVER) -> None:
        """Search for q (N, n) that reach the targets, and see whether those that resist are out of reach.

        With starts see `near_start`. Without, a joint that has a turn or more ends at the one that is nearest to the
        posture wished for.
        """
        if len(asked.starts):
            if self.attempts(asked, 0, 0, q, outcome) > 0:
                self._near_start.search_on(asked, q, outcome, halted)
            return
        if self.proofs.srs is not None:
            self._find_in_closed_form(asked, q, outcome, halted)
        else:
            self._find_by_descents(asked, q, outcome, halted)
        if self.turns is not None:
            unwind(self.chain, self.turns.aim[None], outcome[:, SUCCESS], q)

    @cached_property
    def _near_start(self) -> NearStart:
        return NearStart.of(self)

    def _find_in_closed_form(self, asked: Asked, q: np.ndarray, outcome: np.ndarray, halted: Event) -> None:
        """The same for an S-R-S arm, without starts: descents are left what is singular, and no nearest point found."""
        some: slice | np.ndarray = slice(None)
        if self.settles:
            assert self.redundancy is not None
            posture, weights = self.redundancy[2:].reshape(2, -1)
            self.reach_near_posture(asked.rows, posture, weights, q, outcome)
            if outcome[:, SUCCESS].all():
                return
            some = np.flatnonzero(outcome[:, SUCCESS] == 0.0)
        some_q, some_outcome = q[some], outcome[some]
        self._reach_in_closed_form(asked.some(some), some_q, some_outcome)
        q[some], outcome[some] = some_q, some_outcome
        if outcome[:, SUCCESS].min() > 0.0:
            return
        proved, left = np.flatnonzero(outcome[:, SUCCESS] == PROVED), np.flatnonzero(outcome[:, SUCCESS] == 0.0)
        self._approach_in_closed_form(asked, proved, q, outcome)
        beyond = proved[~np.isfinite(outcome[proved, FINAL_COST])]
        for open_ones, last in ((beyond, min(HEAD, self.last_attempt)), (left, self.last_attempt)):
            for part in parts(open_ones, last + 1, halted):
                q[part], outcome[part] = self._attempt(asked, 0, last, part)
        outcome[proved, SUCCESS] = PROVED

    def _find_by_descents(self, asked: Asked, q: np.ndarray, outcome: np.ndarray, halted: Event) -> None:
        """The same for any chain: some descents at each target, then proofs, then the others at what resists."""
        last, head = self.last_attempt, min(HEAD, self.last_attempt)
        self.attempts(asked, 0, head, q, outcome)
        if outcome[:, SUCCESS].all():
            return
        left = np.flatnonzero((outcome[:, SUCCESS] == 0.0) & np.isfinite(outcome[:, FINAL_COST]))
        for part in parts(left, last + 1, halted):
            proved = self.proofs.unreachable(asked.rows[part])
            outcome[part[proved], SUCCESS] = PROVED
            resisting = part[~proved]
            if head < last and len(resisting):
                found_q, found = self._attempt(asked, head + 1, last, resisting)
                found[:, SPENT] += outcome[resisting, SPENT]
                worse = (found[:, SUCCESS] == 0.0) & (outcome[resisting, FINAL_COST] <= found[:, FINAL_COST])
                found[worse, FINAL_COST:] = outcome[resisting[worse], FINAL_COST:]
                found_q[worse] = q[resisting[worse]]
                q[resisting], outcome[resisting] = found_q, found

    def _attempt(self, asked: Asked, first: int, last: int, some: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """q (k, n) and outcomes (k, 7) of the attempts first, ..., last at k of the targets."""
        q, outcome = np.empty((len(some), self.robot.n)), np.empty((len(some), OUTCOME))
        self.attempts(asked.some(some), first, last, q, outcome)
        return q, outcome

    def reach_near_posture(
        self, rows: np.ndarray, posture: np.ndarray, weights: np.ndarray, q: np.ndarray, outcome: np.ndarray
    ) -> None:
        """Put q (N, 7) of an S-R-S arm that reach the targets near a posture (7,), weighted; some are left open."""
        problem = self.chain, self.settings, self.proofs.srs, rows, posture, weights
        memory = np.empty(FLOATS), np.empty(INTEGERS, np.int64), np.empty((ROWS, LANES)), np.empty((20, 3))
        reach_near_posture(*problem, *memory, q, outcome)

    def _reach_in_closed_form(self, asked: Asked, q: np.ndarray, outcome: np.ndarray) -> None:
        """Put q (N, 7) that reach the targets, or that it is proved that nothing does; the rest is left open."""
        problem = self.chain, self.settings, self.proofs.srs, asked.rows, asked.streams, asked.shuffled
        memory = np.empty(FLOATS), np.empty(INTEGERS, np.int64), np.empty((8, PIECES, 3)), np.empty((20, 3))
        reach_in_closed_form(*problem, *memory, q, outcome)

    def _approach_in_closed_form(self, asked: Asked, some: np.ndarray, q: np.ndarray, outcome: np.ndarray) -> None:
        """Put the nearest points of some of the targets, which are out of reach, into q (N, 7)."""
        if len(some):
            near, end, tolerance = q[some], outcome[some], self.settling[STATIONARITY_TOLERANCE]
            problem, (rows, _, streams, shuffled) = (self.chain, self.settings, self.proofs.srs), asked.some(some)
            nearest_in_closed_form(*problem, self.proofs.span, rows, streams, shuffled, tolerance, near, end)
            q[some], outcome[some] = near, end

    def settle(self, rows: np.ndarray, near: np.ndarray | None, q: np.ndarray, after: np.ndarray) -> None:
        """Settle the redundancy at the configurations q (N, n), in place, that reach the targets (N, 12).

        Joints turn to what is `near`, (N, n) or (1, n), as `_at_turns` says; None: they keep their turns.
        """
        self._settle_strictly(rows, q, after)
        if near is not None:
            self._at_turns(rows, near, self._posture, self._settle_strictly, q, after)
        if self.trades_off:
            self._trade_off(rows, q, after)
            if near is not None:
                self._at_turns(rows, near, self._posture, self._trade_off_again, q, after)

    @property
    def trades_off(self) -> bool:
        """There is a redundancy, and it is `Weighted`."""
        return self.redundancy is not None and self.redundancy[KIND] == WEIGHTED

    @cached_property
    def _posture(self) -> tuple[np.ndarray, np.ndarray]:
        """Reference (n,) and weights (n,) of the redundancy's objective."""
        assert self.redundancy is not None
        return self.redundancy[2 : 2 + self.robot.n], self.redundancy[2 + self.robot.n :]

    def _settle_strictly(self, rows: np.ndarray, q: np.ndarray, after: np.ndarray) -> None:
        """To the optima of the objective alone."""
        settle(self.chain, self.settings, rows, *self._posture, self.settling, q, after)

    def _trade_off(self, rows: np.ndarray, q: np.ndarray, after: np.ndarray) -> None:
        """From there to the optima of the weighted sum."""
        weight = self.redundancy[WEIGHT]  # type: ignore[index]
        trade_off_each(self.chain, self.settings, rows, *self._posture, weight, self.settling, q, after)

    def _trade_off_again(self, rows: np.ndarray, q: np.ndarray, after: np.ndarray) -> None:
        """From near such optima."""
        after[:, [REACHED, ITERATIONS]] = 1.0, 0.0
        self._trade_off(rows, q, after)

    def _at_turns(
        self,
        rows: np.ndarray,
        near: np.ndarray,
        posture: tuple[np.ndarray, np.ndarray],
        refine: Callable[[np.ndarray, np.ndarray, np.ndarray], None],
        q: np.ndarray,
        after: np.ndarray,
    ) -> None:
        """Turn joints of q (N, n), which was refined, to the whole turns nearest to what is `near`, in place.

        No joint is turned to where the cost of a posture (n,) by weights (n,) is higher. What was turned is refined
        again: limits that held a joint up may be a whole turn away.
        """
        if not has_free_turn(self.chain, near, *posture, q):
            return
        which = after[:, PROJECTED_GRADIENT] < np.inf
        for _ in range(TURNINGS):
            turned, there = which.copy(), q.copy()
            unwind_free(self.chain, near, *posture, turned, there)
            some = np.flatnonzero(turned)
            if not len(some):
                return
            q_some, end = there[some], np.empty((len(some), SETTLED))
            refine(rows[some], q_some, end)
            end[:, ITERATIONS] += after[some, ITERATIONS]
            worse = (self._is_settled(after[some]) & ~self._is_settled(end)) | (end[:, REACHED] < after[some, REACHED])
            q[some[~worse]], after[some[~worse]] = q_some[~worse], end[~worse]
            which[some[worse]] = False

    def _settle_elsewhere(self, asked: Asked, k: int, q: np.ndarray, outcome: np.ndarray, after: np.ndarray) -> None:
        """Try to settle target k, which resists, from where later attempts reach it: q and both outcomes in place.

        In a narrow fold of the self-motion steps are short, and a walk stops; from its other side it may be easy.
        """
        some, begun = np.array([k]), outcome[k, ATTEMPT]
        for _ in range(ELSEWHERE):
            first = int(begun) + 1
            if first > self.last_attempt:
                return
            there, found = self._attempt(asked, first, self.last_attempt, some)
            if not found[0, SUCCESS] > 0.0:
                return
            begun, end = found[0, ATTEMPT], np.full((1, SETTLED), np.nan)
            if self.turns is not None:
                unwind(self.chain, self.turns.aim[None], found[:, SUCCESS], there)
            self.settle(asked.rows[some], self.references(asked.some(some)), there, end)
            if self._is_settled(end)[0] and end[0, OBJECTIVE] <= WORTH * after[k, OBJECTIVE]:
                found[0, SPENT] += outcome[k, SPENT]
                q[k], outcome[k], after[k] = there[0], found[0], end[0]
                return

    def _is_settled(self, after: np.ndarray) -> np.ndarray:
        """Which of the second outcomes (N, 6) are optima, (N,)."""
        return np.asarray(after[:, PROJECTED_GRADIENT] <= self.settling[STATIONARITY_TOLERANCE])

    def _finish(self, asked: Asked, q: np.ndarray, outcome: np.ndarray) -> np.ndarray:
        """From what was found for the targets (N, 12) to the redundancy's optimum, or the nearest point; q in place.

        The second outcomes (N, 6), see `kernels.refinement.null_space_sqp.settle`; NaN where there was nothing to do.
        """
        after = np.full((len(q), SETTLED), np.nan)
        if self.settles:
            self.settle(asked.rows, self.references(asked), q, after)
            if not len(asked.starts):
                for k in np.flatnonzero((outcome[:, SUCCESS] > 0.0) & ~self._is_settled(after)).tolist():
                    self._settle_elsewhere(asked, k, q, outcome, after)
        if outcome[:, SUCCESS].min() > 0.0:
            return after
        short = np.flatnonzero(~(outcome[:, SUCCESS] > 0.0) & np.isfinite(outcome[:, FINAL_COST]))
        if len(short):
            q[short], after[short] = self.nearest(asked.rows[short], self.references(asked.some(short)), q[short])
        return after

    def references(self, asked: Asked) -> np.ndarray | None:
        """What joints are turned to: the starts (N, n), or the posture wished for (1, n); None: they have one turn."""
        if not self._has_turns:
            return None
        return asked.starts if len(asked.starts) else self.turns.aim[None]  # type: ignore[union-attr]

    @cached_property
    def _has_turns(self) -> bool:
        """Some joint can stand at more than one turn."""
        span = (self.robot.upper - self.robot.lower)[~self.robot.slides]
        return bool((span > TURN + WITHIN).any())

    def nearest(self, rows: np.ndarray, near: np.ndarray | None, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The stationary points of the pose error that q (N, n) lead to, and second outcomes (N, 6).

        Joints turn to what is `near`, (N, n) or (1, n), as `_at_turns` says; None: they keep their turns.
        """
        q, after, free = q.copy(), np.empty((len(q), SETTLED)), np.zeros(self.robot.n)
        self._approach(rows, q, after)
        if near is not None:
            self._at_turns(rows, near, (free, free), self._approach, q, after)
        return q, after

    def _approach(self, rows: np.ndarray, q: np.ndarray, after: np.ndarray) -> None:
        """To the stationary points of the pose error, in place."""
        posture = self._posture if self.settles else (np.full(self.robot.n, np.nan), np.zeros(self.robot.n))
        tolerance, most = self.settling[STATIONARITY_TOLERANCE], int(self.settling[MAX_SETTLING])
        nearest_points(self.chain, self.settings, rows, *posture, tolerance, most, q, after)

    def descend(self, row: np.ndarray, starts: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Where single descents from starts (N, n) toward a target (12,) end: q (N, n), outcomes (N, 7)."""
        q, outcome = np.empty(starts.shape), np.empty((len(starts), OUTCOME))
        asked = Asked(np.tile(row, (len(starts), 1)), starts, np.zeros(len(starts), np.uint64), False)
        self.attempts(asked, 0, 0, q, outcome)
        return q, outcome

    def placed(self, row: np.ndarray, starts: np.ndarray) -> np.ndarray:
        """The starts (N, n) with slides that are sampled in part only placed by a target (12,)."""
        if has_long_slides(self.chain):
            starts = starts.copy()
            place_all(self.chain, self.settings, row, np.empty(lanes_memory(starts.shape[1])), starts)
        return starts

    def settled(self, row: np.ndarray, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The optima of the redundancy near q (N, n), which reach a target (12,), and whether they are reached (N,)."""
        q, outcome = q.copy(), np.empty((len(q), SETTLED))
        self.settle(np.tile(row, (len(q), 1)), None, q, outcome)
        return q, (outcome[:, REACHED] > 0.0) & self._is_settled(outcome)

    def search(
        self, row: np.ndarray, q0: np.ndarray | None, stream: np.ndarray, shuffled: bool, budget: Budget
    ) -> Search:
        """The compiled form of `search.search` for a target (12,). With a deadline it looks up now and then."""
        asked = Asked(row.reshape(1, 12), self._starts(q0), stream, shuffled)
        q, outcome = np.empty((1, self.robot.n)), np.empty((1, OUTCOME))
        if not budget.has_deadline:
            self.find(asked, q, outcome)
        elif not len(asked.starts):
            self.find_in_time(asked, q, outcome, budget)
        elif self.attempts(asked, 0, 0, q, outcome) > 0:
            self._near_start.search_in_time(asked, q, outcome, budget)
        budget.iterations += int(outcome[0, SPENT])
        return found_by_kernel(self.robot, q[0], outcome[0])

    def find_in_time(self, asked: Asked, q: np.ndarray, outcome: np.ndarray, budget: Budget) -> None:
        """`find` for one target without a start, for which there may be too little time."""
        spent, proved = 0.0, False
        for first in range(0, self.last_attempt + 1, LANES):
            found_q, found = self._attempt(asked, first, min(first + LANES - 1, self.last_attempt), np.arange(1))
            spent += found[0, SPENT]
            if first == 0 or found[0, SUCCESS] > 0.0 or found[0, FINAL_COST] < outcome[0, FINAL_COST]:
                q[:], outcome[:] = found_q, found
            outcome[0, ATTEMPT] = found[0, ATTEMPT]
            proved = first == 0 and not (found[0, SUCCESS] > 0.0 or budget.late()) and self._is_proved(asked)
            if found[0, SUCCESS] > 0.0 or proved or budget.late():
                break
        outcome[0, SPENT] = spent
        if proved:
            outcome[0, SUCCESS] = PROVED

    def _is_proved(self, asked: Asked) -> bool:
        return bool(self.proofs.unreachable(asked.rows)[0])

    def solve_batch(
        self,
        rows: np.ndarray,
        starts: np.ndarray | None,
        seed: np.ndarray,
        threads: int | None,
        progress: Progress | None,
    ) -> Outcomes:
        """As `solve`, for targets (N, 12) from starts (N, n) or None."""
        shuffled = bool(seed.any())
        outcomes = Outcomes.empty(len(rows), self.robot.n)

        def work(part: slice, halted: Event) -> None:
            begin, q, outcome = None if starts is None else starts[part], outcomes.q[part], outcomes.search[part]
            asked = Asked(rows[part], self._starts(begin), streams(rows[part], seed), shuffled)
            self.find(asked, q, outcome, halted)
            if not halted.is_set():
                outcomes.refinement[part] = self._finish(asked, q, outcome)

        in_shares(work, len(rows), SHARE, threads, progress)
        return outcomes

    def attempts(self, asked: Asked, first: int, last: int, q: np.ndarray, outcome: np.ndarray) -> int:
        """The attempts first, ..., last at the targets, see `kernels.search.multi_start`; how many are left open."""
        floats, integers = sizes_of(self.n, last - first + 1)
        return search(
            self.chain,
            self.settings,
            self.library,
            self.features,
            self.candidates,
            asked.shuffled,
            asked.rows,
            asked.starts,
            asked.streams,
            first,
            last,
            np.empty(floats),
            np.empty(integers, np.int64),
            q,
            outcome,
        )
