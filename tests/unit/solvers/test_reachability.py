"""Verdicts without the rest of a solve are those of the solve."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import maira_qp as mq
from maira_qp.errors import PoseError
from maira_qp.solvers.reachability import reachability


def poses(robot: mq.Robot, count: int, rng: np.random.Generator, share: float = 1.2) -> np.ndarray:
    """Random poses within so many lengths of the arm."""
    T = np.tile(np.eye(4), (count, 1, 1))
    T[:, :3, :3] = Rotation.random(count, random_state=5).as_matrix()
    T[:, :3, 3] = rng.uniform(-share, share, (count, 3)) * robot.length / 2 + [0, 0, 0.3]
    return T


@pytest.mark.parametrize("make", [mq.Robot.maira, mq.Robot.iiwa14])
def test_verdicts_of_srs_arms_are_those_of_a_solve_and_configurations_reach(make, rng):
    robot = make()
    solver, T = mq.Solver(robot), poses(robot, 3000, rng)
    found = reachability(solver, T)
    batch = solver.solve_batch(T)
    np.testing.assert_array_equal(found.verdict == mq.Reach.REACHABLE, batch.success)
    np.testing.assert_array_equal(found.verdict == mq.Reach.UNREACHABLE, batch.status == mq.Status.UNREACHABLE)
    reached = found.verdict == mq.Reach.REACHABLE
    assert 0.2 < reached.mean() < 0.95
    assert np.isnan(found.q[~reached]).all()
    assert ((robot.lower <= found.q[reached]) & (found.q[reached] <= robot.upper)).all()
    for q, target in zip(found.q[reached][:100], T[reached], strict=False):
        error = mq.pose_error(robot.forward(q), target)
        assert np.linalg.norm(error[:3]) <= 1e-6
        assert np.linalg.norm(error[3:]) <= 1e-6


def test_other_arms_and_redundancies_are_solved(ur5, rng):
    T = poses(ur5, 40, rng)
    for solver in (mq.Solver(ur5), mq.Solver(mq.Robot.maira(), redundancy=mq.Strict(mq.Posture()))):
        found, batch = reachability(solver, T), solver.solve_batch(T)
        np.testing.assert_array_equal(found.verdict == mq.Reach.REACHABLE, batch.success)
        np.testing.assert_array_equal(found.verdict == mq.Reach.UNREACHABLE, batch.status == mq.Status.UNREACHABLE)


def test_chains_without_proofs_reach_the_same_and_leave_the_rest_undecided(panda, rng):
    T = poses(panda, 60, rng)
    solver = mq.Solver(panda, options=mq.Options(max_restarts=20))
    whole, batch = reachability(solver, T), solver.solve_batch(T)
    np.testing.assert_array_equal(whole.verdict == mq.Reach.REACHABLE, batch.success)
    np.testing.assert_array_equal(whole.verdict == mq.Reach.UNREACHABLE, batch.status == mq.Status.UNREACHABLE)
    assert len(set(whole.verdict.tolist())) == 3
    np.testing.assert_allclose(whole.q[batch.success], batch.q[batch.success], atol=1e-9)
    quick = reachability(solver, T, proof_boxes=0)
    np.testing.assert_array_equal(quick.verdict == mq.Reach.REACHABLE, batch.success)
    assert (quick.verdict[~batch.success] == mq.Reach.UNDECIDED).all()
    T[3] = np.nan
    assert reachability(solver, T, proof_boxes=0).verdict[3] == mq.Reach.UNDECIDED


def test_singular_poses_are_left_to_the_solve(maira):
    """The arm stretched upwards: the shoulder's axes are in line."""
    found = reachability(mq.Solver(maira), [maira.forward(np.zeros(7)), maira.forward([0.3, 0, 0.2, 1.0, 0, 0.5, 0])])
    assert (found.verdict == mq.Reach.REACHABLE).all()


def test_a_pose_with_nan_is_undecided_and_spoils_no_other(maira, rng):
    T = poses(maira, 6, rng)
    clean = reachability(mq.Solver(maira), T)
    T[2, 0, 3] = np.nan
    found = reachability(mq.Solver(maira), T)
    assert found.verdict[2] == mq.Reach.UNDECIDED
    others = np.arange(6) != 2
    np.testing.assert_array_equal(found.verdict[others], clean.verdict[others])
    T[1, :3, :3] *= 2.0
    with pytest.raises(PoseError, match="target 1"):
        reachability(mq.Solver(maira), T)


def test_no_verdict_depends_on_threads_or_on_how_poses_are_split(maira, rng):
    T = poses(maira, 9000, rng)
    whole = reachability(mq.Solver(maira), T, threads=2)
    parts = [reachability(mq.Solver(maira), T[k : k + 1234], threads=1) for k in range(0, 9000, 1234)]
    assert np.concatenate([part.q for part in parts]).tobytes() == whole.q.tobytes()
    assert np.concatenate([part.verdict for part in parts]).tobytes() == whole.verdict.tobytes()
