"""Gradient descent: its direction is the objective's gradient, its cap holds, and it converges."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from maira_qp.errors import ConfigurationError, OptionError, PoseError
from maira_qp.evaluation import baselines
from maira_qp.robots.dh.table import DHLink, DHTable
from maira_qp.robots.model.catalog import iiwa14, maira

MIXED = DHTable(
    [
        DHLink(a=0.4, alpha=0.3),
        DHLink(kind="prismatic", d=0.1, theta=0.4, a=0.1, alpha=-0.7, lower=-1.0, upper=1.0),
        DHLink(kind="fixed", a=0.2, alpha=0.5),
        DHLink(kind="continuous", a=0.3, alpha=1.1),
        DHLink(d=0.2),
    ]
)
TABLES = pytest.mark.parametrize("table", [maira(), iiwa14(), MIXED], ids=["maira", "iiwa14", "mixed"])


def half_square(table, q, target, with_orientation):
    """1/2 |e|^2, the objective, with SciPy's rotation vector."""
    T = table.forward(q)
    square = ((T[:3, 3] - target[:3, 3]) ** 2).sum()
    if with_orientation:
        square += Rotation.from_matrix(T[:3, :3].T @ target[:3, :3]).magnitude() ** 2
    return 0.5 * square


def numerical_gradient(function, q, step=1e-6):
    return np.array([(function(q + d) - function(q - d)) / (2 * step) for d in step * np.eye(len(q))])


def draw(table, rng, size=None):
    lower, upper = np.maximum(table.lower, -np.pi), np.minimum(table.upper, np.pi)
    return rng.uniform(lower, upper, None if size is None else (size, table.n))


@TABLES
@pytest.mark.parametrize("with_orientation", [False, True], ids=["position", "pose"])
def test_a_step_goes_down_the_gradient(table, with_orientation):
    """One step is the learning rate times the negative gradient of 1/2 |e|^2, by central differences."""
    rng = np.random.default_rng(12)
    for _ in range(10):
        target, q0 = table.forward(draw(table, rng)), 0.9 * draw(table, rng)
        if with_orientation:
            result = baselines.gradient_descent_pose(table, target, q0, rate=1e-3, max_iterations=1)
        else:
            result = baselines.gradient_descent_position(table, target[:3, 3], q0, rate=1e-3, max_iterations=1)
        gradient = numerical_gradient(lambda q, T=target: half_square(table, q, T, with_orientation), q0)
        np.testing.assert_allclose((result.q - q0) / 1e-3, -gradient, atol=2e-7)


@TABLES
def test_a_small_rate_never_raises_the_objective(table):
    """With a rate below 2 / sigma_max^2 each step lowers 1/2 |e|^2."""
    rng = np.random.default_rng(13)
    target, q0 = table.forward(draw(table, rng)), 0.9 * draw(table, rng)
    result = baselines.gradient_descent_pose(table, target, q0, rate=0.05, max_iterations=100)
    costs = [half_square(table, q, target, True) for q in result.history]
    assert (np.diff(costs) < 0).all()


@TABLES
def test_points_near_the_start_are_reached(table):
    """A point that a move of all joints by up to 0.2 reaches is found to the tolerance."""
    rng = np.random.default_rng(14)
    for q in 0.5 * draw(table, rng, 5):
        point = table.forward(q + rng.uniform(-0.2, 0.2, table.n))[:3, 3]
        result = baselines.gradient_descent_position(table, point, q, rate=0.3, max_iterations=4000)
        assert result.converged
        assert np.linalg.norm(table.forward(result.q)[:3, 3] - point) < 1e-3
        assert result.error < 1e-3


def test_most_random_poses_of_maira_are_reached():
    """From random starts, at least half of 8 random reachable poses converge, and those are at their targets."""
    table = maira()
    rng = np.random.default_rng(15)
    solved = 0
    for q_true, q0 in zip(draw(table, rng, 8), draw(table, rng, 8), strict=True):
        target = table.forward(q_true)
        result = baselines.gradient_descent_pose(table, target, q0)
        if result.converged:
            solved += 1
            T = table.forward(result.q)
            assert np.linalg.norm(T[:3, 3] - target[:3, 3]) < 1e-3
            assert Rotation.from_matrix(T[:3, :3].T @ target[:3, :3]).magnitude() < 1e-3
    assert solved >= 4


def test_the_cap_holds():
    """No joint moves further than the cap in any step, and the longest step is at the cap while far from the target."""
    table = maira()
    point = [0.5, 0.5, 0.9]
    result = baselines.gradient_descent_position(table, point, np.full(7, 0.2), rate=1.0, max_step=0.02)
    steps = np.abs(np.angle(np.exp(1j * np.diff(result.history, axis=0)))).max(axis=1)
    assert steps.max() <= 0.02 * (1 + 1e-12)
    assert steps[0] == pytest.approx(0.02)
    assert result.converged


def test_a_stationary_start_stays():
    """At the fully stretched arm, a point straight beyond gives no gradient: nothing moves and nothing is claimed."""
    result = baselines.gradient_descent_position(maira(), [0.0, 0.0, 3.0], np.zeros(7), max_iterations=20)
    np.testing.assert_allclose(result.q, np.zeros(7), atol=1e-15)
    assert not result.converged
    assert result.error == pytest.approx(3.0 - 1.953)


def test_too_large_a_rate_ends_with_finite_numbers():
    """A slider with a rate far above 2 diverges: the loop ends early, finite, unconverged."""
    table = DHTable([DHLink(kind="prismatic", lower=-1.0, upper=1.0)])
    for rate in (10.0, 1e300):
        result = baselines.gradient_descent_position(table, [0.0, 0.0, 0.5], [0.0], rate=rate)
        assert not result.converged
        assert result.iterations < 15
        assert np.isfinite(result.history).all()


def test_the_same_call_gives_the_same_answer():
    """Nothing random and no state: two calls agree to the bit, and arguments are left alone."""
    table = iiwa14()
    target, q0 = table.forward(np.full(7, 0.7)), np.full(7, 0.2)
    first, second = (baselines.gradient_descent_pose(table, target, q0, max_iterations=50) for _ in range(2))
    assert np.array_equal(first.history, second.history)
    assert np.array_equal(q0, np.full(7, 0.2))


@pytest.mark.parametrize(
    ("change", "error", "says"),
    [
        ({"target": np.zeros((4, 4))}, PoseError, "last row"),
        ({"q0": [0.0]}, ConfigurationError, "q0"),
        ({"rate": np.nan}, OptionError, "rate"),
        ({"max_step": -0.1}, OptionError, "max_step"),
        ({"position_tolerance": 0.0}, OptionError, "position_tolerance"),
        ({"orientation_tolerance": None}, OptionError, "orientation_tolerance"),
        ({"max_iterations": "9"}, OptionError, "max_iterations"),
    ],
)
def test_wrong_arguments_are_named(change, error, says):
    """Each wrong argument raises its own error, which names it."""
    with pytest.raises(error, match=says):
        baselines.gradient_descent_pose(maira(), **({"target": np.eye(4), "q0": np.zeros(7)} | change))


def test_sampled_targets_fill_their_box():
    """Every draw lies in the box, reaches near its sides, follows the seed, and a flat box is allowed."""
    bounds = [[-0.5, 0.5], [0.2, 0.3], [1.0, 1.0]]
    rng = np.random.default_rng(16)
    points = np.array([baselines.sample_target(bounds, rng) for _ in range(2000)])
    assert (points >= [-0.5, 0.2, 1.0]).all()
    assert (points <= [0.5, 0.3, 1.0]).all()
    np.testing.assert_allclose(np.ptp(points, axis=0), [1.0, 0.1, 0.0], rtol=0.02)
    np.testing.assert_allclose(points.mean(axis=0), [0.0, 0.25, 1.0], atol=0.02)
    again = baselines.sample_target(bounds, np.random.default_rng(16))
    assert np.array_equal(again, points[0])


def test_wrong_bounds_are_refused():
    """Inverted bounds and other shapes raise."""
    rng = np.random.default_rng(17)
    for bounds, says in (([[0, 1], [1, 0], [0, 1]], "least"), ([0, 1, 2], "shape"), ([[0, np.inf]] * 3, "finite")):
        with pytest.raises(OptionError, match=says):
            baselines.sample_target(bounds, rng)
