"""Joint angles that differ by whole turns, counted to stay near a reference: the compiled form of
`maira_qp.robots.whole_turns`."""

from __future__ import annotations

import numpy as np

from maira_qp.kernels.chain import LOWER, PRISMATIC, UPPER
from maira_qp.kernels.compilation import bare_kernel

TURN = 2.0 * np.pi


@bare_kernel
def unwind(chain, reference, reached, q):
    """Turn joints of q (N, n) by whole turns, in place, as near to the reference (n,) as the limits let them.

    Rows that have not `reached` (N,) anything, which is not above 0 there, are left as they are.
    """
    for k in range(len(q)):
        if reached[k] > 0.0:
            for i in range(q.shape[1]):
                low, high = chain[i, LOWER], chain[i, UPPER]
                if chain[i, PRISMATIC] == 0.0 and high - low >= TURN:
                    turns = np.floor((reference[i] - q[k, i]) / TURN + 0.5)
                    turns = min(max(turns, np.ceil((low - q[k, i]) / TURN)), np.floor((high - q[k, i]) / TURN))
                    q[k, i] = min(max(q[k, i] + TURN * turns, low), high)
