"""The best configuration of an S-R-S arm for a pose, against all others."""

import numpy as np
import pytest

import maira_qp as mq
from maira_qp.orientation import pose_error
from maira_qp.robots.arcs import arcs
from maira_qp.robots.srs import SRS
from maira_qp.solvers.self_motion import best, nearest


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


def test_where_nothing_reaches_nothing_is_best(iiwa14):
    """None, beyond the annulus."""
    assert best(SRS.of(iiwa14), mq.pose([2.0, 0.0, 0.0]), mq.Posture()) is None


def test_a_solver_lists_its_solutions_best_first(maira, rng):
    """Each reaches the pose within the limits; none is better than the first, nor is what `solve` settles at."""
    solver = mq.Solver(maira, redundancy=mq.Strict(mq.Posture()))
    target = maira.forward(maira.random_configuration(rng))
    found = solver.solutions(target)
    costs = [one.cost for one in found]
    assert costs == sorted(costs)
    assert costs[0] <= solver.solve(target).cost + 1e-9
    for one in found:
        assert np.abs(pose_error(maira.forward(one.q), target)).max() < 1e-12
        assert ((maira.lower <= one.q) & (one.q <= maira.upper)).all()
    assert solver.solutions(mq.pose([5, 0, 0])) == []


def test_other_arms_and_tasks_have_no_solutions_to_list(maira, ur5):
    target = maira.forward(maira.middle)
    for solver, message in [
        (mq.Solver(ur5), "S-R-S"),
        (mq.Solver(maira, task=mq.PositionTask()), "PoseTask"),
        (mq.Solver(maira, tasks=[mq.DampingTask()]), "PoseTask"),
        (mq.Solver(maira, limits=[mq.LinearLimit(np.eye(7), np.full(7, 9.0))]), "joint limits"),
    ]:
        with pytest.raises(mq.errors.OptionError, match=message):
            solver.solutions(target)
