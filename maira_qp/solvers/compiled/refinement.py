"""The refinement stage: the optimum of the redundancy where a pose is reached, else the nearest point, by kernels."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np

from maira_qp.kernels.kinematics.unwrap import has_free_turn, unwind, unwind_free
from maira_qp.kernels.layout import Outcome, Refinement, Settling
from maira_qp.kernels.refinement.nearest_pose import nearest_points
from maira_qp.kernels.refinement.null_space_sqp import settle_alone, trade_off_each
from maira_qp.kernels.refinement.stabilized_sqp_simd import settle_in_lanes
from maira_qp.solvers.compiled.batch import Batch
from maira_qp.solvers.compiled.multi_start import attempt, descend
from maira_qp.solvers.compiled.outcomes import all_reached, unsettled
from maira_qp.solvers.compiled.problem_arrays import ProblemArrays
from maira_qp.solvers.neighbourhood import TURNINGS

ELSEWHERE, WORTH = 6, 1.02
"""Other ways to the pose from which the redundancy is settled where it was not at first, at most; and how much larger
its objective may be there. In a fold of the self-motion the tolerances of the pose are worth a percent of it."""

LARGEST = float(np.finfo(float).max)
"""What every projected gradient of a walk that ended at an optimum is below; the others say infinity."""


def finish(arrays: ProblemArrays, batch: Batch, q: np.ndarray, outcome: np.ndarray) -> np.ndarray:
    """Refine q (N, n), in place, that a search left: to the optimum of the redundancy, or to the nearest point.

    Returns the results (N, 6), see `kernels.layout.Refinement`; NaN where there was nothing to do.
    """
    after = np.empty((len(q), Refinement.WIDTH))
    after.fill(np.nan)
    if arrays.settles:
        refine(arrays, batch.rows, references(arrays, batch), q, after)
        if not len(batch.starts):
            for k in unsettled(after, arrays.stationarity_tolerance):
                if outcome[k, Outcome.SUCCESS] > 0.0:
                    _refine_elsewhere(arrays, batch, k, q, outcome, after)
    if all_reached(outcome):
        return after
    short = np.flatnonzero(~(outcome[:, Outcome.SUCCESS] > 0.0) & np.isfinite(outcome[:, Outcome.FINAL_COST]))
    if len(short):
        q[short], after[short] = nearest(arrays, batch.rows[short], references(arrays, batch.some(short)), q[short])
    return after


def refine(arrays: ProblemArrays, rows: np.ndarray, near: np.ndarray | None, q: np.ndarray, after: np.ndarray) -> None:
    """Optimise the redundancy along the self-motion from q (N, n), in place, which reach the targets (N, 12).

    Results (N, 6) go into `after`. Joints turn to what is `near`, (N, n) or (1, n), see `_at_turns`; None: they keep
    their turns.
    """
    settle(arrays, arrays.posture, rows, q, after)
    if near is not None:
        _at_turns(arrays, rows, near, arrays.posture, partial(settle, arrays, arrays.posture), q, after)
    if arrays.redundancy is None or arrays.redundancy.share is None:
        return
    settled = None if arrays.trades_off else (q.copy(), after.copy())
    _trade_off(arrays, rows, q, after)
    if near is not None:
        _at_turns(arrays, rows, near, arrays.posture, partial(_trade_off_again, arrays), q, after)
    if settled is not None:
        _reach_again(arrays, rows, *settled, q, after)


def refined(arrays: ProblemArrays, row: np.ndarray, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Optimise the redundancy from q (N, n), which reach a target (12,): optima (N, n), and which are optimal (N,)."""
    q, outcome = q.copy(), np.empty((len(q), Refinement.WIDTH))
    refine(arrays, np.tile(row, (len(q), 1)), None, q, outcome)
    return q, (outcome[:, Refinement.REACHED] > 0.0) & is_converged(arrays, outcome)


def nearest(
    arrays: ProblemArrays, rows: np.ndarray, near: np.ndarray | None, q: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Minimise the pose error from q (N, n): stationary points (N, n), and results (N, 6).

    Joints turn to what is `near`, (N, n) or (1, n), as `_at_turns` says; None: they keep their turns.
    """
    q, after, free = q.copy(), np.empty((len(q), Refinement.WIDTH)), np.zeros(arrays.n)
    _approach(arrays, rows, q, after)
    if near is not None:
        _at_turns(arrays, rows, near, (free, free), partial(_approach, arrays), q, after)
    return q, after


def references(arrays: ProblemArrays, batch: Batch) -> np.ndarray | None:
    """Configurations whose whole turns joints go to: starts (N, n), or the posture (1, n); None: there is one turn."""
    if not arrays.has_turns:
        return None
    return batch.starts if len(batch.starts) else arrays.turns.aim[None]  # type: ignore[union-attr]


def is_converged(arrays: ProblemArrays, after: np.ndarray) -> np.ndarray:
    """Which of the results (N, 6) are optimal, (N,) of bool."""
    return np.asarray(after[:, Refinement.PROJECTED_GRADIENT] <= arrays.stationarity_tolerance)


def settle(
    arrays: ProblemArrays,
    posture: tuple[np.ndarray, np.ndarray],
    rows: np.ndarray,
    q: np.ndarray,
    after: np.ndarray,
) -> None:
    """From q (N, n) that reach the targets (N, 12) to the optimum of a posture (n,), weighted (n,), near each.

    In place, to that of `Strict`; results (N, 6) go into `after`. Eight at a time, and one by one where that does not
    end at an optimum: those few have a kernel of their own, so that it is compiled when one of them comes. Where q does
    not reach the pose to begin with it is left as it is, with an infinite gradient.
    """
    settle_in_lanes(arrays.chain, arrays.settings, rows, *posture, arrays.settling, q, after)
    alone = unsettled(after, LARGEST)
    if alone:
        some, end = q[alone], after[alone]
        settle_alone(arrays.chain, arrays.settings, rows[alone], *posture, arrays.settling, some, end)
        q[alone], after[alone] = some, end


def _trade_off(arrays: ProblemArrays, rows: np.ndarray, q: np.ndarray, after: np.ndarray) -> None:
    """From there to the optima of the weighted sum."""
    assert arrays.redundancy is not None
    trade_off_each(arrays.chain, arrays.settings, rows, *arrays.redundancy, arrays.settling, q, after)


def _reach_again(
    arrays: ProblemArrays,
    rows: np.ndarray,
    settled: np.ndarray,
    there: np.ndarray,
    q: np.ndarray,
    after: np.ndarray,
) -> None:
    """From optima of the weighted sum to the pose alone, as the weight fades; what fails stays where it was settled.

    That is `settled` (N, n), with results `there` (N, 6).
    """
    end, outcome = descend(arrays.exact, rows, q)
    reached = (outcome[:, Outcome.SUCCESS] > 0.0) & (there[:, Refinement.REACHED] > 0.0)
    q[:] = np.where(reached[:, None], end, settled)
    after[:, Refinement.ITERATIONS] += outcome[:, Outcome.SPENT]
    after[:, Refinement.OBJECTIVE] = arrays.wish(q)
    after[:, Refinement.POSITION_ERROR] = outcome[:, Outcome.POSITION_ERROR]
    after[:, Refinement.ORIENTATION_ERROR] = outcome[:, Outcome.ORIENTATION_ERROR]
    after[:, Refinement.REACHED] = 1.0
    after[~reached] = there[~reached]


def _trade_off_again(arrays: ProblemArrays, rows: np.ndarray, q: np.ndarray, after: np.ndarray) -> None:
    """From near such optima."""
    after[:, [Refinement.REACHED, Refinement.ITERATIONS]] = 1.0, 0.0
    _trade_off(arrays, rows, q, after)


def _at_turns(
    arrays: ProblemArrays,
    rows: np.ndarray,
    near: np.ndarray,
    posture: tuple[np.ndarray, np.ndarray],
    refine: Callable[[np.ndarray, np.ndarray, np.ndarray], None],
    q: np.ndarray,
    after: np.ndarray,
) -> None:
    """Turn joints of q (N, n), which was refined, to the whole turns nearest to what is `near`, in place.

    No joint is turned to where the cost of a posture (n,) by weights (n,) is higher. What was turned is refined
    again: limits that held a joint up may be a whole turn away.
    """
    if not has_free_turn(arrays.chain, near, *posture, q):
        return
    which = after[:, Refinement.PROJECTED_GRADIENT] < np.inf
    for _ in range(TURNINGS):
        turned, there = which.copy(), q.copy()
        unwind_free(arrays.chain, near, *posture, turned, there)
        some = np.flatnonzero(turned)
        if not len(some):
            return
        q_some, end = there[some], np.empty((len(some), Refinement.WIDTH))
        refine(rows[some], q_some, end)
        end[:, Refinement.ITERATIONS] += after[some, Refinement.ITERATIONS]
        worse = (is_converged(arrays, after[some]) & ~is_converged(arrays, end)) | (
            end[:, Refinement.REACHED] < after[some, Refinement.REACHED]
        )
        q[some[~worse]], after[some[~worse]] = q_some[~worse], end[~worse]
        which[some[worse]] = False


def _refine_elsewhere(
    arrays: ProblemArrays, batch: Batch, k: int, q: np.ndarray, outcome: np.ndarray, after: np.ndarray
) -> None:
    """Try to settle target k, which resists, from where later attempts reach it: q and both outcomes in place.

    In a narrow fold of the self-motion steps are short, and a walk stops; from its other side it may be easy.
    """
    some, begun = np.array([k]), outcome[k, Outcome.ATTEMPT]
    for _ in range(ELSEWHERE):
        first = int(begun) + 1
        if first > arrays.last_attempt:
            return
        there, found = attempt(arrays, batch, first, arrays.last_attempt, some)
        if not found[0, Outcome.SUCCESS] > 0.0:
            return
        begun, end = found[0, Outcome.ATTEMPT], np.full((1, Refinement.WIDTH), np.nan)
        if arrays.turns is not None:
            unwind(arrays.chain, arrays.turns.aim[None], found[:, Outcome.SUCCESS], there)
        refine(arrays, batch.rows[some], references(arrays, batch.some(some)), there, end)
        if is_converged(arrays, end)[0] and end[0, Refinement.OBJECTIVE] <= WORTH * after[k, Refinement.OBJECTIVE]:
            found[0, Outcome.SPENT] += outcome[k, Outcome.SPENT]
            q[k], outcome[k], after[k] = there[0], found[0], end[0]
            return


def _approach(arrays: ProblemArrays, rows: np.ndarray, q: np.ndarray, after: np.ndarray) -> None:
    """To the stationary points of the pose error, in place."""
    posture = arrays.posture if arrays.settles else (np.full(arrays.n, np.nan), np.zeros(arrays.n))
    most = int(arrays.settling[Settling.MAX_SETTLING])
    nearest_points(arrays.chain, arrays.settings, rows, *posture, arrays.stationarity_tolerance, most, q, after)
