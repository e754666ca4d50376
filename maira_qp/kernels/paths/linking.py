"""The best line through layers of configurations, by dynamic programming: the compiled form of what
`solvers.paths.line` says."""

from __future__ import annotations

import numpy as np

from maira_qp.kernels.jit.decorators import device_kernel, kernel
from maira_qp.kernels.kinematics.unwrap import TURN

WITHIN = 1e-9
"""See `robots.model.revolutions`."""
FARTHEST = 1e3
"""What the step of a reconfiguration counts, at most, against another: in steps that are allowed."""


@kernel(allocates=True)
def link(
    nodes, first, windows, forbidden, turning, limits, is_start_given, jump, cost, back, has_jumped, end, least, most
):
    """Find the line of least cost to each node; `cost`, `back`, `has_jumped` (S,), `end`, `least`, `most` in place.

    Args:
        nodes: configurations (S, n) of L layers, one layer after another.
        first: (L + 1,) where each layer begins.
        windows: (L - 1, n) how far each joint may move between two layers [rad or m].
        forbidden: (F, 2) pairs of nodes that are not linked.
        turning: (n,) of bool: joints that are compared without their whole turns.
        limits: (2, n) of the joints.
        is_start_given: the turns of the first layer are those of the line.
        jump: what a step beyond the window costs.
        cost: of the best line to each node.
        back: the node before it on that line.
        has_jumped: the step from there is beyond the window.
        end: (S, n) where the line arrives, its turns counted.
        least: (S, n) the least values of the joints since the last jump.
        most: (S, n) the largest.
    """
    n = nodes.shape[1]
    for j in range(first[1]):
        cost[j], back[j], has_jumped[j] = 0.0, -1, False
        for i in range(n):
            end[j, i] = least[j, i] = most[j, i] = nodes[j, i]
    for layer in range(1, len(first) - 1):
        order = first[layer - 1] + np.argsort(cost[first[layer - 1] : first[layer]])  # soon none can do better
        cheapest = order[0]
        for j in range(first[layer], first[layer + 1]):
            best, origin = cost[cheapest] + jump, -1
            for k in order:
                if not cost[k] < best:
                    break
                far = _step(nodes, k, j, windows, layer - 1, turning, min(1.0, np.sqrt(best - cost[k])))
                total = cost[k] + far * far
                if (
                    far <= 1.0
                    and total < best
                    and not _is_forbidden(forbidden, k, j)
                    and _has_room(nodes, k, j, turning, limits, is_start_given, end, least, most)
                ):
                    best, origin = total, k
            has_jumped[j] = origin < 0
            if origin < 0:
                far = _step(nodes, cheapest, j, windows, layer - 1, turning, FARTHEST)
                cost[j], back[j] = best + min(far, FARTHEST), cheapest
                for i in range(n):
                    end[j, i] = least[j, i] = most[j, i] = nodes[j, i]
            else:
                cost[j], back[j] = best, origin
                for i in range(n):
                    end[j, i] = end[origin, i] + _moved(nodes, origin, j, i, turning)
                    least[j, i] = min(least[origin, i], end[j, i])
                    most[j, i] = max(most[origin, i], end[j, i])


@device_kernel
def _moved(nodes, k, j, i, turning):
    """What joint i moves from node k to node j [rad or m]."""
    moved = nodes[j, i] - nodes[k, i]
    return moved - TURN * np.floor(moved / TURN + 0.5) if turning[i] else moved


@device_kernel
def _step(nodes, k, j, windows, row, turning, enough):
    """The largest joint step from node k to node j, by the window; that of some joint if that is beyond `enough`."""
    far = 0.0
    for i in range(nodes.shape[1]):
        far = max(far, abs(_moved(nodes, k, j, i, turning)) / windows[row, i])
        if far > enough:
            return far
    return far


@device_kernel
def _is_forbidden(forbidden, k, j):
    """Whether the step from node k to node j is not to be taken."""
    found = False
    for row in range(len(forbidden)):
        found = found or (forbidden[row, 0] == k and forbidden[row, 1] == j)
    return found


@device_kernel
def _has_room(nodes, k, j, turning, limits, is_start_given, end, least, most):
    """Whether the travel to node k and on to node j fits between the limits at some turn, or as it is."""
    for i in range(nodes.shape[1]):
        there = end[k, i] + _moved(nodes, k, j, i, turning)
        below = limits[0, i] - WITHIN - min(least[k, i], there)
        above = limits[1, i] + WITHIN - max(most[k, i], there)
        if not turning[i]:
            if below > 0.0 or above < 0.0:
                return False
            continue
        fewest, largest = np.ceil(below / TURN), np.floor(above / TURN)
        if is_start_given:
            fewest, largest = max(fewest, 0.0), min(largest, 0.0)
        if fewest > largest:
            return False
    return True
