"""Where descents begin: at the configurations of a library that are nearest to the target, and at random ones.

The library holds configurations of the robot with their tool poses, in `LANES` lists of the same length. The pose of
each list that is nearest to the target, in the metric of the pose cost, gives a start, the nearest of them the first; a
pass over a few hundred poses costs less than one iteration. After them a start is the best by its cost of a few random
configurations; every `CORNER`th time, of a few with every joint on a limit, near which targets are the hardest to find.

A slide that is much longer than the arm is sampled in part, and then placed where the tool comes nearest to the target.
"""

from __future__ import annotations

import numpy as np
from numba import uint64

from maira_qp.kernels.jit.arena import view
from maira_qp.kernels.jit.decorators import device_kernel, kernel
from maira_qp.kernels.jit.simd import LANES, broadcast, load2, select, store
from maira_qp.kernels.layout import Feature, Joint, Setting
from maira_qp.kernels.search.levenberg_marquardt import make_lanes, pose_cost
from maira_qp.kernels.search.random_numbers import next_random

CORNER = 4
"""One random start in so many is a corner of the limits."""

SWEEPS, PLACED = 200, 1e-6
"""Times at most that slides are placed one after the other, and steps [m] after which they are there. At right angles
one time is enough."""


@kernel
def fill_library(settings, poses, features):
    """Features (K / LANES, Feature.WIDTH, LANES) of tool poses (K, 12)."""
    turning, moving = _pose_weights(settings)
    for k in range(len(poses)):
        square = 0.0
        for i in range(12):
            feature = poses[k, i] * (turning if i < 9 else moving)
            features[k // LANES, i, k % LANES] = feature
            square += feature * feature
        features[k // LANES, Feature.SQUARE, k % LANES] = square


@device_kernel
def _pose_weights(settings):
    """Of the entries of R and of p: |R - R_d|^2 is twice the squared angle between the two where that is small."""
    return settings[Setting.ORIENTATION_WEIGHT] * np.sqrt(0.5), settings[Setting.POSITION_WEIGHT]


@kernel
def find_nearest(settings, features, target, work, nearest):
    """Indices of the library's configurations to start from, into `nearest` (LANES,); `work` is (2, LANES)."""
    turning, moving = _pose_weights(settings)
    t0, t1, t2, t3 = turning * target[0], turning * target[1], turning * target[2], turning * target[3]
    t4, t5, t6, t7 = turning * target[4], turning * target[5], turning * target[6], turning * target[7]
    t8, t9, t10, t11 = turning * target[8], moving * target[9], moving * target[10], moving * target[11]
    least, block = broadcast(work, np.inf), broadcast(work, 0.0)
    for k in range(len(features)):
        # four sums, of which none waits for another, of the product of the two poses
        a = load2(features, k, 0) * t0 + load2(features, k, 1) * t1 + load2(features, k, 2) * t2
        b = load2(features, k, 3) * t3 + load2(features, k, 4) * t4 + load2(features, k, 5) * t5
        c = load2(features, k, 6) * t6 + load2(features, k, 7) * t7 + load2(features, k, 8) * t8
        d = load2(features, k, 9) * t9 + load2(features, k, 10) * t10 + load2(features, k, 11) * t11
        # squared, less the target's own square
        distance = load2(features, k, Feature.SQUARE) - 2.0 * ((a + b) + (c + d))
        nearer = distance < least
        least, block = select(nearer, distance, least), select(nearer, 1.0 * k, block)
    store(work, 0, least)
    store(work, 1, block)
    for lane in range(LANES):  # sorted by insertion
        place = lane
        while place > 0 and work[0, lane] < work[0, nearest[place - 1] % LANES]:
            nearest[place] = nearest[place - 1]
            place -= 1
        nearest[place] = int(work[1, lane]) * LANES + lane


@kernel
def random_start(chain, settings, target, candidates, at_corner, state, lanes, best):
    """The best by cost of a few random configurations, into `best` (n,), or of a few with every joint on a limit.

    It works in what the lanes keep for themselves from one iteration to the next only in passing.
    """
    n, least = len(best), np.inf
    for i in range(12):
        for lane in range(LANES):
            lanes.goal[i, lane] = target[i]
    for first in range(0, candidates, LANES):
        for lane in range(LANES):
            for i in range(n):
                bits, state = next_random(state)
                share = (bits >> uint64(11)) * (1.0 / 9007199254740992.0)
                if at_corner:
                    share = np.floor(share + 0.5)
                low, high = chain[i, Joint.START_LOWER], chain[i, Joint.START_UPPER]
                lanes.trial[i, lane] = min(max((1.0 - share) * low + share * high, low), high)
        if has_long_slides(chain):
            for lane in range(LANES):
                q = view(lanes.dq, 0, (n,))
                for i in range(n):
                    q[i] = lanes.trial[i, lane]
                place_slides(chain, settings, target, lanes, q)
                for i in range(n):
                    lanes.trial[i, lane] = q[i]
        cost = pose_cost(chain, settings, lanes.goal, lanes.trial, lanes.axes, lanes.origins, lanes.tool, lanes.e)
        store(lanes.dq, 0, cost)
        for lane in range(min(LANES, candidates - first)):
            if lanes.dq[0, lane] < least or (first == 0 and lane == 0):
                least = lanes.dq[0, lane]
                for i in range(n):
                    best[i] = lanes.trial[i, lane]


@kernel
def has_long_slides(chain):
    """Whether there are slides that are sampled in part only."""
    found = False
    for i in range(len(chain) - 1):
        found = found or _is_long(chain, i)
    return found


@device_kernel
def _is_long(chain, i):
    cut = chain[i, Joint.START_LOWER] > chain[i, Joint.LOWER] or chain[i, Joint.START_UPPER] < chain[i, Joint.UPPER]
    return chain[i, Joint.PRISMATIC] != 0.0 and cut


@kernel
def place_slides(chain, settings, target, lanes, q):
    """Move the long slides of q (n,), in place, to where the tool comes nearest to the position of a target (12,).

    A slide turns nothing, so this is a least-squares problem in a box: it is solved one slide after the other. Works in
    what the lanes keep for themselves only in passing.
    """
    n = len(q)
    if settings[Setting.POSITION_WEIGHT] == 0.0:
        return
    axes, origins = view(lanes.axes, 0, (n, 3)), view(lanes.origins, 0, (n, 3))
    tool, e = view(lanes.tool, 0, (12,)), view(lanes.e, 0, (6,))
    pose_cost(chain, settings, target, q, axes, origins, tool, e)
    for _ in range(SWEEPS):
        longest = 0.0
        for i in range(n):
            if _is_long(chain, i):
                step = axes[i, 0] * e[0] + axes[i, 1] * e[1] + axes[i, 2] * e[2]
                place = min(max(q[i] + step, chain[i, Joint.LOWER]), chain[i, Joint.UPPER])
                for k in range(3):
                    e[k] -= (place - q[i]) * axes[i, k]
                longest = max(longest, abs(place - q[i]))
                q[i] = place
        if longest <= PLACED:
            break


@kernel
def place_all(chain, settings, target, floats, starts):
    """`place_slides` of starts (N, n), in place; memory as of `make_lanes`."""
    lanes = make_lanes(starts.shape[1], floats)
    for k in range(len(starts)):
        place_slides(chain, settings, target, lanes, starts[k])
