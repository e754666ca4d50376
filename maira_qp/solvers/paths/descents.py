"""Descents along a path of poses: one from each start, none of which looks elsewhere."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from maira_qp.kernels.layout import Outcome, Setting
from maira_qp.kernels.paths.self_motions import self_motions
from maira_qp.problem.problem import Problem
from maira_qp.solvers.compiled.batch import Batch
from maira_qp.solvers.compiled.multi_start import attempts
from maira_qp.solvers.compiled.problem_arrays import ProblemArrays
from maira_qp.solvers.paths.meter import Meter


@dataclass(frozen=True, eq=False)
class PathArrays:
    """Poses of a path, all of them or some, and the compiled problem that they are targets of."""

    arrays: ProblemArrays
    rows: np.ndarray
    """(N, 12) R by rows, then p"""
    place: np.ndarray
    """(N,) which poses of the whole path they are"""
    window: np.ndarray
    """(n,) largest step of each joint from pose to pose of the whole path [rad or m]"""
    asked: Problem
    """What was asked: the problem of the arrays, or one whose robot has a joint less, see `free_axis`"""
    beat: Callable[[], object] = Meter(None, 0).beat
    """Called before each series of descents; what it raises ends the work"""
    times: float = 1.0
    """So many times the step that is allowed the window is"""

    def __len__(self) -> int:
        return len(self.rows)

    @property
    def problem(self) -> Problem:
        """What is solved at each pose."""
        return self.arrays.problem

    @property
    def n(self) -> int:
        """How many joints there are."""
        return self.arrays.n

    @property
    def rank(self) -> int:
        """How many numbers the task asks for."""
        return int((self.problem.tasks[0].all_weights > 0.0).sum())

    @property
    def windows(self) -> np.ndarray:
        """How far (N - 1, n) each joint may move to the next of the poses."""
        return np.asarray(np.diff(self.place)[:, None] * self.window)

    def wider(self, times: float) -> PathArrays:
        """The same with so many times the steps."""
        return replace(self, window=times * self.window, times=times * self.times)

    def some(self, which: np.ndarray | slice) -> PathArrays:
        """Some of the poses."""
        return replace(self, rows=self.rows[which], place=self.place[which])

    def largest_steps(self, q: np.ndarray) -> np.ndarray:
        """The largest joint step (N - 1,) between neighbours of a line (N, n), by what is allowed."""
        return np.asarray((np.abs(np.diff(q, axis=0)) / self.windows).max(axis=1, initial=0.0))

    def errors(self, rows: np.ndarray, q: np.ndarray) -> np.ndarray:
        """Errors of position and orientation (M, 2) [m, rad] of configurations (M, n) at poses (M, 12)."""
        settings = self.arrays.settings.copy()
        settings[Setting.MAX_ITERATIONS] = 0
        _, outcome = _attempted(replace(self.arrays, settings=settings), rows, q)
        return outcome[:, [Outcome.POSITION_ERROR, Outcome.ORIENTATION_ERROR]]

    def reached(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Errors (N, 2) [m, rad] by a fresh forward kinematics of each of q (N, n), and which (N,) reach their poses.

        Those that break a limit do not.
        """
        errors = self.errors(self.rows, q)
        return errors, np.asarray(self.problem.is_reached(*errors.T)) & self.keeps_limits(q)

    def descend(self, which: np.ndarray, starts: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Descend to the poses `which` (M,), indices, from starts (M, n): q (M, n), and which of them arrived (M,)."""
        return self.descend_to(self.rows[which], starts)

    def descend_to(self, rows: np.ndarray, starts: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The same to poses (M, 12) that are given. What a start breaks of the limits is clipped.

        What breaks a limit beside those of the joints has not arrived.
        """
        self.beat()
        q, outcome = _attempted(self.arrays, rows, starts)
        arrived = outcome[:, Outcome.SUCCESS] > 0.0
        if self.asked.additional_limits:
            arrived[arrived] = self.keeps_limits(q[arrived])
        return q, arrived

    def exactly(self, which: np.ndarray, q: np.ndarray) -> np.ndarray:
        """Configurations (M, n) that reach the poses `which` (M,) to the last digits, from those that reach them.

        So that one on a limit is on it at each of its whole turns. What cannot be brought nearer stays.
        """
        there, outcome = _attempted(self.arrays.exact, self.rows[which], q)
        return np.where(outcome[:, [Outcome.SUCCESS]] > 0.0, there, q)

    def keeps_limits(self, q: np.ndarray) -> np.ndarray:
        """Which (M,) of the configurations (M, n) keep the limits beside those of the joints."""
        if not self.asked.additional_limits:
            return np.ones(len(q), dtype=bool)
        robot = self.asked.robot
        return np.array([not self.asked.limit_violations(robot.at(each[: robot.n])) for each in q], dtype=bool)

    def self_motions(self, q: np.ndarray) -> np.ndarray:
        """Orthonormal directions (M, n, n - rank) along which configurations (M, n) keep what the task asks for."""
        jacobians = self.arrays.robot.jacobians(q)[:, self.problem.tasks[0].all_weights > 0.0]
        directions = np.empty((len(q), self.n, self.n - self.rank))
        self_motions(np.ascontiguousarray(jacobians), directions)
        return directions


def _attempted(arrays: ProblemArrays, rows: np.ndarray, starts: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """q (M, n) and outcomes (M, 9) of one descent each to poses (M, 12) from starts (M, n)."""
    q, outcome = np.empty(starts.shape), np.empty((len(starts), Outcome.WIDTH))
    rows, starts = np.ascontiguousarray(rows), np.ascontiguousarray(starts)
    attempts(arrays, Batch(rows, starts, np.zeros(len(starts), np.uint64), False), 0, 0, q, outcome)
    return q, outcome
