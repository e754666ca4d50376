"""The compiled engine: which problems it takes, and the arrays that it needs of them.

For one task of the tip of a serial chain with box limits it runs the search of `search.py` and `descent.py` in compiled
code, and, with one `Posture` or `LimitDistance`, the settling of `settling.py`.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np

from maira_qp.kernels.lanes import LANES
from maira_qp.kernels.rigid import FINE
from maira_qp.kernels.search import FARTHEST_START, OUTCOME, admit, memory_sizes, search
from maira_qp.kernels.settling import OUTCOME as SETTLED
from maira_qp.kernels.settling import settle
from maira_qp.kernels.starts import FEATURES, fill_library
from maira_qp.orientation import ORTHONORMAL_WITHIN
from maira_qp.problem.objectives import LimitDistance, Posture
from maira_qp.problem.redundancy import Strict, Weighted
from maira_qp.problem.tasks.frame import FrameTask
from maira_qp.robots.robot import Robot
from maira_qp.robots.serial_chain import chain_of
from maira_qp.solvers import descent, settling
from maira_qp.solvers.descent import Budget, Descent
from maira_qp.solvers.options import Options
from maira_qp.solvers.priorities import Priorities
from maira_qp.solvers.search import Search, found_by_kernel
from maira_qp.solvers.targets import SEED_0, row_of

CHUNK, CHUNK_OF_ATTEMPTS = 256, 80_000
"""Targets of a batch, and their attempts, that a thread takes up at a stretch: between two of them Ctrl-C is heard."""

LIBRARY, CORNERS = 512, 128
"""Configurations to start from whose poses are known, and how many of them at most have every joint on a limit.

A pass over them costs a fraction of an iteration. Targets near a corner of the limits are the hardest to find."""

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
    """(7,) see `maira_qp.kernels.settling`"""

    @staticmethod
    def of(priorities: Priorities, extra_limits: int, options: Options) -> Compiled | str:
        """The problem's arrays, or the reason why the compiled engine cannot take it."""
        robot, task = priorities.robot, priorities.first[0]
        if len(priorities.first) > 1:
            return "it has more than one task"
        if not isinstance(task, FrameTask) or task.target is not None:
            return "its task is none of PoseTask(), PositionTask() and OrientationTask() with a target from the call"
        if not task.is_even:
            return "the axes of its task count differently"
        if extra_limits:
            return "it has limits beside those of the joints"
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
        chain, library = chain_of(robot), _library(robot)
        features = np.empty((LIBRARY // LANES, FEATURES, LANES))
        fill_library(settings, np.array([row_of(robot.at(q).placement(None)) for q in library]), features)
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

        If the pose was reached and the kernels know the redundancy, q is where it was settled, and there is a second
        outcome (6,), see `kernels.settling.settle`.
        """
        row, stream = np.empty((1, 12)), np.empty(1, np.uint64)
        q, outcome = np.empty((1, self.robot.n)), np.empty((1, OUTCOME))
        settled, starts = np.empty((0, SETTLED)), self._starts(q0)
        fault = admit(T, ORTHONORMAL_WITHIN, starts, seed, row, stream)
        if fault == FINE:
            shuffled = seed is not SEED_0 and bool(seed.any())
            self._search(row, starts, stream, shuffled, 0, self.last_attempt, q, outcome)
            if self.settles and outcome[0, 0] > 0.0:
                settled = np.empty((1, SETTLED))
                self._settle(row, q, settled)
        return fault, q[0], outcome[0].tolist(), settled.ravel().tolist()

    def _starts(self, q0: np.ndarray | None) -> np.ndarray:
        """Starts (N, n) of a search: q0 (n,) or (N, n), or none of them."""
        return np.empty((0, self.robot.n)) if q0 is None else q0.reshape(-1, self.robot.n)

    def _settle(self, rows: np.ndarray, q: np.ndarray, settled: np.ndarray) -> None:
        """Settle the redundancy at the configurations q (N, n), in place, that reach the targets (N, 12)."""
        n, own = self.robot.n, self.redundancy
        assert own is not None
        weight = own[WEIGHT] if own[KIND] == WEIGHTED else 0.0
        settle(self.chain, self.settings, rows, own[2 : 2 + n], own[2 + n :], weight, self.settling, q, settled)

    def search(
        self, row: np.ndarray, q0: np.ndarray | None, stream: np.ndarray, shuffled: bool, budget: Budget
    ) -> Search:
        """The compiled form of `search.search` for a target (12,). With a deadline it looks up now and then."""
        first, stride = 0, LANES - 1 if budget.has_deadline else self.last_attempt
        best: Descent | None = None
        starts = self._starts(q0)
        while True:
            last = min(first + stride, self.last_attempt)
            q, outcome = np.empty((1, self.robot.n)), np.empty((1, OUTCOME))
            self._search(row.reshape(1, 12), starts, stream, shuffled, first, last, q, outcome)
            budget.iterations += int(outcome[0, 2])
            found = found_by_kernel(self.robot, q[0], outcome[0])
            if best is None or found.best.reached or found.best.cost < best.cost:
                best = found.best
            if best.reached or last == self.last_attempt or budget.late():
                return Search(best, found.restarts)
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
        """q (N, n), outcomes (N, 7), second outcomes (N, 6) or (0, 6), as of `solve`.

        The targets are (N, 12), the starts (N, n) or None.
        """
        count = len(rows)
        q, outcome = np.empty((count, self.robot.n)), np.empty((count, OUTCOME))
        settled = np.empty((count if self.settles else 0, SETTLED))
        chunk = min(CHUNK, max(LANES, CHUNK_OF_ATTEMPTS // (self.last_attempt + 1)))

        def run(first: int) -> int:
            part = slice(first, first + chunk)
            begin = self._starts(None if starts is None else starts[part])
            self._search(rows[part], begin, streams[part], shuffled, 0, self.last_attempt, q[part], outcome[part])
            if self.settles:
                self._settle(rows[part], q[part], settled[part])
            return min(first + chunk, count)

        threads = min(threads or os.cpu_count() or 1, -(-count // chunk))
        if threads <= 1:
            for first in range(0, count, chunk):
                done = run(first)
                if progress is not None:
                    progress(done, count)
            return q, outcome, settled
        pool = ThreadPoolExecutor(threads)
        try:
            for done in pool.map(run, range(0, count, chunk)):
                if progress is not None:
                    progress(done, count)
        finally:
            pool.shutdown(cancel_futures=True)  # Ctrl-C waits for the chunks under way, not for the rest
        return q, outcome, settled

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


def _library(robot: Robot) -> np.ndarray:
    """Configurations (LIBRARY, n): corners of the limits, the others spread evenly."""
    lower, upper = robot.drawn_range
    all_of_them = 2**robot.n <= CORNERS
    pick = np.arange(2**robot.n)[:, None] >> np.arange(robot.n) & 1 if all_of_them else _spread(CORNERS, robot.n) > 0.5
    corners = np.where(pick, upper, lower)
    share = _spread(LIBRARY - len(corners), robot.n)
    return np.concatenate([corners, np.clip((1 - share) * lower + share * upper, lower, upper)])


def _spread(count: int, n: int) -> np.ndarray:
    """Points (count, n) that fill the unit cube evenly.

    Point k is the fractional part of k a, a the powers of the root of x^(n + 1) = x + 1 (Roberts, "The unreasonable
    effectiveness of quasirandom sequences", 2018).
    """
    root = 2.0
    for _ in range(60):
        root = (1 + root) ** (1 / (n + 1))
    return (0.5 + np.outer(np.arange(count), root ** -np.arange(1.0, n + 1))) % 1
