"""Which limits a tick is at, in compiled code, against the boxes that `problem.limits.joint` makes of them."""

import numpy as np
from support.compiled_problems import few

from maira_qp.kernels.control import active_limits as kinds_of
from maira_qp.problem.limits.joint import braking_displacement

WITHIN, SHARE = 1e-9, 1 - 1e-6


def kind(lower, upper, fastest, acceleration, q, velocity, displacement, dt):
    """Of one joint, with what is returned."""
    limits = np.array([[lower, upper, fastest, acceleration, 1.0]])
    kinds, speed = np.full(1, -1), np.array([displacement / dt])
    q, velocity, ahead = np.array([q]), np.array([velocity]), np.array([q + displacement])
    ways = kinds_of.active_limits(limits, q, velocity, ahead, speed, dt, WITHIN, SHARE, kinds)
    return int(kinds[0]), ways


def test_each_box_is_told_at_its_end_and_not_a_hundredth_before(rng):
    """Of all the displacements of a box the ends alone are at a limit, and that of the narrowest box."""
    told = {kinds_of.SPEED: 0, kinds_of.ACCELERATION: 0, kinds_of.BRAKING_UPPER: 0, kinds_of.BRAKING_LOWER: 0}
    for _ in range(few(2000)):
        dt, acceleration, fastest = 0.01 * np.exp(rng.uniform(-1, 1)), rng.uniform(1, 20), rng.uniform(0.5, 3)
        velocity, room = rng.uniform(0, 1) * fastest, np.exp(rng.uniform(-6, 1))
        sign = rng.choice([-1.0, 1.0])
        ends = {
            kinds_of.SPEED: fastest * dt,
            kinds_of.ACCELERATION: velocity * dt + acceleration * dt**2,
            kinds_of.BRAKING_UPPER: float(braking_displacement(np.array([room]), acceleration * dt**2)[0]),
        }
        narrowest = min(ends, key=ends.__getitem__)
        end, slowest = ends[narrowest], velocity * dt - acceleration * dt**2
        lower, upper = (-room, 9.0) if sign < 0 else (-9.0, room)
        arguments = lower, upper, fastest, acceleration, 0.0, sign * velocity
        if 0.98 * end < slowest:  # it could not brake so hard
            continue
        found, (total, longest, last) = kind(*arguments, sign * end, dt)
        expected = narrowest if narrowest != kinds_of.BRAKING_UPPER or sign > 0 else kinds_of.BRAKING_LOWER
        assert found == expected
        told[expected] += 1
        np.testing.assert_allclose((total, longest, last), (end / dt, end / dt / acceleration, 0))
        assert kind(*arguments, sign * 0.99 * end, dt)[0] == kinds_of.FREE
    assert min(told.values()) >= (few(2000) > 100) * 20


def test_position_limits_go_before_all_others_and_nothing_is_at_limits_that_are_none():
    for end, expected in ((0.02, kinds_of.UPPER), (-0.02, kinds_of.LOWER)):
        assert kind(-0.02, 0.02, 2.0, 5.0, 0.0, 0.0, end, 0.01)[0] == expected
    found, ways = kind(-np.inf, np.inf, np.inf, np.inf, 0.0, 0.0, 5.0, 0.01)
    assert found == kinds_of.FREE
    np.testing.assert_allclose(ways, (500.0, 0.0, 0))
    assert kind(-1.0, 1.0, 2.0, 5.0, 0.0, 0.0, 0.0, 0.01)[0] == kinds_of.FREE
