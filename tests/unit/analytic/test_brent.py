"""Minima of many functions side by side, against those that are known."""

import numpy as np

from maira_qp.analytic.brent import minima


def test_minima_of_many_functions_are_found(rng):
    """Quartics about places inside their intervals and beyond; the value is the one at the place."""
    middle, low = rng.uniform(-2, 2, 200), rng.uniform(-3, 0, 200)
    high = low + rng.uniform(0.1, 3, 200)

    def function(rows, x):
        assert (low[rows] <= x).all()
        assert (x <= high[rows]).all()
        return (x - middle[rows]) ** 2 + 0.3 * (x - middle[rows]) ** 4

    x, value = minima(function, low, high)
    np.testing.assert_allclose(x, np.clip(middle, low, high), atol=1e-7)
    np.testing.assert_array_equal(value, function(np.arange(200), x))


def test_a_minimum_does_not_depend_on_its_neighbours(rng):
    """To the bit: each goes its own way."""
    phase = rng.uniform(0, 6, 50)
    low, high = np.full(50, -3.0), np.full(50, 3.0)
    together, _ = minima(lambda rows, x: np.cos(x + phase[rows]), low, high)
    for i in range(50):
        alone, _ = minima(lambda _, x, i=i: np.cos(x + phase[[i]]), low[:1], high[:1])
        assert alone[0] == together[i]


def test_it_takes_few_steps():
    """A parabola's vertex is found by parabolas, not by thirty golden sections; nothing is asked of nothing."""
    asked = []
    x, _ = minima(lambda _, x: (asked.append(len(x)), (x - 0.3) ** 2)[1], np.array([-1.0]), np.array([2.0]))
    assert abs(x[0] - 0.3) < 1e-8
    assert len(asked) < 12
    assert minima(lambda _, x: x, np.empty(0), np.empty(0))[0].shape == (0,)
