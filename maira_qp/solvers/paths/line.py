"""The best line through the layers of a path, by dynamic programming (Bellman, "Dynamic Programming", 1957).

From layer to layer a line costs the square of its largest joint step; a reconfiguration, a step beyond what is allowed,
costs more than any line without. Joints whose range is a turn or more are compared without their whole turns. Where
their travel on the best line does not fit between the limits, whatever turn they begin at, the line is sought once
more, to each configuration at each number of turns.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from maira_qp.kernels.paths.linking import link
from maira_qp.robots.model.revolutions import WITHIN, WholeTurns

STATES = 256
"""At how many numbers of turns a configuration is looked at, at most."""
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
    roots: np.ndarray
    """(R, n) configurations of the first layer from which lines without one lead farthest"""

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
    nodes, limits = np.concatenate(layers), (turns.robot.lower, turns.robot.upper)
    uncounted = np.zeros(nodes.shape, np.int64)
    line = _best_line(layers, windows, forbidden, turns, is_start_given, uncounted, uncounted)
    if (line.q < limits[0] - WITHIN).any() or (line.q > limits[1] + WITHIN).any():
        fewest, counts = _numbers_of_turns(turns, nodes)
        if is_start_given:
            fewest[: len(layers[0])], counts[: len(layers[0])] = 0, np.minimum(counts[: len(layers[0])], 1)
        line = _best_line(layers, windows, forbidden, turns, is_start_given, fewest, counts)
    return replace(line, q=np.clip(line.q, *limits))


def _best_line(
    layers: list[np.ndarray],
    windows: np.ndarray,
    forbidden: set[Edge],
    turns: WholeTurns,
    is_start_given: bool,
    fewest: np.ndarray,
    counts: np.ndarray,
) -> Line:
    """The line of least cost to nodes at `counts` (S, n) numbers of turns, from the fewest (S, n) on; see `link`."""
    first = np.cumsum([0, *map(len, layers)])
    nodes, edges = np.concatenate(layers), np.array(list(forbidden), dtype=np.int64).reshape(-1, 2)
    states = np.concatenate([[0], np.cumsum(np.maximum(counts, 1).prod(axis=1))])
    cost, back, has_jumped = np.empty(states[-1]), np.empty(states[-1], np.int64), np.empty(states[-1], np.bool_)
    link(
        nodes,
        first,
        np.ascontiguousarray(windows),
        np.sort(edges @ np.array([len(nodes), 1])),
        turns.everywhere,
        fewest,
        counts,
        states,
        RECONFIGURATION,
        cost,
        back,
        has_jumped,
    )
    come_to = [int(states[first[-2]] + cost[states[first[-2]] :].argmin())]
    while back[come_to[-1]] >= 0:
        come_to.append(int(back[come_to[-1]]))
    come_to.reverse()
    chosen = np.searchsorted(states, come_to, side="right") - 1
    q, breaks = nodes[chosen], np.flatnonzero(has_jumped[come_to]).tolist()
    for begin, stop in pairwise([0, *breaks, len(layers)]):
        q[begin + 1 : stop] = q[begin] + np.cumsum(turns.shortest(np.diff(q[begin:stop], axis=0)), axis=0)
        least, most = q[begin:stop].min(axis=0), q[begin:stop].max(axis=0)
        if begin:
            q[begin:stop] += turns.room_near(least, most, q[begin - 1] - q[begin])
        elif not is_start_given:
            q[begin:stop] += turns.room_for(least, most)
    layer = np.searchsorted(first, np.searchsorted(states, np.arange(states[-1]), side="right") - 1, side="right") - 1
    there = np.flatnonzero((cost < RECONFIGURATION) & (layer == layer[cost < RECONFIGURATION].max()))
    while back[there[0]] >= 0:
        there = np.unique(back[there])
    roots = nodes[np.unique(np.searchsorted(states, there, side="right") - 1)]
    return Line(chosen.tolist(), q, len(breaks), roots)


def _numbers_of_turns(turns: WholeTurns, nodes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """By how many whole turns, from the fewest (S, n) on so many (S, n), joints of nodes (S, n) may be turned.

    Where they are too many to be counted, those joints that have the most count as if they had no limits, and have 0.
    """
    first, last = turns.turns_for(nodes, nodes)
    counts = np.where(turns.everywhere & np.isfinite(last - first), np.maximum(last - first + 1, 1), 0)
    while np.maximum(most := counts.max(axis=0), 1).prod() > STATES:
        counts[:, most.argmax()] = 0
    return np.where(counts > 0, first, 0).astype(np.int64), counts.astype(np.int64)
