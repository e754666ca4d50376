"""The compiled engine: which problems it takes, and the arrays that it needs of them.

It runs the search of `search.py` and `descent.py` in compiled code for one pose task of the tip of a serial chain with
box limits. The chain's arrays are read off `pin.Model`, so there is one truth about the robot.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from maira_qp.kernels.chain import LOWER, PRISMATIC, ROW, UPPER, jacobians
from maira_qp.kernels.search import search, search_batch
from maira_qp.problem.tasks import FrameTask
from maira_qp.robots.robot import Robot
from maira_qp.solvers import descent
from maira_qp.solvers.descent import Budget, Descent
from maira_qp.solvers.options import Options
from maira_qp.solvers.search import Search

CHUNK = 256
"""Targets of a batch that a thread solves at a stretch: between two of them Ctrl-C is heard."""


@dataclass(frozen=True)
class Compiled:
    """The arrays of one problem, see `maira_qp.kernels.chain` and `maira_qp.kernels.descent`."""

    robot: Robot
    chain: np.ndarray
    """(n + 1, 15)"""
    settings: np.ndarray
    """(13,)"""
    candidates: int
    last_attempt: int

    @staticmethod
    def of(robot: Robot, tasks: Sequence[FrameTask], extra_limits: int, options: Options) -> Compiled | str:
        """The problem's arrays, or the reason why the compiled engine cannot take it."""
        if len(tasks) > 1:
            return "it has more than one task"
        if extra_limits:
            return "it has limits beside those of the joints"
        if tasks[0].frame not in (None, robot.tip):
            return "its task is not the tip's"
        if robot.kinematics.has_mimic:
            return "the robot has mimic joints"
        weights = np.zeros(6)
        weights[tasks[0].rows] = tasks[0].weights
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
        return Compiled(robot, chain_of(robot), settings, int(options.start_candidates), int(options.max_restarts))

    def search(self, row: np.ndarray, q0: np.ndarray | None, stream: int, budget: Budget) -> Search:
        """The compiled form of `search.search` for a target (12,). With a deadline it looks up between attempts."""
        q, outcome = np.empty(self.robot.n), np.empty(6)
        start = q if q0 is None else q0
        first, stride = 0, 0 if budget.has_deadline else self.last_attempt
        best: Descent | None = None
        while True:
            last = min(first + stride, self.last_attempt)
            args = (start, q0 is not None, self.candidates, first, last, np.uint64(stream), q, outcome)
            search(self.chain, self.settings, row, *args)
            budget.iterations += int(outcome[2])
            found = self.found(q, outcome)
            if best is None or found.best.reached or found.best.cost < best.cost:
                best = found.best
            if best.reached or last == self.last_attempt or budget.late():
                return Search(best, found.restarts)
            first = last + 1

    def jacobians(self, q: np.ndarray) -> np.ndarray:
        """Jacobians (N, 6, n) of the tip at q (N, n)."""
        J = np.empty((*q.shape, 6))
        jacobians(self.chain, q, J)
        return J.swapaxes(1, 2)

    def found(self, q: np.ndarray, outcome: np.ndarray) -> Search:
        """What a kernel left in q (n,) and outcome (6,)."""
        return Search(Descent(self.robot.at(q), float(outcome[3]), bool(outcome[0])), int(outcome[1]))

    def search_batch(
        self, rows: np.ndarray, starts: np.ndarray | None, streams: np.ndarray, threads: int | None
    ) -> tuple[np.ndarray, np.ndarray]:
        """q (N, n), outcomes (N, 6) of `maira_qp.kernels.search`, of targets (N, 12) from starts (N, n) or None."""
        count, n = len(rows), self.robot.n
        q, outcome = np.zeros((count, n)), np.empty((count, 6))
        given = q if starts is None else starts

        def run(first: int) -> None:
            part = slice(first, first + CHUNK)
            begin = given[part]
            args = (
                begin,
                starts is not None,
                self.candidates,
                self.last_attempt,
                streams[part],
                q[part],
                outcome[part],
            )
            search_batch(self.chain, self.settings, rows[part], *args)

        pool = ThreadPoolExecutor(threads or os.cpu_count())
        try:
            for _ in pool.map(run, range(0, count, CHUNK)):
                pass
        finally:
            pool.shutdown(cancel_futures=True)  # Ctrl-C waits for the chunks under way, not for the rest
        return q, outcome


def chain_of(robot: Robot) -> np.ndarray:
    """The robot's chain (n + 1, 15) of `maira_qp.kernels.chain`: each joint's frame turned so that it moves along z."""
    model, n = robot.model, robot.n
    data = model.createData()
    pin.computeJointJacobians(model, data, np.zeros(n))
    chain, turn = np.zeros((n + 1, ROW)), np.eye(3)
    for i in range(n):
        motion = pin.getJointJacobian(model, data, i + 1, pin.LOCAL).reshape(6, n)[:, i]
        prismatic = bool(np.abs(motion[:3]).max() > 0.5)
        placement, next_turn = model.jointPlacements[i + 1], _z_onto(motion[:3] if prismatic else motion[3:])
        chain[i, :9] = (turn.T @ placement.rotation @ next_turn).ravel()
        chain[i, 9:12] = turn.T @ placement.translation
        chain[i, PRISMATIC], chain[i, LOWER], chain[i, UPPER] = prismatic, robot.lower[i], robot.upper[i]
        turn = next_turn
    tool = model.frames[robot.frame_id(None)].placement
    chain[n, :9], chain[n, 9:12] = (turn.T @ tool.rotation).ravel(), turn.T @ tool.translation
    return chain


def _z_onto(axis: np.ndarray) -> np.ndarray:
    """A rotation (3, 3) whose z axis is the unit vector `axis` (3,); the identity where that is z."""
    if axis[2] == 1.0:
        return np.eye(3)
    x = np.cross(np.eye(3)[np.abs(axis).argmin()], axis)
    x /= np.linalg.norm(x)
    return np.column_stack([x, np.cross(axis, x), axis])
