"""Limits on a displacement, merged into one box that is never empty."""

from types import SimpleNamespace

import numpy as np
import pytest

from maira_qp.errors import OptionError
from maira_qp.problem.limits.joint import AccelerationLimit, PositionLimit, Tick, VelocityLimit, merge
from maira_qp.problem.limits.linear import LinearLimit

AT_ONCE = np.inf


def at(*q: float) -> SimpleNamespace:
    """All that these limits see of a configuration."""
    return SimpleNamespace(q=np.array(q, dtype=float), n=len(q))


def still(dt: float, n: int) -> Tick:
    """A tick that begins at rest."""
    return Tick(dt, np.zeros(n))


def test_position_limits_are_distances_and_velocity_counts_only_in_time():
    limits = [
        PositionLimit(np.array([-1.0, -2.0]), np.array([1.0, 2.0]), np.full(2, AT_ONCE)),
        VelocityLimit(np.array([1.0, 10.0])),
    ]
    always = merge(limits, at(0.5, 0.0))
    assert always.lower.tolist() == [-1.5, -2.0]
    assert always.upper.tolist() == [0.5, 2.0]
    tick = merge(limits, at(0.5, 0.0), still(0.1, 2))
    assert tick.lower.tolist() == [-0.1, -1.0]
    assert tick.upper.tolist() == [0.1, 1.0]


def test_a_joint_outside_comes_back_at_its_limit_speed_and_no_faster():
    limits = [
        PositionLimit(np.array([-1.0, -1.0]), np.array([1.0, 1.0]), np.full(2, AT_ONCE)),
        VelocityLimit(np.array([1.0, 1.0])),
    ]
    bounds = merge(limits, at(1.5, -1.05), still(0.1, 2))
    assert bounds.lower.tolist() == [-0.1, pytest.approx(0.05)]
    assert bounds.upper.tolist() == [-0.1, 0.1]


def test_the_merged_box_is_never_empty(rng):
    for _ in range(1000):
        lower = rng.normal(size=4)
        upper = lower + rng.choice([0.0, 1.0], size=4) * rng.random(4)
        acceleration = rng.choice([rng.uniform(1e-3, 100), AT_ONCE], size=4)
        limits = [
            AccelerationLimit(acceleration),
            PositionLimit(lower, upper, acceleration),
            VelocityLimit(rng.uniform(1e-6, 10, 4)),
        ]
        bounds = merge(limits, at(*3 * rng.normal(size=4)), Tick(rng.uniform(1e-4, 1), rng.normal(size=4)))
        assert (bounds.lower <= bounds.upper).all()


def test_a_broken_row_may_not_be_broken_further():
    limit = LinearLimit([[1.0, 1.0]], [1.0])
    assert limit.rows(at(1, 1), None)[1].tolist() == [-1.0]
    assert merge([limit], at(1, 1)).h.tolist() == [0.0]
    assert merge([limit], at(0, 0.25)).h.tolist() == [0.75]


def test_a_row_that_a_joint_cannot_help_breaking_leaves_it_room_to_brake():
    """At 1 rad/s, able to slow by 0.1 rad/s in a tick of 0.1 s, before a row that allows nothing."""
    limits = [AccelerationLimit(np.array([1.0])), LinearLimit([[1.0]], [0.0])]
    bounds = merge(limits, at(0.0), Tick(0.1, np.array([1.0])))
    assert bounds.rest.tolist() == [pytest.approx(0.09)]
    assert bounds.h.tolist() == bounds.rest.tolist()


def joint_limits(acceleration: float, speed: float) -> list:
    """Of one joint between -1 and 1, in the order of a solver."""
    return [
        AccelerationLimit(np.array([acceleration])),
        PositionLimit(np.array([-1.0]), np.array([1.0]), np.array([acceleration])),
        VelocityLimit(np.array([speed])),
    ]


@pytest.mark.parametrize("spread", [0.0, 0.2, 3.0])
def test_a_joint_never_comes_to_its_limit_faster_than_it_can_brake(spread, rng):
    """As fast as allowed toward the limit, in ticks of the same length, of lengths that vary by 20 %, of 1 to 20 times.

    Acceleration always kept, the limit reached, at rest.
    """
    for _ in range(8):
        acceleration, dt = 10 ** rng.uniform(-1, 2), 10 ** rng.uniform(-3, -1)
        limits = joint_limits(acceleration, 10 ** rng.uniform(-1, 1))
        q, velocity, fastest = rng.uniform(-1, 1), 0.0, 0.0
        for _ in range(200_000):
            dt_now = dt * np.exp(rng.uniform(-spread, spread) / 2)
            step = float(merge(limits, at(q), Tick(dt_now, np.array([velocity]))).upper[0])
            assert abs(step / dt_now - velocity) <= acceleration * dt_now * (1 + 1e-9) + 1e-12
            assert q + step <= 1 + 1e-12
            if step < 1e-15:
                break
            q, velocity = q + step, step / dt_now
            fastest = max(fastest, velocity)
        assert q == pytest.approx(1, abs=1e-9)
        assert fastest > 0


def test_a_joint_that_is_too_fast_to_stop_brakes_evenly_and_stops_at_its_limit(rng):
    """From a velocity that no tick would have led to: never beyond, harder than allowed by no more than it takes."""
    for _ in range(100):
        room, acceleration = rng.uniform(0.01, 1), 10 ** rng.uniform(-1, 1)
        needed = acceleration * 10 ** rng.uniform(0.1, 2)  # the even deceleration that stops at the limit
        velocity = np.sqrt(2 * needed * room)
        limits, q = joint_limits(acceleration, np.inf), 1 - room
        for _ in range(10_000):
            dt = 10 ** rng.uniform(-4, -1)
            step = float(merge(limits, at(q), Tick(dt, np.array([velocity]))).upper[0])
            assert step >= 0
            assert q + step <= 1 + 1e-12
            assert velocity - step / dt <= needed * dt * (1 + 1e-6)
            q, velocity = q + step, step / dt
            if velocity < 1e-9:
                break
        assert velocity < 1e-9


@pytest.mark.parametrize(
    ("A", "b"), [([1.0, 2.0], [1.0]), ([[1.0, np.nan]], [1.0]), ([[1.0, 2.0]], [1.0, 2.0]), ("x", [1])]
)
def test_a_linear_limit_checks_its_shape(A, b):
    with pytest.raises(OptionError, match="LinearLimit"):
        LinearLimit(A, b)
