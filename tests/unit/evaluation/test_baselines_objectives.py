"""The null-space objectives of the reference methods, their values and gradients by independent formulas."""

from itertools import pairwise

import numpy as np
import pytest

from maira_qp.errors import ConfigurationError, OptionError
from maira_qp.evaluation import baselines
from maira_qp.robots.dh.table import DHLink, DHTable
from maira_qp.robots.model.catalog import iiwa14, maira

MIXED = DHTable(
    [
        DHLink(a=0.4, alpha=0.3),
        DHLink(kind="prismatic", d=0.1, theta=0.4, a=0.1, alpha=-0.7, lower=-1.0, upper=2.0),
        DHLink(kind="fixed", a=0.2, alpha=0.5),
        DHLink(kind="continuous", a=0.3, d=0.2, alpha=1.1),
        DHLink(d=0.2, alpha=1.5, lower=0.3, upper=0.3),
        DHLink(a=0.1, alpha=-1.2),
        DHLink(kind="prismatic", a=0.2, alpha=0.8, lower=0.0, upper=0.4),
        DHLink(d=0.15, a=0.05),
    ]
)
TABLES = pytest.mark.parametrize("table", [maira(), iiwa14(), MIXED], ids=["maira", "iiwa14", "mixed"])


def draw(table, rng):
    return rng.uniform(np.maximum(table.lower, -np.pi), np.minimum(table.upper, np.pi))


def numerical_gradient(function, q, step=1e-6):
    return np.array([(function(q + d) - function(q - d)) / (2 * step) for d in step * np.eye(len(q))])


@TABLES
def test_manipulability_is_the_root_of_the_determinant(table):
    """The product of singular values equals sqrt(det(J J^T)) with the finite-difference Jacobian."""
    rng = np.random.default_rng(18)
    for _ in range(20):
        q = draw(table, rng)
        J = table.finite_difference_jacobian(q)
        assert baselines.manipulability(table, q) == pytest.approx(np.sqrt(np.linalg.det(J @ J.T)), abs=1e-7)


@TABLES
def test_manipulability_gradient(table):
    """It equals central differences of the manipulability, prismatic and fixed links included."""
    rng = np.random.default_rng(19)
    for _ in range(20):
        q = draw(table, rng)
        numerical = numerical_gradient(lambda x: baselines.manipulability(table, x), q)
        np.testing.assert_allclose(baselines.manipulability_gradient(table, q), numerical, atol=1e-8)


def test_manipulability_has_no_gradient_where_it_has_a_kink():
    """At the stretched arm, and with fewer than six joints, the value is 0 and the gradient zero, with no warning."""
    planar = DHTable([DHLink(a=1.0), DHLink(a=1.0)])
    for table in (maira(), iiwa14(), planar):
        assert baselines.manipulability(table, np.zeros(table.n)) == pytest.approx(0.0, abs=1e-12)
        assert not baselines.manipulability_gradient(table, np.zeros(table.n)).any()
    assert not baselines.manipulability_gradient(planar, [0.3, 0.9]).any()


def test_manipulability_rises_along_its_gradient_in_the_null_space():
    """Used by the null-space method, it ends with a larger manipulability than Newton alone in most of 15 cases."""
    table = maira()
    rng = np.random.default_rng(20)
    higher = 0
    for _ in range(15):
        q = 0.7 * draw(table, rng)
        target = table.forward(q)
        far = q + 0.3 * rng.normal(size=7)
        plain = baselines.newton_pose(table, target, far)
        climbed = baselines.newton_null_space(
            table, target, far, lambda x: baselines.manipulability_gradient(table, x), alpha=2.0
        )
        higher += baselines.manipulability(table, climbed.q) > baselines.manipulability(table, plain.q)
    assert higher >= 10


def test_limit_distance_values():
    """0 in the middle of the ranges, -1/8 with every joint at a limit, whatever the ranges are."""
    for table in (maira(), iiwa14(), DHTable([DHLink(lower=0.5, upper=2.5), DHLink(lower=-1.0, upper=0.0)])):
        assert baselines.limit_distance(table, (table.lower + table.upper) / 2) == 0.0
        for corner in (table.lower, table.upper):
            assert baselines.limit_distance(table, corner) == pytest.approx(-1 / 8)


@TABLES
def test_limit_distance_gradient(table):
    """It equals central differences; joints without limits and locked ones have none."""
    rng = np.random.default_rng(21)
    for _ in range(10):
        q = draw(table, rng) + 0.1
        gradient = baselines.limit_distance_gradient(table, q)
        numerical = numerical_gradient(lambda x: baselines.limit_distance(table, x), q)
        np.testing.assert_allclose(gradient, numerical, atol=1e-9)
        span = table.upper - table.lower
        assert (gradient[(span == 0) | np.isinf(span)] == 0).all()
        assert np.isfinite(gradient).all()


@TABLES
def test_obstacle_distance_is_the_least_over_the_arm(table):
    """It equals the least distance to points laid densely along the links, from the transforms."""
    rng = np.random.default_rng(22)
    s = np.linspace(0, 1, 4001)[:, None]
    for _ in range(10):
        q, obstacle = draw(table, rng), rng.uniform(-1, 1, 3)
        origins = table.compute_htms(q)[:, :3, 3]
        points = np.concatenate([a + s * (b - a) for a, b in pairwise(origins)])
        dense = np.linalg.norm(points - obstacle, axis=1).min()
        assert dense - 1e-6 <= baselines.obstacle_distance(table, q, obstacle) <= dense + 1e-12


@TABLES
def test_obstacle_distance_gradient(table):
    """It equals central differences, in the middle of a link and at its ends."""
    rng = np.random.default_rng(23)
    moving = 0
    for _ in range(40):
        q, obstacle = draw(table, rng), rng.uniform(-1.5, 1.5, 3)
        gradient = baselines.obstacle_distance_gradient(table, q, obstacle)
        numerical = numerical_gradient(lambda x, o=obstacle: baselines.obstacle_distance(table, x, o), q)
        np.testing.assert_allclose(gradient, numerical, atol=1e-7)
        moving += bool(np.abs(gradient).max() > 0.1)
    assert moving >= 10


def test_an_obstacle_that_the_arm_touches_gives_no_gradient():
    """On the arm the distance is 0 and has no direction."""
    assert baselines.obstacle_distance(maira(), np.zeros(7), [0.0, 0.0, 1.0]) == 0.0
    assert not baselines.obstacle_distance_gradient(maira(), np.zeros(7), [0.0, 0.0, 1.0]).any()


@pytest.mark.parametrize("function", [baselines.manipulability, baselines.limit_distance_gradient])
def test_wrong_configurations_are_refused(function):
    """The shape of q is checked."""
    with pytest.raises(ConfigurationError, match="shape"):
        function(maira(), np.zeros(6))


def test_wrong_obstacles_are_refused():
    """An obstacle is a finite point."""
    with pytest.raises(OptionError, match="obstacle"):
        baselines.obstacle_distance(maira(), np.zeros(7), [0.0, np.inf, 0.0])
    with pytest.raises(OptionError, match="obstacle"):
        baselines.obstacle_distance_gradient(maira(), np.zeros(7), [0.0, 0.0])
