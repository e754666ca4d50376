"""Prove that a chain cannot reach a pose: branch and bound over boxes of joint values.

A box is a configuration q and half-widths h (n,). Between q and any configuration q' of the box, change one joint after
the other, the last one first. When joint i turns, the joints before it still stand at q, so its axis is the one at q,
and a point that is d_i away from that axis at q is by then at most d_i + D away, D being how far the joints behind it
have moved the point: it moves it by at most 2 sin(h_i / 2) (d_i + D), and a sliding joint by at most h_i.

Take a point p of the tool, and a pivot o on the axis of joint i: their distance |p - o| is changed by the joints behind
joint i alone, by E at most. The joints before it move o, by F at most beside the first joint, which takes it along an
arc whose distance from the wanted place t is known exactly. No configuration of the box reaches the pose, to the
point's tolerance, if

    |t - o| - F > |p - o| + E + tolerance      (too far)      at the near end of the arc, or
    |t - o| + F < |p - o| - E - tolerance      (too near)     at its far end;

the same with o = p and E = 0; and if the angle between the orientations exceeds the sum of the half-widths. A box that
is not ruled out is halved across the joint that moves most in the test that came closest, until all are ruled out, or
there are too many. Pivots and points where axes meet are moved by few joints, and tell the most: of an arm with
spherical shoulder and wrist, the elbow alone changes the distance between their centres.

Sources: Land and Doig, "An automatic method of solving discrete programming problems", 1960 (branch and bound); the
bound is a first-order interval enclosure in centred form (Moore, "Interval analysis", 1966) with exact chords.
"""

from __future__ import annotations

import math

import numpy as np

from maira_qp.kernels.jit.decorators import device_kernel, kernel
from maira_qp.kernels.kinematics.serial_chain import forward
from maira_qp.kernels.layout import Joint, Pivot, Point

DEPTH = 400
"""Boxes that wait, at most."""

NARROWEST = 1e-9
"""Boxes are not halved across a joint whose half-width is smaller than this [rad or m]."""


ORIENTATION = -1
"""In place of a point: what rules a box out is the angle between the orientations."""


@kernel(allocates=True)
def exclude(chain, points, pivots, turn, targets, most, boxes, excluded):
    """For each of `targets` (N, 12): the number of boxes that rule out all configurations, else 0, into (N,).

    points (k, 4): places in the tool and their tolerances [m]; pivots (m, 2); `turn` [rad]: how far the orientation may
    be off, inf where it is free; at most `most` boxes are looked at for a target. Those that were ruled out for the
    last target are written to `boxes` (., 2 n + 2), as far as there is room: lower and upper ends, and what ruled the
    box out, the point (`ORIENTATION`: the angle) and the pivot (m: the point itself).
    """
    n = len(chain) - 1
    stack, vectors = np.empty((DEPTH, 2 * n + 2)), np.empty((4, n))
    axes, origins, tool = np.empty((n, 3)), np.empty((n, 3)), np.empty(12)
    for k in range(len(targets)):
        excluded[k] = _exclude(
            chain, points, pivots, turn, targets[k], most, stack, vectors, axes, origins, tool, boxes
        )


@device_kernel
def _exclude(chain, points, pivots, turn, target, most, stack, vectors, axes, origins, tool, boxes):
    n, waiting, ruled_out, q, h = vectors.shape[1], 1, 0, vectors[0], vectors[1]
    for i in range(n):
        stack[0, i], stack[0, n + i] = chain[i, Joint.START_LOWER], chain[i, Joint.START_UPPER]
    for _ in range(most):
        waiting -= 1
        for i in range(n):
            q[i] = 0.5 * (stack[waiting, i] + stack[waiting, n + i])
            h[i] = 0.5 * (stack[waiting, n + i] - stack[waiting, i])
        forward(chain, q, axes, origins, tool)
        split, point, pivot = _judge(
            chain, points, pivots, turn, target, h, axes, origins, tool, vectors[2], vectors[3]
        )
        if split >= 0:
            if waiting + 2 > len(stack) or h[split] < NARROWEST:
                break
            for i in range(2 * n):
                stack[waiting + 1, i] = stack[waiting, i]
            stack[waiting, n + split] = stack[waiting + 1, split] = q[split]
            waiting += 2
        else:
            stack[waiting, 2 * n], stack[waiting, 2 * n + 1] = point, pivot
            for i in range(2 * n + 2):
                if ruled_out < len(boxes):
                    boxes[ruled_out, i] = stack[waiting, i]
            ruled_out += 1
            if waiting == 0:
                return ruled_out
    return 0


@device_kernel
def _judge(chain, points, pivots, turn, target, h, axes, origins, tool, behind, before):
    """The joint across which a box is to be halved, -1 if the box is ruled out; the point and the pivot that say so.

    Work (n,): how far each joint, and those that count with it, may move the point and the pivot.
    """
    n, split, nearest, point, pivot, total = len(h), 0, 0.0, ORIENTATION, len(pivots), turn
    for i in range(n):
        total += h[i] if chain[i, Joint.PRISMATIC] == 0.0 else 0.0
        split = i if h[i] > h[split] else split
    if turn < math.inf:
        nearest = _angle_between(tool, target) / total
    for k in range(len(points)):
        p, t = _placed(tool, points, k), _placed(target, points, k)
        _moved(chain, h, axes, origins, p, n, behind)
        for m in range(len(pivots) + 1):
            if nearest > 1.0:
                return -1, point, pivot
            joint, o = n, p
            if m < len(pivots):
                joint = int(pivots[m, Pivot.JOINT])
                o = _on_axis(axes, origins, joint, pivots[m, Pivot.ALONG])
            _moved(chain, h, axes, origins, o, joint, before)
            near, far = _from_path(chain, h[0] if joint > 0 else 0.0, axes, origins, o, t)
            slack = points[k, Point.TOLERANCE] + _from(before, 1, joint) + _from(behind, joint + 1, n)
            length = _distance(o, p)
            share = max(near - length, length - far) / slack
            if share > nearest:
                nearest, point, pivot, split, largest = share, k, m, 0, far - near
                for i in range(1, n):
                    moves = _from(before, i, joint) - _from(before, i + 1, joint)
                    if i > joint:
                        moves = _from(behind, i, n) - _from(behind, i + 1, n)
                    if moves > largest:
                        split, largest = i, moves
    return -1 if nearest > 1.0 else split, point, pivot


@device_kernel
def _from(moved, first, stop):
    """How far the joints first, ..., stop - 1 together may move what `_moved` was asked about."""
    return moved[first] if first < stop else 0.0


@device_kernel
def _moved(chain, h, axes, origins, point, stop, moved):
    """How far the joints i, ..., stop - 1 together may move a point (3,) into moved[i], for every i >= 1."""
    total = 0.0
    for i in range(stop - 1, 0, -1):
        if chain[i, Joint.PRISMATIC] != 0.0:
            total += h[i]
        else:
            total += 2.0 * math.sin(0.5 * min(h[i], math.pi)) * (_from_axis(axes, origins, i, point) + total)
        moved[i] = total


@device_kernel
def _angle_between(pose, other):
    """The angle [rad] between the orientations of two poses (12,)."""
    square = 0.0
    for i in range(9):
        square += (pose[i] - other[i]) ** 2
    return 2.0 * math.asin(min(math.sqrt(square / 8.0), 1.0))


@device_kernel
def _placed(pose, points, k):
    """One of the points of a body in the base, the body at `pose` (12,)."""
    x, y, z = points[k, 0], points[k, 1], points[k, 2]
    return (
        pose[0] * x + pose[1] * y + pose[2] * z + pose[9],
        pose[3] * x + pose[4] * y + pose[5] * z + pose[10],
        pose[6] * x + pose[7] * y + pose[8] * z + pose[11],
    )


@device_kernel
def _on_axis(axes, origins, i, along):
    return (
        origins[i, 0] + along * axes[i, 0],
        origins[i, 1] + along * axes[i, 1],
        origins[i, 2] + along * axes[i, 2],
    )


@device_kernel
def _distance(a, b):
    return math.sqrt((a[0] - b[0]) ** 2 + (a[1] - b[1]) ** 2 + (a[2] - b[2]) ** 2)


@device_kernel
def _from_axis(axes, origins, i, point):
    """How far a point is from the axis of joint i."""
    u, v, w = axes[i, 0], axes[i, 1], axes[i, 2]
    x, y, z = point[0] - origins[i, 0], point[1] - origins[i, 1], point[2] - origins[i, 2]
    return math.sqrt((v * z - w * y) ** 2 + (w * x - u * z) ** 2 + (u * y - v * x) ** 2)


@device_kernel
def _from_path(chain, h, axes, origins, p, t):
    """The least and the largest distance of t from where the first joint takes p, turning by up to h either way."""
    u, v, w = axes[0, 0], axes[0, 1], axes[0, 2]
    px, py, pz = p[0] - origins[0, 0], p[1] - origins[0, 1], p[2] - origins[0, 2]
    tx, ty, tz = t[0] - origins[0, 0], t[1] - origins[0, 1], t[2] - origins[0, 2]
    high, wanted = px * u + py * v + pz * w, tx * u + ty * v + tz * w
    px, py, pz = px - high * u, py - high * v, pz - high * w
    tx, ty, tz = tx - wanted * u, ty - wanted * v, tz - wanted * w
    if chain[0, Joint.PRISMATIC] != 0.0:
        across = (px - tx) ** 2 + (py - ty) ** 2 + (pz - tz) ** 2
        rise = abs(wanted - high)
        return math.sqrt(across + max(rise - h, 0.0) ** 2), math.sqrt(across + (rise + h) ** 2)
    r, s, turned = math.sqrt(px * px + py * py + pz * pz), math.sqrt(tx * tx + ty * ty + tz * tz), 0.0
    if r > 0.0 and s > 0.0:
        cross = (py * tz - pz * ty) * u + (pz * tx - px * tz) * v + (px * ty - py * tx) * w
        turned = abs(math.atan2(cross, px * tx + py * ty + pz * tz))
    flat, near = (high - wanted) ** 2 + (r - s) ** 2, math.sin(0.5 * max(turned - h, 0.0))
    far = math.sin(0.5 * min(turned + h, math.pi))
    return math.sqrt(flat + 4.0 * r * s * near * near), math.sqrt(flat + 4.0 * r * s * far * far)
