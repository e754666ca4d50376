"""The best line through layers of configurations, by dynamic programming: the compiled form of what
`solvers.paths.line` says."""

from __future__ import annotations

import numpy as np

from maira_qp.kernels.jit.decorators import device_kernel, kernel
from maira_qp.kernels.kinematics.unwrap import TURN

FARTHEST = 1e3
"""What the step of a reconfiguration counts, at most, against another: in steps that are allowed."""
LARGEST = 1.0 + 1e-12
"""The square of a step that is allowed, by the window, at most: a step of the window itself rounds."""


@kernel(allocates=True)
def link(nodes, first, windows, forbidden, turning, fewest, counts, states, jump, cost, back, has_jumped):
    """Find the line of least cost to each state; `cost`, `back`, `has_jumped` (T,) in place.

    Args:
        nodes: configurations (S, n) of L layers, one layer after another.
        first: (L + 1,) where each layer begins.
        windows: (L - 1, n) how far each joint may move between two layers [rad or m].
        forbidden: (F,) pairs of nodes k, j that are not linked, as k S + j, in order.
        turning: (n,) of bool: joints that are compared without their whole turns.
        fewest: (S, n) the least number of whole turns by which each joint of each node may be turned.
        counts: (S, n) how many numbers of turns it has; 0: it has no limits, and its turns are not counted.
        states: (S + 1,) where the states of each node begin: a node at one number of turns of each joint, that of the
            first joint counts the fastest.
        jump: what a step beyond the window costs.
        cost: of the best line to each state.
        back: the state before it on that line.
        has_jumped: the step from there is beyond the window.
    """
    cheapest = np.zeros(len(nodes))
    turns = np.zeros(nodes.shape[1], np.int64)
    spread, period = np.empty(nodes.shape[1]), np.empty(nodes.shape[1])
    cost[: states[first[1]]], back[: states[first[1]]], has_jumped[: states[first[1]]] = 0.0, -1, False
    for layer in range(1, len(first) - 1):
        begin, end = first[layer - 1], first[layer]
        for k in range(begin, end):
            cheapest[k] = cost[states[k] : states[k + 1]].min()
        order = begin + np.argsort(cheapest[begin:end])  # soon none can do better
        start = order[0]
        fallen = states[start] + np.argmin(cost[states[start] : states[start + 1]])
        _measure_spread(nodes[begin:end], windows[layer - 1], turning, spread)
        joints = np.argsort(-spread)  # first those that tell most nodes from others
        window = windows[layer - 1][joints]
        before, here, costs = np.empty((end - begin, len(joints))), np.empty(len(joints)), cheapest[order]
        for i in range(len(joints)):
            period[i] = TURN / window[i] if turning[joints[i]] else 0.0
            before[:, i] = nodes[order, joints[i]] / window[i]
        for j in range(end, first[layer + 1]):
            own = slice(states[j], states[j + 1])
            cost[own], back[own], has_jumped[own] = cost[fallen] + jump, fallen, True
            dearest = cost[fallen] + jump
            for i in range(len(joints)):
                here[i] = nodes[j, joints[i]] / window[i]
            for place in range(len(order)):
                room = dearest - costs[place]
                if not room > 0.0:
                    break
                far = _step(before[place], here, period, min(room, LARGEST))
                if far > LARGEST or not far < room:
                    continue
                k = order[place]
                if _is_forbidden(forbidden, k * len(nodes) + j):
                    continue
                for i in range(nodes.shape[1]):
                    turns[i] = _turns(nodes[j, i] - nodes[k, i], turning[i])
                _relax(k, j, turns, fewest, counts, states, far, cost, back, has_jumped)
                dearest = cost[own].max()
            if dearest >= cost[fallen] + jump:
                far = min(np.sqrt(_step(before[0], here, period, FARTHEST**2)), FARTHEST)
                for state in range(states[j], states[j + 1]):
                    if has_jumped[state]:
                        cost[state] += far


@device_kernel
def _measure_spread(nodes, window, turning, spread):
    """How many windows (n,) wide the nodes (M, n) are spread in each joint, into `spread` (n,)."""
    for i in range(len(window)):
        wide = nodes[:, i].max() - nodes[:, i].min()
        spread[i] = (min(wide, TURN) if turning[i] else wide) / window[i]


@device_kernel
def _relax(k, j, turns, fewest, counts, states, price, cost, back, has_jumped):
    """Let the states of node j have been come to from those of node k, where that costs less; in place.

    Args:
        k: a node.
        j: a node of the next layer.
        turns: (n,) whole turns of the joints from k to j that the shortest way takes back.
        fewest: see `link`, as the others.
        counts: as there.
        states: as there.
        price: of the step.
        cost: as there.
        back: as there.
        has_jumped: as there.
    """
    is_alike = True  # the states of both nodes are the same numbers of turns: most are
    for i in range(len(turns)):
        is_alike = is_alike and counts[j, i] == counts[k, i] and fewest[j, i] + turns[i] == fewest[k, i]
    for state in range(states[j], states[j + 1]):
        rest, stride = state - states[j], 1
        before = states[k] + (rest if is_alike else 0)
        for i in range(0 if is_alike else len(turns)):
            if counts[j, i] == 0:
                continue
            number = fewest[j, i] + rest % counts[j, i] + turns[i] - fewest[k, i]
            rest //= counts[j, i]
            if number < 0 or number >= counts[k, i]:
                before = -1
                break
            before += stride * number
            stride *= counts[k, i]
        if before >= 0 and cost[before] + price < cost[state]:
            cost[state], back[state], has_jumped[state] = cost[before] + price, before, False


@device_kernel
def _turns(moved, is_turning):
    """How many whole turns are nearest to what a joint moves [rad or m]; 0: they do not count."""
    return np.int64(np.floor(moved / TURN + 0.5)) if is_turning and abs(moved) > 0.5 * TURN else 0


@device_kernel
def _step(before, here, period, enough):
    """The square of the largest joint step from one node (n,) to another, both by the window; or one beyond `enough`.

    A whole turn of a joint is one `period` (n,); 0: its turns count.
    """
    far = 0.0
    for i in range(len(here)):
        moved = here[i] - before[i]
        if period[i] > 0.0 and abs(moved) > 0.5 * period[i]:
            moved -= period[i] * np.floor(moved / period[i] + 0.5)
        far = max(far, moved * moved)
        if far > enough:
            break
    return far


@device_kernel
def _is_forbidden(forbidden, link):
    """Whether a link is among those (F,), in order, that are not to be taken."""
    place = np.searchsorted(forbidden, link)
    return place < len(forbidden) and forbidden[place] == link
