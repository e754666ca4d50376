"""Slides that are much longer than the arm they carry: their range is no measure of the arm, nor of its starts."""

import numpy as np
import pytest
from support.made_robots import BASES, mobile

import maira_qp as mq
from maira_qp.kernels.search.levenberg_marquardt import LANES_ARENA
from maira_qp.kernels.search.seeds import place_all
from maira_qp.problem.problem import Problem
from maira_qp.problem.targets import row_of
from maira_qp.robots.model.revolutions import WholeTurns
from maira_qp.solvers.compiled.engine import Compiled


def configurations(robot: mq.Robot, rng: np.random.Generator, count: int) -> np.ndarray:
    """Some (N, n) within 2 m of home, others anywhere, but where a joint would have to aim far along a slide."""
    q = np.array([robot.random_configuration(rng) for _ in range(count)])
    near = slice(None, None, 2 if robot.slides[0] else 1)
    q[near, robot.slides] = rng.uniform(-2.0, 2.0, q[near, robot.slides].shape)
    return q


@pytest.mark.parametrize("length", [1e3, 999999.0])
@pytest.mark.parametrize("base", BASES)
def test_what_is_within_reach_is_reached_however_long_the_slides(base, length, rng):
    """By both engines, with a handful of restarts; judged by kinematics of the answer."""
    robot = mobile(base, length)
    T = np.array([robot.forward(q).homogeneous for q in configurations(robot, rng, 16)])
    batch = mq.Solver(robot).solve_batch(T)
    assert batch.success.all()
    assert batch.restarts.max() <= 20
    for q, target in zip(batch.q, T, strict=True):
        assert np.abs(mq.pose_error(robot.forward(q).homogeneous, target)).max() < 1e-6
    general = mq.Solver(robot, backend="daqp")
    assert all(general.solve(target).success for target in T[:2])


def test_the_arm_is_measured_by_its_links():
    """And by slides as far as these are no longer than they are."""
    links = 0.1 + 0.4 + 0.2 + 0.2 + 0.1
    assert mobile("rail", 999999.0).length == pytest.approx(0.3 + links + 1.3)
    assert mobile("rail", 0.05).length == pytest.approx(0.3 + links + 0.1)
    weights = [mq.Solver(mobile("floor", length)).tasks[0].weights[0] for length in (10.0, 1e6)]
    assert weights[0] == pytest.approx(weights[1])


def test_the_verdict_beside_a_rail_is_true(rng):
    """A target 2 m above what the arm reaches: the answer is as far away as it must be, beside it on the rail."""
    robot = mobile("rail", 999999.0)
    s = mq.Solver(robot, task=mq.PositionTask()).solve(mq.pose([5e4, 0.0, 3.3]))
    assert s.status in (mq.Status.NEAREST, mq.Status.UNREACHABLE)
    assert s.position_error == pytest.approx(2.0, abs=1e-5)
    with pytest.raises(mq.errors.PoseError, match="times the arm's length"):
        mq.Solver(robot).solve(mq.pose([1e12, 0.0, 0.5]))


def test_solutions_and_further_limits_find_their_way_along_a_rail(rng):
    robot = mobile("rail", 999999.0)
    solver = mq.Solver(robot, limits=[mq.LinearLimit(np.eye(7)[1:2], [0.5])])
    for q in configurations(robot, rng, 3):
        q[1] = min(q[1], 0.4)
        target = robot.forward(q)
        assert solver.solve(target).success
        listed = mq.Solver(robot).solutions(target)
        assert len(listed) > 0
        assert all(max(one.position_error, one.orientation_error) < 1e-6 for one in listed)


@pytest.mark.parametrize("base", BASES)
def test_slides_are_placed_where_no_other_place_is_nearer(base, rng):
    """Against a hundred places around it, the ends of the slides included."""
    robot = mobile(base, 20.0)
    engine = Compiled.build(Problem.build(robot))
    slides = robot.slides
    assert WholeTurns(robot, robot.middle).long_slides.tolist() == slides.tolist()
    for far in (1.0, 40.0):
        target = mq.pose(rng.uniform(-far, far, 3))
        starts = np.array([robot.random_configuration(rng) for _ in range(3)])
        placed = starts.copy()
        place_all(engine.chain, engine.settings, row_of(target), *LANES_ARENA.empty(robot.n), placed)
        np.testing.assert_array_equal(placed[:, ~slides], starts[:, ~slides])
        for q in placed:
            least = np.linalg.norm(robot.forward(q).translation - target.translation)
            for step in 10.0 ** rng.uniform(-4, 1.5, 100):
                other = q.copy()
                other[slides] += step * rng.standard_normal(int(slides.sum()))
                other = robot.clip(other)
                assert np.linalg.norm(robot.forward(other).translation - target.translation) > least - 1e-3
