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

from maira_qp.kernels.jit.arena import Arena
from maira_qp.kernels.jit.decorators import device_kernel, kernel
from maira_qp.kernels.jit.simd import LANES, any_lane, load
from maira_qp.kernels.kinematics.unwrap import nearest_turn
from maira_qp.kernels.layout import Descent, Joint, Lane, Outcome, Setting, Slot, SlotBest
from maira_qp.kernels.search.levenberg_marquardt import LANES_ARENA, advance, begin, make_lanes
from maira_qp.kernels.search.random_numbers import state_of, stream_of
from maira_qp.kernels.search.seeds import CORNER, find_nearest, has_long_slides, place_slides, random_start
from maira_qp.kernels.spatial.pose_validation import FINE, pose_row

NOBODY = -1
"""In place of a slot or of its target: there is none."""

FARTHEST_START, TOO_FAR = 1e5, -1
"""Joint values [rad or m] beyond the first the kernels do not begin at: their sine loses digits; or NaN."""


SEARCH = Arena(
    "SearchWork",
    "n attempts",
    floats={
        "lanes": LANES_ARENA.floats,
        "q0": "n",
        "found": f"{LANES}, {SlotBest.Q} + n",  # of each slot: cost, squared errors, cost of the start and q
    },
    integers={
        "nearest": f"{LANES}, {LANES}",  # of each slot its starts in the library
        "spent": f"{LANES}, attempts",  # of each slot every attempt's iterations
        "slots": f"{LANES}, {Slot.WIDTH}",
        "lane_of": f"{LANES}, {Lane.WIDTH}",
    },
)
"""Work of `search`, for a chain of n joints."""
SearchWork, carve_search = SEARCH.Arrays, SEARCH.carve


@kernel
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
    `settings` expect, 0]. `floats` and `integers` are memory to work in, see `SEARCH`.
    Returns how many targets were not reached, or went so far.
    A target with NaN costs only itself: it is left at q = 0, or as near as the limits allow, with errors of NaN.
    """
    n, attempts = len(chain) - 1, last - first + 1
    work = carve_search(n, attempts, floats, integers)
    lanes, q0, found = make_lanes(n, work.lanes), work.q0, work.found
    nearest, spent, slots, lane_of = work.nearest, work.spent, work.slots, work.lane_of
    for lane in range(LANES):
        lane_of[lane, Lane.SERVES], slots[lane, Slot.TARGET] = NOBODY, NOBODY
    opened, open_ends = 0, 0
    while True:
        if any_lane(load(lanes.state, Descent.ENDED) > 0.0):
            _collect(lanes.state, lanes.q, lane_of, slots, found, spent, first, last)
            open_ends += _close(chain, settings, starts, slots, found, spent, first, last, q, outcome)
            busy = False
            for lane in range(LANES):
                if lane_of[lane, Lane.SERVES] == NOBODY:
                    slot = _slot_to_serve(slots, last)
                    while opened < len(targets) and (slot == NOBODY or slots[slot, Slot.RUNNING] > 0):
                        if _is_finite(targets, opened):
                            slot = _open(slots, found, opened, first, last)
                            if last >= len(starts[:1]):
                                find_nearest(settings, features, targets[opened], lanes.e, nearest[slot])
                        else:
                            _refuse(chain, opened, q, outcome)
                            open_ends += 1
                        opened += 1
                    if slot != NOBODY:
                        k, attempt = slots[slot, Slot.TARGET], slots[slot, Slot.FOLLOWING]
                        place = attempt - (len(starts) > 0)
                        if place < 0:
                            for i in range(n):
                                q0[i] = min(max(starts[k, i], chain[i, Joint.LOWER]), chain[i, Joint.UPPER])
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
                        lane_of[lane, Lane.SERVES], lane_of[lane, Lane.MAKES] = slot, attempt
                        slots[slot, Slot.FOLLOWING] += 1
                        slots[slot, Slot.RUNNING] += 1
                busy = busy or lane_of[lane, Lane.SERVES] != NOBODY
            if not busy:
                return open_ends
        advance(chain, settings, lanes)


@device_kernel
def _copy(rows, k, row):
    for i in range(len(row)):
        row[i] = rows[k, i]


@device_kernel
def _collect(state, lane_q, lane_of, slots, found, spent, first, last):
    """Note the attempts that have ended, and break off those that can no longer count."""
    for lane in range(LANES):
        slot, attempt = lane_of[lane, Lane.SERVES], lane_of[lane, Lane.MAKES]
        if slot == NOBODY or state[Descent.ENDED, lane] == 0.0:
            continue
        lane_of[lane, Lane.SERVES] = NOBODY
        slots[slot, Slot.RUNNING] -= 1
        spent[slot, attempt - first] = int(state[Descent.ITERATIONS, lane])
        cost = state[Descent.COST, lane]
        if state[Descent.REACHED, lane] > 0.0:
            better = attempt < slots[slot, Slot.WINNER]
            slots[slot, Slot.WINNER] = min(attempt, slots[slot, Slot.WINNER])
        else:
            tie = cost == found[slot, SlotBest.COST] and attempt < slots[slot, Slot.BEST]
            better = slots[slot, Slot.WINNER] > last and (cost < found[slot, SlotBest.COST] or tie)
        if better:
            slots[slot, Slot.BEST] = attempt
            found[slot, SlotBest.COST], found[slot, SlotBest.POSITION] = cost, state[Descent.POSITION, lane]
            found[slot, SlotBest.ORIENTATION] = state[Descent.ORIENTATION, lane]
            found[slot, SlotBest.FIRST_COST] = state[Descent.FIRST_COST, lane]
            for i in range(len(lane_q)):
                found[slot, SlotBest.Q + i] = lane_q[i, lane]
    for lane in range(LANES):
        slot = lane_of[lane, Lane.SERVES]
        if slot != NOBODY and lane_of[lane, Lane.MAKES] > slots[slot, Slot.WINNER]:
            lane_of[lane, Lane.SERVES] = NOBODY
            slots[slot, Slot.RUNNING] -= 1
            state[Descent.ENDED, lane] = 1.0


@device_kernel
def _close(chain, settings, starts, slots, found, spent, first, last, q, outcome):
    """Write down what became of the targets that are done, and free their slots: how many are not settled by that."""
    open_ends = 0
    for slot in range(LANES):
        k, winner = slots[slot, Slot.TARGET], slots[slot, Slot.WINNER]
        if k == NOBODY or slots[slot, Slot.RUNNING] > 0 or (winner > last and slots[slot, Slot.FOLLOWING] <= last):
            continue
        slots[slot, Slot.TARGET] = NOBODY
        iterations = 0
        for attempt in range(min(winner, last) - first + 1):
            iterations += spent[slot, attempt]
        for i in range(q.shape[1]):
            q[k, i] = found[slot, SlotBest.Q + i]
        outcome[k, Outcome.SUCCESS], outcome[k, Outcome.ATTEMPT] = winner <= last, min(winner, last)
        outcome[k, Outcome.SPENT] = iterations
        outcome[k, Outcome.FINAL_COST] = found[slot, SlotBest.COST]
        outcome[k, Outcome.MOVED] = len(starts) > 0 and _is_outside(chain, starts, k)
        outcome[k, Outcome.POSITION_ERROR] = (
            np.sqrt(found[slot, SlotBest.POSITION]) if settings[Setting.POSITION_WEIGHT] > 0.0 else 0.0
        )
        outcome[k, Outcome.ORIENTATION_ERROR] = (
            np.sqrt(found[slot, SlotBest.ORIENTATION]) if settings[Setting.ORIENTATION_WEIGHT] > 0.0 else 0.0
        )
        outcome[k, Outcome.WANDERED], outcome[k, Outcome.LEFT] = 0.0, 0.0
        if len(starts) > 0:
            farthest = _turn_to_start(chain, starts, k, q)
            expected = (
                settings[Setting.NEAR_BY_ERROR] * np.sqrt(np.sqrt(2.0 * found[slot, SlotBest.FIRST_COST]))
                if winner <= last
                else 0.0
            )
            outcome[k, Outcome.WANDERED] = slots[slot, Slot.BEST] == 0 and farthest > max(
                settings[Setting.NEAR], expected
            )
        open_ends += winner > last or outcome[k, Outcome.WANDERED] > 0.0
    return open_ends


@device_kernel
def _turn_to_start(chain, starts, k, q):
    """Turn each joint of q[k] to the turn nearest to starts[k], moved inside: how far the farthest is from there."""
    farthest = 0.0
    for i in range(q.shape[1]):
        start = min(max(starts[k, i], chain[i, Joint.LOWER]), chain[i, Joint.UPPER])
        q[k, i] = nearest_turn(chain, i, q[k, i], start)
        farthest = max(farthest, abs(q[k, i] - start))
    return farthest


@device_kernel
def _slot_to_serve(slots, last):
    """The open slot that needs an attempt most: with none under way, else with the fewest; `NOBODY` if none does."""
    served = NOBODY
    for slot in range(LANES):
        unsolved = slots[slot, Slot.TARGET] != NOBODY and slots[slot, Slot.WINNER] > last
        fewest = served == NOBODY or slots[slot, Slot.RUNNING] < slots[served, Slot.RUNNING]
        if unsolved and slots[slot, Slot.FOLLOWING] <= last and fewest:
            served = slot
    return served


@device_kernel
def _open(slots, found, k, first, last):
    """Take target k into a free slot."""
    slot = 0
    while slots[slot, Slot.TARGET] != NOBODY:
        slot += 1
    slots[slot, Slot.TARGET], slots[slot, Slot.FOLLOWING], slots[slot, Slot.RUNNING] = k, first, 0
    slots[slot, Slot.WINNER], slots[slot, Slot.BEST] = last + 1, last + 1
    found[slot, SlotBest.COST] = np.inf
    return slot


@device_kernel
def _is_finite(targets, k):
    total = 0.0
    for i in range(12):
        total += 0.0 * targets[k, i]
    return total == 0.0


@device_kernel
def _refuse(chain, k, q, outcome):
    """The outcome of a target that is not finite."""
    for i in range(q.shape[1]):
        q[k, i] = min(max(0.0, chain[i, Joint.LOWER]), chain[i, Joint.UPPER])
    outcome[k, Outcome.SUCCESS], outcome[k, Outcome.ATTEMPT], outcome[k, Outcome.SPENT] = 0.0, 0.0, 0.0
    outcome[k, Outcome.FINAL_COST], outcome[k, Outcome.POSITION_ERROR] = np.nan, np.nan
    outcome[k, Outcome.ORIENTATION_ERROR] = np.nan
    outcome[k, Outcome.MOVED], outcome[k, Outcome.WANDERED], outcome[k, Outcome.LEFT] = 0.0, 0.0, 0.0


@device_kernel
def _is_outside(chain, rows, k):
    outside = False
    for i in range(rows.shape[1]):
        outside = outside or rows[k, i] < chain[i, Joint.LOWER] or rows[k, i] > chain[i, Joint.UPPER]
    return outside


@kernel
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
