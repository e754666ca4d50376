"""The best configuration of an S-R-S arm for a pose, against all others."""

import numpy as np
import pytest

import maira_qp as mq
from maira_qp.analytic.srs.arcs import arcs
from maira_qp.analytic.srs.geometry import SRS
from maira_qp.analytic.srs.optimum import SampledArcs, best, nearest
from maira_qp.orientation import pose_error


@pytest.mark.parametrize("objective", [mq.Posture(), mq.LimitDistance(), mq.Manipulability()])
def test_nothing_on_a_fine_grid_is_better(iiwa14, rng, objective):
    """Of 200 points on every arc none costs less, and the best reaches the pose within the limits."""
    srs, ready = SRS.of(iiwa14), objective.of(iiwa14)
    T = iiwa14.forward(iiwa14.random_configuration(rng))
    found = best(srs, T, objective)
    grid = [arc.at(np.linspace(arc.lower, arc.upper, 200)) for arc in arcs(srs, T)]
    costs = np.array([ready.cost(iiwa14.at(q)) for q in np.concatenate(grid)])
    assert found.cost <= costs.min() + 1e-12
    assert found.cost > costs.min() - 0.05 * np.ptp(costs)
    assert np.abs(pose_error(iiwa14.forward(found.q), T)).max() < 1e-12
    assert ((iiwa14.lower <= found.q) & (found.q <= iiwa14.upper)).all()


def test_the_nearest_to_a_solution_is_itself(iiwa14, maira, rng):
    """Whatever the weights."""
    for robot in (iiwa14, maira):
        q = robot.random_configuration(rng)
        found = nearest(SRS.of(robot), robot.forward(q), q, rng.uniform(0.5, 2, 7))
        np.testing.assert_allclose(found.q, q, atol=1e-6)


def test_no_local_search_finds_better(iiwa14, rng):
    """The strict hierarchy ends at a local minimum of the posture: never below the global one."""
    srs, solver = SRS.of(iiwa14), mq.Solver(iiwa14, redundancy=mq.Strict(mq.Posture()))
    for _ in range(2):
        T = iiwa14.forward(iiwa14.random_configuration(rng))
        assert best(srs, T, mq.Posture()).cost <= solver.solve(T, rng=rng).cost + 1e-4


@pytest.mark.parametrize("weights", [None, [1.0, 0.0, 2.0, 0.5, 0.0, 0.0, 3.0]])
def test_leaving_out_arcs_by_their_bound_loses_nothing(iiwa14, rng, weights):
    """No arc costs less than its bound, and the best of all is the least of them."""
    srs = SRS.of(iiwa14)
    T = iiwa14.forward(iiwa14.random_configuration(rng))
    objective = mq.Posture(iiwa14.random_configuration(rng), weights).of(iiwa14)
    sampled = SampledArcs.of(srs, T, objective)
    costs = np.array([one.cost for one in sampled.refined(np.ones(len(sampled.arcs), bool))])
    assert (sampled.bounds <= costs).all()
    assert (sampled.bounds > costs.min()).any()
    assert best(srs, T, objective).cost == pytest.approx(costs.min(), rel=1e-12)


def test_where_nothing_reaches_nothing_is_best(iiwa14):
    """None, beyond the annulus."""
    assert best(SRS.of(iiwa14), mq.pose([2.0, 0.0, 0.0]), mq.Posture()) is None
