"""maira_qp as a user calls it: validation, result object and all."""

from __future__ import annotations

from functools import partial

import numpy as np

import maira_qp as mq
from maira_qp.evaluation.contestant import Contestant
from peers.arms import Arm

SOLVE = "maira_qp solve"
"""The name of the row that all others are compared with."""


def one_at_a_time(arm: Arm) -> list[Contestant]:
    """`Solver.solve` for the pose alone, and with the posture as a strict second level."""
    return [
        _contestant(SOLVE, "default options, from Python", mq.Solver(arm.robot)),
        _contestant(
            "maira_qp strict", "posture below the pose", mq.Solver(arm.robot, redundancy=mq.Strict(mq.Posture()))
        ),
    ]


def batches(arm: Arm) -> list[Contestant]:
    """`Solver.solve_batch` on one thread and on two."""
    solver = mq.Solver(arm.robot)
    return [
        Contestant(name="maira_qp batch", settings="one thread", solve_all=partial(_solve_all, solver, 1), slack=0.0),
        Contestant(
            name="maira_qp batch x2", settings="two threads", solve_all=partial(_solve_all, solver, 2), slack=0.0
        ),
    ]


def _contestant(name: str, settings: str, solver: mq.Solver) -> Contestant:
    def solve(target: np.ndarray, start: np.ndarray | None) -> np.ndarray | None:
        solution = solver.solve(target, start)
        return solution.q if solution.success else None

    return Contestant(
        name=name,
        settings=settings,
        forward=lambda q: solver.robot.forward(q).homogeneous,
        solve=solve,
        draws_starts=True,
        step=lambda q, target, dt: solver.step(q, target, dt).velocity,
        limits=(solver.robot.lower, solver.robot.upper),
        slack=0.0,
    )


def _solve_all(solver: mq.Solver, threads: int, targets: np.ndarray) -> np.ndarray:
    batch = solver.solve_batch(targets, threads=threads)
    return np.where(batch.success[:, None], batch.q, np.nan)
