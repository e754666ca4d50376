"""Joint angles that differ by whole turns, counted to stay near a reference: the compiled form of
`maira_qp.robots.whole_turns`."""

from __future__ import annotations

import numpy as np

from maira_qp.kernels.chain import LOWER, PRISMATIC, UPPER
from maira_qp.kernels.compilation import bare_kernel

TURN = 2.0 * np.pi


@bare_kernel
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


@bare_kernel
def nearest_turn(chain, i, angle, reference):
    """The value of joint i that is whole turns from `angle`, within the limits, and nearest to the reference."""
    low, high = chain[i, LOWER], chain[i, UPPER]
    if chain[i, PRISMATIC] != 0.0 or not high - low >= TURN:
        return angle
    turns = np.floor((reference - angle) / TURN + 0.5)
    turns = min(max(turns, np.ceil((low - angle) / TURN)), np.floor((high - angle) / TURN))
    return min(max(angle + TURN * turns, low), high)
