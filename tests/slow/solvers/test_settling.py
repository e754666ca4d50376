"""The redundancy: optimal along the self-motion under Strict, a measured trade-off under Weighted."""

import numpy as np
import pytest
from support.robots import load

import maira_qp as mq
from maira_qp.problem.objectives import Objective
from maira_qp.solvers.compiled import refinement

OBJECTIVES = {
    "posture": mq.Posture(),
    "limit distance": mq.LimitDistance(),
    "manipulability": mq.Manipulability(),
    "obstacle": mq.ObstacleDistance([0.3, 0.2, 0.5]),
}


def free_gradient(robot: mq.Robot, q: np.ndarray, gradient: np.ndarray) -> float:
    """Largest entry of the gradient along the self-motions that the active limits allow, by multipliers of its own.

    min over multipliers of the pose (any sign) and of the active limits (their sign): a non-negative least squares
    problem, solved by SciPy. Shares no code with the solver.
    """
    from scipy.optimize import lsq_linear

    J = robot.jacobian(q)
    low, high = q <= robot.lower + 1e-9, q >= robot.upper - 1e-9
    columns = np.hstack([J.T, -np.eye(robot.n)[:, low], np.eye(robot.n)[:, high]])
    bounds = np.concatenate([np.full(6, -np.inf), np.zeros(low.sum() + high.sum())])
    left = lsq_linear(columns, -gradient, bounds=(bounds, np.inf), tol=1e-14, lsmr_tol="auto").x
    return float(np.abs(columns @ left + gradient).max())


@pytest.mark.parametrize("name", OBJECTIVES)
@pytest.mark.parametrize("arm", ["maira", "panda", "xarm7"])
def test_strict_ends_where_the_objective_is_optimal_along_the_self_motion(arm, name):
    """Pose within tolerance, and no multiplier left over: limits active or not."""
    robot = mq.Robot.maira() if arm == "maira" else load(arm)
    solver, rng = mq.Solver(robot, redundancy=mq.Strict(OBJECTIVES[name])), np.random.default_rng(1)
    objective: Objective = OBJECTIVES[name].of(robot)
    at_a_limit = optimal = 0
    for k in range(40):
        T, q0 = robot.forward(robot.random_configuration(rng)), robot.random_configuration(rng)
        s = solver.solve(T, q0, rng=k)  # without q0 an S-R-S arm begins where no limit is in the way
        assert s.success
        assert max(s.position_error, s.orientation_error) <= 1e-6
        assert s.cost == pytest.approx(objective.cost(robot.at(s.q)), rel=1e-12)
        at_a_limit += bool(s.active_limits)
        if s.projected_gradient <= 1e-6:
            optimal += 1
            assert free_gradient(robot, s.q, objective.gradient(robot.at(s.q))) <= 1e-5
    assert optimal >= 39  # a self-motion may end in a singularity, where no projected gradient tells
    assert at_a_limit > 0 or name == "limit distance"


def test_what_a_fold_of_the_self_motion_holds_up_is_settled_from_its_other_side(monkeypatch):
    """The optimum is proved, the objective about as good, and in a batch as alone; all others stay as they were."""
    robot, rng = load("talos_arm"), np.random.default_rng(1)
    q = rng.uniform(*robot.drawn_range, (16000, robot.n))
    solver, targets = mq.Solver(robot, redundancy=mq.Strict(mq.Posture())), np.array(list(map(robot.forward, q)))
    batch = solver.solve_batch(targets)
    with monkeypatch.context() as patch:
        patch.setattr(refinement, "ELSEWHERE", 0)
        held_up = solver.solve_batch(targets)
    moved = np.flatnonzero((batch.q != held_up.q).any(axis=1))
    assert len(moved) >= 2
    assert batch.success.all()
    assert (~batch.optimal).sum() <= (~held_up.optimal).sum() - 2
    for i in moved:
        assert batch.restarts[i] > held_up.restarts[i]
        assert free_gradient(robot, batch.q[i], batch.q[i] - robot.middle) <= 1e-4
        assert batch.cost[i] <= 1.03 * held_up.cost[i]
        alone = solver.solve(targets[i])
        np.testing.assert_array_equal(alone.q, batch.q[i])
        assert alone.optimal
        begun = solver.solve(targets[i], q0=held_up.q[i])
        np.testing.assert_allclose(begun.q, held_up.q[i], atol=0.1)


@pytest.mark.parametrize("arm", ["tiago", "g1_arm", "panda_finger"])
def test_strict_is_optimal_with_several_redundant_degrees_of_freedom(arm):
    robot = load(arm)
    solver, rng = mq.Solver(robot, redundancy=mq.Strict(mq.Posture())), np.random.default_rng(2)
    optimal = 0
    for k in range(25):
        s = solver.solve(robot.forward(robot.random_configuration(rng)), rng=k)
        assert s.success
        optimal += s.projected_gradient <= 1e-6
        if s.projected_gradient <= 1e-6:
            assert free_gradient(robot, s.q, s.q - robot.middle) <= 1e-5
    assert optimal >= 24


def test_no_neighbour_on_the_self_motion_has_a_better_posture(maira, rng):
    """By trial: elbows swung a little to either side and brought back to the pose by Newton's method of the test."""
    solver = mq.Solver(maira, redundancy=mq.Strict(mq.Posture()))
    tried = 0
    for k in range(30):
        target = maira.forward(maira.random_configuration(rng))
        s = solver.solve(target, rng=k)
        for direction in (-1, 1):
            q = s.q + direction * 0.02 * np.linalg.svd(maira.jacobian(s.q))[2][-1]
            for _ in range(6):
                e = mq.pose_error(maira.forward(q).homogeneous, target.homogeneous)
                q = q + np.linalg.pinv(maira.jacobian(q)) @ e
            if np.abs(e).max() < 1e-9 and (q >= maira.lower).all() and (q <= maira.upper).all():
                tried += 1
                assert 0.5 * np.sum(q**2) >= s.cost - 1e-9
    assert tried > 30


def test_strict_improves_the_posture_of_the_pose_alone_and_keeps_the_pose(maira, rng):
    pose_only, strict = mq.Solver(maira), mq.Solver(maira, redundancy=mq.Strict(mq.Posture()))
    better = 0
    for k in range(40):
        target, q0 = maira.forward(maira.random_configuration(rng)), maira.random_configuration(rng)
        before, after = pose_only.solve(target, q0=q0, rng=k), strict.solve(target, q0=q0, rng=k)
        assert after.success
        assert after.cost <= 0.5 * np.sum(before.q**2) + 1e-4  # before.q may use its tolerance, 1e-6
        better += after.cost < 0.5 * np.sum(before.q**2) - 1e-3
    assert better > 30


def test_a_posture_that_reaches_the_target_is_found_from_nearby(maira, rng):
    """The optimum is known: the reference itself, cost 0."""
    for k in range(20):
        q_ref = 0.8 * maira.random_configuration(rng)
        q_ref[[1, 3, 5]] = 0.9 * rng.choice([-1, 1], size=3)  # far from singularities
        solver = mq.Solver(maira, redundancy=mq.Strict(mq.Posture(q_ref)))
        s = solver.solve(maira.forward(q_ref), q0=maira.clip(q_ref + 0.05 * rng.normal(size=7)), rng=k)
        assert np.abs(s.q - q_ref).max() <= 1e-5


def test_lower_objectives_act_only_where_higher_ones_leave_room(rng):
    """Torso and arm, 8 joints: first the torso's height, then the posture; the height is optimal as if alone."""
    robot = load("tiago")
    first = mq.Posture(weights=[1.0] + [0.0] * 7)
    alone, both = (mq.Solver(robot, redundancy=mq.Strict(*o)) for o in ([first], [first, mq.Posture()]))
    lower = 0
    for k in range(15):
        target, q0 = robot.forward(robot.random_configuration(rng)), robot.random_configuration(rng)
        a, b = alone.solve(target, q0=q0, rng=k), both.solve(target, q0=q0, rng=k)
        assert b.success
        posture = [mq.Posture().of(robot).cost(robot.at(s.q)) for s in (a, b)]
        assert b.cost <= a.cost + 1e-6
        lower += posture[1] < posture[0] - 1e-3
    assert lower > 5


def test_the_residual_of_weighted_is_of_the_order_of_its_weight(maira, rng):
    """Ten times the weight, up to ten times the pose error (less near a singularity), and less posture cost."""
    for k in range(10):
        target, q0 = maira.forward(maira.random_configuration(rng)), maira.random_configuration(rng)
        answers = [
            mq.Solver(maira, redundancy=mq.Weighted(mq.Posture(), w)).solve(target, q0=q0, rng=k)
            for w in (1e-10, 1e-5, 1e-4, 1e-3)
        ]
        errors = [max(s.position_error, s.orientation_error) for s in answers]
        costs = [s.cost for s in answers]
        assert answers[0].status is mq.Status.CONVERGED
        assert answers[3].status is mq.Status.NEAREST
        assert not answers[3].success
        assert 2 < errors[2] / errors[1] < 20
        assert costs == sorted(costs, reverse=True)


def test_weighted_is_stationary_for_the_weighted_sum(maira, rng):
    """`P(-J^T W^2 e + w (q - q_ref)) = 0` by the test's own arithmetic."""
    w = 1e-2
    solver = mq.Solver(maira, redundancy=mq.Weighted(mq.Posture(), w))
    for k in range(30):
        target = maira.forward(maira.random_configuration(rng))
        s = solver.solve(target, rng=k)
        e = mq.pose_error(maira.forward(s.q).homogeneous, target.homogeneous)
        g = -maira.jacobian(s.q).T @ (solver.tasks[0].weights ** 2 * e) + w * s.q
        left = np.where((s.q <= maira.lower) & (g > 0) | (s.q >= maira.upper) & (g < 0), 0.0, g)
        assert np.abs(left).max() <= 1e-6


def test_weighted_tends_to_strict_as_its_weight_falls(maira, rng):
    strict = mq.Solver(maira, redundancy=mq.Strict(mq.Posture()))
    weighted = mq.Solver(maira, redundancy=mq.Weighted(mq.Posture(), 1e-9))
    for k in range(20):
        target, q0 = maira.forward(maira.random_configuration(rng)), maira.random_configuration(rng)
        a, b = strict.solve(target, q0=q0, rng=k), weighted.solve(target, q0=q0, rng=k)
        assert b.success
        assert a.cost == pytest.approx(b.cost, abs=1e-4)


def test_a_robot_without_redundancy_is_left_where_it_is(ur5, rng):
    target, q0 = ur5.forward(ur5.random_configuration(rng)), ur5.random_configuration(rng)
    a = mq.Solver(ur5).solve(target, q0=q0)
    b = mq.Solver(ur5, redundancy=mq.Strict(mq.Posture())).solve(target, q0=q0)
    assert b.success
    assert np.abs(a.q - b.q).max() < 1e-5
    assert b.projected_gradient <= 1e-6


def test_an_unreachable_target_is_not_settled(maira):
    s = mq.Solver(maira, redundancy=mq.Strict(mq.Posture()), options=mq.Options(max_restarts=2)).solve(
        mq.pose([3, 0, 0])
    )
    assert s.status is mq.Status.UNREACHABLE
    assert s.optimal
    assert s.cost == pytest.approx(0.5 * np.sum(s.q**2))


def test_a_third_level_is_as_good_as_the_two_above_it_allow(maira):
    """Position, then manipulability, then posture: against SciPy's SLSQP, which may give up 1e-9 of manipulability."""
    from scipy.optimize import minimize

    rng = np.random.default_rng(3)
    solver = mq.Solver(maira, task=mq.PositionTask(), redundancy=mq.Strict(mq.Manipulability(), mq.Posture()))
    for k in range(4):
        target, q0 = maira.forward(maira.random_configuration(rng)), maira.random_configuration(rng)
        s = solver.solve(target, q0=q0, rng=k)
        assert s.success
        reference = minimize(
            lambda q: 0.5 * q @ q,
            s.q,
            jac=lambda q: q,
            method="SLSQP",
            bounds=list(zip(maira.lower, maira.upper, strict=True)),
            constraints=[
                {"type": "eq", "fun": lambda q, p=target.translation: 100 * (maira.forward(q).translation - p)},
                {"type": "ineq", "fun": lambda q, w=-s.cost: 100 * (maira.manipulability(q) - w + 1e-9)},
            ],
            options={"maxiter": 300, "ftol": 1e-12},
        )
        assert reference.success
        assert 0.5 * s.q @ s.q <= reference.fun + 5e-3
