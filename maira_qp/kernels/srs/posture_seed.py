"""The swivel angle at which an S-R-S arm comes nearest to a posture: where to begin settling its redundancy.

Swivel angles spread over the circle are tried eight at a time, on all eight branches. Given the elbow, the shoulder's
share of the objective `1/2 sum_i w_i (q_i - ref_i)^2` and the wrist's depend on a branch of their own each, so that
four sums take the place of eight. The squares take no angle: with u = 1 - cos(q_i - ref_i), which the sinusoids of
`swivel.py` give, (q_i - ref_i)^2 is nearly a polynomial of u, and differences of more than half a turn count as larger
still. That is rough near half a turn, and exact where it matters; what follows ends at the optimum itself.
"""

from __future__ import annotations

import numpy as np

from maira_qp.kernels.jit.arena import Arena
from maira_qp.kernels.jit.decorators import device_kernel, kernel
from maira_qp.kernels.jit.simd import LANES, broadcast, load, maximum, select, square_root, store
from maira_qp.kernels.jit.simd_trig import sine_cosine
from maira_qp.kernels.layout import Axis, Outcome, Part, Range, SeedLanes, Spherical
from maira_qp.kernels.srs.feasible_configuration import bends, spans, turns
from maira_qp.kernels.srs.reach import confirm
from maira_qp.kernels.srs.spherical_joint import cos_half
from maira_qp.kernels.srs.swivel import approach, bend, swing, values_at
from maira_qp.kernels.srs.swivel_intervals import carve_intervals

ROUNDS = 2
"""So many times eight swivel angles are tried."""

TURN = 2.0 * np.pi

_SQUARE_2, _SQUARE_3, _SQUARE_4 = 1.482, -2.3223, 1.1575
"""delta^2 by powers of 1 - cos delta, the first of which is exact: least squares, exact at half a turn too."""

SEEDING = Arena("Seeding", floats={"lanes": f"{SeedLanes.WIDTH}, {LANES}", "postures": "2, 3, 3"})
Seeding, carve_seeding = SEEDING.Arrays, SEEDING.carve


@kernel
def reach_near_posture(
    chain, settings, arm, targets, reference, weights, floats, integers, seeding, kinematics, q, outcome
):
    """Configurations q (N, 7) that reach `targets` (N, 12), about the best of the objective for each of them.

    Memory: `seeding` as of `SEEDING`, the rest as of `reach_in_closed_form`, and so is `outcome` (N, 7). Which targets
    have no solution is left open: then the outcome is no success.
    """
    work, (lanes, postures) = carve_intervals(floats, integers), carve_seeding(seeding)
    for lane in range(LANES):
        lanes[SeedLanes.SINE, lane], lanes[SeedLanes.COSINE, lane] = sine_cosine(TURN / LANES * lane)
    for part in range(2):
        for which in range(3):
            i = which if part == 0 else 6 - which
            centre = arm[Part.SHOULDER + part, Spherical.RANGES + Range.WIDTH * which + Range.CENTRE]
            postures[part, which, 1], postures[part, which, 0] = sine_cosine(reference[i] - centre)
            postures[part, which, 2] = 0.5 * weights[i]
    for k in range(len(targets)):
        found = _start(arm, targets[k], postures, reference[3], weights[3], work, lanes, q[k])
        outcome[k, Outcome.SUCCESS], outcome[k, Outcome.FINAL_COST], outcome[k, Outcome.LEFT] = 0.0, np.inf, 0.0
        if found:
            confirm(chain, settings, targets[k], kinematics, q[k], outcome[k])


@device_kernel
def _start(arm, target, postures, elbow_reference, elbow_weight, work, lanes, q):
    """Whether a configuration within the limits that reaches the target (12,) was found; it is put into q (7,) [rad].

    `postures` (2, 3, 3): of each joint of shoulder and wrist the cosine and the sine of its reference, counted from the
    middle of its range, and half its weight.
    """
    distance = approach(arm, target, work.base)
    if not spans(arm, distance):
        return False
    cosine, sine = bend(arm, distance)
    store(lanes, SeedLanes.LEAST, broadcast(lanes, np.inf))
    store(lanes, SeedLanes.CHOICE, broadcast(lanes, 0.0))
    for elbow in range(2):
        circles, sign = work.circles[elbow], 1.0 - 2.0 * elbow
        if bends(arm, cosine, sine, sign, q) and swing(arm, work.base, cosine, sine, sign, circles):
            off = q[3] - elbow_reference
            _try(arm, circles, postures, 0.5 * elbow_weight * off * off, elbow, lanes)
    lane = 0
    for other in range(1, LANES):
        lane = other if lanes[SeedLanes.LEAST, other] < lanes[SeedLanes.LEAST, lane] else lane
    if lanes[SeedLanes.LEAST, lane] == np.inf:
        return False
    choice = int(lanes[SeedLanes.CHOICE, lane])
    elbow, turned = choice % 2, choice // 8
    sign, shoulder, wrist = 1.0 - 2.0 * elbow, 1.0 - 2.0 * (choice // 2 % 2), 1.0 - 2.0 * (choice // 4 % 2)
    s, c = sine_cosine(TURN / LANES * (lane + turned / ROUNDS))
    circles = work.circles[elbow]
    return (
        bends(arm, cosine, sine, sign, q)
        and turns(arm, circles, 0, shoulder, c, s, q)
        and turns(arm, circles, 1, wrist, c, s, q)
    )


@device_kernel
def _try(arm, circles, postures, bent, elbow, lanes):
    """Try swivel angles for an elbow that costs `bent`; the best one a lane, and how it was found, go into `lanes`."""
    step_s, step_c = sine_cosine(TURN / (LANES * ROUNDS))
    c, s = load(lanes, SeedLanes.COSINE), load(lanes, SeedLanes.SINE)
    lowest, choice = load(lanes, SeedLanes.LEAST), load(lanes, SeedLanes.CHOICE)
    for k in range(ROUNDS):
        shoulder, shoulder_branch = _part(arm, circles, postures, 0, c, s)
        wrist, wrist_branch = _part(arm, circles, postures, 1, c, s)
        cost = shoulder + wrist + bent
        better = cost < lowest
        lowest = select(better, cost, lowest)
        choice = select(better, 2.0 * shoulder_branch + 4.0 * wrist_branch + (8.0 * k + elbow), choice)
        c, s = c * step_c - s * step_s, s * step_c + c * step_s
    store(lanes, SeedLanes.LEAST, lowest)
    store(lanes, SeedLanes.CHOICE, choice)


@device_kernel
def _part(arm, circles, postures, part, c, s):
    """What shoulder or wrist costs at swivel angles, infinity outside the limits, and the better branch, 0 or 1."""
    joint, posture = arm[Part.SHOULDER + part], postures[part]
    z, p, r, p_last, r_last = values_at(circles, part, c, s)
    a, b, sin_a = joint[Spherical.COS_FIRST], joint[Spherical.COS_LAST], joint[Spherical.SIN_FIRST]
    sin_b = joint[Spherical.SIN_LAST]
    first, rise, last = b - a * z, z - a * b, a - b * z
    across = p * p + r * r
    square = sin_a * sin_a * across - first * first
    n = square_root(maximum(square, 0.0))
    outer, scale = 1.0 / across, 1.0 / (sin_a * sin_b)
    from_first, from_last = outer * (1.0 / sin_a), outer * (1.0 / sin_b)
    cosine, sine = scale * joint[Spherical.COS_PHASE], scale * joint[Spherical.SIN_PHASE]
    lowest, branch = z * 0.0 + np.inf, z * 0.0
    for k in range(2):
        cost = (
            half_square(joint, posture, Axis.FIRST, from_first * (p * first - r * n), from_first * (r * first + p * n))
            + half_square(joint, posture, Axis.MIDDLE, cosine * rise - sine * n, sine * rise + cosine * n)
            + half_square(
                joint,
                posture,
                Axis.LAST,
                from_last * (p_last * last - r_last * n),
                from_last * (r_last * last + p_last * n),
            )
        )
        better = cost < lowest
        lowest, branch = select(better, cost, lowest), select(better, 1.0 * k, branch)
        n = -n
    return select(square >= 0.0, lowest, np.inf), branch


@kernel
def half_square(joint, posture, which, x, y):
    """Half the weight times the squared distance of an angle, (x, y) from the middle of its range, from the posture."""
    c, s, weight = posture[which, 0], posture[which, 1], posture[which, 2]
    u = 1.0 - (x * c + y * s)
    square = u * (2.0 + u * (_SQUARE_2 + u * (_SQUARE_3 + u * _SQUARE_4)))
    beyond = ((y * c - x * s) * y < 0.0) & (y * s < 0.0)
    return select(x >= cos_half(joint, which), weight * select(beyond, 2.0 * np.pi * np.pi - square, square), np.inf)
