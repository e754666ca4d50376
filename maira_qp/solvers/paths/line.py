"""The best line through the layers of a path, by dynamic programming (Bellman, "Dynamic Programming", 1957).

From layer to layer a line costs the square of its largest joint step; a reconfiguration, a step beyond what is allowed,
costs more than any line without. Joints whose range is a turn or more are compared without their whole turns. How far
each of them travels on the best line to a configuration is kept beside it, and a line ends where no turn to begin at
leaves room for all of its travel between the limits.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from maira_qp.kernels.paths.linking import link
from maira_qp.robots.model.revolutions import WholeTurns

RECONFIGURATION = 1e9
"""What a reconfiguration costs, in squares of the step that is allowed."""

Edge = tuple[int, int]
"""Two configurations of neighbouring layers, counted through all layers"""


@dataclass(frozen=True)
class Line:
    """A line through L layers."""

    chosen: list[int]
    """Which configuration of each layer, counted through all of them"""
    q: np.ndarray
    """(L, n) at turns that leave room for its travel"""
    reconfigurations: int
    """How many there are between the layers"""

    def edge(self, layer: int) -> Edge:
        """The step to a layer."""
        return self.chosen[layer - 1], self.chosen[layer]


def best_line(
    layers: list[np.ndarray], windows: np.ndarray, forbidden: set[Edge], turns: WholeTurns, is_start_given: bool
) -> Line:
    """The line of least cost.

    Args:
        layers: configurations (M_l, n) of L layers, none empty.
        windows: (L - 1, n) how far each joint may move between two layers [rad or m].
        forbidden: steps that turned out not to be continuous.
        turns: whole turns of the robot's joints.
        is_start_given: the first layer is where the line begins, its turns too.
    """
    nodes, first = np.concatenate(layers), np.cumsum([0, *map(len, layers)])
    edges = np.array(sorted(forbidden), dtype=np.int64).reshape(-1, 2)
    limits = np.stack([turns.robot.lower, turns.robot.upper])
    cost, back, has_jumped = np.empty(len(nodes)), np.empty(len(nodes), np.int64), np.empty(len(nodes), np.bool_)
    end, least, most = (np.empty(nodes.shape) for _ in range(3))
    link(
        nodes,
        first,
        np.ascontiguousarray(windows),
        edges,
        turns.everywhere,
        limits,
        is_start_given,
        RECONFIGURATION,
        cost,
        back,
        has_jumped,
        end,
        least,
        most,
    )
    chosen = [int(first[-2] + cost[first[-2] :].argmin())]
    while back[chosen[-1]] >= 0:
        chosen.append(int(back[chosen[-1]]))
    chosen.reverse()
    q, breaks = end[chosen], np.flatnonzero(has_jumped[chosen]).tolist()
    for begin, stop in pairwise([0, *breaks, len(layers)]):
        least, most = q[begin:stop].min(axis=0), q[begin:stop].max(axis=0)
        if begin:
            q[begin:stop] += turns.room_near(least, most, q[begin - 1] - q[begin])
        elif not is_start_given:
            q[begin:stop] += turns.room_for(least, most)
    return Line(chosen, np.clip(q, *limits), len(breaks))
