"""The multi-start stage: descents from starts, from the seed library and from random configurations, by kernels."""

from __future__ import annotations

from threading import Event

import numpy as np

from maira_qp.kernels.jit.simd import LANES
from maira_qp.kernels.layout import Outcome
from maira_qp.kernels.search.levenberg_marquardt import LANES_ARENA
from maira_qp.kernels.search.multi_start import SEARCH, search
from maira_qp.kernels.search.seeds import has_long_slides, place_all
from maira_qp.solvers.compiled.batch import Batch
from maira_qp.solvers.compiled.outcomes import none_open
from maira_qp.solvers.compiled.problem_arrays import ProblemArrays
from maira_qp.solvers.compiled.thread_pool import parts
from maira_qp.solvers.reference.levenberg_marquardt import Budget
from maira_qp.solvers.reference.multi_start import HEAD


def attempts(arrays: ProblemArrays, batch: Batch, first: int, last: int, q: np.ndarray, outcome: np.ndarray) -> int:
    """Make the attempts first, ..., last at N targets: q (N, n) and outcomes (N, 9) in place.

    Returns how many targets are left open. See `kernels.search.multi_start.search`.
    """
    return search(
        arrays.chain,
        arrays.settings,
        arrays.seeds.configurations,
        arrays.seeds.features,
        arrays.candidates,
        batch.shuffled,
        batch.rows,
        batch.starts,
        batch.streams,
        first,
        last,
        *SEARCH.empty(arrays.n, last - first + 1),
        q,
        outcome,
    )


def attempt(
    arrays: ProblemArrays, batch: Batch, first: int, last: int, some: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Make the attempts first, ..., last at k of the targets: q (k, n) and outcomes (k, 9)."""
    q, outcome = np.empty((len(some), arrays.n)), np.empty((len(some), Outcome.WIDTH))
    attempts(arrays, batch.some(some), first, last, q, outcome)
    return q, outcome


def find_by_descents(arrays: ProblemArrays, batch: Batch, q: np.ndarray, outcome: np.ndarray, halted: Event) -> None:
    """Search for q (N, n) of any chain that reach the targets, without starts; see `anywhere.find_anywhere`.

    Some descents at each target come first, then certificates, then the other descents at what resists.
    """
    last, head = arrays.last_attempt, min(HEAD, arrays.last_attempt)
    attempts(arrays, batch, 0, head, q, outcome)
    if none_open(outcome):
        return
    left = np.flatnonzero((outcome[:, Outcome.SUCCESS] == 0.0) & np.isfinite(outcome[:, Outcome.FINAL_COST]))
    for part in parts(left, last + 1, halted):
        proved = arrays.proofs.unreachable(batch.rows[part])
        outcome[part[proved], Outcome.SUCCESS] = Outcome.PROVED
        resisting = part[~proved]
        if head < last and len(resisting):
            found_q, found = attempt(arrays, batch, head + 1, last, resisting)
            found[:, Outcome.SPENT] += outcome[resisting, Outcome.SPENT]
            worse = (found[:, Outcome.SUCCESS] == 0.0) & (
                outcome[resisting, Outcome.FINAL_COST] <= found[:, Outcome.FINAL_COST]
            )
            found[worse, Outcome.FINAL_COST :] = outcome[resisting[worse], Outcome.FINAL_COST :]
            found_q[worse] = q[resisting[worse]]
            q[resisting], outcome[resisting] = found_q, found


def find_in_time(arrays: ProblemArrays, batch: Batch, q: np.ndarray, outcome: np.ndarray, budget: Budget) -> None:
    """Search for q (1, n) that reaches one target, without a start, for which there may be too little time."""
    spent, proved = 0.0, False
    for first in range(0, arrays.last_attempt + 1, LANES):
        found_q, found = attempt(arrays, batch, first, min(first + LANES - 1, arrays.last_attempt), np.arange(1))
        spent += found[0, Outcome.SPENT]
        if (
            first == 0
            or found[0, Outcome.SUCCESS] > 0.0
            or found[0, Outcome.FINAL_COST] < outcome[0, Outcome.FINAL_COST]
        ):
            q[:], outcome[:] = found_q, found
        outcome[0, Outcome.ATTEMPT] = found[0, Outcome.ATTEMPT]
        proved = first == 0 and not (found[0, Outcome.SUCCESS] > 0.0 or budget.late()) and _is_proved(arrays, batch)
        if found[0, Outcome.SUCCESS] > 0.0 or proved or budget.late():
            break
    outcome[0, Outcome.SPENT] = spent
    if proved:
        outcome[0, Outcome.SUCCESS] = Outcome.PROVED


def _is_proved(arrays: ProblemArrays, batch: Batch) -> bool:
    return bool(arrays.proofs.unreachable(batch.rows)[0])


def descend(arrays: ProblemArrays, rows: np.ndarray, starts: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Descend once from each of N starts (N, n) toward targets, (N, 12) or one (12,): q (N, n) and outcomes (N, 9)."""
    q, outcome = np.empty(starts.shape), np.empty((len(starts), Outcome.WIDTH))
    batch = Batch(
        np.ascontiguousarray(np.broadcast_to(rows, (len(starts), 12))), starts, np.zeros(len(starts), np.uint64), False
    )
    attempts(arrays, batch, 0, 0, q, outcome)
    return q, outcome


def placed(arrays: ProblemArrays, row: np.ndarray, starts: np.ndarray) -> np.ndarray:
    """Place the slides of starts (N, n) that are sampled in part only by a target (12,): (N, n)."""
    if has_long_slides(arrays.chain):
        starts = starts.copy()
        place_all(arrays.chain, arrays.settings, row, *LANES_ARENA.empty(starts.shape[1]), starts)
    return starts
