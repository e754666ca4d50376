"""Proofs that an S-R-S arm cannot reach a pose, nor any other within the tolerances of it.

A pose within the tolerances has its wrist at most e_w = eps_p + lever eps_o away, lever being the distance of tip and
wrist, so its distance d from the shoulder is known to that:

1. *Annulus.* It is beyond what the stretched, or the folded, arm reaches.
2. *Elbow.* The cosine of theta = |q_4 - phi| is off by at most c = e_w (2 d + e_w) / rho. So theta is off by at most
   delta = 1.6 sqrt(c), and, where that is no more than sin theta, by at most delta = 2.11 c / sin theta. Both elbow
   angles are outside the limits by more.
3. *Swivel.* The line from the shoulder to the wrist turns by at most asin(e_w / d), and v, as the elbow bends, by at
   most asin(g delta / d), g being the forearm's part across the elbow's axis. Their sum bounds how far the shoulder's
   rotation is from one that brings the wrist to the middle of its ball: from A(psi) at some psi, all of which are
   looked at. For the wrist, B = R_4^T A^T D, delta and eps_o come on top. With these margins the arcs that are blocked
   (`blocked.py`) cover the circle on all branches whose elbow is not outside.

So that rounding is no concern, `ROUNDING` is added to all margins, and it includes what the axes may miss each other by
(`analytic.srs.geometry.MEETS_WITHIN`). As long as a swivel angle is found at which the arm does reach the pose, there
is no need to look at the arcs.
"""

from __future__ import annotations

import numpy as np

from maira_qp.kernels.jit.decorators import device_kernel, kernel
from maira_qp.kernels.layout import Arc, Elbow, Hindrance, Part
from maira_qp.kernels.srs.swivel import approach, bend, elbow_from_middle, first_within, swing
from maira_qp.kernels.srs.swivel_intervals import block, carve_intervals, cover

POSSIBLE, TOO_FAR, TOO_NEAR, ELBOW_OUTSIDE, SWIVEL_BLOCKED = 0, 1, 2, 3, 4
"""Verdicts; the first is none."""
ROUNDING = 1e-7
"""Of lengths, in lengths of the arm, and of angles [rad]."""
LARGE = 0.1
"""With a larger margin [rad] no proof is tried."""


@kernel
def verdicts(arm, targets, position_tolerance, orientation_tolerance, floats, integers, pieces, codes):
    """`verdict` of each of targets (N, 12) into codes (N,); floats and integers are memory, see `INTERVALS`."""
    work = carve_intervals(floats, integers)
    for k in range(len(targets)):
        codes[k] = verdict(arm, targets[k], position_tolerance, orientation_tolerance, work, pieces)


@kernel
def verdict(arm, target, position_tolerance, orientation_tolerance, work, pieces):
    """Why no pose within the tolerances [m, rad] of a target (12,) can be reached; POSSIBLE where that is not proved.

    With ELBOW_OUTSIDE and SWIVEL_BLOCKED, `pieces` (8, PIECES, 3) has the proof: for each branch, in the order of
    `analytic.srs.geometry.BRANCHES`, arcs of psi that cover the circle, see `blocked.cover`. An elbow outside its
    limits is one arc, from -pi to pi.
    """
    distance = approach(arm, target, work.base)
    ball = _ball(arm, target, position_tolerance, orientation_tolerance)
    smallest, largest = arm[Part.ELBOW, Elbow.SMALLEST], arm[Part.ELBOW, Elbow.LARGEST]
    if distance > largest + ball:
        return TOO_FAR
    if distance < smallest - ball:
        return TOO_NEAR
    if not smallest < distance < largest:
        return POSSIBLE
    cosine, sine = bend(arm, distance)
    change = 2.0 * ball * (2.0 * distance + ball) / ((largest - smallest) * (largest + smallest))
    delta = 1.6 * np.sqrt(change)
    if delta <= sine:
        delta = 2.11 * change / sine
    if not delta <= LARGE:
        return POSSIBLE
    if _elbows_outside(arm, cosine, sine, delta + ROUNDING, pieces) == 2:
        return ELBOW_OUTSIDE
    g = np.sqrt(arm[Part.ELBOW, Elbow.FOREARM] ** 2 + arm[Part.ELBOW, Elbow.FOREARM + 1] ** 2)
    turned = (ball + g * delta) / distance
    if not turned <= LARGE:  # up to there asin(x) <= 1.01 x
        return POSSIBLE
    shoulder = 1.01 * turned + ROUNDING
    wrist = shoulder + delta + orientation_tolerance
    for elbow in range(2):
        if pieces[4 * elbow, 0, Arc.REASON] < 0.0:
            sign, circles = 1.0 - 2.0 * elbow, work.circles[elbow]
            known = swing(arm, work.base, cosine, sine, sign, circles)
            if not known or _is_solved(arm, circles, cosine, sine, sign):
                return POSSIBLE
    for elbow in range(2):
        if pieces[4 * elbow, 0, Arc.REASON] < 0.0 and not _is_covered(
            arm, work, elbow, shoulder, wrist, pieces[4 * elbow : 4 * elbow + 4]
        ):
            return POSSIBLE
    return SWIVEL_BLOCKED


@device_kernel
def _ball(arm, target, position_tolerance, orientation_tolerance):
    """How far [m] the wrist can be from where a target has it; NaN for what is not finite."""
    total, farthest = 0.0, 0.0
    for i in range(12):
        total += 0.0 * target[i]
        farthest = max(farthest, abs(target[i]) if i > 8 else 0.0)
    lever = np.sqrt(
        arm[Part.ELBOW, Elbow.LEVER] ** 2
        + arm[Part.ELBOW, Elbow.LEVER + 1] ** 2
        + arm[Part.ELBOW, Elbow.LEVER + 2] ** 2
    )
    rounding = ROUNDING * arm[Part.ELBOW, Elbow.LENGTH] + 1e-14 * farthest + total
    return position_tolerance + lever * orientation_tolerance + rounding


@device_kernel
def _elbows_outside(arm, cosine, sine, delta, pieces):
    """How many of the elbow's angles are outside its limits by more than delta [rad]; the reasons go into `pieces`."""
    outside = 0
    for elbow in range(2):
        reason = _elbow(arm, cosine, sine, 1.0 - 2.0 * elbow, delta)
        outside += reason >= 0.0
        for k in range(4 * elbow, 4 * elbow + 4):
            pieces[k, 0, Arc.LOWER], pieces[k, 0, Arc.UPPER], pieces[k, 0, Arc.REASON] = -np.pi, np.pi, reason
    return outside


@device_kernel
def _elbow(arm, cosine, sine, sign, delta):
    """The reason why the elbow is outside its limits by more than delta [rad]; -1 where it is not."""
    c, s = arm[Part.ELBOW, Elbow.COS_HALF], arm[Part.ELBOW, Elbow.SIN_HALF]
    x, y = elbow_from_middle(arm, cosine, sine, sign)
    if x >= c or s * np.cos(delta) + c * np.sin(delta) <= 0.0:  # inside, or the range becomes a turn
        return -1.0
    if x >= c * np.cos(delta) - s * np.sin(delta):
        return -1.0
    return 3.0 * 3 + (Hindrance.UPPER_LIMIT if y > 0.0 else Hindrance.LOWER_LIMIT)


@device_kernel
def _is_solved(arm, circles, cosine, sine, sign):
    """Whether the elbow is within its limits, and the rest of the arm at one of a few swivel angles."""
    within = elbow_from_middle(arm, cosine, sine, sign)[0] >= arm[Part.ELBOW, Elbow.COS_HALF]
    return within and first_within(arm, circles, 1.0, 0.0)[2]


@device_kernel
def _is_covered(arm, work, elbow, shoulder, wrist, pieces):
    """Whether the blocked arcs cover the circle on all four branches of an elbow, with the margins of both parts."""
    block(arm, work.circles[elbow], shoulder, wrist, work)
    covered = True
    for branches in range(4):
        covered = covered and cover(work, branches // 2, branches % 2, pieces[branches])
    return covered
