"""Limits on a displacement, merged into one box that is never empty."""

import numpy as np
import pytest

from maira_qp.errors import OptionError
from maira_qp.problem.limits import LinearLimit, PositionLimit, VelocityLimit, merge


def test_position_limits_are_distances_and_velocity_counts_only_in_time():
    limits = [PositionLimit(np.array([-1.0, -2.0]), np.array([1.0, 2.0])), VelocityLimit(np.array([1.0, 10.0]))]
    q = np.array([0.5, 0.0])
    still = merge(limits, q)
    assert still.lower.tolist() == [-1.5, -2.0]
    assert still.upper.tolist() == [0.5, 2.0]
    tick = merge(limits, q, dt=0.1)
    assert tick.lower.tolist() == [-0.1, -1.0]
    assert tick.upper.tolist() == [0.1, 1.0]


def test_a_joint_outside_comes_back_at_its_limit_speed_and_no_faster():
    limits = [PositionLimit(np.array([-1.0, -1.0]), np.array([1.0, 1.0])), VelocityLimit(np.array([1.0, 1.0]))]
    bounds = merge(limits, np.array([1.5, -1.05]), dt=0.1)
    assert bounds.lower.tolist() == [-0.1, pytest.approx(0.05)]
    assert bounds.upper.tolist() == [-0.1, 0.1]


def test_the_merged_box_is_never_empty(rng):
    for _ in range(1000):
        lower = rng.normal(size=4)
        upper = lower + rng.choice([0.0, 1.0], size=4) * rng.random(4)
        limits = [PositionLimit(lower, upper), VelocityLimit(rng.uniform(1e-6, 10, 4))]
        bounds = merge(limits, 3 * rng.normal(size=4), dt=rng.uniform(1e-4, 1))
        assert (bounds.lower <= bounds.upper).all()


def test_a_broken_row_may_not_be_broken_further():
    limit = LinearLimit([[1.0, 1.0]], [1.0])
    assert limit.rows(np.array([1.0, 1.0]))[1].tolist() == [-1.0]
    assert merge([limit], np.array([1.0, 1.0])).h.tolist() == [0.0]
    assert merge([limit], np.array([0.0, 0.25])).h.tolist() == [0.75]


@pytest.mark.parametrize(
    ("A", "b"), [([1.0, 2.0], [1.0]), ([[1.0, np.nan]], [1.0]), ([[1.0, 2.0]], [1.0, 2.0]), ("x", [1])]
)
def test_a_linear_limit_checks_its_shape(A, b):
    with pytest.raises(OptionError, match="LinearLimit"):
        LinearLimit(A, b)
