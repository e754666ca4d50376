"""Closed form against multi-start on S-R-S arms: `python benchmarks/closed_form.py --targets 4000`.

Both kernels get the same reachable poses in turns, several times, on one thread; the best time of each counts. The
closed form is what goes before the search (`kernels/srs/reach.py`), the multi-start is the search
(`kernels/search/multi_start.py`), which begins at known configurations next to the pose. Poses that cannot be reached
are timed beside them: verdict, proof and nearest point.
"""

from collections.abc import Callable
from dataclasses import dataclass
from time import perf_counter

import numpy as np
import tyro
from rich.console import Console

import maira_qp as mq
from maira_qp.evaluation.report import table_of
from maira_qp.evaluation.runner import judge_of
from maira_qp.evaluation.targets import TargetSource
from maira_qp.kernels.layout import Outcome
from maira_qp.solvers.compiled.batch import Batch
from maira_qp.solvers.compiled.closed_form import reach_in_closed_form
from maira_qp.solvers.compiled.engine import Compiled
from maira_qp.solvers.compiled.multi_start import attempts

ARMS = {"maira": mq.Robot.maira, "iiwa14": mq.Robot.iiwa14}
NO_STARTS = np.empty((0, 7))


@dataclass(frozen=True, kw_only=True)
class Settings:
    """What to compare."""

    targets: int = 4_000
    """Poses an arm, those of random configurations; a quarter of them are solved one by one as well."""
    rounds: int = 9
    """How often both are timed, in turns."""
    seed: int = 0
    """Seed of the poses."""


def main(settings: Settings) -> None:
    """One row an arm, in a batch and one by one."""
    columns = ("us closed form", "us multi-start", "ratio", "solved", "solved", "us out of reach, batch")
    table = table_of("", ["arm", ""], columns)
    for name, make in ARMS.items():
        robot = make()
        solver = mq.Solver(robot)
        solver.solve(robot.forward(robot.middle))
        engine = solver.engines.compiled
        assert isinstance(engine, Compiled)
        poses, _ = TargetSource(robot, judge_of(robot)).batch("uniform", settings.targets, settings.seed)
        beyond = poses.copy()
        beyond[:, :3, 3] *= 2 * robot.length / np.linalg.norm(poses[:, :3, 3], axis=1)[:, None]
        away = min(timed(lambda solver=solver, T=beyond: solver.solve_batch(T, threads=1), 3)) / len(beyond)
        for kind, chunk, count in (("batch", 256, len(poses)), ("single", 1, len(poses) // 4)):
            rows = np.hstack([poses[:count, :3, :3].reshape(-1, 9), poses[:count, :3, 3]])
            chunks = [np.ascontiguousarray(rows[i : i + chunk]) for i in range(0, count, chunk)]
            methods = closed_form(engine), multi_start(engine)
            solved = [np.mean(np.concatenate([method(part) for part in chunks])) for method in methods]
            times = np.array([[run(method, chunks) for method in methods] for _ in range(settings.rounds)])
            ours, theirs = 1e6 * times.min(axis=0) / count
            shares = (f"{100 * share:.2f} %" for share in solved)
            told = f"{1e6 * away:.1f}" if kind == "batch" else ""
            table.add_row(name, kind, f"{ours:.2f}", f"{theirs:.2f}", f"{ours / theirs:.2f}", *shares, told)
    Console(width=120).print(table)


def closed_form(engine: Compiled) -> Callable[[np.ndarray], np.ndarray]:
    """Which of targets (N, 12) are reached in closed form (N,)."""

    def method(rows: np.ndarray) -> np.ndarray:
        q, outcome = np.empty((len(rows), 7)), np.empty((len(rows), Outcome.WIDTH))
        reach_in_closed_form(engine, Batch(rows, NO_STARTS, np.zeros(len(rows), np.uint64), False), q, outcome)
        return outcome[:, Outcome.SUCCESS] > 0

    return method


def multi_start(engine: Compiled) -> Callable[[np.ndarray], np.ndarray]:
    """Which of targets (N, 12) are reached by the search (N,)."""

    def method(rows: np.ndarray) -> np.ndarray:
        q, outcome, last = np.empty((len(rows), 7)), np.empty((len(rows), Outcome.WIDTH)), engine.last_attempt
        attempts(engine, Batch(rows, NO_STARTS, np.zeros(len(rows), np.uint64), False), 0, last, q, outcome)
        return outcome[:, Outcome.SUCCESS] > 0

    return method


def run(method: Callable[[np.ndarray], np.ndarray], chunks: list[np.ndarray]) -> float:
    """The time [s] of all chunks."""
    return timed(lambda: [method(rows) for rows in chunks], 1)[0]


def timed(work: Callable[[], object], rounds: int) -> list[float]:
    """The times [s] of some rounds of work."""
    times = []
    for _ in range(rounds):
        begin = perf_counter()
        work()
        times.append(perf_counter() - begin)
    return times


if __name__ == "__main__":
    main(tyro.cli(Settings))
