"""One configuration of each cell of a grid: the inner loop of `solvers.paths.layers`."""

from __future__ import annotations

import numpy as np
from numba import int64, uint64

from maira_qp.kernels.jit.decorators import kernel
from maira_qp.kernels.search.random_numbers import next_random

NONE = -1


@kernel
def thin(q, on_limits, cell, table, keys, kept):
    """Write the first of the configurations (M, n) of each cell, and of each set of joints (M, n) on limits.

    Args:
        q: [rad or m].
        on_limits: of bool.
        cell: the edge of the cells [rad or m].
        table: (T,) of int64, T a power of two and more than M: where keys are sought, open addressing.
        keys: (M,) of uint64: what cells are told apart by, two alike by a chance of 2^-64.
        kept: (M,) of int64: the indices that are kept, in order.

    Returns: how many are kept.
    """
    table[:] = NONE
    last, count = uint64(len(table) - 1), 0
    for k in range(len(q)):
        key = uint64(0)
        for i in range(q.shape[1]):
            number = int64(np.floor(q[k, i] / cell + 0.5)) * 2 + (1 if on_limits[k, i] else 0)
            key = next_random(uint64(key ^ uint64(number)))[0]
        place = key & last
        while table[place] != NONE and keys[table[place]] != key:
            place = (place + uint64(1)) & last
        if table[place] == NONE:
            keys[count], kept[count], table[place] = key, k, count
            count += 1
    return count
