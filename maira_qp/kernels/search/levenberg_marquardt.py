"""Damped Gauss-Newton descents of pose costs inside a box, eight at a time: the compiled form of
`solvers.reference.levenberg_marquardt`.

From the same start and settings each lane takes the same steps; the algorithm and its source stand there. `LONGEST`
bounds what a step moves any joint; where that is small, a descent follows the valley that it begins in. All lanes go on
together, one iteration a call of `advance`; a lane that has ended is given a new start by whoever drives them.
"""

from __future__ import annotations

import numpy as np

from maira_qp.kernels.jit.arena import Arena
from maira_qp.kernels.jit.decorators import device_kernel, kernel
from maira_qp.kernels.jit.simd import any_lane, broadcast, load, load2, maximum, select, store, store2
from maira_qp.kernels.kinematics.serial_chain import forward, jacobian
from maira_qp.kernels.layout import Descent, Setting
from maira_qp.kernels.qp.box_qp_simd import solve_box_qps
from maira_qp.kernels.search.damping import bound_step, damp, next_factor, take_step
from maira_qp.kernels.spatial.pose_error import pose_error

LANES_ARENA = Arena(
    "Lanes",
    "n",
    lanes=True,
    floats={
        "state": f"{Descent.WIDTH}",
        **dict.fromkeys(("target", "goal", "tool"), "12"),
        "e": "6",
        **dict.fromkeys(("q", "trial", "c", "diagonal", "lower", "upper", "side", "dq"), "n"),
        **dict.fromkeys(("axes", "origins"), "n, 3"),
        "J": "n, 6",
        **dict.fromkeys(("H", "A"), "n, n"),
    },
)
"""All arrays of eight descents of a chain of n joints: the state of each, its q and target, and work."""
Lanes, carve_lanes = LANES_ARENA.Arrays, LANES_ARENA.carve


@kernel
def make_lanes(n, floats):
    """Eight descents, all of them ended, in memory as long as `LANES_ARENA` says."""
    lanes = carve_lanes(n, floats)
    store(lanes.state, Descent.ENDED, 1.0)
    return lanes


@kernel
def begin(state, q, target, lane, q0, wanted):
    """Begin a descent from q0 (n,) toward the target `wanted` (12,) in one lane."""
    for i in range(len(q0)):
        q[i, lane] = q0[i]
    for i in range(12):
        target[i, lane] = wanted[i]
    state[Descent.COST, lane], state[Descent.POSITION, lane], state[Descent.ORIENTATION, lane] = np.inf, np.inf, np.inf
    state[Descent.STARTING, lane], state[Descent.ENDED, lane], state[Descent.REACHED, lane] = 1.0, 0.0, 0.0


@kernel
def pose_cost(chain, settings, target, q, axes, origins, tool, e):
    """`1/2 |W e|^2` at q (n,); the kinematics and the error are left in the arrays."""
    forward(chain, q, axes, origins, tool)
    pose_error(tool, target, e)
    position, orientation = squares(e)
    return 0.5 * (
        settings[Setting.POSITION_WEIGHT] ** 2 * position + settings[Setting.ORIENTATION_WEIGHT] ** 2 * orientation
    )


@kernel
def squares(e):
    """Squared errors of position and orientation in e (6,)."""
    e0, e1, e2, e3, e4, e5 = load(e, 0), load(e, 1), load(e, 2), load(e, 3), load(e, 4), load(e, 5)
    return e0 * e0 + e1 * e1 + e2 * e2, e3 * e3 + e4 * e4 + e5 * e5


@kernel
def is_reached(settings, e):
    """The error (6,) is within the tolerances, a part with weight 0 being free."""
    position, orientation = squares(e)
    return (position <= _largest_square(settings, Setting.POSITION_WEIGHT, Setting.POSITION_TOLERANCE)) & (
        orientation <= _largest_square(settings, Setting.ORIENTATION_WEIGHT, Setting.ORIENTATION_TOLERANCE)
    )


@device_kernel
def _largest_square(settings, weight, tolerance):
    return settings[tolerance] ** 2 if settings[weight] > 0.0 else np.inf


@kernel
def quadratic_model(settings, J, e, H, c, renew):
    """Gauss-Newton's H (n, n) and c (n,) from the transposed Jacobian J (n, 6) and e (6,); the largest entry of |H|.

    Where the mask `renew` is false H and c stay as they are.
    """
    p2, o2 = settings[Setting.POSITION_WEIGHT] ** 2, settings[Setting.ORIENTATION_WEIGHT] ** 2
    e0, e1, e2, e3, e4, e5 = load(e, 0), load(e, 1), load(e, 2), load(e, 3), load(e, 4), load(e, 5)
    largest = broadcast(c, 0.0)
    for i in range(len(c)):
        a0, a1, a2 = p2 * load2(J, i, 0), p2 * load2(J, i, 1), p2 * load2(J, i, 2)
        a3, a4, a5 = o2 * load2(J, i, 3), o2 * load2(J, i, 4), o2 * load2(J, i, 5)
        slope = -(a0 * e0 + a1 * e1 + a2 * e2 + a3 * e3 + a4 * e4 + a5 * e5)
        store(c, i, select(renew, slope, load(c, i)))
        for j in range(i + 1):
            h = a0 * load2(J, j, 0) + a1 * load2(J, j, 1) + a2 * load2(J, j, 2)
            h = h + (a3 * load2(J, j, 3) + a4 * load2(J, j, 4) + a5 * load2(J, j, 5))
            h = select(renew, h, load2(H, i, j))
            store2(H, i, j, h)
            store2(H, j, i, h)
        largest = maximum(largest, load2(H, i, i))  # of a positive matrix the largest entry stands on the diagonal
    return largest


@kernel
def advance(chain, settings, lanes):
    """One iteration in every lane. What it does to a lane that has ended counts for nothing."""
    state, q, trial, H = lanes.state, lanes.q, lanes.trial, lanes.H
    n = len(q)
    cost, factor, stall_left = load(state, Descent.COST), load(state, Descent.FACTOR), load(state, Descent.STALL_LEFT)
    starting = load(state, Descent.STARTING) > 0.0
    damp(settings, factor, cost, load(state, Descent.LARGEST), lanes.diagonal, H)
    bound_step(chain, settings, q, lanes.lower, lanes.upper)
    solved = starting
    if any_lane(~starting):
        solved = solve_box_qps(H, lanes.c, lanes.lower, lanes.upper, lanes.A, lanes.side, lanes.dq)
    moved = take_step(chain, q, lanes.dq, ~starting, trial) | starting
    value = pose_cost(chain, settings, lanes.target, trial, lanes.axes, lanes.origins, lanes.tool, lanes.e)
    better = (value < cost) & (starting | solved)
    for i in range(n):
        store(q, i, select(better, load(trial, i), load(q, i)))
        store2(H, i, i, load(lanes.diagonal, i))
    jacobian(chain, lanes.axes, lanes.origins, lanes.tool, lanes.J)
    largest = quadratic_model(settings, lanes.J, lanes.e, H, lanes.c, better)
    for i in range(n):
        store(lanes.diagonal, i, load2(H, i, i))
    position, orientation = squares(lanes.e)
    reached = better & is_reached(settings, lanes.e)
    stall_left = select(
        better,
        select(value < (1.0 - settings[Setting.STALL_RATIO]) * cost, settings[Setting.STALL_STEPS], stall_left - 1.0),
        stall_left,
    )
    factor = select(starting, 1.0, next_factor(settings, factor, better))
    iterations = select(starting, 0.0, load(state, Descent.ITERATIONS) + 1.0)
    ended = (
        (stall_left <= 0.0)
        | (iterations >= settings[Setting.MAX_ITERATIONS])
        | (factor > settings[Setting.MOST_FACTOR])
    )
    ended = ended | reached | (solved & ~moved) | (starting & ~better)
    store(state, Descent.FIRST_COST, select(starting, value, load(state, Descent.FIRST_COST)))
    store(state, Descent.COST, select(better, value, cost))
    store(state, Descent.FACTOR, factor)
    store(state, Descent.STALL_LEFT, stall_left)
    store(state, Descent.ITERATIONS, iterations)
    store(state, Descent.LARGEST, largest)
    store(state, Descent.POSITION, select(better, position, load(state, Descent.POSITION)))
    store(state, Descent.ORIENTATION, select(better, orientation, load(state, Descent.ORIENTATION)))
    store(state, Descent.STARTING, 0.0)
    store(state, Descent.ENDED, select(ended, 1.0, broadcast(q, 0.0)))
    store(state, Descent.REACHED, select(reached, 1.0, broadcast(q, 0.0)))
