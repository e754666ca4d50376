"""The best line through a corridor, against all lines one by one."""

from itertools import product

import numpy as np
import pytest

from maira_qp.kernels.paths.corridor import link_beside

HIGH = 10.0


def cost(line: np.ndarray, windows: np.ndarray, largest: float) -> float:
    """What a line (N, n) costs."""
    steps = (np.abs(np.diff(line, axis=0)) / windows).max(axis=1) / largest
    return float(np.sum(steps**2 + HIGH * steps**8))


@pytest.mark.parametrize("seed", range(10))
def test_no_line_costs_less(seed):
    rng = np.random.default_rng(seed)
    count, wide, joints = rng.integers(2, 5), rng.integers(1, 5), rng.integers(1, 4)
    nodes, windows = rng.normal(size=(count, wide, joints)), rng.uniform(0.3, 2.0, size=(count - 1, joints))
    is_node = rng.random((count, wide)) < 0.7
    is_node[np.arange(count), rng.integers(0, wide, size=count)] = True
    line, back = np.empty(count, dtype=np.int64), np.empty((count, wide), dtype=np.int64)
    link_beside(nodes, is_node, windows, 1.5, HIGH, np.empty((2, wide)), back, line)
    assert is_node[np.arange(count), line].all()
    chosen = cost(nodes[np.arange(count), line], windows, 1.5)
    every = [k for k in product(range(wide), repeat=count) if is_node[np.arange(count), k].all()]
    assert chosen == pytest.approx(min(cost(nodes[np.arange(count), k], windows, 1.5) for k in every), rel=1e-12)
