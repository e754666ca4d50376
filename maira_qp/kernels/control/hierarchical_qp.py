"""A strict hierarchy of quadratic levels in a box: the compiled form of `problem.qp.hierarchy`, see there.

The rows of the levels above are factored one level after the other in one growing factorisation: the last columns of
its orthogonal factor are a basis of what is left to the levels below. Rows that say nothing new are told by their size
before the rows above them are taken out of them.
"""

from __future__ import annotations

import math

from maira_qp.kernels.jit.decorators import device_kernel
from maira_qp.kernels.linalg.convexify import convexify
from maira_qp.kernels.linalg.qr_null_space import NONE, extend, null_basis, others, reduce
from maira_qp.kernels.qp.box_qp import solve_box_qp
from maira_qp.kernels.qp.null_space_qp import solve_row_qp

ROW_THRESHOLD = 1e-10
"""Pivots of tasks below this share of the longest row, or of the first pivot, count as zero."""

ESCAPE, RUBS, RUBS_LITTLE, SETTLED, STICKS, JUMP, NO_PART = 1e-3, 20, 1e-3, 1e-9, 0.9, 30.0, 1e-10
"""As in `problem.qp.hierarchy`."""


@device_kernel
def solve_each_level(objectives, share, work):
    """The displacements of the first level alone, of the first two, and so on into work.displacements (L, n): how many.

    Within the bounds work.lower and work.upper, with the models of `levels.level_models`, each pull times `share`.
    """
    H, c, mu, lower, upper, low, high = work.H, work.c, work.mu, work.lower, work.upper, work.low, work.high
    dq, part, g, z, b = work.dq, work.part, work.g, work.z, work.b
    displacements, joints, Z, M, A, V, F = work.displacements, work.joints, work.Z, work.M, work.A, work.V, work.F
    n, held, rank = len(dq), work.locked, NONE
    work.unsolved[0] = 0.0
    for i in range(n):
        g[i] = share * c[0, i]
        for j in range(n):
            M[i, j] = H[0, i, j] + (mu[0] if i == j else 0.0)
    _set_joints_apart(M, lower, upper, work.leaning[0])
    if work.saddle[0] >= 0.0:
        _descend_first(M, g, lower, upper, work)
    if not solve_box_qp(M, g, lower, upper, A, work.free, work.side, work.y, dq):
        return 0
    rubs, worth, friction = work.still[0] > 0.0, 1.0, work.friction
    for i in range(n):
        rubs = rubs and lower[i] <= 0.0 <= upper[i]
    if rubs:
        for i in range(n):
            part[i] = share * c[0, i]
        friction[0] = 0.0
        for rub in range(RUBS):
            more = _more_damping(H[0], mu[0], part, dq, work.still[0], rub, friction)
            if more == 0.0:
                break
            for i in range(n):
                M[i, i] += more
            if not solve_box_qp(M, g, lower, upper, A, work.free, work.side, work.y, dq):
                return 0
        worth = _is_worth(H[0], mu[0], part, dq, work.still[0])
    for i in range(n):
        dq[i] *= worth
        displacements[0, i] = min(max(dq[i], lower[i]), upper[i])
        held[i] = not lower[i] < upper[i]
    count = others(held, joints)
    for level in range(1, len(objectives)):
        rank = add_rows(work, level - 1, joints[:count], rank, ROW_THRESHOLD)
        k = count - rank
        if k == 0:
            return level
        for i in range(n):
            s = share * c[level, i] + mu[level] * dq[i]
            for j in range(n):
                s += H[level, i, j] * dq[j]
            g[i] = s
            part[i], low[i], high[i] = 0.0, min(lower[i] - dq[i], 0.0), max(upper[i] - dq[i], 0.0)
        null_basis(F, work.tau, joints, count, rank, g, work.y, Z, b)
        reduce(H[level], k, Z, work.y, M)
        for p in range(k):
            M[p, p] += mu[level]
        _set_apart(M, b, k, Z, work.leaning[level])
        if work.saddle[level] >= 0.0:
            descend(M, b, k, Z, work.saddle[level], A, V, z)
        else:
            convexify(M, k, A, V)
        if not solve_row_qp(M, b, k, Z, low, high, work.row_qp, work.row_qp_index, z, part):
            work.unsolved[0] = 1.0
        worth = 1.0
        if work.still[level] > 0.0:
            friction[0] = 0.0
            for rub in range(RUBS):
                more = _more_damping(H[level], mu[level], g, part, work.still[level], rub, friction)
                if more == 0.0:
                    break
                for p in range(k):
                    M[p, p] += more
                for i in range(n):
                    part[i] = 0.0
                if not solve_row_qp(M, b, k, Z, low, high, work.row_qp, work.row_qp_index, z, part):
                    work.unsolved[0] = 1.0
            worth = _is_worth(H[level], mu[level], g, part, work.still[level])
        for i in range(n):
            dq[i] += worth * part[i]
            displacements[level, i] = min(max(dq[i], lower[i]), upper[i])
    return len(objectives)


@device_kernel
def _set_joints_apart(H, lower, upper, leaning):
    """The Hessian H (n, n) without what couples joints that lean on a limit to others: see `problem.qp.hierarchy`."""
    n, square = len(H), 0.0
    for i in range(n):
        for j in range(n):
            square += H[i, j] * H[i, j] if lower[i] < upper[i] and lower[j] < upper[j] else 0.0
    for i in range(n):
        if leaning[i] == 0 or not (lower[i] < upper[i] and lower[i] <= 0.0 <= upper[i]):
            continue
        for j in range(n):
            H[i, j], H[j, i] = 0.0, 0.0
        H[i, i] = math.sqrt(square)


@device_kernel
def _set_apart(H, c, k, Z, leaning):
    """The same in coordinates z (k,): the basis Z (n, k) is turned, so that each such joint is moved by one of its own.

    By Householder reflections, H (k, k) and c (k,) with it.
    """
    square, m = 0.0, k
    for p in range(k):
        for r in range(k):
            square += H[p, r] * H[p, r]
    for i in range(len(Z)):
        if leaning[i] == 0 or m == 0:
            continue
        size = 0.0
        for p in range(m):
            size += Z[i, p] * Z[i, p]
        size = math.sqrt(size)
        if size <= NO_PART:
            continue
        last = m - 1
        side = math.copysign(size, Z[i, last])
        corner = Z[i, last] + side
        scale = 1.0 / (side * corner)  # 2 / |v|^2 of v = (Z[i, 0], ..., Z[i, last] + side)
        Z[i, last] = corner
        v = Z[i, :m]
        for p in range(k):
            _reflect(H[p], v, scale)
        for p in range(k):
            _reflect(H[:, p], v, scale)
        _reflect(c, v, scale)
        for j in range(len(Z)):
            if j != i:
                _reflect(Z[j], v, scale)
        for r in range(last):
            Z[i, r] = 0.0
        Z[i, last] = -side
        for p in range(k):
            H[p, last], H[last, p] = 0.0, 0.0
        H[last, last] = math.sqrt(square)
        m = last


@device_kernel
def _reflect(x, v, scale):
    """`x - scale (v x) v` in place, of the first entries of x."""
    s = 0.0
    for r in range(len(v)):
        s += x[r] * v[r]
    for r in range(len(v)):
        x[r] -= scale * s * v[r]


@device_kernel
def _more_damping(H, mu, c, step, still, rub, friction):
    """What to add to the damping for a step (n,) with friction, see `problem.qp.hierarchy._with_friction`; 0: nothing.

    c (n,) is the gradient; `friction` (3,) holds the damping, the one before it, and how slow its step was.
    """
    fall, length = _fall(H, mu, c, step)
    if length == 0.0 or (rub == 0 and still * length <= RUBS_LITTLE * fall):
        return 0.0
    damping, slowness, slope = friction[0], 1.0 / length, 0.0
    if rub > 0:
        if abs(damping * length - still) <= SETTLED * still:
            return 0.0
        slope = (slowness - friction[2]) / (damping - friction[1])
    friction[1], friction[2] = damping, slowness
    if slope * still >= 1.0:
        friction[0] = JUMP * damping
    else:
        friction[0] = max((slowness - slope * damping) / (1.0 / still - slope), 0.0)
    return friction[0] - damping


@device_kernel
def _is_worth(H, mu, c, step, still):
    """1 or, for a step (n,) that friction holds up, 0, as `problem.qp.hierarchy._with_friction`."""
    fall, length = _fall(H, mu, c, step)
    return 1.0 if still * length <= STICKS * fall else 0.0


@device_kernel
def _fall(H, mu, c, step):
    """By how much a step (n,) makes the cost fall, and its length."""
    fall, square = 0.0, 0.0
    for i in range(len(step)):
        s = 2.0 * c[i] + mu * step[i]
        for j in range(len(step)):
            s += H[i, j] * step[j]
        fall -= 0.5 * s * step[i]
        square += step[i] * step[i]
    return fall, math.sqrt(square)


@device_kernel
def _descend_first(H, c, lower, upper, work):
    """`descend` in the joints that can move, where others are locked at a displacement."""
    n, joints, R, Z, b, A, V = len(c), work.joints, work.C, work.Z, work.b, work.A, work.V
    k = 0
    for i in range(n):
        if lower[i] < upper[i]:
            joints[k] = i
            k += 1
    for p in range(k):
        i = joints[p]
        b[p] = c[i]
        for j in range(n):
            Z[j, p] = 1.0 if i == j else 0.0
            b[p] += 0.0 if lower[j] < upper[j] else H[i, j] * lower[j]
        for r in range(k):
            R[p, r] = H[i, joints[r]]
    descend(R, b, k, Z, work.saddle[0], A, V, work.z)
    for p in range(k):
        i = joints[p]
        c[i] = b[p]
        for j in range(n):
            c[i] -= 0.0 if lower[j] < upper[j] else H[i, j] * lower[j]
        for r in range(k):
            H[i, joints[r]] = R[p, r]


@device_kernel
def descend(H, c, k, Z, saddle, A, V, x):
    """H (k, k) made positive, and c (k,) given a pull out of saddle points, as `problem.qp.hierarchy.descending`.

    Work: A and V (k, k), x (k,).
    """
    if convexify(H, k, A, V):
        return
    n = len(Z)
    if k == 1:
        A[0, 0], V[0, 0] = -H[0, 0], 1.0
    for p in range(k):
        value = A[p, p]
        if value >= -saddle:
            continue
        slope, least = 0.0, -ESCAPE * value
        for a in range(k):
            slope += c[a] * V[p, a]
        if abs(slope) >= least:
            continue
        side = -slope
        if abs(slope) < 1e-9 * least:
            side = 0.0
            for i in range(n):
                s = 0.0
                for a in range(k):
                    s += Z[i, a] * V[p, a]
                side = s if abs(s) > abs(side) else side
        pull = slope + math.copysign(least, side)
        for a in range(k):
            c[a] -= pull * V[p, a]


@device_kernel
def add_rows(work, level, joints, rank, threshold):
    """Factor what the levels below this one must leave as it is: the rank so far. `joints` are those that move.

    Pivots below the threshold, a share of the longest row or of the first pivot, count as zero.
    """
    F, rows, ends = work.F, work.rows, work.ends
    n, longest = len(joints), 0.0
    first = ends[level - 1] if level > 0 else 0
    m = ends[level] - first
    for r in range(m):
        square = 0.0
        for value in rows[first + r]:
            square += value * value
        for a in range(n):
            F[a, rank + r] = rows[first + r, joints[a]]
        longest = max(longest, square)
    return extend(F, n, rank, rank + m, threshold, math.sqrt(longest), work.tau, work.order)
