"""The best line through the layers of a path, by dynamic programming (Bellman, "Dynamic Programming", 1957).

From layer to layer a line costs the square of its largest joint step; a reconfiguration, a step beyond what is allowed,
costs more than any line without.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from scipy.spatial.distance import cdist

RECONFIGURATION = 1e9
"""What a reconfiguration costs, in squares of the step that is allowed."""

Edge = tuple[int, int, int]
"""A layer, and which configuration of the one before leads to which of it"""


def best_line(layers: list[np.ndarray], windows: np.ndarray, forbidden: set[Edge]) -> tuple[list[int], int]:
    """One configuration of each layer, by index, and the number of reconfigurations between them.

    Args:
        layers: configurations (M_l, n) of L layers, none empty.
        windows: (L - 1, n) how far each joint may move between two layers [rad or m].
        forbidden: steps that turned out not to be continuous.
    """
    costs, back = [np.zeros(len(layers[0]))], [np.zeros(len(layers[0]), dtype=np.int64)]
    for k, (before, here) in enumerate(pairwise(layers)):
        far = cdist(before / windows[k], here / windows[k], "chebyshev")
        step = np.where(far <= 1.0, far**2, np.inf)
        for layer, i, j in forbidden:
            if layer == k + 1:
                step[i, j] = np.inf
        total = costs[-1][:, None] + step
        chosen = total.argmin(axis=0)
        cost = total[chosen, np.arange(len(here))]
        cheapest = int(costs[-1].argmin())
        jumps = ~(cost < costs[-1][cheapest] + RECONFIGURATION)
        cost[jumps] = costs[-1][cheapest] + RECONFIGURATION + far[cheapest, jumps]
        chosen[jumps] = cheapest
        costs.append(cost)
        back.append(chosen)
    line = [int(costs[-1].argmin())]
    for chosen in reversed(back[1:]):
        line.append(int(chosen[line[-1]]))
    return line[::-1], int(costs[-1].min() // RECONFIGURATION)
