"""Which swivel angles the limits of a spherical joint block, for every rotation within a margin of the true one.

A rotation R'(psi) is within the angle eta of R(psi). At a limit of a joint a function f vanishes that changes by no
more than R turns (`spherical.py`), and one of the branches does so only on one side. So a joint that is outside its
limits stays outside for all of R' where |f| > eta for both limits that this branch can come to. Two things are in the
way of that, and of the branch itself:

*Holes.* Where the angle between a and R c is out of reach by more than eta, no R' has a solution. At the edge the two
branches meet, and R' may have solutions or not. Let the joint's angle go on in the hole as that of the meeting
branches. On the way from R to R', which leads at most 2 eta deep into the hole, it comes to a limit there only at a
point with |f| <= 2 eta, since f is then the cosine of an angle that is off by the depth. Hence |f| > 3 eta excludes
that as well, and what is blocked by a limit borders on what is blocked by the hole.

*Singularities.* Within eta of R c along a, the first and the last joint may be anywhere. But there is a hole that is
deeper than 2 eta, or else |f| <= 3 eta for all of their limits: it is the cosine of an angle that is off by the depth
and eta.

So the circle is cut into *critical* arcs, where |f| <= 3 eta, or there is a hole, and the cells in between, in which
nothing changes: one look at the middle of a cell tells. An arc is (lower, upper), with lower in
[-pi, pi), and upper >= lower, which may be beyond pi.
"""

from __future__ import annotations

import numpy as np

from maira_qp.kernels.jit.arena import Arena
from maira_qp.kernels.jit.decorators import device_kernel, kernel
from maira_qp.kernels.jit.simd_trig import sine_cosine
from maira_qp.kernels.layout import Arc, Axis, CriticalArc, Hindrance, Limit, Part, Sinusoid, Spherical
from maira_qp.kernels.srs.spherical_joint import UNLIMITED, cos_half, discriminant, from_middle
from maira_qp.kernels.srs.swivel import value_at

TURN = 2.0 * np.pi


ARCS, CRITICAL, PIECES = 24, 16, 96
"""At most so many arcs has a branch, so many are critical, and so many pieces make a cover."""
JOINED = 1e-12
"""Arcs this near to each other [rad] touch."""


_BAND = 3.0
_HOLE = 1e-5
"""Holes smaller than this [rad] block nothing: their edge is lost in rounding."""


INTERVALS = Arena(
    "Intervals",
    floats={
        "base": "2, 9",  # see `swivel.approach`
        "circles": f"2, 2, {Sinusoid.WIDTH}",  # of each elbow, see `swivel.swing`
        "critical": f"{CRITICAL}, {CriticalArc.WIDTH}",
        "arcs": f"2, 2, {ARCS}, {Arc.WIDTH}",  # blocked, of shoulder and wrist, of their branches +1 and -1
    },
    integers={"lengths": "2, 2"},  # how many those are
)
"""What a verdict or a start works in."""
Intervals, carve_intervals = INTERVALS.Arrays, INTERVALS.carve


@kernel
def block(arm, circles, shoulder, wrist, work):
    """Find the blocked arcs of shoulder and wrist for one elbow; `shoulder` and `wrist` are their margins eta [rad]."""
    _block(arm[Part.SHOULDER], circles, 0, shoulder, work.critical, work.arcs[0], work.lengths[0])
    _block(arm[Part.WRIST], circles, 1, wrist, work.critical, work.arcs[1], work.lengths[1])


@device_kernel
def _block(joint, circles, part, eta, critical, arcs, lengths):
    """The blocked arcs (2, ARCS, 3) of both branches of the shoulder (part 0) or the wrist (part 1)."""
    count = _holes(joint, circles, part, eta, critical, arcs, lengths)
    for which in range(3):
        if cos_half(joint, which) > UNLIMITED:
            count = _near_limit(joint, circles, part, eta, which, 0, critical, count)
            count = _near_limit(joint, circles, part, eta, which, 1, critical, count)
    _sort(critical, count)
    for which in range(3):
        if cos_half(joint, which) > UNLIMITED:
            for branch in range(2):
                tau = 1.0 - 2.0 * branch
                lengths[branch] = _cells(
                    joint, circles, part, which, tau, critical, count, arcs[branch], lengths[branch]
                )


@device_kernel
def _holes(joint, circles, part, eta, critical, arcs, lengths):
    """Critical arcs in holes, which are blocked as well. Returns how many."""
    count = 0
    lengths[0], lengths[1] = 0, 0
    constant, amplitude, apex = _polar(
        circles[part, Sinusoid.Z], circles[part, Sinusoid.Z + 1], circles[part, Sinusoid.Z + 2]
    )
    for end in range(2):
        sign = 1.0 - 2.0 * end
        depth = np.pi - joint[Spherical.FARTHEST] if end == 1 else joint[Spherical.NEAREST]
        edge = np.cos(depth - eta)
        if depth > 2.0 * eta and sign * constant + amplitude > edge:
            half = np.arccos(max((edge - sign * constant) / amplitude, -1.0))
            count = _add(critical, count, apex + np.pi * end, half, CriticalArc.BOTH, CriticalArc.ALL)
            if depth > _HOLE:
                for branch in range(2):
                    arcs[branch, lengths[branch], Arc.LOWER] = critical[count - 1, Arc.LOWER]
                    arcs[branch, lengths[branch], Arc.UPPER] = critical[count - 1, Arc.UPPER]
                    arcs[branch, lengths[branch], Arc.REASON] = _reason(part, 1, Hindrance.NO_SOLUTION)
                    lengths[branch] += 1
    return count


@device_kernel
def _near_limit(joint, circles, part, eta, which, side, critical, count):
    """Add the critical arcs of one limit, side 0 the lower and 1 the upper; returns how many there are then."""
    k = Spherical.LIMITS + Limit.WIDTH * (2 * which + side)
    p, r = (Sinusoid.P_LAST, Sinusoid.R_LAST) if which == Axis.LAST else (Sinusoid.P, Sinusoid.R)
    wz, wp, wr = joint[k + Limit.WZ], joint[k + Limit.WP], joint[k + Limit.WR]
    constant, amplitude, apex = _polar(
        wz * circles[part, Sinusoid.Z] + wp * circles[part, p] + wr * circles[part, r] - joint[k + Limit.VALUE],
        wz * circles[part, Sinusoid.Z + 1] + wp * circles[part, p + 1] + wr * circles[part, r + 1],
        wz * circles[part, Sinusoid.Z + 2] + wp * circles[part, p + 2] + wr * circles[part, r + 2],
    )
    band = _BAND * eta
    if abs(constant) > amplitude + band:
        return count
    # |f| <= band from `near` to `far` on both sides of the apex
    near = np.arccos(min(max((band - constant) / amplitude, -1.0), 1.0))
    far = np.arccos(min(max((-band - constant) / amplitude, -1.0), 1.0))
    if near == 0.0 or far == np.pi:
        centre, half, arcs = (apex, far, 1) if near == 0.0 else (apex + np.pi, np.pi - near, 1)
    else:
        centre, half, arcs = apex + 0.5 * (near + far), 0.5 * (far - near), 2
    for _ in range(arcs):
        s, c = sine_cosine(centre)
        sided = (
            joint[k + Limit.SP] * value_at(circles, part, p, c, s)
            + joint[k + Limit.SR] * value_at(circles, part, r, c, s)
            + joint[k + Limit.S0]
        )
        tau = CriticalArc.BOTH if abs(sided) <= eta + half else (-1.0 if sided > 0.0 else 1.0)
        count = _add(critical, count, centre, half, tau, float(which))
        centre = apex - 0.5 * (near + far)
    return count


@device_kernel
def _cells(joint, circles, part, which, tau, critical, count, arcs, length):
    """Add the cells in which a joint is outside on a branch; returns how many arcs there are then."""
    end = -np.inf
    for k in range(count):
        if _concerns(critical, k, which, tau):
            end = max(end, critical[k, Arc.UPPER])
    if end == -np.inf:
        return _add_if_outside(joint, circles, part, which, tau, -np.pi, np.pi, arcs, length)
    end -= TURN
    for k in range(count):
        if _concerns(critical, k, which, tau):
            if critical[k, Arc.LOWER] > end:
                length = _add_if_outside(joint, circles, part, which, tau, end, critical[k, Arc.LOWER], arcs, length)
            end = max(end, critical[k, Arc.UPPER])
    return length


@device_kernel
def _concerns(critical, k, which, tau):
    of_joint = critical[k, CriticalArc.JOINT] == which or critical[k, CriticalArc.JOINT] == CriticalArc.ALL
    return of_joint and (critical[k, CriticalArc.TAU] == tau or critical[k, CriticalArc.TAU] == CriticalArc.BOTH)


@device_kernel
def _add_if_outside(joint, circles, part, which, tau, lower, upper, arcs, length):
    s, c = sine_cosine(0.5 * (lower + upper))
    z = value_at(circles, part, Sinusoid.Z, c, s)
    p = value_at(circles, part, Sinusoid.P_LAST if which == Axis.LAST else Sinusoid.P, c, s)
    r = value_at(circles, part, Sinusoid.R_LAST if which == Axis.LAST else Sinusoid.R, c, s)
    x, y, scale = from_middle(joint, which, z, p, r, discriminant(joint, which, z, p, r), tau)
    if x < cos_half(joint, which) * scale:
        turn = TURN if lower < -np.pi else 0.0
        arcs[length, Arc.LOWER], arcs[length, Arc.UPPER] = lower + turn, upper + turn
        arcs[length, Arc.REASON] = _reason(part, which, Hindrance.UPPER_LIMIT if y > 0.0 else Hindrance.LOWER_LIMIT)
        length += 1
    return length


@device_kernel
def _reason(part, which, what):
    """Number of a joint and what is in the way: the shoulder's are the first three, the wrist's the last, backwards."""
    return 3.0 * (which if part == 0 else 6 - which) + what


@device_kernel
def _polar(constant, cosine, sine):
    """constant + amplitude cos(psi - apex): (constant, amplitude > 0, apex) of a sinusoid."""
    return constant, max(np.sqrt(cosine * cosine + sine * sine), 1e-300), np.arctan2(sine, cosine)


@device_kernel
def _add(critical, count, centre, half, tau, which):
    """Add the critical arc [centre - half, centre + half]."""
    lower = centre - half
    turn = TURN * np.floor((lower + np.pi) / TURN)
    critical[count, Arc.LOWER], critical[count, Arc.UPPER] = lower - turn, centre + half - turn
    critical[count, CriticalArc.TAU], critical[count, CriticalArc.JOINT] = tau, which
    return count + 1


@device_kernel
def _sort(critical, count):
    """By their lower ends."""
    for i in range(1, count):
        lower, upper, tau, which = critical[i, 0], critical[i, 1], critical[i, 2], critical[i, 3]
        k = i
        while k > 0 and critical[k - 1, Arc.LOWER] > lower:
            for j in range(CriticalArc.WIDTH):
                critical[k, j] = critical[k - 1, j]
            k -= 1
        critical[k, 0], critical[k, 1], critical[k, 2], critical[k, 3] = lower, upper, tau, which


@kernel
def cover(work, shoulder, wrist, pieces):
    """Whether the blocked arcs of a branch of the shoulder and one of the wrist cover the circle.

    The pieces of the cover go into `pieces` (PIECES, 3), as arcs from -pi on, each from the end of the one before; the
    last ends at pi or beyond.
    """
    at, count = -np.pi, 0
    while at < np.pi:
        end, reason = _reach(work, shoulder, wrist, at)
        if end <= at:
            return False
        pieces[count, Arc.LOWER], pieces[count, Arc.UPPER], pieces[count, Arc.REASON] = at, end, reason
        at, count = end, count + 1
    return True


@kernel
def widest_gap(work, shoulder, wrist):
    """The ends of the widest gap that the blocked arcs of two branches leave in [-pi, pi], see `cover`."""
    at, lower, upper = -np.pi, 0.0, 0.0
    while at < np.pi:
        end, _ = _reach(work, shoulder, wrist, at)
        if end <= at:
            end = _next(work, shoulder, wrist, at)
            if end - at > upper - lower:
                lower, upper = at, end
        at = end
    return lower, upper


@device_kernel
def _reach(work, shoulder, wrist, at):
    """The farthest end of an arc that holds `at`, and its reason; `at` itself if none does."""
    end, reason = at, 0.0
    for part in range(2):
        branch = shoulder if part == 0 else wrist
        for k in range(work.lengths[part, branch]):
            turn = TURN if work.arcs[part, branch, k, Arc.LOWER] > at + JOINED else 0.0
            upper = work.arcs[part, branch, k, Arc.UPPER] - turn
            if work.arcs[part, branch, k, Arc.LOWER] - turn <= at + JOINED and upper > end:
                end, reason = upper, work.arcs[part, branch, k, Arc.REASON]
    return end, reason


@device_kernel
def _next(work, shoulder, wrist, at):
    """Where the next arc begins after `at`; pi if none does."""
    begin = np.pi
    for part in range(2):
        branch = shoulder if part == 0 else wrist
        for k in range(work.lengths[part, branch]):
            lower = work.arcs[part, branch, k, Arc.LOWER]
            if lower > at:
                begin = min(begin, lower)
    return begin
