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

from maira_qp.kernels.jit.decorators import kernel
from maira_qp.kernels.layout import Axis, Range, Spherical

UNLIMITED = -2.0
"""Less than any cosine."""


@kernel
def discriminant(joint, which, z, p, r):
    """s^2, the same from the pair (p, r) of the first joint and from that of the last; below 0 without a solution."""
    own, other = (
        (Spherical.COS_LAST, Spherical.COS_FIRST) if which == Axis.LAST else (Spherical.COS_FIRST, Spherical.COS_LAST)
    )
    m = joint[other] - joint[own] * z
    return joint[own + 1] * joint[own + 1] * (p * p + r * r) - m * m


@kernel
def from_middle(joint, which, z, p, r, square, tau):
    """How far one of the joints is from the middle of its range, on the branch tau: (x, y, scale), for s^2 = square.

    x / scale and y / scale are the cosine and the sine of the angle. p and r are p' and r' for the last joint. Without
    a solution, the angle is that of s = 0, which is where the two branches meet.
    """
    n = -tau * np.sqrt(max(square, 0.0))
    if which == Axis.MIDDLE:
        rise = z - joint[Spherical.COS_FIRST] * joint[Spherical.COS_LAST]
        x = joint[Spherical.COS_PHASE] * rise + joint[Spherical.SIN_PHASE] * n
        y = joint[Spherical.SIN_PHASE] * rise - joint[Spherical.COS_PHASE] * n
        return x, y, joint[Spherical.SIN_FIRST] * joint[Spherical.SIN_LAST] if square > 0.0 else abs(rise)
    own, other = (
        (Spherical.COS_LAST, Spherical.COS_FIRST) if which == Axis.LAST else (Spherical.COS_FIRST, Spherical.COS_LAST)
    )
    m, across = joint[other] - joint[own] * z, p * p + r * r
    return p * m + r * n, r * m - p * n, joint[own + 1] * across if square > 0.0 else abs(m) * np.sqrt(across)


@kernel
def cos_half(joint, which):
    """The cosine of half the range of one of the joints; UNLIMITED for a turn or more."""
    return joint[Spherical.RANGES + Range.WIDTH * which + Range.COS_HALF]


@kernel
def is_reached(joint, z, p, r, p_last, r_last, square, tau):
    """Whether the branch tau, which has a solution, has it within the limits."""
    x, _, scale = from_middle(joint, Axis.FIRST, z, p, r, square, tau)
    if x < cos_half(joint, Axis.FIRST) * scale:
        return False
    x, _, scale = from_middle(joint, Axis.MIDDLE, z, p, r, square, tau)
    if x < cos_half(joint, Axis.MIDDLE) * scale:
        return False
    x, _, scale = from_middle(joint, Axis.LAST, z, p_last, r_last, square, tau)
    return x >= cos_half(joint, Axis.LAST) * scale


@kernel
def angle(joint, which, z, p, r, square, tau):
    """The angle [rad] of one of the joints, within half a turn of the middle of its range; see `from_middle`."""
    x, y, _ = from_middle(joint, which, z, p, r, square, tau)
    return joint[Spherical.RANGES + Range.WIDTH * which + Range.CENTRE] + np.arctan2(y, x)
