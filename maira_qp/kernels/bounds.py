"""What a joint may move in a tick: the compiled form of `maira_qp.problem.limits`, where the formulas are explained."""

from __future__ import annotations

import math

from maira_qp.kernels.chain import LOWER, UPPER
from maira_qp.kernels.compilation import bare_kernel
from maira_qp.kernels.tree import ACCELERATION, VELOCITY


@bare_kernel
def bounds_of_tick(tree, q, velocity, dt, lower, upper):
    """Bounds (n,) on the displacement in a tick of dt [s] from q (n,) at a velocity (n,)."""
    for i in range(len(q)):
        acceleration, reach = tree[i, ACCELERATION], tree[i, VELOCITY] * dt
        change = acceleration * (dt * dt)
        low = -braking_displacement(q[i] - tree[i, LOWER], change)
        high = braking_displacement(tree[i, UPPER] - q[i], change)
        change = acceleration * dt
        slow, fast = (velocity[i] - change) * dt, (velocity[i] + change) * dt
        lower[i] = min(max(min(max(low, slow), fast), -reach), reach)
        upper[i] = min(max(min(max(high, slow), fast), -reach), reach)


@bare_kernel
def bounds_of_position(tree, q, lower, upper):
    """Bounds (n,) on the displacement from q (n,) where no time passes."""
    for i in range(len(q)):
        lower[i], upper[i] = tree[i, LOWER] - q[i], tree[i, UPPER] - q[i]


@bare_kernel
def braking_displacement(room, change):
    """The largest displacement of a tick from which a joint stops within `room`, slower by `change` a tick."""
    if not (0.0 < room < math.inf and change < math.inf):
        return room
    k = math.floor(0.5 * (math.sqrt(1.0 + 8.0 * room / change) - 1.0))
    return min((room + 0.5 * change * k * (k + 1.0)) / (k + 1.0), room)


@bare_kernel
def share_to_stop(tree, way, dt):
    """The largest share of the way (n,) that a tick may go so that every joint could stop where the way ends."""
    share = 1.0
    for i in range(len(way)):
        room = abs(way[i])
        if room > 0.0:
            share = min(share, braking_displacement(room, tree[i, ACCELERATION] * (dt * dt)) / room)
    return share


@bare_kernel
def rest_of(lower, upper, rest):
    """The displacement (n,) nearest to none within the bounds: whether it is none."""
    none = True
    for i in range(len(rest)):
        rest[i] = min(max(0.0, lower[i]), upper[i])
        none = none and rest[i] == 0.0
    return none
