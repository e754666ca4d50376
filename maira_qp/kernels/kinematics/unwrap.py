"""Joint angles that differ by whole turns, counted to stay near a reference: the compiled form of
`robots.model.revolutions`."""

from __future__ import annotations

import numpy as np

from maira_qp.kernels.jit.decorators import device_kernel, kernel
from maira_qp.kernels.layout import Joint

TURN = 2.0 * np.pi

ROUNDING = 1e-9
"""See `solvers.neighbourhood`."""


@kernel
def unwind(chain, references, reached, q):
    """Turn joints of q (N, n) by whole turns, in place, as near to the references (N, n) as the limits let them.

    One reference (1, n) stands for all. Rows that have not `reached` (N,) anything, which is not above 0 there, are
    left as they are.
    """
    for k in range(len(q)):
        if reached[k] > 0.0:
            row = k if len(references) > 1 else 0
            for i in range(q.shape[1]):
                q[k, i] = nearest_turn(chain, i, q[k, i], references[row, i])


@kernel
def unwind_free(chain, references, posture, weights, turned, q):
    """As `unwind`, but only joints for which `1/2 sum_i weights_i (q_i - posture_i)^2` is no higher then.

    Rows that have not `turned` (N,) of bool are left as they are; the others are marked if any joint was turned.
    """
    for k in range(len(q)):
        if turned[k]:
            turned[k] = False
            row = k if len(references) > 1 else 0
            for i in range(q.shape[1]):
                angle = _free_turn(chain, i, q[k, i], references[row, i], posture[i], weights[i])
                turned[k] = turned[k] or angle != q[k, i]
                q[k, i] = angle


@kernel
def has_free_turn(chain, references, posture, weights, q):
    """Whether `unwind_free` would turn any joint of q (N, n)."""
    for k in range(len(q)):
        row = k if len(references) > 1 else 0
        for i in range(q.shape[1]):
            if _free_turn(chain, i, q[k, i], references[row, i], posture[i], weights[i]) != q[k, i]:
                return True
    return False


@device_kernel
def _free_turn(chain, i, angle, reference, posture, weight):
    """The turn of joint i nearest to the reference, or its own angle where that costs the posture less."""
    there = nearest_turn(chain, i, angle, reference)
    before, after = (angle - posture) ** 2, (there - posture) ** 2
    moves = abs(there - angle) > 1.0 and weight * (after - before) <= weight * ROUNDING * before
    return there if moves else angle


@kernel
def nearest_turn(chain, i, angle, reference):
    """The value of joint i that is whole turns from `angle`, within the limits, and nearest to the reference."""
    low, high = chain[i, Joint.LOWER], chain[i, Joint.UPPER]
    if chain[i, Joint.PRISMATIC] != 0.0 or not high - low >= TURN:
        return angle
    turns = np.floor((reference - angle) / TURN + 0.5)
    turns = min(max(turns, np.ceil((low - angle) / TURN)), np.floor((high - angle) / TURN))
    return min(max(angle + TURN * turns, low), high)
