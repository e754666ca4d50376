"""From the pose of a hand to the target of a tool: checked, compared with the last one, and mapped."""

from __future__ import annotations

import math

from maira_qp.kernels.jit.decorators import device_kernel, kernel
from maira_qp.kernels.spatial.pose_error import pose_error
from maira_qp.kernels.spatial.pose_validation import FINE, pose_row

JUMPED = -1
"""Beside the faults of a pose: it is too far from the last one."""


@kernel
def follow_hands(T, within, largest, hands, alignment, scale, rotation_scale, is_relative, targets, seen, goals, out):
    """The targets of K tools for K hands T (K, 4, 4) into goals (K, 4, 4); or what is wrong, and what was seen of it.

    The hands go into seen (K, 12), R by rows and p, exact rotations where they are off by `within` at most. `hands`
    (K, 12) are the last ones, from which none may be farther than `largest` (2,) [m; rad]; NaN: there are none.

    Without `is_relative` the goals are the hands. With it each of the last targets (K, 4, 4) moves as its hand did,
    `p + scale A dp` and `exp(rotation_scale A dphi) R`, with A the alignment (3, 3) and [dp; dphi] the motion of the
    hand since the last one in the axes of its frame: by so little each time that an angle never passes a half turn.
    Without last hands the targets stay.

    Out (9,): the index of the hand that is wrong, how far [m] and [rad] it is from the last one, and [dp; dphi].
    """
    for k in range(len(T)):
        out[0] = k
        fault = pose_row(T[k], within, seen[k])
        if fault != FINE:
            return fault
        motion = out[3:]
        for i in range(6):
            motion[i] = 0.0
        if not math.isnan(hands[k, 0]):
            pose_error(hands[k], seen[k], motion)
            out[1] = math.sqrt(motion[0] ** 2 + motion[1] ** 2 + motion[2] ** 2)
            out[2] = math.sqrt(motion[3] ** 2 + motion[4] ** 2 + motion[5] ** 2)
            if not (out[1] <= largest[0] and out[2] <= largest[1]):
                return JUMPED
        if is_relative:
            _move(motion, alignment, scale, rotation_scale, targets[k], goals[k])
        else:
            _write(seen[k], goals[k])
    return FINE


@device_kernel
def _write(row, T):
    """A pose (12,) as a transformation T (4, 4)."""
    for i in range(3):
        for j in range(3):
            T[i, j] = row[3 * i + j]
            T[3, j] = 0.0
        T[i, 3] = row[9 + i]
    T[3, 3] = 1.0


@device_kernel
def _move(motion, alignment, scale, rotation_scale, before, after):
    """The transformation `before` (4, 4), moved by a motion (6,) of the hand, into `after` (4, 4)."""
    x = y = z = 0.0
    for j in range(3):
        x += rotation_scale * alignment[0, j] * motion[3 + j]
        y += rotation_scale * alignment[1, j] * motion[3 + j]
        z += rotation_scale * alignment[2, j] * motion[3 + j]
    square = x * x + y * y + z * z
    angle = math.sqrt(square)
    # Rodrigues' formula: v + a (u x v) + b u x (u x v)
    a = math.sin(angle) / angle if angle > 0.0 else 1.0
    b = 2.0 * (math.sin(0.5 * angle) / angle) ** 2 if angle > 0.0 else 0.5
    for j in range(3):
        v0, v1, v2 = before[0, j], before[1, j], before[2, j]
        c0, c1, c2 = y * v2 - z * v1, z * v0 - x * v2, x * v1 - y * v0
        after[0, j] = v0 + a * c0 + b * (y * c2 - z * c1)
        after[1, j] = v1 + a * c1 + b * (z * c0 - x * c2)
        after[2, j] = v2 + a * c2 + b * (x * c1 - y * c0)
        after[3, j] = 0.0
    for i in range(3):
        p = before[i, 3]
        for j in range(3):
            p += scale * alignment[i, j] * motion[j]
        after[i, 3] = p
    after[3, 3] = 1.0
