"""Eight compiled descents take the steps of the reference engine, each as if it were alone."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numba import njit
from support.compiled_problems import (
    arm,
    compiled,
    configurations,
    descents,
    few,
    kinematic_work,
    nine_robots,
    reachable_rows,
    row_of,
    three_tasks,
)
from support.made_robots import random_chain

import maira_qp as mq
from maira_qp.kernels.jit.simd import LANES, load, select, store
from maira_qp.kernels.kinematics.serial_chain import jacobian
from maira_qp.kernels.layout import Descent, Joint
from maira_qp.kernels.search.levenberg_marquardt import (
    advance,
    begin,
    is_reached,
    pose_cost,
    quadratic_model,
)
from maira_qp.problem.qp.costs import TaskCost
from maira_qp.problem.targets import pose_of
from maira_qp.solvers.compiled.engine import Compiled
from maira_qp.solvers.reference import levenberg_marquardt as general
from maira_qp.solvers.reference.multi_start import stationarity

helpers_compile_once = pytest.mark.xdist_group("helpers of the descent")

TOLD = [Descent.COST, Descent.ITERATIONS, Descent.POSITION, Descent.ORIENTATION, Descent.ENDED, Descent.REACHED]
"""What a descent tells of itself when it has ended."""


def descend_eight(problem: Compiled, starts: np.ndarray, rows: np.ndarray, lanes: Any = None) -> Any:
    """The lanes when all descents, from `starts` (8, n) toward `rows` (8, 12), have ended.

    A lane that ends early goes on with whatever it does; here its state is put back after each iteration.
    """
    lanes = descents(problem.robot.n) if lanes is None else lanes
    for lane in range(LANES):
        begin(lanes.state, lanes.q, lanes.target, lane, starts[lane], rows[lane])
    while True:
        done = lanes.state[Descent.ENDED] > 0
        if done.all():
            return lanes
        state, q = lanes.state.copy(), lanes.q.copy()
        advance(problem.chain, problem.settings, lanes)
        lanes.state[:, done], lanes.q[:, done] = state[:, done], q[:, done]


@njit
def model_and_verdict(settings, J, e, H, c, renew, largest, verdict):
    """`quadratic_model` where `renew` (1,) or (1, 8) is positive, and `is_reached` as a number."""
    store(largest, 0, quadratic_model(settings, J, e, H, c, load(renew, 0) > 0.0))
    store(verdict, 0, select(is_reached(settings, e), 1.0, 0.0))


@helpers_compile_once
@three_tasks
@nine_robots
def test_cost_and_model_are_those_of_the_task(name, task, rng):
    """In lanes and one by one; at the target itself, and only there, the verdict is that it is reached."""
    robot = arm(name)
    problem, n = compiled(robot, task), robot.n
    work, work8 = kinematic_work(n), kinematic_work(n, LANES)
    model, model8 = ([np.full((*shape, *k), np.nan) for shape in ((n, n), (n,))] for k in ((), (LANES,)))
    told, told8 = np.empty((2, 1)), np.empty((2, 1, LANES))
    for _ in range(few(6)):
        rows, q = reachable_rows(robot, rng, LANES), configurations(robot, rng, LANES)
        at_target = np.arange(LANES) >= LANES - 2
        rows[at_target] = [row_of(robot.forward(each)) for each in q[at_target]]
        targets8, q8 = np.ascontiguousarray(rows.T), np.ascontiguousarray(q.T)
        value8 = cost_in_lanes(problem, targets8, q8, work8)
        jacobian(problem.chain, *work8[:3], work8[4])
        model_and_verdict(problem.settings, work8[4], work8[3], *model8, np.ones((1, LANES)), *told8)
        for lane in range(LANES):
            value = pose_cost(problem.chain, problem.settings, rows[lane], q[lane], *work[:4])
            jacobian(problem.chain, *work[:3], work[4])
            model_and_verdict(problem.settings, work[4], work[3], *model, np.ones(1), *told)
            cost = TaskCost((task.of(robot).toward({robot.tip: pose_of(rows[lane])}),))
            level = cost.level(robot.at(q[lane]))
            in_lane = value8[lane], model8[0][..., lane], model8[1][:, lane], *told8[:, 0, lane]
            for v, H, c, largest, reached in ((value, *model, *told[:, 0]), in_lane):
                assert v == pytest.approx(cost.value(robot.at(q[lane])), rel=1e-12, abs=1e-24)
                assert np.abs(H - level.H).max() < 1e-12 * largest
                assert largest == pytest.approx(np.abs(level.H).max())
                assert np.abs(c - level.c).max() < 1e-11
                assert (reached > 0) == at_target[lane]


@njit
def cost_into(chain, settings, target, q, axes, origins, tool, e, out):
    store(out, 0, pose_cost(chain, settings, target, q, axes, origins, tool, e))


def cost_in_lanes(problem: Compiled, targets, q, work) -> np.ndarray:
    """The costs (8,) at q (n, 8)."""
    out = np.empty((1, LANES))
    cost_into(problem.chain, problem.settings, targets, q, *work[:4], out)
    return out[0]


@helpers_compile_once
def test_a_model_is_renewed_only_where_it_is_asked_for(rng):
    problem = compiled(arm("maira"))
    J, e = rng.normal(size=(7, 6, LANES)), rng.normal(size=(6, LANES))
    old_H, old_c, renew = rng.normal(size=(7, 7, LANES)), rng.normal(size=(7, LANES)), np.arange(LANES) % 3 == 0
    old_H += old_H.swapaxes(0, 1)
    H, c, told = old_H.copy(), old_c.copy(), np.empty((2, 1, LANES))
    model_and_verdict(problem.settings, J, e, H, c, renew[None] - 0.5, *told)
    assert (H[..., ~renew] == old_H[..., ~renew]).all()
    assert (c[:, ~renew] == old_c[:, ~renew]).all()
    for lane in np.flatnonzero(renew):
        W = np.diag(problem.settings[[0, 0, 0, 1, 1, 1]])
        A = W @ J[..., lane].T
        np.testing.assert_allclose(H[..., lane], A.T @ A, rtol=1e-13, atol=1e-13)
        np.testing.assert_allclose(c[:, lane], -A.T @ W @ e[:, lane], rtol=1e-13, atol=1e-13)
    np.testing.assert_array_equal(told[0, 0], [H[..., k].diagonal().max(initial=0) for k in range(LANES)])


def assert_the_steps_of_the_general_engine(robot: mq.Robot, task, rng, blocks: int, max_iterations: int = 25) -> None:
    """From the same start the same end, verdict and iteration count, reached or stalled or out of iterations.

    Only where a descent ends at a nearest point, and rounding says which of its last steps still improve, may it take
    more steps or fewer.
    """
    options = mq.Options(max_iterations=max_iterations)
    problem = compiled(robot, task, max_iterations=max_iterations)
    setting = mq.Solver(robot, backend="daqp", options=options).engines.reference.context
    for _ in range(blocks):
        rows, starts = reachable_rows(robot, rng, LANES), configurations(robot, rng, LANES)
        rows[0, 9:] *= 3.0  # out of reach
        starts[1:3] = rng.choice([robot.drawn_range[0], robot.drawn_range[1]], (2, robot.n))[..., 0, :]
        lanes = descend_eight(problem, starts, rows)
        for lane in range(LANES):
            cost, budget = TaskCost((task.of(robot).toward({robot.tip: pose_of(rows[lane])}),)), general.Budget(None)
            end = general.descend(
                cost,
                robot.at(starts[lane]),
                setting,
                budget,
                reached=lambda at, cost=cost: max(cost.tasks[0].residual(at)) <= 1e-6,
                max_iterations=max_iterations,
                stall=general.Stall(options.stall_steps, options.stall_ratio),
            )
            state, q = lanes.state[:, lane], lanes.q[:, lane]
            assert np.abs(q - end.at.q).max() < 1e-6
            assert (state[Descent.REACHED] > 0) == end.reached
            assert state[Descent.ITERATIONS] == budget.iterations or stationarity(cost, end.at, setting) < 1e-5
            assert (q >= robot.lower).all()
            assert (q <= robot.upper).all()
            error = cost.tasks[0].residual(robot.at(q))
            told, weighs = np.sqrt(state[[Descent.POSITION, Descent.ORIENTATION]]), problem.settings[:2] > 0
            rounding = 1e-14 * max(1, robot.length) * robot.n
            np.testing.assert_allclose(told[weighs], np.array(error)[weighs], rtol=1e-6, atol=rounding)


@three_tasks
@nine_robots
def test_a_descent_takes_the_steps_of_the_general_engine(name, task, rng):
    assert_the_steps_of_the_general_engine(arm(name), task, rng, few(3))


@pytest.mark.parametrize("joints", [1, 2, 3, 12, 30])
def test_a_descent_of_a_chain_of_any_length_takes_them_too(joints, rng):
    """One to thirty joints along any axes, turning and sliding."""
    for _ in range(few(4)):
        assert_the_steps_of_the_general_engine(random_chain(joints, rng), mq.PoseTask(), rng, 1)


@pytest.mark.parametrize("iterations", range(1, 9))
def test_a_descent_cut_short_takes_them_too_and_tells_of_where_it_stands(iterations, rng):
    """Also where the last step was refused: the errors are those of the configuration that it keeps."""
    assert_the_steps_of_the_general_engine(arm("panda"), mq.PoseTask(), rng, few(4), iterations)


def test_a_descent_that_is_pushed_onto_its_limits_never_leaves_them_by_a_bit(rng):
    """A slide with limits of any size toward a target beyond them, where q + (limit - q) may be outside by an ulp.

    There it ends, since it cannot move: after one iteration if it began there.
    """
    slide = mq.Robot.from_dh([mq.DHLink(kind="prismatic", lower=-1.0, upper=1.0)])
    problem = compiled(slide)
    for _ in range(few(200)):
        chain, size = problem.chain.copy(), 10.0 ** rng.integers(-2, 2)
        lower, upper = np.sort(size * rng.normal(size=2))
        chain[0, [Joint.LOWER, Joint.UPPER]] = lower, upper
        starts = rng.uniform(lower, upper, (LANES, 1))
        starts[0], starts[1] = lower, upper
        beyond = np.where(rng.random(LANES) < 0.5, lower - 3 * size, upper + 3 * size)
        rows = np.array([row_of(mq.pose([0, 0, z])) for z in beyond])
        lanes = descend_eight(replace(problem, chain=chain), starts, rows)
        limit = np.where(beyond < lower, lower, upper)
        assert (lanes.q[0] >= lower).all()
        assert (lanes.q[0] <= upper).all()
        assert np.abs(lanes.q[0] - limit).max() < 1e-15 * max(abs(lower), abs(upper))
        assert (lanes.state[Descent.REACHED] == 0.0).all()
        assert (lanes.state[Descent.ITERATIONS][starts[:, 0] == limit] == 1.0).all()


@pytest.mark.parametrize("name", ["maira", "ur5_limited", "tiago"])
def test_a_descent_depends_on_its_own_lane_alone(name, rng):
    """To the bit, whatever goes on in the others and in whichever lane it is; NaN, unreachable and begun later."""
    robot = arm(name)
    problem = compiled(robot)
    for _ in range(few(10)):
        rows, starts = reachable_rows(robot, rng, LANES), configurations(robot, rng, LANES)
        rows[2, 9:] *= 4.0
        rows[3] = np.nan
        lanes = descend_eight(problem, starts, rows)
        state, q = lanes.state.copy(), lanes.q.copy()
        for _ in range(4):
            order = rng.integers(0, LANES, LANES)
            descend_eight(problem, starts[order], rows[order], lanes)  # the memory is as the last ones left it
            np.testing.assert_array_equal(lanes.q, q[:, order])
            np.testing.assert_array_equal(lanes.state[TOLD], state[TOLD][:, order])


def test_a_lane_begun_among_others_under_way_does_what_it_would_do_with_them(rng):
    """A lane is refilled as soon as it has ended: each descent is, to the bit, the one that all begin together."""
    robot = arm("panda")
    problem = compiled(robot)
    count = 4 * LANES
    rows, starts = reachable_rows(robot, rng, count), configurations(robot, rng, count)
    together = [descend_eight(problem, starts[k : k + LANES], rows[k : k + LANES]) for k in range(0, count, LANES)]
    expected = np.concatenate([np.vstack([lanes.q, lanes.state[TOLD]]) for lanes in together], axis=1)
    lanes, serves, following, seen = descents(robot.n), np.full(LANES, -1), 0, 0
    while seen < count:
        for lane in np.flatnonzero(lanes.state[Descent.ENDED] > 0):
            k = serves[lane]
            if k >= 0:
                np.testing.assert_array_equal(np.r_[lanes.q[:, lane], lanes.state[TOLD, lane]], expected[:, k])
                seen += 1
            serves[lane] = -1
            if following < count:
                begin(lanes.state, lanes.q, lanes.target, lane, starts[following], rows[following])
                serves[lane], following = following, following + 1
        advance(problem.chain, problem.settings, lanes)


def test_a_descent_that_begins_at_its_target_has_arrived_before_it_moves(rng):
    robot = arm("maira")
    problem, q = compiled(robot), configurations(robot, rng, LANES)
    lanes = descend_eight(problem, q, np.array([row_of(robot.forward(each)) for each in q]))
    assert (lanes.state[Descent.REACHED] == 1.0).all()
    assert (lanes.state[Descent.ITERATIONS] == 0.0).all()
    assert np.array_equal(lanes.q.T, q)


def test_a_descent_toward_nan_ends_at_once_where_it_began(rng):
    robot = arm("maira")
    starts, rows = configurations(robot, rng, LANES), np.full((LANES, 12), np.nan)
    lanes = descend_eight(compiled(robot), starts, rows)
    assert (lanes.state[Descent.REACHED] == 0.0).all()
    assert (lanes.state[Descent.ITERATIONS] == 0.0).all()
    assert np.array_equal(lanes.q.T, starts)
