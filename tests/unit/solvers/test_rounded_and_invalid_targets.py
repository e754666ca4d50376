"""Targets as they come: rounded to a few decimals, or with nothing in them; what the answer says about them."""

import math
import pickle

import numpy as np
import pytest
from support.robots import load

import maira_qp as mq
from maira_qp.errors import PoseError


def rounded_targets(robot, rng, count, decimals):
    """Reachable targets (count, 4, 4) whose rotations are rounded, and the same with their nearest rotations."""
    T = np.array([robot.forward(robot.random_configuration(rng)).homogeneous for _ in range(count)])
    T[:, :3, :3] = np.round(T[:, :3, :3], decimals)
    return T, np.array([mq.pose(matrix=each).homogeneous for each in T])


@pytest.mark.parametrize("backend", [None, "daqp"])
def test_a_rounded_target_is_its_nearest_rotation_in_both_engines_and_the_answer_says_so(maira, rng, backend):
    """By solve, solve_batch and step, which agree; what is exact, or from single precision, is taken without a word."""
    T, exact = rounded_targets(maira, rng, 4, 3)
    solver = mq.Solver(maira, backend=backend)
    batch = solver.solve_batch(T)
    assert batch.success.all()
    for i in range(len(T)):
        s = solver.solve(T[i])
        assert s.q.tolist() == solver.solve(exact[i]).q.tolist() == batch.q[i].tolist() == batch[i].q.tolist()
        off = np.abs(T[i, :3, :3] @ T[i, :3, :3].T - np.eye(3)).max()
        assert s.target_deviation == batch.target_deviation[i] == batch[i].target_deviation == pytest.approx(off)
        assert 1e-5 < s.target_deviation < 2e-3
        assert s.as_dict()["target_deviation"] == s.target_deviation
        assert solver.solve(exact[i]).target_deviation == 0
        assert solver.step(s.q, T[i], 0.01).q == pytest.approx(solver.step(s.q, exact[i], 0.01).q, abs=1e-12)
    assert solver.solve(T[0], s.q, prefer="closest").target_deviation > 0
    single = exact.astype(np.float32).astype(float)
    assert solver.solve_batch(single).target_deviation.tolist() == [0] * 4
    off = exact[0].copy()
    off[:3, :3] *= 1.002
    for refused in (lambda: solver.solve(off), lambda: solver.solve_batch([off]), lambda: solver.step(s.q, off, 0.01)):
        with pytest.raises(PoseError, match="project=True"):
            refused()


@pytest.mark.parametrize("robot", ["maira", "panda", "tree"])
def test_a_batch_row_without_a_pose_is_answered_by_nan_and_spoils_no_other(robot, request, rng):
    """In the compiled engine, in the reference one, and of several frames, as arrays and as mappings."""
    made = load("baxter_arms") if robot == "tree" else request.getfixturevalue(robot)
    solver = mq.Solver(made)
    q = np.array([made.random_configuration(rng) for _ in range(4)])
    targets = {tip: np.array([made.forward(each, tip).homogeneous for each in q]) for tip in made.tips}
    whole = solver.solve_batch(targets if robot == "tree" else targets[made.tip], q)
    targets[made.tips[-1]][1, 0, 3] = np.nan
    targets[made.tip][2, 1, 1] = np.inf
    invalid = np.array([False, True, True, False])
    asked = [targets if robot == "tree" else targets[made.tip]]
    asked.append([{tip: T[i] for tip, T in targets.items()} for i in range(4)] if robot == "tree" else list(asked[0]))
    for each in asked:
        batch = solver.solve_batch(each, q)
        assert (batch.status == mq.Status.INVALID_TARGET).tolist() == invalid.tolist()
        assert batch.q[~invalid].tolist() == whole.q[~invalid].tolist()
        for name in ("q", "position_error", "orientation_error", "cost", "projected_gradient", "condition_number"):
            assert np.isnan(getattr(batch, name)[invalid]).all()
        assert not (batch.success | batch.optimal)[invalid].any()
        assert np.isfinite(batch.condition_number[~invalid]).all()
        assert [batch.active_limits[i] for i in (1, 2)] == [[], []]
        one = pickle.loads(pickle.dumps(batch))[1]
        assert one.status is mq.Status.INVALID_TARGET
        assert math.isnan(batch[1].condition_number)
        assert "NaN" in one.status.meaning
        assert "INVALID_TARGET" in repr(batch[1])
        assert batch[1].as_dict()["condition_number"] is None
        assert repr(batch)
    with pytest.raises(PoseError):
        solver.solve({tip: T[1] for tip, T in targets.items()})
