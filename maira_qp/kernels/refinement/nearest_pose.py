"""Where a pose was not reached: the nearest point, the compiled form of `solvers.reference.multi_start.nearest`."""

from __future__ import annotations

import numpy as np

from maira_qp.kernels.jit.arena import Arena
from maira_qp.kernels.jit.decorators import kernel
from maira_qp.kernels.jit.simd import LANES
from maira_qp.kernels.refinement.newton_simd import newton_in_lanes
from maira_qp.kernels.refinement.null_space_sqp import tell
from maira_qp.kernels.refinement.weighted_sum import trade_off
from maira_qp.kernels.refinement.workspace import make_workspace
from maira_qp.kernels.search.levenberg_marquardt import LANES_ARENA, pose_cost

NEWTON = Arena("NewtonWork", "n", floats={"lanes": LANES_ARENA.floats}, integers={"lane_of": f"{LANES}"})
"""Work of `newton_in_lanes`."""
NewtonWork, make_newton = NEWTON.Arrays, NEWTON.make


@kernel(allocates=True)
def nearest_points(chain, settings, targets, reference, weights, tolerance, most, q, outcome):
    """From configurations q (N, n) to the stationary points of the pose error near them, in place, by Newton's method.

    It ends when no entry of the gradient that the limits leave is larger than `tolerance`, or after `most` iterations.
    q stays inside the limits to the bit. `outcome` (N, 6) is as of `kernels.refinement.null_space_sqp.settle`, for the
    targets (N, 12); the objective `1/2 sum_i w_i (q_i - ref_i)^2` is told, and moves nothing.
    """
    n = q.shape[1]
    work, nothing, own = make_workspace(n), np.zeros(n), make_newton(n)
    left, steps = np.full(len(q), np.inf), np.zeros(len(q), np.int64)
    if most > 0:
        newton_in_lanes(chain, settings, targets, 1, tolerance, own.lanes, own.lane_of, q, left, steps)
    for k in range(len(q)):
        if left[k] <= tolerance:
            pose_cost(chain, settings, targets[k], q[k], work.axes, work.origins, work.tool, work.e)
        else:
            more, left[k] = trade_off(chain, settings, targets[k], nothing, nothing, 0.0, tolerance, most, work, q[k])
            steps[k] += more
        tell(settings, reference, weights, work.e, steps[k], left[k], q[k], outcome[k])
