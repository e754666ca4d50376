"""Nearest points in compiled code: Newton's method in lanes, and its starts in closed form, against other searches."""

import numpy as np
import pytest
from support.compiled_problems import few, first_in_plain_python, rubbish
from support.robots import load

import maira_qp as mq
from maira_qp.kernels.jit.simd import LANES
from maira_qp.kernels.refinement.newton_simd import newton_in_lanes
from maira_qp.kernels.search.levenberg_marquardt import LANES_ARENA
from maira_qp.orientation import pose_error
from maira_qp.solvers.compiled.engine import Compiled

TOLERANCE = 1e-7


def problem(robot: mq.Robot) -> Compiled:
    """The arrays of a pose task."""
    solver = mq.Solver(robot)
    solver.solve(robot.forward(robot.middle))
    assert isinstance(solver.engines.compiled, Compiled)
    return solver.engines.compiled


def out_of_reach(robot: mq.Robot, rng: np.random.Generator, count: int) -> np.ndarray:
    """Poses (count, 4, 4) of configurations, moved outwards by up to the arm's length: few of them are reached."""
    poses = np.array([robot.forward(robot.random_configuration(rng)).homogeneous for _ in range(count)])
    poses[:, :3, 3] *= (
        1 + rng.uniform(0.1, 1.0, (count, 1)) * robot.length / np.linalg.norm(poses[:, :3, 3], axis=1)[:, None]
    )
    return poses


def rows_of(poses: np.ndarray) -> np.ndarray:
    """Targets (N, 12)."""
    return np.ascontiguousarray(np.hstack([poses[:, :3, :3].reshape(-1, 9), poses[:, :3, 3]]))


def descended(engine: Compiled, rows: np.ndarray, starts: int, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Where descents from q (N starts, n) end, and what is left there."""
    q, left, steps = q.copy(), np.full(len(q), np.nan), np.empty(len(q), np.int64)
    memory = *rubbish(LANES_ARENA, q.shape[1]), np.empty(LANES, np.int64)
    newton_in_lanes(engine.chain, engine.settings, rows, starts, TOLERANCE, *memory, q, left, steps)
    return q, left


def cost_of(engine: Compiled, robot: mq.Robot, q: np.ndarray, T: np.ndarray) -> float:
    """`1/2 |W e|^2` by Pinocchio."""
    weights = np.repeat(engine.settings[:2], 3)
    return 0.5 * float(np.sum((weights * pose_error(robot.forward(q), T)) ** 2))


@pytest.mark.parametrize("name", ["maira", "iiwa14", "panda", "ur5_limited", "pr2_arm"])
def test_newton_ends_where_the_gradient_is_held_by_limits(name, rng):
    """By differences of Pinocchio's cost; inside the limits to the bit, lower than where it began; mostly."""
    robot = load(name) if name not in ("maira", "iiwa14") else getattr(mq.Robot, name)()
    engine, poses = problem(robot), out_of_reach(robot, rng, few(40))
    begin = np.array([robot.random_configuration(rng) for _ in poses])
    ends, left = descended(engine, rows_of(poses), 1, begin)
    assert ((robot.lower <= ends) & (ends <= robot.upper)).all()
    assert (left > TOLERANCE).sum() <= max(1, 0.25 * len(left))  # one of the few that plain Python tries
    for k in np.flatnonzero(left <= TOLERANCE):
        assert cost_of(engine, robot, ends[k], poses[k]) <= cost_of(engine, robot, begin[k], poses[k])
        for i in range(robot.n):
            h = np.eye(robot.n)[i] * 1e-5
            ahead, behind = (cost_of(engine, robot, ends[k] + side, poses[k]) for side in (h, -h))
            slope = (ahead - behind) / 2e-5
            held = (ends[k, i] == robot.lower[i] and slope > 0) or (ends[k, i] == robot.upper[i] and slope < 0)
            assert held or abs(slope) < 1e-5


def test_a_descent_depends_on_its_lane_alone(maira, rng):
    """To the bit, whatever is in the other lanes and in memory; starts that are NaN stay as they are."""
    engine, poses = problem(maira), out_of_reach(maira, rng, 10)
    begin = np.array([maira.random_configuration(rng) for _ in range(30)])
    begin[[4, 17]] = np.nan
    ends, left = descended(engine, rows_of(poses), 3, begin)
    assert np.isnan(ends[[4, 17]]).all()
    assert (left[[4, 17]] == np.inf).all()
    for k in (0, 5, 16, 29):
        alone, left_alone = descended(engine, rows_of(poses[[k // 3]]), 1, begin[[k]])
        np.testing.assert_array_equal(alone[0], ends[k])
        assert left_alone[0] == left[k]


@pytest.mark.parametrize("name", first_in_plain_python("maira", "iiwa14"))
def test_the_nearest_points_from_closed_form_are_as_near_as_those_of_many_starts(name, rng):
    """Of 150 poses beyond the reach hardly one has a nearer point at the end of any of 20 descents."""
    robot = getattr(mq.Robot, name)()
    solver, engine, poses = mq.Solver(robot), problem(robot), out_of_reach(robot, rng, few(150))
    batch = solver.solve_batch(poses)
    beyond = np.flatnonzero(batch.status == mq.Status.UNREACHABLE)
    assert len(beyond) > 0.6 * len(poses)
    assert np.nanmax(batch.projected_gradient[beyond]) < 1e-6
    begin = np.array([robot.random_configuration(rng) for _ in range(20 * len(beyond))])
    ends, _ = descended(engine, rows_of(poses[beyond]), 20, begin)
    worse = better = 0
    for k, i in enumerate(beyond):
        own = cost_of(engine, robot, batch.q[i], poses[i])
        others = min(cost_of(engine, robot, q, poses[i]) for q in ends[20 * k : 20 * k + 20])
        worse += own > others + 1e-6
        better += own < others - 1e-6
    assert worse <= 0.05 * len(beyond) + 1
    assert better >= worse


def test_a_single_target_out_of_reach_is_that_of_a_batch(iiwa14, rng):
    """To the bit, with any seed."""
    solver, poses = mq.Solver(iiwa14), out_of_reach(iiwa14, rng, 12)
    for seed in (0, 5):
        batch = solver.solve_batch(poses, seed=seed)
        for k in range(len(poses)):
            np.testing.assert_array_equal(solver.solve(poses[k], rng=seed).q, batch.q[k])
