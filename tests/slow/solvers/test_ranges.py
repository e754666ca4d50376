"""Limits of where a frame is, hard and soft, in solves and ticks, judged by NumPy and by SciPy's SLSQP."""

import numpy as np
import pytest
from scipy.optimize import minimize
from support.placement_limits import limits_about, outside
from support.robots import load

import maira_qp as mq

KINDS = list(limits_about(mq.pose(), "").keys())
FEW = mq.Options(max_restarts=10)


def robot_of(name: str) -> mq.Robot:
    return mq.Robot.maira() if name == "maira" else load(name)


def scene(robot: mq.Robot, kind: str, rng: np.random.Generator):
    """A pose, the limit about it, a configuration at it and a target outside, as {tip: pose}."""
    tip = robot.tips[0]
    q = robot.middle + 0.6 * (robot.random_configuration(rng) - robot.middle)
    T = robot.forward(q, tip)
    away = robot.clip(q + 0.6 * rng.normal(size=robot.n))
    return T, limits_about(T, tip)[kind], q, {each: robot.forward(away, each) for each in robot.tips}


def best_near(robot: mq.Robot, cost, gradient, limit: mq.Limit, q: np.ndarray) -> float:
    """The least cost that SciPy finds from q (n,) within the limits."""
    bound = limit.of(robot)
    inside = {
        "type": "ineq",
        "fun": lambda x: bound.rows(robot.at(x), None)[1],
        "jac": lambda x: -bound.rows(robot.at(x), None)[0],
    }
    box = list(zip(robot.lower, robot.upper, strict=True))
    found = minimize(
        cost, q, jac=gradient, bounds=box, constraints=inside, method="SLSQP", options={"ftol": 1e-14, "maxiter": 300}
    )
    return float(found.fun) if bound.violation(robot.at(found.x)) < 1e-7 else np.inf


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("name", ["maira", "ur5"])
def test_a_solve_ends_at_the_nearest_point_within_the_limit(name, kind, rng):
    """From a start inside and one outside: inside, stationary, and SciPy finds nothing better near."""
    robot = robot_of(name)
    T, limit, q, target = scene(robot, kind, rng)
    solver = mq.Solver(robot, limits=[limit], options=FEW)
    task = solver.tasks[0].toward(target)
    for q0 in (q, robot.clip(q + 0.3 * rng.normal(size=robot.n))):
        s = solver.solve(target, q0=q0)
        assert outside(kind, T, robot.forward(s.q)) <= 0
        assert s.broken_limits == {}
        if s.success:  # the target is within the limit
            continue
        assert s.status is mq.Status.NEAREST

        def cost(x):
            return 0.5 * float(np.sum(task.weighted_error(robot.at(x)) ** 2))

        def gradient(x):
            A, r = task.rows(robot.at(x))
            return -(A.T @ r)

        assert cost(s.q) <= best_near(robot, cost, gradient, limit, s.q) + 1e-6
        assert any(type(limit).__name__ in each for each in s.active_limits)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(("name", "acceleration"), [("maira", None), ("maira", 5.0), ("panda", None)])
def test_ticks_stay_within_the_limit_and_slide_along_it(name, acceleration, kind, rng):
    """Toward a target outside: never left, and at rest at the nearest point around."""
    robot = robot_of(name)
    robot = robot if acceleration is None else robot.limited(acceleration=acceleration)
    T, limit, q, target = scene(robot, kind, rng)
    solver = mq.Solver(robot, limits=[limit], redundancy=mq.Strict(mq.Posture()))
    v = np.zeros(robot.n)
    for _ in range(60):
        t = solver.step(q, target, 0.03, velocity=v)
        q, v = t.q, t.velocity
        assert outside(kind, T, robot.forward(q)) <= 1e-12
        assert (robot.lower <= q).all()
        assert (q <= robot.upper).all()
    if name == "maira" and acceleration is None:
        assert t.status in (mq.StepStatus.NEAREST, mq.StepStatus.ARRIVED)


def test_no_tick_of_a_long_way_to_a_stop_is_outside(maira):
    """Joints that stop one after another: the way to a stop bends the most between ticks that are looked at first."""
    robot, rng = maira.limited(acceleration=10.0), np.random.default_rng(1)
    q, v = rng.uniform(robot.lower, robot.upper), np.zeros(robot.n)
    centre = robot.forward(q).translation
    solver = mq.Solver(robot, limits=[mq.DistanceLimit(point=centre, upper=0.15)])
    for leg in range(2):
        target = robot.forward(rng.uniform(robot.lower, robot.upper))
        if rng.random() < 0.5:
            target = robot.forward(q)
            target.translation += 0.5 * rng.normal(size=3)
        for _ in range(60 - 30 * leg):
            t = solver.step(q, target, 0.01, velocity=v)
            q, v = t.q, t.velocity
            assert np.linalg.norm(robot.forward(q).translation - centre) <= 0.15 + 1e-9


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("name", ["maira", "tiago"])
def test_ticks_come_back_from_outside(name, kind, rng):
    """No part is broken further in any tick, and in the end none is."""
    robot = robot_of(name)
    T, limit, q, target = scene(robot, kind, rng)
    bound, solver = limit.of(robot), mq.Solver(robot, limits=[limit])
    q = robot.clip(q + 0.1 * rng.normal(size=robot.n))
    before = bound.violations(robot.at(q))
    for _ in range(80):
        q = solver.step(q, target, 0.03).q
        now = bound.violations(robot.at(q))
        assert (now <= before + 1e-9).all()
        before = now
        if outside(kind, T, robot.forward(q)) <= -1e-3:
            break
    assert outside(kind, T, robot.forward(q)) <= 1e-9


@pytest.mark.parametrize("kind", KINDS)
def test_anywhere_within_a_limit_in_the_posture_that_is_preferred(kind, maira, rng):
    """As the first level: converged means inside, the posture is optimal, and ticks come to rest at it."""
    T, limit, q, _ = scene(maira, kind, rng)
    q_ref = maira.clip(maira.middle + 0.3 * rng.normal(size=7))
    solver = mq.Solver(maira, task=mq.LimitTask(limit=limit), redundancy=mq.Strict(mq.Posture(q_ref)))
    for q0 in (None, q):
        s = solver.solve(q0=q0)
        assert s.status is mq.Status.CONVERGED
        assert outside(kind, T, maira.forward(s.q)) <= 0
        best = best_near(maira, lambda x: 0.5 * (x - q_ref) @ (x - q_ref), lambda x: x - q_ref, limit, s.q)
        assert s.cost <= best + 1e-6
    q = maira.clip(s.q + 0.1 * rng.normal(size=7))
    for _ in range(60):
        t = solver.step(q, None, 0.05)
        q = t.q
    assert outside(kind, T, maira.forward(q)) <= 1e-5
    assert np.abs(t.velocity).max() < 0.1
    alone = mq.Solver(maira, task=mq.LimitTask(limit=limit)).solve(rng=1)
    assert alone.success
    assert outside(kind, T, maira.forward(alone.q)) <= 0


def test_a_limit_below_a_pose_yields_to_it(maira, rng):
    """A box that the pose is outside of: the pose is reached; a box that the elbow can keep beside the pose is kept."""
    q = np.array([0.2, 0.4, 0.0, 1.0, 0.1, 0.6, 0.0])
    target, elbow = maira.forward(q), maira.forward(q, "link4").translation
    away = mq.LimitTask(limit=mq.BoxLimit(upper=target.translation - 0.1), priority=2)
    assert mq.Solver(maira, tasks=[away]).solve(target, q0=q).success
    low = mq.HalfSpaceLimit(frame="link4", normal=[0, 1, 0], point=elbow + np.array([0, 0.05, 0]))
    wish = mq.LimitTask(limit=low, priority=2)
    s = mq.Solver(maira, tasks=[wish]).solve(target, q0=q)
    assert s.success
    assert maira.forward(s.q, "link4").translation[1] >= elbow[1] + 0.05 - 1e-6


def test_limits_beside_each_other_that_exclude_each_other_are_named(maira):
    """By the names that they were given."""
    left = mq.HalfSpaceLimit(normal=[0, 1, 0], point=0.3, name="left")
    right = mq.HalfSpaceLimit(normal=[0, -1, 0], point=0.3, name="right")
    s = mq.Solver(maira, limits=[left, right], options=FEW).solve(mq.pose([0.5, 0.0, 0.6]))
    assert s.status is mq.Status.LIMITS_BROKEN
    assert s.broken_limits == {"left": pytest.approx(0.3, abs=1e-3), "right": pytest.approx(0.3, abs=1e-3)}
    assert "left by 0.3" in str(s.explain())
