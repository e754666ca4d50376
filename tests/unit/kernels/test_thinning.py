"""One configuration of each cell, against a dictionary of cells."""

import numpy as np
import pytest

from maira_qp.kernels.paths.thinning import thin


@pytest.mark.parametrize("cell", [0.01, 0.3, 2.0, 100.0])
@pytest.mark.parametrize("count", [0, 1, 400])
def test_the_first_of_each_cell_is_kept(count, cell):
    """Some in the same place, on limits or not, some that are the negatives of others."""
    rng = np.random.default_rng(count)
    q = rng.uniform(-3.0, 3.0, size=(count, 4))
    q[count // 2 :] = -q[: count - count // 2]
    q[count // 3 : count // 2] = q[: count // 2 - count // 3]
    on_limits = rng.random(size=q.shape) < 0.1
    kept = np.empty(count, np.int64)
    number = thin(q, on_limits, cell, np.empty(1024, np.int64), np.empty(count, np.uint64), kept)
    cells = np.floor(q / cell + 0.5).astype(int)
    first = {}
    for k in range(count):
        first.setdefault((*cells[k], *on_limits[k]), k)
    assert kept[:number].tolist() == list(first.values())
