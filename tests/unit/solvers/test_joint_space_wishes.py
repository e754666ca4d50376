"""Gains of postures and matrices as joint weights: what ticks and solves make of them, in both engines."""

import pickle

import numpy as np
import pytest
from support.robots import load

import maira_qp as mq

BACKENDS = [None, "daqp"]


def definite(rng, n):
    A = rng.normal(size=(n, n))
    return A @ A.T + 0.1 * np.eye(n)


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("kind", ["strict", "lower level", "limit distance"])
def test_a_gain_is_the_rate_at_which_joints_return(maira, backend, kind, rng):
    """With one row a above: v = gain (d - W^-1 a (a d) / (a W^-1 a)), d = q_ref - q, and for any dt the same."""
    robot, gain = maira, 0.25
    q_ref, weights = robot.middle + 0.2, rng.uniform(0.5, 2.0, 7)
    posture = mq.Posture(q_ref, weights, gain=gain)
    if kind == "limit distance":
        posture, q_ref, weights = mq.LimitDistance(gain=gain), robot.middle, (robot.upper - robot.lower) ** -2
    lower = {"tasks": [mq.ObjectiveTask(posture, priority=2)]} if kind == "lower level" else {}
    redundancy = None if kind == "lower level" else mq.Strict(posture)
    a = 1.0 + 0.3 * np.arange(7)
    task = mq.JointCouplingTask(coefficients=dict(zip(robot.joint_names, a, strict=True)), value=0.3)
    solver = mq.Solver(robot, task=task, redundancy=redundancy, backend=backend, **lower)
    q = robot.middle + rng.uniform(-0.3, 0.3, 7)
    q += a * (0.3 - a @ q) / (a @ a)  # the row is met
    d = q_ref - q
    expected = gain * (d - (a / weights) * (a @ d) / (a @ (a / weights)))
    for dt in (1e-3, 1e-2, 0.1):
        step = solver.step(q, dt=dt)
        assert step.backend == ("compiled" if backend is None else backend)
        assert np.abs(step.velocity - expected).max() < 1e-5
    assert pickle.loads(pickle.dumps(solver)).step(q, dt=0.1).velocity.tolist() == step.velocity.tolist()


@pytest.mark.parametrize("name", ["maira", "panda", "talos_arm"])
def test_both_engines_take_the_same_ticks_with_a_gain(name, rng):
    robot = mq.Robot.maira() if name == "maira" else load(name)
    for redundancy in (mq.Strict(mq.Posture(gain=2.0)), mq.Weighted(mq.Posture(gain=0.5), 1e-2)):
        solvers = [mq.Solver(robot, redundancy=redundancy, backend=backend) for backend in BACKENDS]
        for dt in (0.002, 0.05, 2.0):
            q = robot.random_configuration(rng)
            target = robot.forward(robot.random_configuration(rng))
            steps = [s.step(q, target, dt) for s in solvers]
            assert np.abs(steps[0].velocity - steps[1].velocity).max() < 1e-5
            assert [s.backend for s in steps] == ["compiled", "daqp"]


def test_a_gain_lets_a_posture_decay_as_a_differential_equation_does(maira):
    """With the pose held, the distance to the optimum along the self-motion falls like exp(-gain t), for any dt."""
    target = maira.forward(maira.middle + 0.4)
    wish = mq.Posture(maira.middle, gain=2.0)
    solver = mq.Solver(maira, redundancy=mq.Strict(wish))
    best = solver.solve(target, maira.middle + 0.4)
    start = mq.Solver(maira).solve(target, best.q + 0.15 * np.sin(np.arange(7)))
    left = []
    for dt in (0.01, 0.04):
        q = start.q
        for _ in range(round(0.5 / dt)):
            q = solver.step(q, target, dt).q
        left.append(np.linalg.norm(q - best.q) / np.linalg.norm(start.q - best.q))
    assert left == pytest.approx([np.exp(-1.0)] * 2, rel=0.15)


@pytest.mark.parametrize("name", ["maira", "panda"])
def test_a_posture_with_a_matrix_is_settled_where_its_gradient_vanishes(name, rng):
    """M (q - q_ref) is in the row space of the Jacobian, and no start leads to a lower value."""
    robot = mq.Robot.maira() if name == "maira" else load(name)
    M = definite(rng, robot.n)
    solver = mq.Solver(robot, redundancy=mq.Strict(mq.Posture(weights=M)))
    assert "no posture with joint weights" in solver.engine_for().reason
    assert solver.engine_for("step").engine == "daqp"
    assert "matrix" in solver.engine_for("step").reason
    for _ in range(5):
        q = robot.middle + rng.uniform(-0.4, 0.4, robot.n)
        s = solver.solve(robot.forward(q), q)
        assert s.success
        assert s.optimal
        gradient, J = M @ (s.q - robot.middle), robot.jacobian(s.q)
        free = (s.q > robot.lower) & (s.q < robot.upper)
        Z = np.linalg.svd(J[:, free])[2][np.linalg.matrix_rank(J[:, free]) :]
        assert np.abs(Z @ gradient[free]).max(initial=0.0) < 1e-4
        assert s.cost <= 0.5 * (q - robot.middle) @ M @ (q - robot.middle) + 1e-9


def test_the_closest_in_a_matrix_is_the_least_of_all_that_are_sampled(maira, rng):
    M, solver = definite(rng, 7), mq.Solver(maira)
    for _ in range(3):
        q0, target = maira.random_configuration(rng), maira.forward(maira.random_configuration(rng))
        s = solver.solve(target, q0, prefer="closest", metric=M)
        assert s.success
        others = mq.Solver(maira).solve_batch([target] * 300, [maira.random_configuration(rng) for _ in range(300)])
        d = others.q[others.success] - q0
        assert s.cost <= 0.5 * np.einsum("ki,ij,kj->k", d, M, d).min() + 1e-9
        assert s.cost == pytest.approx(0.5 * (s.q - q0) @ M @ (s.q - q0))
        diagonal = solver.solve(target, q0, prefer="closest", metric=np.diag([1.0, 2, 3, 4, 5, 6, 7]))
        assert (
            diagonal.q.tolist() == solver.solve(target, q0, prefer="closest", metric=[1, 2, 3, 4, 5, 6, 7]).q.tolist()
        )


def test_a_tick_damped_by_a_matrix_is_the_dynamically_consistent_one(maira, rng):
    """The velocity of least 1/2 v^T M v that the task asks for: M^-1 J^T (J M^-1 J^T)^-1 e / dt."""
    robot, M, dt = maira, definite(rng, 7), 1.0
    q = robot.middle + rng.uniform(-0.3, 0.3, 7)
    p = robot.forward(q).translation + 1e-4 * np.array([1.0, -2.0, 1.0])
    target = mq.pose(p)
    solver = mq.Solver(robot, task=mq.PositionTask(), tasks=[mq.DampingTask(metric=M, priority=2)])
    assert solver.engine_for("step").engine == "daqp"
    J, e = robot.jacobian(q)[:3], p - robot.forward(q).translation
    W = np.linalg.solve(M, J.T)
    expected = W @ np.linalg.solve(J @ W, e) / dt
    velocity = solver.step(q, target, dt).velocity
    assert np.abs(velocity - expected).max() < 1e-3 * np.abs(expected).max()
    weights = rng.uniform(0.5, 2.0, 7)
    by_weights, by_matrix = (
        mq.Solver(robot, task=mq.PositionTask(), tasks=[task]).step(q, target, dt).velocity
        for task in (mq.DampingTask(weight=weights), mq.DampingTask(metric=np.diag(weights**2)))
    )
    assert np.abs(by_weights - by_matrix).max() < 1e-8
