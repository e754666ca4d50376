"""Every kernel against its slow, obvious twin."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from conftest import load

import maira_qp as mq
from maira_qp.kernels import compilation
from maira_qp.kernels.box_qp import solve_box_qp
from maira_qp.kernels.chain import forward, jacobian
from maira_qp.kernels.descent import descend, is_reached, pose_cost, quadratic_model
from maira_qp.kernels.pose_error import pose_error
from maira_qp.kernels.search import random_start, search, search_batch, state_of
from maira_qp.kernels.sine import sine_cosine
from maira_qp.problem.backends import Backend
from maira_qp.problem.costs import TaskCost
from maira_qp.problem.qp import QP
from maira_qp.solvers import descent as general
from maira_qp.solvers.compiled import Compiled, chain_of
from maira_qp.solvers.targets import row_of, stream_of

ROBOTS = ["maira", "panda", "xarm7", "ur5_limited", "pr2_arm", "tiago", "kinova", "irb140", "talos_arm"]


@pytest.fixture(scope="module", params=ROBOTS)
def robot(request) -> mq.Robot:
    return mq.Robot.maira() if request.param == "maira" else load(request.param)


def arrays(n: int):
    """axes, origins, tool, e"""
    return np.empty((n, 3)), np.empty((n, 3)), np.empty(12), np.empty(6)


def assert_same_kinematics(robot: mq.Robot, rng, count: int) -> None:
    chain, (axes, origins, tool, _), J = chain_of(robot), arrays(robot.n), np.empty((robot.n, 6))
    for _ in range(count):
        q = robot.random_configuration(rng)
        forward(chain, q, axes, origins, tool)
        jacobian(chain, axes, origins, tool, J)
        assert np.abs(tool - row_of(robot.forward(q))).max() < 2e-14 * max(1, np.abs(tool).max()) * robot.n
        assert np.abs(J.T - robot.jacobian(q)).max() < 2e-14 * max(1, np.abs(tool).max()) * robot.n


def test_kinematics_are_pinocchios_on_real_robots(robot, rng):
    """Axes along x, y, z, against them and skew; prismatic and continuous joints."""
    assert_same_kinematics(robot, rng, 200)


@pytest.mark.parametrize("joints", [1, 2, 7, 30])
def test_kinematics_are_pinocchios_on_random_chains_of_any_axes(joints, rng):
    for _ in range(5):
        body = "".join(
            f'<link name="l{i + 1}"/><joint name="j{i}" type="{rng.choice(["revolute", "prismatic", "continuous"])}">'
            f'<parent link="l{i}"/><child link="l{i + 1}"/>'
            f'<origin xyz="{numbers(rng.normal(size=3))}" rpy="{numbers(rng.normal(size=3))}"/>'
            f'<axis xyz="{numbers(axis_of(rng))}"/><limit lower="-2" upper="3" velocity="1" effort="1"/></joint>'
            for i in range(joints)
        )
        robot = mq.Robot.from_urdf(f'<robot name="random"><link name="l0"/>{body}</robot>')
        assert_same_kinematics(robot, rng, 20)


def numbers(values) -> str:
    return " ".join(repr(float(v)) for v in values)


def axis_of(rng) -> np.ndarray:
    """A skew axis, or one along x, y or z, either way."""
    return rng.normal(size=3) if rng.random() < 0.5 else rng.choice([-1, 1]) * np.eye(3)[rng.integers(3)]


def test_sine_and_cosine_are_those_of_the_library(rng):
    angles = np.concatenate([rng.uniform(-7, 7, 20_000), rng.uniform(-1e5, 1e5, 5000), np.arange(-40, 41) * np.pi / 4])
    angles = np.concatenate([angles, [0.0, -0.0, 1e-300, 1e-9, 1e6, 1e15]])
    found = np.array([sine_cosine(a) for a in angles])
    assert np.abs(found[:, 0] - np.sin(angles)).max() < 3e-16
    assert np.abs(found[:, 1] - np.cos(angles)).max() < 3e-16
    assert np.isnan([sine_cosine(a) for a in (np.nan, np.inf)]).all()


def test_the_pose_error_is_that_of_the_definition(rng):
    """Random, near 0, near pi, on every branch; equal poses give exactly 0."""
    e = np.empty(6)
    for k in range(3000):
        axis = rng.normal(size=3)
        angle = [rng.uniform(0, np.pi), 10 ** rng.uniform(-15, -3), np.pi - 10 ** rng.uniform(-12, -2)][k % 3]
        u = 0.5 * angle * axis / np.linalg.norm(axis)
        R = mq.pose([0, 0, 0], rpy=rng.uniform(-3, 3, 3)).rotation
        turn = mq.pose([0, 0, 0], quaternion=[np.cos(np.linalg.norm(u)), *(u * np.sinc(np.linalg.norm(u) / np.pi))])
        T, T_d = np.eye(4), np.eye(4)
        T[:3, :3], T_d[:3, :3] = R, turn.rotation @ R
        T[:3, 3], T_d[:3, 3] = rng.normal(size=3), rng.normal(size=3)
        pose_error(np.r_[T[:3, :3].ravel(), T[:3, 3]], np.r_[T_d[:3, :3].ravel(), T_d[:3, 3]], e)
        expected = mq.pose_error(T, T_d)
        assert np.abs(e - expected).max() <= 1e-14 + 1e-13 * (k % 3 == 2)
    pose_error(np.r_[np.eye(3).ravel(), 1, 2, 3], np.r_[np.eye(3).ravel(), 1, 2, 3], e)
    assert np.array_equal(e, np.zeros(6))


def qp_work(n: int):
    """A, free, side, y"""
    return np.empty((n, n)), np.empty(n, np.int64), np.empty(n, np.int64), np.empty(n)


@pytest.mark.parametrize("n", [1, 2, 7, 12, 30])
def test_the_box_qp_satisfies_its_kkt_conditions(n, rng):
    """Tight, wide, infinite, one-sided and empty boxes; 0 at a bound or not; H nearly singular."""
    from maira_qp.problem.qp import QPSolution

    work, x = qp_work(n), np.empty(n)
    for _ in range(400):
        J = rng.normal(size=(6, n))
        H = J.T @ J + 10 ** rng.uniform(-8 if n <= 7 else -3, 0) * np.eye(n)
        c = rng.normal(size=n) * 10 ** rng.uniform(-8, 1)
        size = 10 ** rng.uniform(-3, 1)
        lower, upper = -size * rng.random(n), size * rng.random(n)
        lower[rng.random(n) < 0.2] = 0.0
        upper[rng.random(n) < 0.2] = 0.0
        upper[rng.random(n) < 0.2] = np.inf
        assert solve_box_qp(H, c, lower, upper, *work, x)
        assert (x >= lower).all()
        assert (x <= upper).all()
        g = H @ x + c
        qp = QP(H, c, lower, upper, np.empty((0, n)), np.empty(0))
        z = np.where(x == lower, -np.maximum(g, 0), 0) + np.where(x == upper, np.maximum(-g, 0), 0)
        solution = QPSolution(qp, True, x, np.empty(0), z)
        scale = np.abs(c).max() + np.abs(H).max() * np.abs(x).max()
        assert solution.dual_residual() <= 1e-10 * scale


def test_a_nearly_singular_qp_with_many_variables_still_descends_inside_its_box(rng):
    n = 30
    work, x = qp_work(n), np.empty(n)
    for _ in range(200):
        J = rng.normal(size=(6, n))
        H, c = J.T @ J + 1e-9 * np.eye(n), J.T @ rng.normal(size=6)
        lower, upper = -rng.random(n), rng.random(n)
        assert solve_box_qp(H, c, lower, upper, *work, x)
        assert (x >= lower).all()
        assert (x <= upper).all()
        assert 0.5 * x @ H @ x + c @ x < 0


def test_the_box_qp_agrees_with_a_backend(rng):
    backend, n = Backend("daqp"), 7
    work, x = qp_work(n), np.empty(n)
    for _ in range(300):
        J = rng.normal(size=(6, n))
        H, c = J.T @ J + 1e-3 * np.eye(n), rng.normal(size=n)
        lower, upper = -rng.random(n), rng.random(n)
        assert solve_box_qp(H, c, lower, upper, *work, x)
        assert np.abs(x - backend.solve(QP(H, c, lower, upper, np.empty((0, n)), np.empty(0))).x).max() < 1e-8


def test_an_indefinite_qp_is_told(rng):
    n = 3
    work, x = qp_work(n), np.empty(n)
    assert not solve_box_qp(-np.eye(n), np.ones(n), -np.ones(n), np.ones(n), *work, x)
    assert not solve_box_qp(np.full((n, n), np.nan), np.ones(n), -np.ones(n), np.ones(n), *work, x)


@pytest.mark.parametrize(
    "task", [mq.PoseTask(), mq.PositionTask(), mq.OrientationTask()], ids=lambda t: type(t).__name__
)
def test_cost_and_model_are_those_of_the_task(robot, task, rng):
    compiled = Compiled.of(robot, (task.of(robot),), 0, mq.Options())
    axes, origins, tool, e = arrays(robot.n)
    J, H, c = np.empty((robot.n, 6)), np.empty((robot.n, robot.n)), np.empty(robot.n)
    for _ in range(20):
        target, q = robot.forward(robot.random_configuration(rng)), robot.random_configuration(rng)
        cost, at = TaskCost((task.of(robot).toward(target),)), robot.at(q)
        value = pose_cost(compiled.chain, compiled.settings, row_of(target), q, axes, origins, tool, e)
        jacobian(compiled.chain, axes, origins, tool, J)
        largest = quadratic_model(compiled.settings, J, e, H, c)
        level = cost.level(at)
        assert value == pytest.approx(cost.value(at), rel=1e-12)
        assert np.abs(H - level.H).max() < 1e-12 * largest
        assert largest == pytest.approx(np.abs(level.H).max())
        assert np.abs(c - level.c).max() < 1e-11
        assert not is_reached(compiled.settings, e)
    pose_cost(compiled.chain, compiled.settings, row_of(robot.forward(q)), q, axes, origins, tool, e)
    assert is_reached(compiled.settings, e)


@pytest.mark.parametrize(
    "task", [mq.PoseTask(), mq.PositionTask(), mq.OrientationTask()], ids=lambda t: type(t).__name__
)
def test_the_descent_takes_the_steps_of_the_general_engine(robot, task, rng):
    """From the same start the same end, iteration count and verdict, reached or stalled or out of iterations."""
    options = mq.Options(max_iterations=25)
    compiled = Compiled.of(robot, (task.of(robot),), 0, options)
    setting = mq.Solver(robot, backend="daqp", options=options)._setting
    differ = 0
    for _ in range(20):
        target, start = robot.forward(robot.random_configuration(rng)), robot.random_configuration(rng)
        q, row = start.copy(), row_of(target)
        cost, reached, iterations = descend(compiled.chain, compiled.settings, row, q)
        tasks, budget = TaskCost((task.of(robot).toward(target),)), general.Budget(None)
        end = general.descend(
            tasks,
            robot.at(start),
            setting,
            budget,
            reached=lambda at, t=tasks: max(t.tasks[0].residual(at)) <= 1e-6,
            max_iterations=25,
            stall=general.Stall(options.stall_steps, options.stall_ratio),
        )
        same = np.abs(q - end.at.q).max() < 1e-6 and (reached, iterations) == (end.reached, budget.iterations)
        differ += not same
        assert same or cost > 1e-12  # rounding may part two paths only on the way to nowhere
    assert differ <= 1


def test_a_search_cut_into_calls_is_the_same_search(maira):
    compiled = Compiled.of(maira, (mq.PoseTask().of(maira),), 0, mq.Options())
    row = row_of(mq.pose([2.5, 0, 0.4]))
    whole, q, outcome = (np.empty(7), np.empty(6)), np.empty(7), np.empty(6)
    stream = np.uint64(stream_of(row, 5))
    search(compiled.chain, compiled.settings, row, q, False, 8, 0, 9, stream, *whole)
    parts = []
    for attempt in range(10):
        search(compiled.chain, compiled.settings, row, q, False, 8, attempt, attempt, stream, q, outcome)
        parts.append((outcome[3], q.copy()))
    best = min(parts, key=lambda part: part[0])
    assert best[0] == whole[1][3]
    assert np.array_equal(best[1], whole[0])


def test_random_starts_fill_the_limits_and_differ_by_seed_target_and_attempt(maira):
    compiled = Compiled.of(maira, (mq.PoseTask().of(maira),), 0, mq.Options())
    starts = []
    for seed in range(3):
        for place in range(20):
            row = row_of(mq.pose([0.1 * place, 0, 0]))
            for attempt in range(20):
                q, stream = np.empty(7), np.uint64(stream_of(row, seed))
                state = np.uint64(state_of(stream, attempt))
                random_start(compiled.chain, compiled.settings, row, 1, state, q)
                starts.append(q)
    starts = np.array(starts)
    assert len(np.unique(starts, axis=0)) == 1200
    share = (starts - maira.lower) / (maira.upper - maira.lower)
    assert (share >= 0).all()
    assert (share <= 1).all()
    # mean and spread of 1,200 uniform draws, within 4 standard errors
    assert np.abs(share.mean(axis=0) - 0.5).max() < 4 / np.sqrt(12 * 1200)
    assert np.abs(share.std(axis=0) - 1 / np.sqrt(12)).max() < 0.02


def test_a_target_with_nan_costs_only_itself(maira, rng):
    compiled = Compiled.of(maira, (mq.PoseTask().of(maira),), 0, mq.Options(max_restarts=5))
    rows = np.array([row_of(maira.forward(maira.random_configuration(rng))) for _ in range(3)])
    rows[1] = np.nan
    q, outcome = np.zeros((3, 7)), np.empty((3, 6))
    streams = np.arange(3, dtype=np.uint64)
    search_batch(compiled.chain, compiled.settings, rows, q, False, 8, 100, streams, q, outcome)
    assert outcome[:, 0].tolist() == [1, 0, 1]
    assert np.isfinite(q).all()
    assert (q >= maira.lower).all()
    assert (q <= maira.upper).all()


def test_kernels_compile_where_there_is_no_folder_for_the_cache(tmp_path):
    """A read-only package and no home: slower to start, but no failure."""
    source = Path(compilation.__file__).read_text(encoding="utf-8")
    script = f"{source}\n\ndef double(x):\n    return 2 * x\n\nassert kernel(double)(21) == 42\n"
    run = subprocess.run([sys.executable, "-"], input=script, text=True, capture_output=True, check=False)
    assert run.returncode == 0, run.stderr  # a script from standard input has no file to keep a cache beside
