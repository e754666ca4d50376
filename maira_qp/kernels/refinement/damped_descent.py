"""The damped descent of one cost within the limits, a QP with a box an iteration: that of
`solvers.reference.levenberg_marquardt`, for costs that the lanes of `search.levenberg_marquardt` do not know.

    q <- clip(q + dq),   dq = argmin  c^T dq + 1/2 dq^T (H + mu I) dq   subject to   lower <= dq <= upper
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from maira_qp.kernels.jit.decorators import device_kernel
from maira_qp.kernels.layout import Setting
from maira_qp.kernels.qp.box_qp import solve_box_qp
from maira_qp.kernels.search.damping import damp, next_factor, take_step
from maira_qp.kernels.search.levenberg_marquardt import pose_cost


def damped_descent(model: Callable, value: Callable) -> Any:
    """The kernel that descends a cost which two kernels know, with a `problem` that is their own.

    `model(chain, settings, problem, tolerance, cost, work, q)` puts H, c and the box of a step from q (n,) into `work`,
    whose kinematics are those of q; it returns what is left to do and the largest entry of H. `value(problem, cost, q)`
    is what falls, where the pose costs `cost`.
    """

    @device_kernel
    def descend(chain, settings, target, problem, tolerance, most, work, q):
        """Descend from q (n,), in place, until no more than `tolerance` is left, or `most` iterations.

        `work` holds the kinematics of q afterwards. Returns the pose's cost, the iterations and what is left.
        """
        axes, origins, tool, e, trial = work.axes, work.origins, work.tool, work.e, work.trial
        H, c, diagonal, lower, upper, dq = work.H, work.c, work.diagonal, work.lower, work.upper, work.dq
        A, free, side, y = work.A, work.free, work.side, work.y
        n, factor, spent, fresh, largest, left = len(q), 1.0, 0, True, 0.0, math.inf
        cost = pose_cost(chain, settings, target, q, axes, origins, tool, e)
        now = value(problem, cost, q)
        while True:
            if fresh:
                left, largest = model(chain, settings, problem, tolerance, cost, work, q)
                for i in range(n):
                    diagonal[i] = H[i, i]
            if left <= tolerance or spent >= most:
                break
            spent += 1
            damp(settings, factor, cost, largest, diagonal, H)
            if not solve_box_qp(H, c, lower, upper, A, free, side, y, dq) or not take_step(chain, q, dq, True, trial):
                break
            trial_cost = pose_cost(chain, settings, target, trial, axes, origins, tool, e)
            ahead = value(problem, trial_cost, trial)
            fresh = ahead < now
            factor = next_factor(settings, factor, fresh)
            if fresh:
                cost, now = trial_cost, ahead
                for i in range(n):
                    q[i] = trial[i]
            elif factor > settings[Setting.MOST_FACTOR]:
                break
        if not fresh:
            pose_cost(chain, settings, target, q, axes, origins, tool, e)
        return cost, spent, left

    return descend
