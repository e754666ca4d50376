"""The compiled engine: which problems it takes, and the arrays that it needs of them.

For one task of the tip of a serial chain with box limits it runs the search of `search.py` and `descent.py` in compiled
code, and, with one `Posture` or `LimitDistance`, the settling of `settling.py`.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

import numpy as np

from maira_qp.kernels.blocked import FLOATS, INTEGERS, PIECES
from maira_qp.kernels.chain import LOWER, UPPER
from maira_qp.kernels.closed_form_search import reach_in_closed_form
from maira_qp.kernels.descent import (
    LEAST_DAMPING,
    MAX_ITERATIONS,
    ORIENTATION_TOLERANCE,
    POSITION_TOLERANCE,
    STALL_RATIO,
)
from maira_qp.kernels.lane_walk import MAX_SETTLING, PROJECTED_GRADIENT, REACHED, STATIONARITY_TOLERANCE
from maira_qp.kernels.lane_walk import OUTCOME as SETTLED
from maira_qp.kernels.lanes import LANES
from maira_qp.kernels.nearest import nearest_points
from maira_qp.kernels.nearest_in_closed_form import nearest_in_closed_form
from maira_qp.kernels.rigid import FINE
from maira_qp.kernels.search import (
    ATTEMPT,
    FARTHEST_START,
    FINAL_COST,
    OUTCOME,
    PROVED,
    SPENT,
    SUCCESS,
    admit,
    memory_sizes,
    search,
)
from maira_qp.kernels.settling import settle
from maira_qp.kernels.starts import FEATURES, fill_library
from maira_qp.orientation import ORTHONORMAL_WITHIN
from maira_qp.problem.objectives import LimitDistance, Posture
from maira_qp.problem.redundancy import Strict, Weighted
from maira_qp.problem.tasks.frame import FrameTask
from maira_qp.robots.robot import Robot
from maira_qp.robots.serial_chain import chain_of
from maira_qp.solvers import descent, settling
from maira_qp.solvers.descent import Budget
from maira_qp.solvers.library import LIBRARY, starting_library
from maira_qp.solvers.options import Options
from maira_qp.solvers.priorities import Priorities
from maira_qp.solvers.proofs import Proofs
from maira_qp.solvers.search import HEAD, Search, found_by_kernel
from maira_qp.solvers.targets import SEED_0, row_of

CHUNK, CHUNK_OF_ATTEMPTS = 256, 80_000
"""Targets of a batch, and their attempts, that a thread takes up at a stretch: between two of them Ctrl-C is heard."""

EXACT = 1e-12
"""Errors [m, rad] at which a descent that is to be exact ends."""

LEAST_EXACT_DAMPING = 1e-14
"""Its `LEAST_DAMPING`, at the edge of rounding: more would slow it down where singular values are as small."""

# the entries of `Compiled.redundancy`, before 2 n more: the reference and the weights of the posture
KIND, WEIGHT = 0, 1
NONE, WEIGHTED, STRICT = 0, 1, 2

Progress = Callable[[int, int], object]


@dataclass(frozen=True)
class Compiled:
    """The arrays of one problem, see `maira_qp.kernels`: `chain`, `descent`, `starts`."""

    robot: Robot
    chain: np.ndarray
    """(n + 1, 17)"""
    settings: np.ndarray
    """(13,)"""
    library: np.ndarray
    """(K, n)"""
    features: np.ndarray
    """(K / LANES, FEATURES, LANES)"""
    candidates: int
    """Random configurations of which a start is the best"""
    last_attempt: int
    redundancy: np.ndarray | None
    """(2 + 2 n,) kind, weight, reference and weights of a posture; None: another wish"""
    settling: np.ndarray
    """(7,) see `maira_qp.kernels.lane_walk`"""
    proofs: Proofs

    @staticmethod
    def of(priorities: Priorities, options: Options) -> Compiled | str:
        """The problem's arrays, or the reason why the compiled engine cannot take it."""
        robot, task = priorities.robot, priorities.first[0]
        if len(priorities.first) > 1:
            return "it has more than one task"
        if not isinstance(task, FrameTask) or task.target is not None:
            return "its task is none of PoseTask(), PositionTask() and OrientationTask() with a target from the call"
        if not task.is_even:
            return "the axes of its task count differently"
        if task.frame != robot.tip:
            return "its task is not the tip's"
        if not robot.is_chain:
            return "the robot is no single chain of independent joints"
        weights = task.all_weights
        settings = np.array(
            [
                weights[0],
                weights[5],
                options.position_tolerance,
                options.orientation_tolerance,
                options.max_iterations,
                options.damping,
                options.stall_steps,
                options.stall_ratio,
                descent.ACCEPTED,
                descent.REFUSED,
                *descent.FACTOR_RANGE,
                descent.LEAST_DAMPING,
            ]
        )
        constants = np.array(
            [
                options.max_settling,
                options.stationarity_tolerance,
                settling.FIRST_RADIUS,
                settling.LEAST_RADIUS,
                settling.RESTORING,
                settling.RESTORED,
                settling.RESOLUTION,
            ]
        )
        chain, library = chain_of(robot), starting_library(robot)
        features = np.empty((LIBRARY // LANES, FEATURES, LANES))
        fill_library(settings, np.array([row_of(robot.at(q).placement(None)) for q in library]), features)
        proofs = Proofs.of(priorities, options)
        assert proofs is not None
        return Compiled(
            robot,
            chain,
            settings,
            library,
            features,
            options.start_candidates,
            options.max_restarts,
            None if priorities.below else _posture(robot, priorities.redundancy),
            constants,
            proofs,
        )

    def takes(self, starts: np.ndarray | None) -> bool:
        """Whether the kernels can begin there, at (n,) or (N, n): a continuous joint may have wound up too far."""
        return starts is None or bool(np.abs(starts).max(initial=0.0) <= FARTHEST_START)

    @property
    def settles(self) -> bool:
        """There is a redundancy, and the kernels know it."""
        return self.redundancy is not None and self.redundancy[KIND] != NONE

    def solve(
        self, T: np.ndarray, q0: np.ndarray | None, seed: np.ndarray
    ) -> tuple[int, np.ndarray, list[float], list[float]]:
        """What is wrong, see `kernels.search.admit`; q (n,), outcome (7,) for a target T (4, 4) from q0 (n,).

        Where more was to be done than to reach the pose, there is a second outcome (6,), see `_finish`.
        """
        row, stream = np.empty((1, 12)), np.empty(1, np.uint64)
        q, outcome, after, starts = np.empty((1, self.robot.n)), np.empty((1, OUTCOME)), [], self._starts(q0)
        fault = admit(T, ORTHONORMAL_WITHIN, starts, seed, row, stream)
        if fault == FINE:
            self._find(row, starts, stream, seed is not SEED_0 and bool(seed.any()), q, outcome)
            if self.settles or not outcome[0, SUCCESS] > 0.0:
                after = self._finish(row, q, outcome).ravel().tolist()
        return fault, q[0], outcome[0].tolist(), after

    def _starts(self, q0: np.ndarray | None) -> np.ndarray:
        """Starts (N, n) of a search: q0 (n,) or (N, n), or none of them."""
        return np.empty((0, self.robot.n)) if q0 is None else q0.reshape(-1, self.robot.n)

    def _find(
        self,
        rows: np.ndarray,
        starts: np.ndarray,
        streams: np.ndarray,
        shuffled: bool,
        q: np.ndarray,
        outcome: np.ndarray,
    ) -> None:
        """Search for q (N, n) that reach the targets (N, 12), and see whether those that resist are out of reach."""
        last = self.last_attempt
        if self.proofs.srs is not None and not len(starts):
            self._reach_in_closed_form(rows, streams, shuffled, q, outcome)
            if outcome[:, SUCCESS].min() > 0.0:
                return
            proved, left = np.flatnonzero(outcome[:, SUCCESS] == PROVED), np.flatnonzero(outcome[:, SUCCESS] == 0.0)
            self._approach_in_closed_form(rows, streams, shuffled, proved, q, outcome)
            beyond = proved[~np.isfinite(outcome[proved, FINAL_COST])]
            self._part(rows, starts, streams, shuffled, (0, min(HEAD, last)), beyond, q, outcome)
            self._part(rows, starts, streams, shuffled, (0, last), left, q, outcome)
            outcome[proved, SUCCESS] = PROVED
            return
        head = min(HEAD, last)
        self._search(rows, starts, streams, shuffled, 0, head, q, outcome)
        if outcome[:, SUCCESS].all():
            return
        left = np.flatnonzero((outcome[:, SUCCESS] == 0.0) & np.isfinite(outcome[:, FINAL_COST]))
        proved = self.proofs.unreachable(rows[left])
        outcome[left[proved], SUCCESS] = PROVED
        if head < last:
            before_q, before = q.copy(), outcome.copy()
            left = left[~proved]
            self._part(rows, starts, streams, shuffled, (head + 1, last), left, q, outcome)
            outcome[left, SPENT] += before[left, SPENT]
            worse = left[(outcome[left, SUCCESS] == 0.0) & (before[left, FINAL_COST] <= outcome[left, FINAL_COST])]
            before[worse, SPENT], before[worse, ATTEMPT] = outcome[worse, SPENT], outcome[worse, ATTEMPT]
            q[worse], outcome[worse] = before_q[worse], before[worse]

    def _part(
        self,
        rows: np.ndarray,
        starts: np.ndarray,
        streams: np.ndarray,
        shuffled: bool,
        attempts: tuple[int, int],
        some: np.ndarray,
        q: np.ndarray,
        outcome: np.ndarray,
    ) -> None:
        """Make attempts, from a first to a last, at some of the targets."""
        if len(some):
            part_q, part = q[some], outcome[some]
            starts = starts[some] if len(starts) else starts
            self._search(rows[some], starts, streams[some], shuffled, *attempts, part_q, part)
            q[some], outcome[some] = part_q, part

    def _reach_in_closed_form(
        self, rows: np.ndarray, streams: np.ndarray, shuffled: bool, q: np.ndarray, outcome: np.ndarray
    ) -> None:
        reach_in_closed_form(
            self.chain,
            self.settings,
            self.proofs.srs,
            rows,
            streams,
            shuffled,
            np.empty(FLOATS),
            np.empty(INTEGERS, np.int64),
            np.empty((8, PIECES, 3)),
            np.empty((20, 3)),
            q,
            outcome,
        )

    def _approach_in_closed_form(
        self,
        rows: np.ndarray,
        streams: np.ndarray,
        shuffled: bool,
        some: np.ndarray,
        q: np.ndarray,
        outcome: np.ndarray,
    ) -> None:
        """Put the nearest points of some of the targets, which are out of reach, into q (N, 7)."""
        if len(some):
            near, end, tolerance = q[some], outcome[some], self.settling[STATIONARITY_TOLERANCE]
            problem = self.chain, self.settings, self.proofs.srs, self.proofs.span
            nearest_in_closed_form(*problem, rows[some], streams[some], shuffled, tolerance, near, end)
            q[some], outcome[some] = near, end

    def _settle(self, rows: np.ndarray, q: np.ndarray, after: np.ndarray) -> None:
        """Settle the redundancy at the configurations q (N, n), in place, that reach the targets (N, 12)."""
        n, own = self.robot.n, self.redundancy
        assert own is not None
        weight = own[WEIGHT] if own[KIND] == WEIGHTED else 0.0
        settle(self.chain, self.settings, rows, own[2 : 2 + n], own[2 + n :], weight, self.settling, q, after)

    def _finish(self, rows: np.ndarray, q: np.ndarray, outcome: np.ndarray) -> np.ndarray:
        """From what was found for the targets (N, 12) to the redundancy's optimum, or the nearest point; q in place.

        The second outcomes (N, 6), see `kernels.settling.settle`; NaN where there was nothing to do.
        """
        n, own, constants, after = self.robot.n, self.redundancy, self.settling, np.full((len(q), SETTLED), np.nan)
        reached = outcome[:, SUCCESS] > 0.0
        short = np.flatnonzero(~reached & np.isfinite(outcome[:, FINAL_COST]))
        if self.settles:
            self._settle(rows, q, after)
        if len(short):
            reference, weights = np.full(n, np.nan), np.zeros(n)
            if own is not None and self.settles:
                reference, weights = own[2 : 2 + n], own[2 + n :]
            near, end = q[short], np.empty((len(short), SETTLED))
            tolerance, most = constants[STATIONARITY_TOLERANCE], int(constants[MAX_SETTLING])
            nearest_points(self.chain, self.settings, rows[short], reference, weights, tolerance, most, near, end)
            q[short], after[short] = near, end
        return after

    def descend(self, row: np.ndarray, starts: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Where single descents from starts (N, n) toward a target (12,) end: q (N, n), outcomes (N, 7)."""
        q, outcome = np.empty(starts.shape), np.empty((len(starts), OUTCOME))
        self._search(np.tile(row, (len(starts), 1)), starts, np.zeros(len(starts), np.uint64), False, 0, 0, q, outcome)
        return q, outcome

    def settled(self, row: np.ndarray, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The optima of the redundancy near q (N, n), which reach a target (12,), and whether they are reached (N,)."""
        q, outcome = q.copy(), np.empty((len(q), SETTLED))
        self._settle(np.tile(row, (len(q), 1)), q, outcome)
        tolerance = self.settling[STATIONARITY_TOLERANCE]
        return q, (outcome[:, REACHED] > 0.0) & (outcome[:, PROJECTED_GRADIENT] <= tolerance)

    def exact(self) -> Compiled:
        """The same with descents that do not end before the last digits, even next to a singularity."""
        settings = self.settings.copy()
        settings[[POSITION_TOLERANCE, ORIENTATION_TOLERANCE]] = EXACT
        settings[STALL_RATIO], settings[LEAST_DAMPING], settings[MAX_ITERATIONS] = 0.0, LEAST_EXACT_DAMPING, 1000
        return replace(self, settings=settings)

    def without_limits(self, joints: np.ndarray) -> Compiled:
        """The same with some joints (n,) of bool set free."""
        chain = self.chain.copy()
        chain[:-1, LOWER][joints], chain[:-1, UPPER][joints] = -np.inf, np.inf
        return replace(self, chain=chain)

    def preferring(self, redundancy: Strict) -> Compiled:
        """The same with another redundancy, made for the robot."""
        return replace(self, redundancy=_posture(self.robot, redundancy))

    def search(
        self, row: np.ndarray, q0: np.ndarray | None, stream: np.ndarray, shuffled: bool, budget: Budget
    ) -> Search:
        """The compiled form of `search.search` for a target (12,). With a deadline it looks up now and then."""
        rows, starts, first, best = row.reshape(1, 12), self._starts(q0), 0, None
        while True:
            q, outcome = np.empty((1, self.robot.n)), np.empty((1, OUTCOME))
            last = min(first + LANES - 1, self.last_attempt) if budget.has_deadline else self.last_attempt
            if budget.has_deadline:
                self._search(rows, starts, stream, shuffled, first, last, q, outcome)
            else:
                self._find(rows, starts, stream, shuffled, q, outcome)
            budget.iterations += int(outcome[0, SPENT])
            found = found_by_kernel(self.robot, q[0], outcome[0])
            if best is None or found.best.reached or found.best.cost < best.cost:
                best = found.best
            asks = budget.has_deadline and not (best.reached or first or budget.late())
            proved = found.proved or (asks and bool(self.proofs.unreachable(rows)[0]))
            if best.reached or proved or last == self.last_attempt or budget.late():
                return Search(best, found.restarts, proved)
            first = last + 1

    def solve_batch(
        self,
        rows: np.ndarray,
        starts: np.ndarray | None,
        streams: np.ndarray,
        shuffled: bool,
        threads: int | None,
        progress: Progress | None,
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """q (N, n), outcomes (N, 7), second outcomes (N, 6), NaN where nothing was left to do, as of `solve`.

        The targets are (N, 12), the starts (N, n) or None.
        """
        count = len(rows)
        q, outcome, after = np.empty((count, self.robot.n)), np.empty((count, OUTCOME)), np.empty((count, SETTLED))
        chunk = min(CHUNK, max(LANES, CHUNK_OF_ATTEMPTS // (self.last_attempt + 1)))

        def run(first: int) -> int:
            part = slice(first, first + chunk)
            begin = self._starts(None if starts is None else starts[part])
            self._find(rows[part], begin, streams[part], shuffled, q[part], outcome[part])
            after[part] = self._finish(rows[part], q[part], outcome[part])
            return min(first + chunk, count)

        threads = min(threads or os.cpu_count() or 1, -(-count // chunk))
        if threads <= 1:
            for first in range(0, count, chunk):
                done = run(first)
                if progress is not None:
                    progress(done, count)
            return q, outcome, after
        pool = ThreadPoolExecutor(threads)
        try:
            for done in pool.map(run, range(0, count, chunk)):
                if progress is not None:
                    progress(done, count)
        finally:
            pool.shutdown(cancel_futures=True)  # Ctrl-C waits for the chunks under way, not for the rest
        return q, outcome, after

    def _search(
        self,
        rows: np.ndarray,
        starts: np.ndarray,
        streams: np.ndarray,
        shuffled: bool,
        first: int,
        last: int,
        q: np.ndarray,
        outcome: np.ndarray,
    ) -> None:
        floats, integers = memory_sizes(self.robot.n, last - first + 1)
        search(
            self.chain,
            self.settings,
            self.library,
            self.features,
            self.candidates,
            shuffled,
            rows,
            starts,
            streams,
            first,
            last,
            np.empty(floats),
            np.empty(integers, np.int64),
            q,
            outcome,
        )


def _posture(robot: Robot, redundancy: Weighted | Strict | None) -> np.ndarray | None:
    """What `Compiled.redundancy` holds of a redundancy that was made for the robot."""
    kind, weight, posture = NONE, 0.0, Posture().of(robot)
    if redundancy is not None:
        objectives = redundancy.objectives if isinstance(redundancy, Strict) else (redundancy.objective,)
        objective = objectives[0]
        if len(objectives) > 1 or not isinstance(objective, (Posture, LimitDistance)):
            return None
        kind, weight = (STRICT, 0.0) if isinstance(redundancy, Strict) else (WEIGHTED, redundancy.weight)
        posture = objective if isinstance(objective, Posture) else objective.as_posture
    return np.concatenate([[kind, weight], posture.q_ref, posture.weights])
