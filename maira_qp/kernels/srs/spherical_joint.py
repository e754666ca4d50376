"""A spherical joint: three rotations R = R_a R_b R_c about axes a, b, c, read off five numbers without an angle.

With frames (a, e, h) and (c, e', h') of right-angled unit vectors, e and e' being the middle axis' part across a and
across c, each turned to where its joint is in the middle of its range,

    z = a . R c,   p = e . R c,   r = h . R c,   p' = a . R e',   r' = a . R h'.

Across a, the middle axis has length |a x b|, and R c the coordinates (p, r); between the two is the angle whose cosine
and sine are as

    m = b . c - (a . b) z   and   n = -tau s,   s^2 = |a x b|^2 (p^2 + r^2) - m^2,

tau = +1 and -1 being the branches. So the first joint is at the angle of (p m + r n, r m - p n), counted from its
middle, and the last, with a and c, (p, r) and (p', r') exchanged, by the same formula: h' = e' x c has the opposite
hand. The middle joint has rho cos(q_b - phi) = z - k_0 and rho sin(q_b - phi) = tau s. Where s^2 < 0 there is no
solution. All as in `analytic.srs.geometry`, without the half-angle formula: s is exact at right angles.

A joint is within its limits if the cosine of its angle from the middle is at least that of half its range. It stands at
a limit only where `wz z + wp p + wr r = value`, with unit vectors on both sides of the matrix product, so that this
changes by no more than the angle by which R turns; and then `side = sp p + sr r + s0` has the sign of -tau.
"""

from __future__ import annotations

import numpy as np

from maira_qp.kernels.jit.decorators import bare_kernel

# the entries of a spherical joint's row; its joints are FIRST, MIDDLE and LAST, as they turn about a, b and c
FIRST, MIDDLE, LAST = 0, 1, 2
FIRST_FRAME, LAST_FRAME = 0, 9
"""(a, e, h) and (c, e', h'), nine numbers each"""
COS_FIRST, SIN_FIRST, COS_LAST, SIN_LAST = 18, 19, 20, 21
"""of the angle between a and b, and between b and c"""
NEAREST, FARTHEST = 22, 23
"""The angles between a and R c [rad] are in this interval"""
COS_PHASE, SIN_PHASE = 24, 25
"""of phi less the middle of the middle joint's range"""
RANGES, CENTRE, COS_HALF, LOWER, UPPER, RANGE = 26, 0, 1, 2, 3, 4
"""of each joint: the middle of its range [rad], cos of half of it, or UNLIMITED for a turn or more, and both limits"""
LIMITS, WZ, WP, WR, VALUE, SP, SR, S0, LIMIT = 38, 0, 1, 2, 3, 4, 5, 6, 7
"""of each joint its lower and its upper limit: see above"""
ROW = LIMITS + 6 * LIMIT

UNLIMITED = -2.0
"""Less than any cosine."""


@bare_kernel
def discriminant(joint, which, z, p, r):
    """s^2, the same from the pair (p, r) of the first joint and from that of the last; below 0 without a solution."""
    own, other = (COS_LAST, COS_FIRST) if which == LAST else (COS_FIRST, COS_LAST)
    m = joint[other] - joint[own] * z
    return joint[own + 1] * joint[own + 1] * (p * p + r * r) - m * m


@bare_kernel
def from_middle(joint, which, z, p, r, square, tau):
    """How far one of the joints is from the middle of its range, on the branch tau: (x, y, scale), for s^2 = square.

    x / scale and y / scale are the cosine and the sine of the angle. p and r are p' and r' for the last joint. Without
    a solution, the angle is that of s = 0, which is where the two branches meet.
    """
    n = -tau * np.sqrt(max(square, 0.0))
    if which == MIDDLE:
        rise = z - joint[COS_FIRST] * joint[COS_LAST]
        x = joint[COS_PHASE] * rise + joint[SIN_PHASE] * n
        y = joint[SIN_PHASE] * rise - joint[COS_PHASE] * n
        return x, y, joint[SIN_FIRST] * joint[SIN_LAST] if square > 0.0 else abs(rise)
    own, other = (COS_LAST, COS_FIRST) if which == LAST else (COS_FIRST, COS_LAST)
    m, across = joint[other] - joint[own] * z, p * p + r * r
    return p * m + r * n, r * m - p * n, joint[own + 1] * across if square > 0.0 else abs(m) * np.sqrt(across)


@bare_kernel
def cos_half(joint, which):
    """The cosine of half the range of one of the joints; UNLIMITED for a turn or more."""
    return joint[RANGES + RANGE * which + COS_HALF]


@bare_kernel
def is_reached(joint, z, p, r, p_last, r_last, square, tau):
    """Whether the branch tau, which has a solution, has it within the limits."""
    x, _, scale = from_middle(joint, FIRST, z, p, r, square, tau)
    if x < cos_half(joint, FIRST) * scale:
        return False
    x, _, scale = from_middle(joint, MIDDLE, z, p, r, square, tau)
    if x < cos_half(joint, MIDDLE) * scale:
        return False
    x, _, scale = from_middle(joint, LAST, z, p_last, r_last, square, tau)
    return x >= cos_half(joint, LAST) * scale


@bare_kernel
def angle(joint, which, z, p, r, square, tau):
    """The angle [rad] of one of the joints, within half a turn of the middle of its range; see `from_middle`."""
    x, y, _ = from_middle(joint, which, z, p, r, square, tau)
    return joint[RANGES + RANGE * which + CENTRE] + np.arctan2(y, x)
