"""Along which directions the joints move and the tool does not, for many configurations."""

from __future__ import annotations

import numpy as np

from maira_qp.kernels.jit.decorators import kernel
from maira_qp.kernels.linalg.qr_null_space import factor, null_vector

VANISHING = 1e-14
"""A pivot that is smaller, by the first, counts as zero."""


@kernel(allocates=True)
def self_motions(jacobians, directions):
    """Orthonormal vectors of the null spaces of Jacobians (N, m, n), m < n, into `directions` (N, n, n - m).

    Where a Jacobian has not full rank these are some of its null space.
    """
    count, m, n = jacobians.shape
    At, tau, order, x = np.empty((n, m)), np.empty(m), np.empty(m, np.int64), np.empty(n)
    for k in range(count):
        for i in range(n):
            for j in range(m):
                At[i, j] = jacobians[k, j, i]
        rank = factor(At, n, m, VANISHING, tau, order)
        for b in range(n - m):
            null_vector(At, n, rank, tau, b, x)
            for i in range(n):
                directions[k, i, b] = x[i]
