"""Obstacles that stand elsewhere in a call, beside solvers that were built with them there."""

import pickle
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

import maira_qp as mq
from maira_qp.errors import OptionError, PoseError

BOX = mq.Box([0.1, 0.3, 0.2], mq.pose([0.2, -0.6, 0.4]))


def limit_with(pose=None, **how) -> mq.CollisionLimit:
    return mq.CollisionLimit(obstacles={"ball": mq.Sphere(0.12, pose), "box": BOX}, margin=0.02, **how)


@pytest.fixture(scope="module")
def solver() -> mq.Solver:
    """With the ball far away."""
    return mq.Solver(mq.Robot.maira(), limits=[limit_with(mq.pose([3, 3, 3]))], options=mq.Options(max_restarts=10))


def places(rng: np.random.Generator, count: int) -> list:
    points = rng.uniform([-0.6, -0.6, 0.3], [0.6, 0.6, 1.0], (count, 3))
    return [mq.pose(p, rpy=p) for p in points]


def test_a_moved_obstacle_is_where_it_was_moved_to(maira, rng):
    """Rows, names and distances, beside those of a limit built there, and of the limit as it was, after each other."""
    there = limit_with(mq.pose([0.5, 0.0, 0.6])).of(maira)
    for T in places(rng, 30):
        at = maira.at(maira.random_configuration(rng))
        moved, built = there.with_obstacles({"ball": T}), limit_with(T).of(maira)
        for one, other in ((moved, built), (there, limit_with(mq.pose([0.5, 0.0, 0.6])).of(maira))):
            rows, expected = one.rows(at, None), other.rows(at, None)
            assert (rows is None) == (expected is None)
            if rows is not None:
                np.testing.assert_allclose(rows[0], expected[0], atol=1e-9)
                np.testing.assert_allclose(rows[1], expected[1], atol=1e-9)
            assert one.broken(at, "").keys() == other.broken(at, "").keys()
        again = pickle.loads(pickle.dumps(moved))
        assert again.distance(at) == pytest.approx(moved.distance(at), abs=1e-9)
        back = moved.with_obstacles({"ball": mq.pose([0.5, 0.0, 0.6])})
        assert back.distance(at) == pytest.approx(there.distance(at), abs=1e-9)


def test_a_solve_keeps_clear_of_it(solver, rng):
    robot, near = solver.robot, 0
    for T in places(rng, 4):
        target = robot.forward(robot.random_configuration(rng))
        watch = limit_with(T).of(robot)
        s = solver.solve(target, obstacles={"ball": T})
        assert watch.violation(robot.at(s.q)) == 0 or s.status is mq.Status.LIMITS_BROKEN
        assert (s.broken_limits == {}) == (watch.violation(robot.at(s.q)) == 0)
        near += bool(s.active_limits)
    batch = solver.solve_batch([target], obstacles={"ball": T})
    assert np.array_equal(batch.q[0], s.q)
    assert batch.broken_limits == [s.broken_limits]
    assert solver.solve(target).q.shape == (7,)


def test_ticks_slide_around_a_ball_that_comes_nearer(solver):
    """The same ticks as of solvers that are built anew for each place; the arm gives way."""
    robot, dt = solver.robot, 0.02
    q = np.array([0.0, 0.5, 0.0, 1.2, 0.0, 0.6, 0.0])
    target, at_last = robot.forward(q), robot.forward(q).translation
    backends = set()
    for k in range(40):
        T = mq.pose(at_last + np.array([0.5 - 0.01 * k, 0.02, 0.0]))
        t = solver.step(q, target, dt, obstacles={"ball": T})
        backends.add(t.backend)
        assert limit_with(T).of(robot).violation(robot.at(t.q)) <= 1e-9
        if k % 13 == 12:
            built = mq.Solver(robot, limits=[limit_with(T)]).step(q, target, dt)
            np.testing.assert_allclose(t.q, built.q, atol=1e-9)
        q = t.q
    assert backends == {"compiled", "daqp"}
    assert np.linalg.norm(robot.forward(q).translation - at_last) > 0.02


def test_threads_do_not_see_each_others_obstacles(solver, rng):
    """Each call has its own places; the answers are those of one thread."""
    robot = solver.robot
    calls = [(robot.random_configuration(rng), T) for T in places(rng, 40)]
    target = robot.forward(robot.middle)

    def tick(call):
        q, T = call
        return solver.step(q, target, 0.02, obstacles={"ball": T}).q

    alone = [tick(call) for call in calls]
    with ThreadPoolExecutor(4) as pool:
        for q, expected in zip(pool.map(tick, calls), alone, strict=True):
            assert np.array_equal(q, expected)


def test_a_soft_collision_limit_knows_the_obstacles_of_the_call(maira):
    wish = mq.LimitTask(limit=limit_with(mq.pose([3, 3, 3]), self_collision=False), priority=2)
    solver, q = mq.Solver(maira, tasks=[wish]), np.array([0.2, 0.4, 0.0, 1.0, 0.1, 0.6, 0.0])
    T = mq.pose(maira.forward(q, "link4").translation + np.array([0.0, 0.15, 0.0]))
    s = solver.solve(maira.forward(q), q0=q, obstacles={"ball": T})
    assert s.success
    watch = limit_with(T, self_collision=False).of(maira)
    assert watch.distance(maira.at(s.q)) > watch.distance(maira.at(q)) + 1e-3


@pytest.mark.parametrize(
    ("obstacles", "error", "words"),
    [
        ({"bal": np.eye(4)}, OptionError, "no obstacle 'bal'; .*ball"),
        ({"ball": np.eye(3)}, PoseError, "pose of 'ball'"),
        ({"ball": 2 * np.eye(4)}, PoseError, "pose of 'ball'"),
        ([np.eye(4)], OptionError, "mapping"),
    ],
)
def test_what_is_no_obstacle_or_no_pose_is_refused(solver, obstacles, error, words):
    with pytest.raises(error, match=words):
        solver.step(solver.robot.middle, np.eye(4), 0.01, obstacles=obstacles)


def test_a_solver_without_obstacles_says_so(maira):
    with pytest.raises(OptionError, match="no CollisionLimit has any"):
        mq.Solver(maira).solve(np.eye(4), obstacles={"ball": np.eye(4)})


def test_obstacles_by_name_are_shapes(maira):
    with pytest.raises(OptionError, match="is not a Sphere"):
        mq.CollisionLimit(obstacles={"ball": 0.1})
    with pytest.raises(OptionError, match="by their names"):
        mq.CollisionLimit(obstacles=mq.Sphere(0.1))
    assert limit_with().obstacle_names == ("ball", "box")


def test_an_obstacle_without_a_pose_has_that_of_the_call(maira):
    """A solver is made of it; each call without its pose is refused, and one with it is as if it were made with it."""
    limit, T = mq.CollisionLimit(obstacles={"ball": mq.Sphere(0.08), "box": BOX}), mq.pose([0.5, -0.4, 0.8])
    solver, target = mq.Solver(maira, limits=[limit]), maira.forward(maira.middle)
    other = {"box": mq.pose([2.0, 0.0, 0.0])}
    calls = [
        lambda: solver.solve(target),
        lambda: solver.solve(target, obstacles=other),
        lambda: solver.solve_batch([target]),
        lambda: solver.step(maira.middle, target, 0.01),
        lambda: solver.solutions(target),
        lambda: solver.track([target]),
        lambda: limit.of(maira).distance(maira.at(maira.middle)),
    ]
    for call in calls:
        with pytest.raises(OptionError, match=r"^no pose of 'ball': give obstacles=\{\"ball\": pose\} in the call"):
            call()
    placed = mq.CollisionLimit(obstacles={"ball": mq.Sphere(0.08, T), "box": BOX})
    s = solver.solve(target, obstacles={"ball": T})
    np.testing.assert_allclose(s.q, mq.Solver(maira, limits=[placed]).solve(target).q, rtol=0, atol=1e-9)
    at = maira.at(maira.middle)
    assert mq.CollisionLimit(obstacles=[mq.Sphere(0.08, name="ball")]).of(maira).distance(at) < 0.1  # at the origin
