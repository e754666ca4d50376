"""What a joint may move in a tick: the compiled form of `problem.limits.joint`, where the formulas are explained."""

from __future__ import annotations

import math

from maira_qp.kernels.jit.decorators import device_kernel, kernel
from maira_qp.kernels.layout import Joint

RESERVE = 0.7
"""As in `problem.limits.joint`."""


@kernel
def bounds_of_tick(tree, q, velocity, dt, lower, upper):
    """Bounds (n,) on the displacement in a tick of dt [s] from q (n,) at a velocity (n,)."""
    for i in range(len(q)):
        reach, change, ahead = tree[i, Joint.VELOCITY] * dt, tree[i, Joint.ACCELERATION] * (dt * dt), velocity[i] * dt
        below, above = tree[i, Joint.LOWER] - q[i], tree[i, Joint.UPPER] - q[i]
        low, high = -_toward(-below, change, -ahead), _toward(above, change, ahead)
        if above < 0.0:
            low = min(low, high)
        if below > 0.0:
            high = max(low, high)
        lower[i] = min(max(min(max(ahead - change, low), high), -reach), reach)
        upper[i] = min(max(min(max(ahead + change, low), high), -reach), reach)


@device_kernel
def _toward(room, change, ahead):
    """The largest displacement toward a limit that is `room` away; where that is negative, the way back."""
    return max(room, ahead - change) if room < 0.0 else braking_displacement(room, change, ahead)


@kernel
def bounds_of_position(tree, q, lower, upper):
    """Bounds (n,) on the displacement from q (n,) where no time passes."""
    for i in range(len(q)):
        lower[i], upper[i] = tree[i, Joint.LOWER] - q[i], tree[i, Joint.UPPER] - q[i]


@kernel
def braking_displacement(room, change, ahead):
    """The largest displacement of a tick from which a joint that goes `ahead` now stops within `room`."""
    if not (0.0 < room < math.inf and change < math.inf):
        return room
    x = 2.0 * room / change
    if ahead > 0.0 and ahead * ahead > 2.0 * room * change:
        x = (2.0 * room / ahead) ** 2
    return min(2.0 * room / (1.0 + math.sqrt(1.0 + x)), room)


@device_kernel
def _stopping_displacement(joint, way, dt):
    """The largest displacement of a tick from which a joint stops at the end of its way, with a `RESERVE`."""
    room = braking_displacement(abs(way), RESERVE * joint[Joint.ACCELERATION] * (dt * dt), 0.0)
    return math.copysign(room, way)


@kernel
def share_to_stop(tree, way, dt):
    """The largest share of the way (n,) that a tick may go so that every joint could stop where the way ends."""
    share = 1.0
    for i in range(len(way)):
        if way[i] != 0.0:
            share = min(share, _stopping_displacement(tree[i], way[i], dt) / way[i])
    return share


@kernel
def keep_along(tree, way, dt, lower, upper):
    """Narrow the bounds (n,) of a tick so that joints keep to their way (n,) and could stop at its end."""
    for i in range(len(way)):
        if tree[i, Joint.ACCELERATION] < math.inf:
            stop, low, high = _stopping_displacement(tree[i], way[i], dt), lower[i], upper[i]
            lower[i], upper[i] = min(max(min(stop, 0.0), low), high), min(max(max(stop, 0.0), low), high)


@kernel
def rest_of(lower, upper, rest):
    """The displacement (n,) nearest to none within the bounds: whether it is none."""
    none = True
    for i in range(len(rest)):
        rest[i] = min(max(0.0, lower[i]), upper[i])
        none = none and rest[i] == 0.0
    return none
