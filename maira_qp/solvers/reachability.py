"""Whether poses can be reached, and nothing else: verdicts without the nearest points that a solve looks for.

For S-R-S arms that is the closed form, both ways: a configuration, or the proof that there is none; what it leaves
open, poses next to a singularity, is solved. For other serial chains it is the descents of a solve, then its proofs by
boxes of joint values, which take nearly all of the time and may be made shorter. What is neither is undecided.
"""

from __future__ import annotations

from threading import Event
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from maira_qp.problem.targets import checked_seed, streams
from maira_qp.results.status import Reach, reach_of
from maira_qp.solvers.solver import Solver

if TYPE_CHECKING:
    from maira_qp.solvers.compiled.problem_arrays import ProblemArrays

SHARE, SLOW_SHARE = 4096, 256
"""Poses that a thread takes up at a stretch: in closed form, and where descents and proofs take their time."""


class Reachability(NamedTuple):
    """Verdicts on N poses."""

    verdict: np.ndarray
    """(N,) of int8, values of `Reach`"""
    q: np.ndarray
    """(N, n) configurations [rad or m] that reach what is REACHABLE; elsewhere NaN"""


def reachability(
    solver: Solver, targets: np.ndarray, *, seed: int = 0, threads: int | None = None, proof_boxes: int | None = None
) -> Reachability:
    """Whether each of N poses (N, 4, 4) can be reached, as `solve_batch` would say.

    Args:
        solver: for its first task; what it prefers among the configurations that reach a pose is as in a solve for
            what is left to a solve.
        targets: (N, 4, 4), or a sequence of poses.
        seed: as for `Solver.solve_batch`.
        threads: of the compiled engine; None: one per processor. No verdict depends on it.
        proof_boxes: boxes of joint values that a proof may take, for chains in compiled code that are no S-R-S arms; 0:
            no proof is tried; None: as many as in a solve.

    Raises `PoseError`, `OptionError`.
    """
    compiled = solver.engines.searching
    if compiled is None or compiled.settles:
        batch = solver.solve_batch(targets, seed=seed, threads=threads)
        return _reachability(reach_of(batch.status), batch.q)
    asked, words = solver.problem.targets(targets), checked_seed(seed)
    rows = np.ascontiguousarray(asked.rows[:, 0])
    if compiled.proofs.srs is None:
        verdict, q = np.full(len(rows), Reach.UNDECIDED, dtype=np.int8), np.empty((len(rows), compiled.n))
        finite = np.flatnonzero(asked.is_finite)
        verdict[finite], q[finite] = _by_descents(compiled, rows[finite], words, threads, proof_boxes)
        return _reachability(verdict, q)
    verdict, q = _in_closed_form(compiled, rows, words, threads)
    left = np.flatnonzero((verdict == Reach.UNDECIDED) & asked.is_finite)
    if len(left):
        batch = solver.engines.solve_batch(asked[left], None, words, threads, None)
        verdict[left], q[left] = reach_of(batch.status), batch.q
    return _reachability(verdict, q)


def _reachability(verdict: np.ndarray, q: np.ndarray) -> Reachability:
    q[verdict != Reach.REACHABLE] = np.nan
    return Reachability(verdict, q)


def _in_closed_form(
    arrays: ProblemArrays, rows: np.ndarray, seed: np.ndarray, threads: int | None
) -> tuple[np.ndarray, np.ndarray]:
    """Verdicts (N,) and configurations (N, 7) of an S-R-S arm for rows (N, 12), under a seed (2,)."""
    from maira_qp.kernels.kinematics.unwrap import unwind
    from maira_qp.kernels.layout import Outcome
    from maira_qp.solvers.compiled.batch import Batch
    from maira_qp.solvers.compiled.closed_form import reach_in_closed_form
    from maira_qp.solvers.compiled.thread_pool import in_shares

    q, outcome, shuffled = np.empty((len(rows), 7)), np.empty((len(rows), Outcome.WIDTH)), bool(seed.any())

    def work(part: slice, halted: Event) -> None:
        batch = Batch(rows[part], arrays.no_starts, streams(rows[part], seed), shuffled)
        reach_in_closed_form(arrays, batch, q[part], outcome[part])
        if arrays.turns is not None:
            unwind(arrays.chain, arrays.turns.aim[None], outcome[part, Outcome.SUCCESS], q[part])

    in_shares(work, len(rows), SHARE, threads)
    success = outcome[:, Outcome.SUCCESS]
    kinds = [success > 0.0, success == Outcome.PROVED]
    return np.select(kinds, [Reach.REACHABLE, Reach.UNREACHABLE], Reach.UNDECIDED).astype(np.int8), q


def _by_descents(
    arrays: ProblemArrays, rows: np.ndarray, seed: np.ndarray, threads: int | None, proof_boxes: int | None
) -> tuple[np.ndarray, np.ndarray]:
    """Verdicts (N,) and configurations (N, n) of a chain for finite rows (N, 12), under a seed (2,)."""
    from maira_qp.kernels.kinematics.unwrap import unwind
    from maira_qp.kernels.layout import Outcome
    from maira_qp.solvers.certificates import MOST_BOXES
    from maira_qp.solvers.compiled.batch import Batch
    from maira_qp.solvers.compiled.multi_start import attempts
    from maira_qp.solvers.compiled.thread_pool import in_shares

    most = MOST_BOXES if proof_boxes is None else proof_boxes
    q, outcome, shuffled = np.empty((len(rows), arrays.n)), np.empty((len(rows), Outcome.WIDTH)), bool(seed.any())
    verdict = np.full(len(rows), Reach.UNDECIDED, dtype=np.int8)

    def work(part: slice, halted: Event) -> None:
        batch = Batch(rows[part], arrays.no_starts, streams(rows[part], seed), shuffled)
        attempts(arrays, batch, 0, arrays.last_attempt, q[part], outcome[part])
        reached = outcome[part, Outcome.SUCCESS] > 0.0
        verdict[part][reached] = Reach.REACHABLE
        if arrays.turns is not None:
            unwind(arrays.chain, arrays.turns.aim[None], outcome[part, Outcome.SUCCESS], q[part])
        if most and not reached.all() and not halted.is_set():
            left = np.arange(part.start, part.stop)[~reached]
            verdict[left[arrays.proofs.unreachable(rows[left], most)]] = Reach.UNREACHABLE

    in_shares(work, len(rows), SLOW_SHARE, threads)
    return verdict, q
