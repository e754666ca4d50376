"""Eight box QPs at once, by the kernel."""

import numpy as np
from numba import njit

from maira_qp.kernels.jit.simd import LANES, select, store
from maira_qp.kernels.qp.box_qp_simd import solve_box_qps


@njit
def solve_and_tell(H, c, lower, upper, A, side, x, definite):
    """The mask of `solve_box_qps` as numbers."""
    mask = solve_box_qps(H, c, lower, upper, A, side, x)
    store(definite, 0, select(mask, 1.0, 0.0))


def solve_eight(problems) -> tuple[np.ndarray, np.ndarray]:
    """Of eight problems (H, c, lower, upper) x (8, n), and which are positive definite (8,)."""
    H, c, lower, upper = (np.ascontiguousarray(np.stack(part, axis=-1)) for part in zip(*problems, strict=True))
    n = len(c)
    x, definite = np.full((n, LANES), np.nan), np.full((1, LANES), np.nan)
    A, side = np.full((n, n, LANES), np.nan), np.full((n, LANES), np.nan)
    solve_and_tell(H, c, lower, upper, A, side, x, definite)
    return x.T, definite[0] > 0
