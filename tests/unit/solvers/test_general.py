"""What an answer of the reference engine rests on: tolerances, verdict, limits, each by itself."""

import numpy as np
import pytest

import maira_qp as mq

OUTCOME = [1.0, *[0.0] * 8]
"""What a compiled search leaves where it has reached the target at once."""


@pytest.mark.parametrize(("position", "orientation"), [(1e-3, 1e-7), (1e-7, 1e-3)])
def test_each_error_is_compared_with_its_own_tolerance(maira, position, orientation, rng):
    """Starts that are off by less than one tolerance and more than the other do not count as there."""
    options = mq.Options(position_tolerance=position, orientation_tolerance=orientation)
    solver = mq.Solver(maira, options=options, backend="daqp")
    q = np.array([0.3, 0.5, -0.2, 1.1, 0.4, 0.7, 0.2])
    here = maira.forward(q)
    moved, turned = here.copy(), here.copy()
    moved.translation = here.translation + np.array([0, 0, 1e-5])
    turned.rotation = here.rotation @ mq.pose([0, 0, 0], rpy=[0, 0, 1e-5]).rotation
    for target in (moved, turned, here):
        s = solver.solve(target, q)
        assert s.success
        error = mq.pose_error(maira.forward(s.q), target)
        assert np.linalg.norm(error[:3]) <= position
        assert np.linalg.norm(error[3:]) <= orientation


def test_a_proof_goes_before_a_nearest_point(maira):
    """A target that is proved to be out of reach is told as such also where the answer is stationary."""
    target = mq.pose([3.0, 0.0, 0.5], quaternion=[0, 1, 0, 0])
    for backend in (None, "daqp"):
        s = mq.Solver(maira, backend=backend, options=mq.Options(max_restarts=2)).solve(target)
        assert s.optimal
        assert s.status is mq.Status.UNREACHABLE


@pytest.mark.parametrize("redundancy", [None, mq.Strict(mq.Manipulability())], ids=["none", "strict"])
def test_what_is_returned_is_inside_the_limits_wherever_a_search_ended(maira, redundancy):
    """A search that ends beyond a limit by rounding, or by more."""
    solver = mq.Solver(maira, redundancy=redundancy)
    for beyond in (np.nextafter(maira.upper, np.inf), maira.upper + 1e-9, maira.lower - 1e-9):
        target = solver.problem.target(maira.forward(maira.clip(beyond))).rows[0]
        s = solver.engines.reference.finish(beyond, OUTCOME, target)
        assert (maira.lower <= s.q).all()
        assert (s.q <= maira.upper).all()
