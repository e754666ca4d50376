"""The closed-form stage of S-R-S arms: poses reached, certified unreachable, and nearest points, by kernels."""

from __future__ import annotations

from threading import Event

import numpy as np

from maira_qp.kernels.kinematics.serial_chain import KINEMATICS
from maira_qp.kernels.layout import Outcome
from maira_qp.kernels.srs import nearest_pose, posture_seed, reach
from maira_qp.kernels.srs.posture_seed import SEEDING
from maira_qp.kernels.srs.swivel_intervals import INTERVALS, PIECES
from maira_qp.solvers.compiled.batch import Batch
from maira_qp.solvers.compiled.multi_start import attempt
from maira_qp.solvers.compiled.outcomes import all_reached, none_open
from maira_qp.solvers.compiled.problem_arrays import ProblemArrays
from maira_qp.solvers.compiled.thread_pool import parts
from maira_qp.solvers.reference.multi_start import HEAD


def find_in_closed_form(arrays: ProblemArrays, batch: Batch, q: np.ndarray, outcome: np.ndarray, halted: Event) -> None:
    """Search for q (N, 7) of an S-R-S arm that reach the targets, without starts; see `anywhere.find_anywhere`.

    Descents are left what is singular. Of targets out of reach the nearest points are found.
    """
    some: slice | np.ndarray = slice(None)
    if arrays.settles:
        reach_near_posture(arrays, batch.rows, *arrays.posture, q, outcome)
        if none_open(outcome):
            return
        some = np.flatnonzero(outcome[:, Outcome.SUCCESS] == 0.0)
    some_q, some_outcome = q[some], outcome[some]
    reach_in_closed_form(arrays, batch.some(some), some_q, some_outcome)
    q[some], outcome[some] = some_q, some_outcome
    if all_reached(outcome):
        return
    proved = np.flatnonzero(outcome[:, Outcome.SUCCESS] == Outcome.PROVED)
    left = np.flatnonzero(outcome[:, Outcome.SUCCESS] == 0.0)
    approach_in_closed_form(arrays, batch, proved, q, outcome)
    beyond = proved[~np.isfinite(outcome[proved, Outcome.FINAL_COST])]
    for open_ones, last in ((beyond, min(HEAD, arrays.last_attempt)), (left, arrays.last_attempt)):
        for part in parts(open_ones, last + 1, halted):
            q[part], outcome[part] = attempt(arrays, batch, 0, last, part)
    outcome[proved, Outcome.SUCCESS] = Outcome.PROVED


def reach_near_posture(
    arrays: ProblemArrays,
    rows: np.ndarray,
    posture: np.ndarray,
    weights: np.ndarray,
    q: np.ndarray,
    outcome: np.ndarray,
) -> None:
    """Put q (N, 7) of an S-R-S arm that reach the targets near a posture (7,), weighted; some are left open."""
    problem = arrays.chain, arrays.settings, arrays.proofs.srs, rows, posture, weights
    memory = *INTERVALS.empty(), *SEEDING.empty(), *KINEMATICS.empty(arrays.n)
    posture_seed.reach_near_posture(*problem, *memory, q, outcome)


def reach_in_closed_form(arrays: ProblemArrays, batch: Batch, q: np.ndarray, outcome: np.ndarray) -> None:
    """Put q (N, 7) that reach the targets, or that it is proved that nothing does; the rest is left open."""
    problem = arrays.chain, arrays.settings, arrays.proofs.srs, batch.rows, batch.streams, batch.shuffled
    memory = *INTERVALS.empty(), np.empty((8, PIECES, 3)), *KINEMATICS.empty(arrays.n)
    reach.reach_in_closed_form(*problem, *memory, q, outcome)


def approach_in_closed_form(
    arrays: ProblemArrays, batch: Batch, some: np.ndarray, q: np.ndarray, outcome: np.ndarray
) -> None:
    """Put the nearest points of some of the targets, which are out of reach, into q (N, 7)."""
    if len(some):
        near, end, tolerance = q[some], outcome[some], arrays.stationarity_tolerance
        problem, (rows, _, streams, shuffled) = (arrays.chain, arrays.settings, arrays.proofs.srs), batch.some(some)
        nearest_pose.nearest_in_closed_form(*problem, arrays.proofs.span, rows, streams, shuffled, tolerance, near, end)
        q[some], outcome[some] = near, end
