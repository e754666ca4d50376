"""Reach a pose from a start and from random ones: the compiled form of `maira_qp.solvers.search`.

Every attempt has a random stream of its own, made from the target's stream and the attempt's number alone, so that an
answer depends on neither threads, nor order, nor on how a search is cut into calls.
"""

from __future__ import annotations

import numpy as np
from numba import uint64

from maira_qp.kernels.chain import LOWER, UPPER
from maira_qp.kernels.compilation import kernel
from maira_qp.kernels.descent import ORIENTATION_WEIGHT, POSITION_WEIGHT, descend, is_reached, pose_cost


@kernel
def next_random(state):
    """The next 64 bits of a stream, and its new state (Steele, Lea and Flood, "splitmix64", OOPSLA 2014)."""
    state = uint64(state + uint64(0x9E3779B97F4A7C15))
    z = uint64((state ^ (state >> uint64(30))) * uint64(0xBF58476D1CE4E5B9))
    z = uint64((z ^ (z >> uint64(27))) * uint64(0x94D049BB133111EB))
    return uint64(z ^ (z >> uint64(31))), state


@kernel
def state_of(stream, attempt):
    """The first state of an attempt's stream."""
    bits, _ = next_random(uint64(stream))
    bits, _ = next_random(uint64(bits ^ uint64(attempt)))
    return bits


@kernel
def random_start(chain, settings, target, candidates, state, best):
    """The best by cost of a few random configurations, into `best` (n,); a joint without limits starts in one turn."""
    n = len(best)
    axes, origins, tool, e = np.empty((n, 3)), np.empty((n, 3)), np.empty(12), np.empty(6)
    q, least = np.empty(n), np.inf
    for _ in range(candidates):
        for i in range(n):
            low, high = chain[i, LOWER], chain[i, UPPER]
            if np.isinf(low):
                low, high = -np.pi, np.pi
            bits, state = next_random(state)
            share = (bits >> uint64(11)) * (1.0 / 9007199254740992.0)
            q[i] = min(max((1.0 - share) * low + share * high, low), high)
        cost = pose_cost(chain, settings, target, q, axes, origins, tool, e)
        if cost < least:
            least = cost
            best[:] = q


@kernel
def search(chain, settings, target, start, has_start, candidates, first, last, stream, q, outcome):
    """The best of the attempts first, ..., last into q (n,); attempt 0 begins at `start` (n,) if there is one.

    `outcome` (6,) becomes [reached, last attempt made, iterations, cost, position error, orientation error], the
    verdict and the errors by a fresh evaluation of q.
    """
    n = len(q)
    trial, least, iterations, attempt = np.empty(n), np.inf, 0, first
    for i in range(n):
        q[i] = min(max(0.0, chain[i, LOWER]), chain[i, UPPER])
    while True:
        if attempt == 0 and has_start:
            trial[:] = start
        else:
            random_start(chain, settings, target, candidates, state_of(stream, attempt), trial)
        cost, reached, spent = descend(chain, settings, target, trial)
        iterations += spent
        if reached or cost < least:
            least = cost
            q[:] = trial
        if reached or attempt >= last:
            break
        attempt += 1
    axes, origins, tool, e = np.empty((n, 3)), np.empty((n, 3)), np.empty(12), np.empty(6)
    outcome[3] = pose_cost(chain, settings, target, q, axes, origins, tool, e)
    outcome[0], outcome[1], outcome[2] = is_reached(settings, e), attempt, iterations
    outcome[4] = np.sqrt(e[0] * e[0] + e[1] * e[1] + e[2] * e[2]) if settings[POSITION_WEIGHT] > 0.0 else 0.0
    outcome[5] = np.sqrt(e[3] * e[3] + e[4] * e[4] + e[5] * e[5]) if settings[ORIENTATION_WEIGHT] > 0.0 else 0.0


@kernel
def search_batch(chain, settings, targets, starts, has_start, candidates, last, streams, q, outcome):
    """`search` for each of `targets` (N, 12) from `starts` (N, n) with `streams` (N,): q (N, n), outcome (N, 6).

    A target with NaN costs only itself.
    """
    for k in range(len(targets)):
        search(chain, settings, targets[k], starts[k], has_start, candidates, 0, last, streams[k], q[k], outcome[k])
