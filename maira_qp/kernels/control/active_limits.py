"""Which limit of each joint a control tick is at."""

from __future__ import annotations

import math

from maira_qp.kernels.jit.decorators import kernel

FREE, LOWER, UPPER, SPEED, BRAKING_LOWER, BRAKING_UPPER, ACCELERATION = 0, 1, 2, 3, 4, 5, 6


@kernel
def active_limits(limits, q, velocity, ahead, speed, dt, within, share, kinds):
    """Write into kinds (n,) which limits a tick of dt [s] from q (n,) at a velocity (n,) to `ahead` at a `speed` is at.

    Limits (n, 5): lower and upper limit [rad or m], largest speed and acceleration, and what a displacement counts as
    an angle [rad/rad, or rad/m]. A position limit is active from `within` on, others from a `share` of them on; a joint
    brakes for its position limit if what the tick and stopping take is what there is.

    Returns the sum of the speeds as angles [rad/s], the longest time to stop [s], and the joint that it is of.
    """
    total, longest, last = 0.0, 0.0, 0
    for i in range(len(q)):
        lower, upper, fastest, acceleration = limits[i, 0], limits[i, 1], limits[i, 2], limits[i, 3]
        v = abs(speed[i])
        total += limits[i, 4] * v
        if v / acceleration > longest:
            longest, last = v / acceleration, i
        room = upper - q[i] if speed[i] > 0.0 else q[i] - lower
        kinds[i] = FREE
        if ahead[i] <= lower + within:
            kinds[i] = LOWER
        elif ahead[i] >= upper - within:
            kinds[i] = UPPER
        elif v >= share * fastest:
            kinds[i] = SPEED
        elif v > 0.0 and acceleration < math.inf and v * dt + 0.5 * v * v / acceleration >= share * room:
            kinds[i] = BRAKING_UPPER if speed[i] > 0.0 else BRAKING_LOWER
        elif abs(speed[i] - velocity[i]) >= share * acceleration * dt:
            kinds[i] = ACCELERATION
    return total, longest, last
