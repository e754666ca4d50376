"""Proofs of unreachable poses against the solver: `python benchmarks/verdicts.py --targets 100000`.

Targets are poses of random configurations with some joints on their limits, each moved by 1e-6 to 1 m and rad, and
poses of any orientation around the arm. What is proved to be out of reach the solver must never reach; how many of the
others it does not reach either shows how few are left open. One thread.
"""

from dataclasses import dataclass
from time import perf_counter

import numpy as np
import tyro
from rich.console import Console

import maira_qp as mq
from maira_qp.analytic.srs.arrays import srs_array
from maira_qp.analytic.srs.geometry import SRS
from maira_qp.evaluation.report import table_of
from maira_qp.evaluation.runner import judge_of
from maira_qp.evaluation.targets import TargetSource
from maira_qp.kernels.layout import Outcome
from maira_qp.kernels.srs.swivel_intervals import INTERVALS, PIECES
from maira_qp.kernels.srs.unreachability import POSSIBLE, verdicts
from maira_qp.solvers.compiled.batch import Batch
from maira_qp.solvers.compiled.closed_form import reach_in_closed_form
from maira_qp.solvers.compiled.engine import Compiled

VERDICTS = ("possible", "too far", "too near", "elbow", "swivel")
ARMS = {"maira": mq.Robot.maira, "iiwa14": mq.Robot.iiwa14}


@dataclass(frozen=True, kw_only=True)
class Settings:
    """What to compare."""

    targets: int = 100_000
    """Targets an arm; a tenth of them anywhere, the others near what the arm reaches."""
    restarts: int = 20
    """Of the solver, a target."""
    seed: int = 0
    """Seed of the targets."""


def main(settings: Settings) -> None:
    """One row an arm."""
    options = mq.Options(max_restarts=settings.restarts, max_settling=0)  # the nearest point is not asked for
    figures = ("targets", *VERDICTS, "proved, solved", "open, not solved", "closed form, wrong", "us verdict")
    table = table_of("", ["arm"], figures)
    for name, make in ARMS.items():
        robot = make()
        poses = TargetSource(robot, judge_of(robot)).around(settings.targets, settings.seed)
        rows = np.hstack([poses[:, :3, :3].reshape(-1, 9), poses[:, :3, 3]])
        codes, us_verdict = judged(robot, rows, options)
        found, wrong = reached(robot, rows, poses)
        solved = mq.Solver(robot, options=options).solve_batch(poses, threads=1).success
        proved = codes != POSSIBLE
        counts = np.bincount(codes, minlength=len(VERDICTS))
        left = int((~proved & ~solved & ~found).sum())
        shown = (int((proved & (solved | found)).sum()), left, wrong, f"{us_verdict:.2f}")
        table.add_row(name, str(len(rows)), *map(str, counts), *map(str, shown))
    Console(width=150).print(table)


def judged(robot: mq.Robot, rows: np.ndarray, options: mq.Options) -> tuple[np.ndarray, float]:
    """Verdicts (N,), and how long one took [us]."""
    arm, codes, pieces = srs_array(known(robot)), np.empty(len(rows), np.int64), np.empty((8, PIECES, 3))
    tolerances, memory = (options.position_tolerance, options.orientation_tolerance), INTERVALS.empty()
    verdicts(arm, rows[:1], *tolerances, *memory, pieces, codes[:1])
    begin = perf_counter()
    verdicts(arm, rows, *tolerances, *memory, pieces, codes)
    return codes, 1e6 * (perf_counter() - begin) / len(rows)


def reached(robot: mq.Robot, rows: np.ndarray, poses: np.ndarray) -> tuple[np.ndarray, int]:
    """Which targets are reached in closed form (N,), and how many of them the judge finds missed by 1e-9."""
    engine, q, outcome = compiled(robot), np.empty((len(rows), robot.n)), np.empty((len(rows), Outcome.WIDTH))
    reach_in_closed_form(engine, Batch(rows, np.empty((0, 7)), np.zeros(len(rows), np.uint64), False), q, outcome)
    found = outcome[:, Outcome.SUCCESS] > 0
    right = judge_of(robot).verdict(q[found], poses[found]).within(1e-9, 1e-9)
    return found, int((~right).sum())


def compiled(robot: mq.Robot) -> Compiled:
    """The arrays of a pose task."""
    solver = mq.Solver(robot)
    solver.solve(robot.forward(robot.middle))
    assert isinstance(solver.engines.compiled, Compiled)
    return solver.engines.compiled


def known(robot: mq.Robot) -> SRS:
    """The geometry of an S-R-S arm."""
    srs = SRS.of(robot)
    assert srs is not None
    return srs


if __name__ == "__main__":
    main(tyro.cli(Settings))
