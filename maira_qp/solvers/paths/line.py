"""The best line through the layers of a path, by dynamic programming (Bellman, "Dynamic Programming", 1957).

From layer to layer a line costs the square of its largest joint step; a reconfiguration, a step beyond what is allowed,
costs more than any line without. Joints whose range is a turn or more are compared without their whole turns. How far
each of them travels on the best line to a configuration is kept beside it, and a line ends where no turn to begin at
leaves room for all of its travel between the limits.
"""

from __future__ import annotations

from itertools import pairwise
from typing import NamedTuple

import numpy as np

from maira_qp.robots.model.revolutions import TURN, WholeTurns

RECONFIGURATION = 1e9
"""What a reconfiguration costs, in squares of the step that is allowed."""

Edge = tuple[int, int, int]
"""A layer, and which configuration of the one before leads to which of it"""


class Line(NamedTuple):
    """A line through L layers."""

    chosen: list[int]
    """Which configuration of each layer"""
    q: np.ndarray
    """(L, n) at turns that leave room for its travel"""
    reconfigurations: int
    """How many there are between the layers"""


class Travel(NamedTuple):
    """Where the best lines to the configurations of a layer arrive, and how far they have been."""

    end: np.ndarray
    """(M, n)"""
    least: np.ndarray
    """(M, n)"""
    most: np.ndarray
    """(M, n)"""

    def on(self, which: np.ndarray, moved: np.ndarray) -> Travel:
        """Some of them (E,), moved on by so much (E, n)."""
        end = self.end[which] + moved
        return Travel(end, np.minimum(self.least[which], end), np.maximum(self.most[which], end))

    def some(self, which: np.ndarray) -> Travel:
        """Some of them."""
        return Travel(*(each[which] for each in self))


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
    cost, back, jumped = np.zeros(len(layers[0])), list[np.ndarray](), list[np.ndarray]()
    travels = [Travel(layers[0], layers[0], layers[0])]
    for k, (before, here) in enumerate(pairwise(layers)):
        far = _farthest(before, here, windows[k], turns)
        for layer, i, j in forbidden:
            if layer == k + 1:
                far[i, j] = np.inf
        origin, end = np.nonzero(far <= 1.0)
        travel = travels[-1].on(origin, turns.shortest(here[end] - before[origin]))
        has_room = turns.has_room(travel.least, travel.most, is_start_given)
        origin, end, travel = origin[has_room], end[has_room], travel.some(has_room)
        total = cost[origin] + far[origin, end] ** 2
        best = np.full(len(here), -1)
        dearest_first = np.argsort(-total, kind="stable")
        best[end[dearest_first]] = dearest_first
        cheapest = int(cost.argmin())
        dearest = cost[cheapest] + RECONFIGURATION
        jumps = best < 0
        jumps[~jumps] = total[best[~jumps]] >= dearest
        chosen = np.where(jumps, cheapest, origin[best] if len(origin) else cheapest)
        cost = np.where(jumps, dearest + np.minimum(far[cheapest], 1e3), total[best] if len(origin) else np.inf)
        arrived = [np.where(jumps[:, None], here, each[best]) if len(origin) else here for each in travel]
        travels.append(Travel(*arrived))
        back.append(chosen)
        jumped.append(jumps)
    line = [int(cost.argmin())]
    for chosen in reversed(back):
        line.append(int(chosen[line[-1]]))
    line.reverse()
    breaks = [k + 1 for k, jumps in enumerate(jumped) if jumps[line[k + 1]]]
    q = np.array([travel.end[j] for travel, j in zip(travels, line, strict=True)])
    for begin, end in pairwise([0, *breaks, len(layers)]):
        if begin or not is_start_given:
            q[begin:end] += turns.room_for(q[begin:end].min(axis=0), q[begin:end].max(axis=0))
    return Line(line, np.clip(q, turns.robot.lower, turns.robot.upper), len(breaks))


def _farthest(before: np.ndarray, here: np.ndarray, window: np.ndarray, turns: WholeTurns) -> np.ndarray:
    """The largest joint step (M, K) from each configuration (M, n) to each (K, n), by how far each may move (n,)."""
    far = np.zeros((len(before), len(here)))
    for joint, wide in enumerate(window):
        moved = here[:, joint] - before[:, None, joint]
        if turns.everywhere[joint]:
            moved -= TURN * np.round(moved / TURN)
        np.maximum(far, np.abs(moved) / wide, out=far)
    return far
