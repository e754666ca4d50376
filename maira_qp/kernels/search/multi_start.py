"""Reach poses from given starts and from others, eight descents at a time: the compiled form of
`solvers.reference.multi_start`.

A search makes attempts in order until one arrives, and takes the first that does. The lanes are shared between up to
eight targets: a lane that is free opens the next target, or, where none is left, makes a further attempt at one that is
open, in case the attempts under way fail. So a batch keeps all lanes busy, and a single target has eight attempts at
once; but which attempt counts depends on neither: every attempt begins where its target, its number and the target's
random numbers say, and an earlier one that arrives goes before a later one.
"""

from __future__ import annotations

import numpy as np

from maira_qp.kernels.jit.decorators import bare_kernel
from maira_qp.kernels.jit.simd import LANES, any_lane, load
from maira_qp.kernels.kinematics.serial_chain import LOWER, UPPER
from maira_qp.kernels.kinematics.unwrap import nearest_turn
from maira_qp.kernels.search.levenberg_marquardt import (
    COST,
    ENDED,
    FIRST_COST,
    ITERATIONS,
    NEAR,
    NEAR_BY_ERROR,
    ORIENTATION,
    ORIENTATION_WEIGHT,
    POSITION,
    POSITION_WEIGHT,
    REACHED,
    advance,
    begin,
    lanes_memory,
    make_lanes,
)
from maira_qp.kernels.search.random_numbers import state_of, stream_of
from maira_qp.kernels.search.seeds import CORNER, find_nearest, has_long_slides, place_slides, random_start
from maira_qp.kernels.spatial.pose_validation import FINE, pose_row

NOBODY = -1

FARTHEST_START, TOO_FAR = 1e5, -1
"""Joint values [rad or m] beyond the first the kernels do not begin at: their sine loses digits; or NaN."""

# the entries of an outcome
SUCCESS, ATTEMPT, SPENT, FINAL_COST, POSITION_ERROR, ORIENTATION_ERROR, MOVED = 0, 1, 2, 3, 4, 5, 6
WANDERED, LEFT = 7, 8
OUTCOME = 9

PROVED = -1.0
"""In place of SUCCESS, written by whoever proves it: the target cannot be reached."""

# the columns of `slots`, the targets that are open, eight at most: its number (`NOBODY`: the slot is free), the attempt
# that comes next, how many are under way, the first that arrived (past the last: none), the one that `found` is from
TARGET, FOLLOWING, RUNNING, WINNER, BEST = 0, 1, 2, 3, 4
SLOT = 5

# the columns of `lane_of`: the slot that a lane serves (`NOBODY`: none), and which attempt it makes
SERVES, MAKES = 0, 1


def memory_sizes(n, attempts):
    """How many numbers `search` needs as `floats` and as `integers`, for a chain of n joints."""
    return lanes_memory(n) + n + LANES * (4 + n), LANES * (2 + SLOT + LANES + attempts)


@bare_kernel
def search(
    chain,
    settings,
    library,
    features,
    candidates,
    shuffled,
    targets,
    starts,
    streams,
    first,
    last,
    floats,
    integers,
    q,
    outcome,
):
    """The first of the attempts first, ..., last to arrive at each of `targets` (N, 12), else the best: q (N, n).

    Attempt 0 begins at `starts` (N, n), which may have no rows; the next `LANES` at configurations of the `library`
    (K, n), the nearest one first, or, if `shuffled`, any of them; the others at the best of so many random
    `candidates`. What is random comes from `streams` (N,). With starts each joint of q is turned to the whole turn
    nearest to its start. `outcome` (N, 9) becomes [reached, last attempt that counts, iterations, cost, position error,
    orientation error, the start was outside the limits and was moved onto them, attempt 0 counts and went further than
    `settings` expect, 0]. `floats` and `integers` are memory to work in, see `memory_sizes`.
    Returns how many targets were not reached, or went so far.
    A target with NaN costs only itself: it is left at q = 0, or as near as the limits allow, with errors of NaN.
    """
    n, attempts = len(chain) - 1, last - first + 1
    lanes, floats = make_lanes(n, floats), floats[lanes_memory(n) :]
    q0 = floats[:n]
    # of each slot: cost, squared errors, cost of the start and q; its starts in the library; every attempt's iterations
    found = floats[n : n + (4 + n) * LANES].reshape(LANES, 4 + n)
    nearest = integers[: LANES * LANES].reshape(LANES, LANES)
    spent = integers[LANES * LANES : LANES * (LANES + attempts)].reshape(LANES, attempts)
    integers = integers[LANES * (LANES + attempts) :]
    slots = integers[: SLOT * LANES].reshape(LANES, SLOT)
    lane_of = integers[SLOT * LANES : (SLOT + 2) * LANES].reshape(LANES, 2)
    for lane in range(LANES):
        lane_of[lane, SERVES], slots[lane, TARGET] = NOBODY, NOBODY
    opened, open_ends = 0, 0
    while True:
        if any_lane(load(lanes.state, ENDED) > 0.0):
            _collect(lanes.state, lanes.q, lane_of, slots, found, spent, first, last)
            open_ends += _close(chain, settings, starts, slots, found, spent, first, last, q, outcome)
            busy = False
            for lane in range(LANES):
                if lane_of[lane, SERVES] == NOBODY:
                    slot = _slot_to_serve(slots, last)
                    while opened < len(targets) and (slot == NOBODY or slots[slot, RUNNING] > 0):
                        if _is_finite(targets, opened):
                            slot = _open(slots, found, opened, first, last)
                            if last >= len(starts[:1]):
                                find_nearest(settings, features, targets[opened], lanes.e, nearest[slot])
                        else:
                            _refuse(chain, opened, q, outcome)
                            open_ends += 1
                        opened += 1
                    if slot != NOBODY:
                        k, attempt = slots[slot, TARGET], slots[slot, FOLLOWING]
                        place = attempt - (len(starts) > 0)
                        if place < 0:
                            for i in range(n):
                                q0[i] = min(max(starts[k, i], chain[i, LOWER]), chain[i, UPPER])
                        elif place < LANES:
                            turn = streams[k] >> np.uint64(32) if shuffled else np.uint64(0)
                            _copy(library, nearest[slot, (place + np.int64(turn)) % LANES], q0)
                            if has_long_slides(chain):
                                place_slides(chain, settings, targets[k], lanes, q0)
                        else:
                            state = state_of(streams[k], attempt)
                            random_start(
                                chain, settings, targets[k], candidates, attempt % CORNER == 1, state, lanes, q0
                            )
                        begin(lanes.state, lanes.q, lanes.target, lane, q0, targets[k])
                        lane_of[lane, SERVES], lane_of[lane, MAKES] = slot, attempt
                        slots[slot, FOLLOWING] += 1
                        slots[slot, RUNNING] += 1
                busy = busy or lane_of[lane, SERVES] != NOBODY
            if not busy:
                return open_ends
        advance(chain, settings, lanes)


@bare_kernel
def _copy(rows, k, row):
    for i in range(len(row)):
        row[i] = rows[k, i]


@bare_kernel
def _collect(state, lane_q, lane_of, slots, found, spent, first, last):
    """Note the attempts that have ended, and break off those that can no longer count."""
    for lane in range(LANES):
        slot, attempt = lane_of[lane, SERVES], lane_of[lane, MAKES]
        if slot == NOBODY or state[ENDED, lane] == 0.0:
            continue
        lane_of[lane, SERVES] = NOBODY
        slots[slot, RUNNING] -= 1
        spent[slot, attempt - first] = int(state[ITERATIONS, lane])
        cost = state[COST, lane]
        if state[REACHED, lane] > 0.0:
            better = attempt < slots[slot, WINNER]
            slots[slot, WINNER] = min(attempt, slots[slot, WINNER])
        else:
            tie = cost == found[slot, 0] and attempt < slots[slot, BEST]
            better = slots[slot, WINNER] > last and (cost < found[slot, 0] or tie)
        if better:
            slots[slot, BEST] = attempt
            found[slot, 0], found[slot, 1], found[slot, 2] = cost, state[POSITION, lane], state[ORIENTATION, lane]
            found[slot, 3] = state[FIRST_COST, lane]
            for i in range(len(lane_q)):
                found[slot, 4 + i] = lane_q[i, lane]
    for lane in range(LANES):
        slot = lane_of[lane, SERVES]
        if slot != NOBODY and lane_of[lane, MAKES] > slots[slot, WINNER]:
            lane_of[lane, SERVES] = NOBODY
            slots[slot, RUNNING] -= 1
            state[ENDED, lane] = 1.0


@bare_kernel
def _close(chain, settings, starts, slots, found, spent, first, last, q, outcome):
    """Write down what became of the targets that are done, and free their slots: how many are not settled by that."""
    open_ends = 0
    for slot in range(LANES):
        k, winner = slots[slot, TARGET], slots[slot, WINNER]
        if k == NOBODY or slots[slot, RUNNING] > 0 or (winner > last and slots[slot, FOLLOWING] <= last):
            continue
        slots[slot, TARGET] = NOBODY
        iterations = 0
        for attempt in range(min(winner, last) - first + 1):
            iterations += spent[slot, attempt]
        for i in range(q.shape[1]):
            q[k, i] = found[slot, 4 + i]
        outcome[k, SUCCESS], outcome[k, ATTEMPT], outcome[k, SPENT] = winner <= last, min(winner, last), iterations
        outcome[k, FINAL_COST] = found[slot, 0]
        outcome[k, MOVED] = len(starts) > 0 and _is_outside(chain, starts, k)
        outcome[k, POSITION_ERROR] = np.sqrt(found[slot, 1]) if settings[POSITION_WEIGHT] > 0.0 else 0.0
        outcome[k, ORIENTATION_ERROR] = np.sqrt(found[slot, 2]) if settings[ORIENTATION_WEIGHT] > 0.0 else 0.0
        outcome[k, WANDERED], outcome[k, LEFT] = 0.0, 0.0
        if len(starts) > 0:
            farthest = _turn_to_start(chain, starts, k, q)
            expected = settings[NEAR_BY_ERROR] * np.sqrt(np.sqrt(2.0 * found[slot, 3])) if winner <= last else 0.0
            outcome[k, WANDERED] = slots[slot, BEST] == 0 and farthest > max(settings[NEAR], expected)
        open_ends += winner > last or outcome[k, WANDERED] > 0.0
    return open_ends


@bare_kernel
def _turn_to_start(chain, starts, k, q):
    """Turn each joint of q[k] to the turn nearest to starts[k], moved inside: how far the farthest is from there."""
    farthest = 0.0
    for i in range(q.shape[1]):
        start = min(max(starts[k, i], chain[i, LOWER]), chain[i, UPPER])
        q[k, i] = nearest_turn(chain, i, q[k, i], start)
        farthest = max(farthest, abs(q[k, i] - start))
    return farthest


@bare_kernel
def _slot_to_serve(slots, last):
    """The open slot that needs an attempt most: with none under way, else with the fewest; `NOBODY` if none does."""
    served = NOBODY
    for slot in range(LANES):
        unsolved = slots[slot, TARGET] != NOBODY and slots[slot, WINNER] > last
        fewest = served == NOBODY or slots[slot, RUNNING] < slots[served, RUNNING]
        if unsolved and slots[slot, FOLLOWING] <= last and fewest:
            served = slot
    return served


@bare_kernel
def _open(slots, found, k, first, last):
    """Take target k into a free slot."""
    slot = 0
    while slots[slot, TARGET] != NOBODY:
        slot += 1
    slots[slot, TARGET], slots[slot, FOLLOWING], slots[slot, RUNNING] = k, first, 0
    slots[slot, WINNER], slots[slot, BEST] = last + 1, last + 1
    found[slot, 0] = np.inf
    return slot


@bare_kernel
def _is_finite(targets, k):
    total = 0.0
    for i in range(12):
        total += 0.0 * targets[k, i]
    return total == 0.0


@bare_kernel
def _refuse(chain, k, q, outcome):
    """The outcome of a target that is not finite."""
    for i in range(q.shape[1]):
        q[k, i] = min(max(0.0, chain[i, LOWER]), chain[i, UPPER])
    outcome[k, SUCCESS], outcome[k, ATTEMPT], outcome[k, SPENT] = 0.0, 0.0, 0.0
    outcome[k, FINAL_COST], outcome[k, POSITION_ERROR], outcome[k, ORIENTATION_ERROR] = np.nan, np.nan, np.nan
    outcome[k, MOVED], outcome[k, WANDERED], outcome[k, LEFT] = 0.0, 0.0, 0.0


@bare_kernel
def _is_outside(chain, rows, k):
    outside = False
    for i in range(rows.shape[1]):
        outside = outside or rows[k, i] < chain[i, LOWER] or rows[k, i] > chain[i, UPPER]
    return outside


@bare_kernel
def admit(T, within, farthest, starts, seed, row, stream):
    """A target T (4, 4) as a row (1, 12), and its stream (1,) under a seed (2,), for a search from starts (1 or 0, n).

    Returns what is wrong with the target, see `pose_validation`; `TOO_FAR` if it is further than `farthest` [m] in one
    coordinate, or the start is beyond `FARTHEST_START`.
    """
    fault = pose_row(T, within, row[0])
    for k in range(len(starts)):
        for i in range(starts.shape[1]):
            if not abs(starts[k, i]) <= FARTHEST_START:
                fault = TOO_FAR
    for i in range(9, 12):
        if fault == FINE and abs(row[0, i]) > farthest:
            fault = TOO_FAR
    if fault == FINE:
        stream[0] = stream_of(row[0], seed)
    return fault
