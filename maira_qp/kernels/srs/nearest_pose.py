"""Nearest points of poses that an S-R-S arm cannot reach, from starts in closed form.

The pose is moved along the line from the shoulder to its wrist, to a distance that the elbow's limits allow. What
reaches it there is a good start. Where limits do not let the arm reach that either, each of the eight branches is
looked at on a few swivel angles, at that where its joints are beyond their limits by the least in all, and clipped
there; the best of these are the starts.
"""

from __future__ import annotations

import numpy as np

from maira_qp.kernels.jit.arena import Arena
from maira_qp.kernels.jit.decorators import device_kernel, kernel
from maira_qp.kernels.jit.simd import LANES
from maira_qp.kernels.kinematics.serial_chain import KINEMATICS, carve_kinematics
from maira_qp.kernels.layout import Axis, Clipped, Elbow, Outcome, Part, Range, Spherical
from maira_qp.kernels.refinement.newton_simd import newton_in_lanes
from maira_qp.kernels.search.levenberg_marquardt import LANES_ARENA, pose_cost, squares
from maira_qp.kernels.srs.feasible_configuration import start
from maira_qp.kernels.srs.reach import TURN
from maira_qp.kernels.srs.spherical_joint import angle, discriminant
from maira_qp.kernels.srs.swivel import approach, bend, elbow_from_middle, swing, values_at
from maira_qp.kernels.srs.swivel_intervals import INTERVALS, carve_intervals

STARTS = 5
"""Of the eight branches that many are descended from."""
SWIVELS = 6
"""Swivel angles that each is looked at on, evenly around the circle."""
_COS, _SIN = np.cos(2 * np.pi / SWIVELS), np.sin(2 * np.pi / SWIVELS)
_BRANCHES = 8

NEAREST = Arena(
    "NearestWork",
    "n count",
    floats={
        "intervals": INTERVALS.floats,
        "lanes": LANES_ARENA.floats,
        "kinematics": KINEMATICS.floats,
        "moved": "12",
        "candidates": f"{_BRANCHES}, n",
        "costs": f"{_BRANCHES}",
        "parts": f"2, 2, {Clipped.WIDTH}",
        "starts": f"count * {STARTS}, n",
        "left": f"count * {STARTS}",
    },
    integers={"lengths": INTERVALS.integers, "lane_of": f"{LANES}", "steps": f"count * {STARTS}"},
)
NearestWork, make_nearest = NEAREST.Arrays, NEAREST.make


@kernel(allocates=True)
def nearest_in_closed_form(chain, settings, arm, span, targets, streams, shuffled, tolerance, q, outcome):
    """The best stationary point of the pose error that Newton's method leads to from a few starts, into q (N, 7).

    For each of targets (N, 12), with outcomes (N, 9) as of `search`, but for what tells of success; the cost stays
    infinite where there is no start. `span` (2,) [m] are the distances of shoulder and wrist that the elbow allows;
    `streams` (N,) and `shuffled` are as of `reach_in_closed_form`, tolerance as of `newton_simd`.
    """
    count, n = q.shape
    work = make_nearest(n, count)
    starts, steps = work.starts, work.steps
    for k in range(count):
        offset = TURN * np.float64(streams[k] >> np.uint64(32)) if shuffled else 0.0
        _put_starts(chain, settings, arm, span, targets[k], offset, work, starts[k * STARTS : (k + 1) * STARTS])
    newton_in_lanes(chain, settings, targets, STARTS, tolerance, work.lanes, work.lane_of, starts, work.left, steps)
    _choose(chain, settings, targets, work.kinematics, starts, steps, q, outcome)


@device_kernel
def _choose(chain, settings, targets, kinematics, ends, steps, q, outcome):
    """The best of the ends (N STARTS, 7) of each target (N, 12) into q (N, 7), and the outcomes (N, 9)."""
    axes, origins, tool, e = carve_kinematics(q.shape[1], kinematics)
    for k in range(len(targets)):
        outcome[k, Outcome.FINAL_COST], outcome[k, Outcome.ATTEMPT] = np.inf, 0.0
        outcome[k, Outcome.SPENT], outcome[k, Outcome.MOVED] = 0.0, 0.0
        for i in range(k * STARTS, (k + 1) * STARTS):
            outcome[k, Outcome.SPENT] += steps[i]
            cost = pose_cost(chain, settings, targets[k], ends[i], axes, origins, tool, e)
            if cost < outcome[k, Outcome.FINAL_COST]:
                position, orientation = squares(e)
                outcome[k, Outcome.FINAL_COST] = cost
                outcome[k, Outcome.POSITION_ERROR] = np.sqrt(position)
                outcome[k, Outcome.ORIENTATION_ERROR] = np.sqrt(orientation)
                for j in range(7):
                    q[k, j] = ends[i, j]


@device_kernel
def _put_starts(chain, settings, arm, span, target, offset, work, starts):
    """The starts (STARTS, 7) of a target (12,); rows are NaN where there are less."""
    moved, candidates, costs = work.moved, work.candidates, work.costs
    intervals = carve_intervals(work.intervals, work.lengths)
    for i in range(STARTS):
        for j in range(7):
            starts[i, j] = np.nan
    _move_within(arm, span, target, moved)
    if start(arm, moved, offset, intervals, starts[0]):
        return
    _clipped_branches(arm, moved, intervals, work.parts, candidates, costs)
    axes, origins, tool, e = carve_kinematics(7, work.kinematics)
    for b in range(_BRANCHES):
        if costs[b] < np.inf:
            costs[b] = pose_cost(chain, settings, target, candidates[b], axes, origins, tool, e)
    for i in range(STARTS):
        best = np.argmin(costs)
        for j in range(7):
            starts[i, j] = candidates[best, j] if costs[best] < np.inf else np.nan
        costs[best] = np.inf


@device_kernel
def _move_within(arm, span, target, moved):
    """A target (12,) moved along the line from the shoulder to its wrist, to a distance within the span (2,) [m]."""
    x, y, z = arm[Part.ELBOW, Elbow.LEVER], arm[Part.ELBOW, Elbow.LEVER + 1], arm[Part.ELBOW, Elbow.LEVER + 2]
    square = 0.0
    for i in range(3):
        moved[i] = (
            target[3 * i] * x
            + target[3 * i + 1] * y
            + target[3 * i + 2] * z
            + target[9 + i]
            - arm[Part.ELBOW, Elbow.CENTRE + i]
        )
        square += moved[i] * moved[i]
    distance = np.sqrt(square)
    share = min(max(distance, span[0]), span[1]) / distance - 1.0 if distance > 0.0 else 0.0
    for i in range(3):
        moved[9 + i] = target[9 + i] + share * moved[i]
    for i in range(9):
        moved[i] = target[i]


@device_kernel
def _clipped_branches(arm, target, work, parts, candidates, misses):
    """A configuration within the limits for each branch, into candidates (8, 7) [rad].

    misses (8,) [rad]: how far its joints were beyond their limits, in all; infinite where there is none.
    """
    circles = work.circles[0]
    cosine, sine = bend(arm, approach(arm, target, work.base))
    for elbow in range(2):
        sign = 1.0 - 2.0 * elbow
        x, y = elbow_from_middle(arm, cosine, sine, sign)
        q4 = arm[Part.ELBOW, Elbow.MIDDLE] + np.arctan2(y, x)
        within = min(max(q4, arm[Part.ELBOW, Elbow.LOWER]), arm[Part.ELBOW, Elbow.UPPER])
        swing(arm, work.base, cosine, sine, sign, circles)
        for b in range(4 * elbow, 4 * elbow + 4):
            candidates[b, 3], misses[b] = within, np.inf
        c, s = 1.0, 0.0
        for _ in range(SWIVELS):
            _clip_parts(arm, circles, c, s, parts)
            for b in range(4):
                shoulder, wrist = parts[0, b // 2], parts[1, b % 2]
                miss, row = abs(q4 - within) + shoulder[Clipped.MISS] + wrist[Clipped.MISS], candidates[4 * elbow + b]
                if miss < misses[4 * elbow + b]:
                    misses[4 * elbow + b] = miss
                    row[0], row[1], row[2] = shoulder[Axis.FIRST], shoulder[Axis.MIDDLE], shoulder[Axis.LAST]
                    row[4], row[5], row[6] = wrist[Axis.LAST], wrist[Axis.MIDDLE], wrist[Axis.FIRST]
            c, s = c * _COS - s * _SIN, s * _COS + c * _SIN


@device_kernel
def _clip_parts(arm, circles, c, s, parts):
    """Shoulder and wrist on both branches at a swivel angle: parts (2, 2, 4), three clipped angles and their miss."""
    for part in range(2):
        joint = arm[Part.SHOULDER + part]
        z, p, r, p_last, r_last = values_at(circles, part, c, s)
        square = discriminant(joint, Axis.FIRST, z, p, r)
        for branch in range(2):
            row, tau = parts[part, branch], 1.0 - 2.0 * branch
            row[Axis.FIRST] = angle(joint, Axis.FIRST, z, p, r, square, tau)
            row[Axis.MIDDLE] = angle(joint, Axis.MIDDLE, z, p, r, square, tau)
            row[Axis.LAST] = angle(joint, Axis.LAST, z, p_last, r_last, square, tau)
            row[Clipped.MISS] = 0.0
            for k in range(3):
                at = Spherical.RANGES + Range.WIDTH * k
                within = min(max(row[k], joint[at + Range.LOWER]), joint[at + Range.UPPER])
                row[Clipped.MISS] += abs(row[k] - within)
                row[k] = within
