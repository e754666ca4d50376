"""The best line through a corridor, by dynamic programming: the compiled form of what `solvers.paths.corridor` says."""

from __future__ import annotations

import numpy as np

from maira_qp.kernels.jit.decorators import device_kernel, kernel


@kernel
def link_beside(nodes, is_node, windows, largest, high, cost, back, line):
    """Find the line of least cost, which of the nodes it takes, into `line` (N,).

    A step costs the square of its largest joint step, and `high` times the eighth power.

    Args:
        nodes: configurations (N, W, n), W at each of N poses.
        is_node: (N, W) of bool: those that may be taken; one at least at each pose.
        windows: (N - 1, n) how far each joint may move from pose to pose [rad or m].
        largest: the largest step of a line, by these, by which others are large.
        high: what the eighth power of a step counts against its square.
        cost: work (2, W).
        back: work (N, W) of integers.
        line: (N,) of integers.
    """
    count, wide = is_node.shape
    for j in range(wide):
        cost[0, j] = 0.0 if is_node[0, j] else np.inf
    for k in range(1, count):
        for j in range(wide):
            cost[1, j], back[k, j] = np.inf, 0
            if not is_node[k, j]:
                continue
            for i in range(wide):
                if cost[0, i] < cost[1, j]:
                    square = _step(nodes, k, i, j, windows, largest) ** 2
                    total = cost[0, i] + square + high * square**4
                    if total < cost[1, j]:
                        cost[1, j], back[k, j] = total, i
        for j in range(wide):
            cost[0, j] = cost[1, j]
    line[count - 1] = 0
    for j in range(wide):
        if cost[0, j] < cost[0, line[count - 1]]:
            line[count - 1] = j
    for k in range(count - 1, 0, -1):
        line[k - 1] = back[k, line[k]]


@device_kernel
def _step(nodes, k, i, j, windows, largest):
    """The largest joint step from node i of pose k - 1 to node j of pose k."""
    far = 0.0
    for joint in range(nodes.shape[2]):
        far = max(far, abs(nodes[k, j, joint] - nodes[k - 1, i, joint]) / windows[k - 1, joint])
    return far / largest
