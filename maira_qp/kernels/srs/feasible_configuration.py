"""A configuration of an S-R-S arm for a pose, within the limits, in closed form.

A few swivel angles are tried. Where none is within the limits, the arcs that they
block are cut out of the circle exactly (`blocked.py`, with no margin), and the middle of the widest gap is taken. What
is left out are isolated solutions, and the vicinity of singularities of shoulder and wrist.
"""

from __future__ import annotations

import numpy as np

from maira_qp.kernels.jit.decorators import device_kernel, kernel
from maira_qp.kernels.jit.simd_trig import sine_cosine
from maira_qp.kernels.layout import Axis, Elbow, Part, Range, Spherical
from maira_qp.kernels.srs.spherical_joint import angle, discriminant
from maira_qp.kernels.srs.swivel import approach, bend, branch_at, elbow_from_middle, first_within, swing, values_at
from maira_qp.kernels.srs.swivel_intervals import block, widest_gap

WITHIN = 1e-12
"""A joint beyond a limit by at most this [rad] is at the limit: it is clipped."""
_REACHED_WITHIN, _SINGULAR = 1e-13, 1e-8


@kernel
def start(arm, target, offset, work, q):
    """Whether a configuration within the limits that reaches the target (12,) was found; it is put into q (7,) [rad].

    The swivel angles are tried from `offset` [rad] on. Of the joints with a range of more than a turn each is within
    half a turn of the middle of its range, a continuous one in (-pi, pi].
    Without a solution q is undefined.
    """
    circles = work.circles[0]
    distance = approach(arm, target, work.base)
    if not spans(arm, distance):
        return False
    cosine, sine = bend(arm, distance)
    c_0, s_0 = sine_cosine(offset)
    for sign in (1.0, -1.0):
        if bends(arm, cosine, sine, sign, q) and swing(arm, work.base, cosine, sine, sign, circles):
            c, s, within = first_within(arm, circles, c_0, s_0)
            if within and _put(arm, circles, c, s, q):
                return True
    for sign in (1.0, -1.0):
        if bends(arm, cosine, sine, sign, q) and swing(arm, work.base, cosine, sine, sign, circles):
            psi, width = _roomiest(arm, circles, work)
            s, c = sine_cosine(psi)
            if width > 0.0 and _put(arm, circles, c, s, q):
                return True
    return False


@kernel
def spans(arm, distance):
    """Whether shoulder and wrist come to this distance [m] from each other, whatever the limits."""
    slack = _REACHED_WITHIN * arm[Part.ELBOW, Elbow.LENGTH]
    return arm[Part.ELBOW, Elbow.SMALLEST] - slack <= distance <= arm[Part.ELBOW, Elbow.LARGEST] + slack


@kernel
def bends(arm, cosine, sine, sign, q):
    """Whether the elbow is within its limits; its angle goes into q."""
    x, y = elbow_from_middle(arm, cosine, sine, sign)
    if x < arm[Part.ELBOW, Elbow.COS_HALF] - WITHIN:
        return False
    q[3] = arm[Part.ELBOW, Elbow.MIDDLE] + np.arctan2(y, x)
    return _clip(q, 3, arm[Part.ELBOW, Elbow.LOWER], arm[Part.ELBOW, Elbow.UPPER])


@device_kernel
def _put(arm, circles, c, s, q):
    """Whether shoulder and wrist have a solution at a swivel angle; it goes into q."""
    shoulder, wrist = branch_at(arm, circles, 0, c, s), branch_at(arm, circles, 1, c, s)
    return turns(arm, circles, 0, shoulder, c, s, q) and turns(arm, circles, 1, wrist, c, s, q)


@kernel
def turns(arm, circles, part, tau, c, s, q):
    """Whether shoulder or wrist is within its limits on a branch at a swivel angle, 0 for none; it goes into q."""
    joint = arm[Part.SHOULDER + part]
    z, p, r, p_last, r_last = values_at(circles, part, c, s)
    if tau == 0.0 or p * p + r * r < _SINGULAR:
        return False
    square = discriminant(joint, Axis.FIRST, z, p, r)
    first, step = (0, 1) if part == 0 else (6, -1)
    q[first] = angle(joint, Axis.FIRST, z, p, r, square, tau)
    q[first + step] = angle(joint, Axis.MIDDLE, z, p, r, square, tau)
    q[first + 2 * step] = angle(joint, Axis.LAST, z, p_last, r_last, square, tau)
    within = True
    for k in range(3):
        i = Spherical.RANGES + Range.WIDTH * k
        within = _clip(q, first + k * step, joint[i + Range.LOWER], joint[i + Range.UPPER]) and within
    return within


@device_kernel
def _clip(q, i, lower, upper):
    """Whether a joint is within its limits, or outside by rounding: then it is clipped. A continuous one has no -pi."""
    if q[i] <= -np.pi and lower == -np.inf:
        q[i] = np.pi
    if not lower - WITHIN <= q[i] <= upper + WITHIN:
        return False
    q[i] = min(max(q[i], lower), upper)
    return True


@device_kernel
def _roomiest(arm, circles, work):
    """The middle [rad] of the widest gap between the blocked arcs, over the branches of one elbow, and its width."""
    block(arm, circles, 0.0, 0.0, work)
    psi, width = 0.0, 0.0
    for branches in range(4):
        lower, upper = widest_gap(work, branches // 2, branches % 2)
        if upper - lower > width:
            psi, width = 0.5 * (lower + upper), upper - lower
    return psi, width
