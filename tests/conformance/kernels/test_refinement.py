"""The kernels of the redundancy: the reference engine's answers, and optimal by its measure, whatever the start."""

from dataclasses import replace

import numpy as np
import pytest
from support.compiled_problems import (
    arm,
    compiled,
    configurations,
    few,
    first_in_plain_python,
    kinematic_work,
    nine_robots,
    row_of,
    search_for,
    three_tasks,
)
from support.derivatives import difference_jacobian
from support.made_robots import random_chain
from support.redundancy_problems import STATIONARY, Problem, reached_starts, settle_by_weight

import maira_qp as mq
from maira_qp.kernels.kinematics.serial_chain import jacobian
from maira_qp.kernels.layout import Refinement
from maira_qp.kernels.search.levenberg_marquardt import pose_cost
from maira_qp.kernels.spatial.pose_hessian import add_curvature, newton_model
from maira_qp.problem.qp.costs import ExactTaskCost, TaskCost
from maira_qp.problem.redundancy import Strict, Weighted
from maira_qp.robots.dh.table import DHLink, DHTable
from maira_qp.solvers.compiled.multi_start import descend


def compare(problem: Problem, rows: np.ndarray, starts: np.ndarray, within: float = 1e-5) -> tuple[int, int, int]:
    """How many settle where the reference engine does, how many are optimal there, and how many here.

    But near singularities, where an error of 1e-6 is worth a lot, Strict regains the pose to 1e-11: it is to be no
    worse than what the start becomes by that.
    """
    same = optimal = found = regained = 0
    for row, start in zip(rows, starts, strict=True):
        q, outcome = problem.settle(row, start)
        problem.assert_told_as_it_is(row, q, outcome)
        general = problem.settle_generally(row, start)
        same += bool(np.abs(q - general.at.q).max() < within)
        optimal += general.projected_gradient <= STATIONARY
        found += outcome[Refinement.PROJECTED_GRADIENT] <= STATIONARY
        exact = descend(problem.arrays.exact, row, start[None])[0][0]
        assert problem.total(row, q) <= max(problem.total(row, start), problem.total(row, exact)) + 1e-2
        regained += problem.cost(row).value(problem.robot.at(q)) <= 1e-22
    assert problem.weight or regained >= 0.9 * len(rows)
    return same, optimal, found


@pytest.mark.parametrize("name", ["maira", "iiwa14", "panda", "xarm7", "pr2_arm", "talos_arm", "tiago", "kinova"])
def test_strict_is_that_of_the_general_engine(name, rng):
    robot, count = mq.Robot.iiwa14() if name == "iiwa14" else arm(name), few(12)
    same, optimal, found = compare(Problem(robot, Strict(mq.Posture())), *reached_starts(robot, rng, count))
    assert same >= 0.9 * count
    assert found >= optimal >= 0.9 * count


@pytest.mark.parametrize("name", ["ur5", "maira"])
@pytest.mark.parametrize("task", [mq.PositionTask(), mq.OrientationTask()], ids=lambda task: type(task).__name__)
def test_strict_is_that_of_the_general_engine_with_several_redundant_degrees_of_freedom(name, task, rng):
    """Three and four of them; the paths are longer, and may part."""
    robot, count = arm(name), max(few(20), 6)
    problem = Problem(robot, Strict(mq.Posture()), task)
    same, optimal, found = compare(problem, *reached_starts(robot, rng, count, task))
    assert same >= 0.8 * count
    assert found >= optimal >= 0.9 * count


@pytest.mark.parametrize("weight", [1e-6, 1e-3, 1.0, 1e3])
@pytest.mark.parametrize("name", ["panda", "tiago"])
def test_weighted_is_that_of_the_general_engine(name, weight, rng):
    robot, count = arm(name), few(12)
    same, optimal, found = compare(Problem(robot, Weighted(mq.Posture(), weight)), *reached_starts(robot, rng, count))
    assert same >= 0.9 * count
    assert found >= optimal - 1 >= 0.8 * count - 1


@pytest.mark.parametrize("redundancy", [Strict(mq.LimitDistance()), Weighted(mq.LimitDistance(), 1e-2)], ids=str)
@pytest.mark.parametrize("name", ["maira", "pr2_arm"])
def test_limit_distance_is_that_of_the_general_engine(name, redundancy, rng):
    """Its Hessian is about 1/300, so that a gradient of 1e-6 leaves q open by 1e-3."""
    robot, count = arm(name), few(12)
    same, optimal, found = compare(Problem(robot, redundancy), *reached_starts(robot, rng, count), within=3e-3)
    assert same >= 0.9 * count
    assert found >= optimal >= 0.9 * count


@pytest.mark.parametrize("name", ["maira", "panda", "xarm7", "pr2_arm", "talos_arm", "tiago", "g1_arm"])
def test_nearly_every_pose_ends_at_an_optimum(name, rng):
    """2,000 poses a robot, one to four redundant degrees of freedom, a batch at once."""
    robot, count = arm(name), few(2000)
    rows, starts = reached_starts(robot, rng, count)
    problem = Problem(robot, Strict(mq.Posture()))
    q, outcome = problem.settle_all(rows, starts)
    optimal = outcome[:, Refinement.PROJECTED_GRADIENT] <= STATIONARY
    assert len(rows) >= 0.99 * count
    assert outcome[:, Refinement.REACHED].all()
    assert (~optimal).sum() <= max(1, 0.002 * count)  # one of the few that plain Python tries
    for k in np.flatnonzero(optimal)[:: max(1, len(rows) // 20)]:
        problem.assert_told_as_it_is(rows[k], q[k], outcome[k])


@pytest.mark.parametrize("redundancy", [Strict(mq.Posture()), Weighted(mq.Posture(), 1e-3)], ids=["strict", "weighted"])
def test_a_batch_is_its_targets_one_by_one_to_the_bit(redundancy, rng):
    """In any order, whatever the others are; what is not reached, or is not a number, is left as it is."""
    robot = arm("tiago")
    rows, starts = reached_starts(robot, rng, max(few(60), 6))
    rows[1], starts[2], starts[4] = np.nan, np.nan, robot.middle
    problem = Problem(robot, redundancy)
    q, outcome = problem.settle_all(rows, starts)
    assert np.array_equal(q[[1, 2, 4]], starts[[1, 2, 4]], equal_nan=True)
    assert outcome[[1, 2, 4], Refinement.REACHED].tolist() == [0, 0, 0]
    assert (outcome[[1, 2, 4], Refinement.PROJECTED_GRADIENT] == np.inf).all()
    for k in rng.permutation(len(rows)):
        if k not in (1, 2, 4):
            alone = problem.settle(rows[k], starts[k])
            assert np.array_equal(alone[0], q[k])
            assert np.array_equal(alone[1], outcome[k])


def test_numbers_that_are_none_come_to_an_end(maira, rng):
    """NaN and infinity in the reference, the weights, the weight."""
    rows, starts = reached_starts(maira, rng, 1)
    arrays = compiled(maira)
    for bad in (np.nan, np.inf):
        for reference, weights, weight in (
            (np.full(7, bad), np.ones(7), 0.0),
            (np.zeros(7), np.full(7, bad), 0.0),
            (np.zeros(7), np.full(7, bad), 1e-3),
            (np.zeros(7), np.ones(7), bad),
        ):
            q, outcomes = starts.copy(), np.full((1, Refinement.WIDTH), np.nan)
            settle_by_weight(arrays, rows, reference, weights, weight, q, outcomes)
            outcome = outcomes[0]
            assert (q >= maira.lower).all()
            assert (q <= maira.upper).all()
            assert outcome[Refinement.REACHED] or weight
            assert not outcome[Refinement.PROJECTED_GRADIENT] <= STATIONARY


def test_a_posture_that_reaches_the_target_is_found_from_nearby(maira, rng):
    """The optimum is known: the reference itself, cost 0."""
    for _ in range(few(40)):
        q_ref = 0.8 * maira.random_configuration(rng)
        q_ref[[1, 3, 5]] = 0.9 * rng.choice([-1, 1], size=3)  # far from singularities
        problem, row = Problem(maira, Strict(mq.Posture(q_ref))), row_of(maira.forward(q_ref))
        start, outcome = search_for(problem.arrays, row[None], maira.clip(q_ref + 0.05 * rng.normal(size=7))[None])
        assert outcome[0, 0] > 0
        q, outcome = problem.settle(row, start[0])
        assert np.abs(q - q_ref).max() < 1e-5
        assert outcome[Refinement.PROJECTED_GRADIENT] <= STATIONARY


@nine_robots
@three_tasks
def test_the_gradient_that_is_told_is_the_general_engines_anywhere(name, task, rng):
    """Without a step: at random configurations, a third of the joints on limits, none of them optimal."""
    robot = arm(name)
    problem, tried = Problem(robot, Strict(mq.Posture()), task, max_settling=0), 0
    for q in configurations(robot, rng, max(few(20), 6)):
        on_limit = (rng.random(robot.n) < 0.33) & np.isfinite(robot.upper)
        q[on_limit] = np.where(rng.random(robot.n) < 0.5, robot.lower, robot.upper)[on_limit]
        row = row_of(robot.forward(q))
        settled, outcome = problem.settle(row, q)
        assert np.abs(settled - q).max() < 1e-9
        problem.assert_told_as_it_is(row, settled, outcome)
        tried += outcome[Refinement.PROJECTED_GRADIENT] > STATIONARY
    assert tried > 0 or robot.n <= 6


def chain_of_links(count: int, limit: float) -> mq.Robot:
    """An arm of `count` joints with axes that alternate, 0.2 m apart."""
    links = [
        DHLink(kind="revolute", a=0.2, alpha=(-1) ** i * np.pi / 2, d=0.1, lower=-limit, upper=limit)
        for i in range(count)
    ]
    return mq.Robot.from_dh(DHTable(links, name="long"))


@pytest.mark.parametrize(("joints", "limit"), [(30, 0.3), *first_in_plain_python((12, 0.5), (12, 3.0))])
def test_long_arms_settle_with_many_joints_on_their_limits(joints, limit, rng):
    """6 to 27 redundant degrees of freedom; a reference out of the limits draws most joints onto them."""
    robot = chain_of_links(joints, limit)
    for task in (mq.PoseTask(), mq.PositionTask()):
        problem = Problem(robot, Strict(mq.Posture(2.0 * limit * rng.uniform(-1, 1, joints))), task)
        rows, starts = reached_starts(robot, rng, few(20), task)
        q, outcome = problem.settle_all(rows, starts)
        optimal = outcome[:, Refinement.PROJECTED_GRADIENT] <= STATIONARY
        for k in range(0, len(rows), 4):
            problem.assert_told_as_it_is(rows[k], q[k], outcome[k])
        assert optimal.mean() >= 0.9
        assert ((q == robot.lower) | (q == robot.upper)).sum(axis=1).mean() > 1


@pytest.mark.parametrize("joints", [1, 2, 4, 9])
def test_chains_of_any_axes(joints, rng):
    """Skew axes, prismatic and continuous joints; fewer joints than rows, where little or nothing can move."""
    for task in (mq.PoseTask(), mq.PositionTask()):
        robot = random_chain(joints, rng)
        problem = Problem(robot, Strict(mq.Posture()), task)
        for q in configurations(robot, rng, few(10)):
            row = row_of(robot.forward(q))
            problem.assert_told_as_it_is(row, *problem.settle(row, q))


def locked(robot: mq.Robot, joints: list[int], q: np.ndarray) -> DHTable:
    """A robot's table with these joints locked at their place in q (n,)."""
    links = [
        replace(link, lower=float(value), upper=float(value)) if i in joints else link
        for i, (link, value) in enumerate(zip(robot.dh.links, q, strict=True))
    ]
    return DHTable(links, name="locked")


@pytest.mark.parametrize("joints", [[], [0], [3, 6], [0, 1, 2, 3, 4], [0, 1, 2, 3, 4, 5, 6]])
@pytest.mark.parametrize("task", [mq.PoseTask(), mq.PositionTask()], ids=lambda task: type(task).__name__)
def test_locked_joints_stay_where_they_are(joints, task, maira, rng):
    for _ in range(few(10)):
        q = 0.5 * maira.random_configuration(rng)
        robot = mq.Robot.from_dh(locked(maira, joints, q))
        problem, row = Problem(robot, Strict(mq.Posture()), task), row_of(robot.forward(q))
        settled, outcome = problem.settle(row, q)
        assert np.array_equal(settled[joints], q[joints])
        problem.assert_told_as_it_is(row, settled, outcome)
        assert outcome[Refinement.PROJECTED_GRADIENT] <= STATIONARY


@pytest.mark.parametrize("stratum", ["one joint on its limit", "all joints on limits", "stretched elbow", "zero"])
@pytest.mark.parametrize("name", ["maira", "panda", "tiago"])
def test_hostile_starts_are_settled_or_told(name, stratum, rng):
    """Never out of the limits, off the pose or a false optimum; the reference engine settles no more of them."""
    robot, problem = arm(name), Problem(arm(name), Strict(mq.Posture()))
    optimal = general = 0
    for k in range(few(12)):
        q = robot.random_configuration(rng)
        corner = np.where(rng.random(robot.n) < 0.5, robot.lower, robot.upper)
        if stratum == "one joint on its limit":
            q[k % robot.n] = corner[k % robot.n]
        elif stratum == "all joints on limits":
            q = corner
        elif stratum == "stretched elbow":
            q[-4] = min(max(0.0, robot.lower[-4]), robot.upper[-4])
        else:
            q = robot.clip(np.zeros(robot.n))
        row = row_of(robot.forward(q))
        settled, outcome = problem.settle(row, q)
        assert outcome[Refinement.REACHED]
        problem.assert_told_as_it_is(row, settled, outcome)
        optimal += outcome[Refinement.PROJECTED_GRADIENT] <= STATIONARY
        general += problem.settle_generally(row, q).projected_gradient <= STATIONARY
    assert optimal >= general - 1


def test_weights_may_be_zero(rng):
    """One joint alone counts: one direction is settled, the others are free."""
    robot = arm("tiago")
    problem = Problem(robot, Strict(mq.Posture(weights=[1.0] + [0.0] * 7)))
    rows, starts = reached_starts(robot, rng, few(30))
    for row, start in zip(rows, starts, strict=True):
        q, outcome = problem.settle(row, start)
        problem.assert_told_as_it_is(row, q, outcome)
        assert outcome[Refinement.PROJECTED_GRADIENT] <= STATIONARY
    nothing = Problem(robot, Strict(mq.Posture(weights=0.0)))
    q, outcome = nothing.settle(rows[0], starts[0])
    assert np.abs(q - starts[0]).max() < 1e-4  # no more than from the tolerance onto the pose
    assert outcome[Refinement.PROJECTED_GRADIENT] == outcome[Refinement.OBJECTIVE] == 0.0


def test_a_walk_within_its_limits_converges_although_the_whole_space_is_not_convex(rng):
    """UR5 with its orientation free and a joint on its limit: the Hessian is indefinite there, and positive within."""
    robot, task = arm("ur5"), mq.PositionTask()
    problem = Problem(robot, Strict(mq.Posture()), task)
    rows, starts = reached_starts(robot, rng, few(2000), task)
    _, outcome = problem.settle_all(rows, starts)
    assert (outcome[:, Refinement.PROJECTED_GRADIENT] <= STATIONARY).mean() > 0.999 - 1 / len(rows)
    assert outcome[:, Refinement.ITERATIONS].mean() < 35


def test_the_budget_of_steps_is_kept(maira, rng):
    rows, starts = reached_starts(maira, rng, few(20))
    ample = Problem(maira, Strict(mq.Posture()))
    for steps in (0, 1, 2):
        scarce = Problem(maira, Strict(mq.Posture()), max_settling=steps)
        for row, start in zip(rows, starts, strict=True):
            q, outcome = scarce.settle(row, start)
            scarce.assert_told_as_it_is(row, q, outcome)
            assert outcome[Refinement.REACHED]
            assert outcome[Refinement.ITERATIONS] <= 1 + 13 * (steps + 1)
            assert scarce.total(row, q) >= ample.total(row, ample.settle(row, start)[0]) - 1e-6


@three_tasks
@nine_robots
def test_the_curvature_of_a_pose_is_that_of_its_jacobian(name, task, rng):
    """By central differences of the compiled Jacobian: the symmetric part of d(weights^T J)/dq."""
    problem = compiled(arm(name), task)
    n = problem.robot.n
    axes, origins, tool, e, J = kinematic_work(n)
    for q in configurations(problem.robot, rng, few(10)):
        row, weights = np.r_[np.eye(3).ravel(), 0, 0, 0], rng.normal(size=6)

        def weighted_rows(q, row=row, weights=weights):
            pose_cost(problem.chain, problem.settings, row, q, axes, origins, tool, e)
            jacobian(problem.chain, axes, origins, tool, J)
            return J @ weights

        D = difference_jacobian(weighted_rows, q)
        weighted_rows(q)
        C = np.zeros((n, n))
        add_curvature(J, weights, C)
        assert np.array_equal(C, C.T)
        assert np.abs(C - 0.5 * (D + D.T)).max() < 1e-8 * max(1.0, np.abs(D).max())


@pytest.mark.parametrize("error", [1e-9, 1e-3, 0.5, 3.1])
def test_the_exact_hessian_is_that_of_the_general_engine(error, rng):
    """For rotation errors near 0, small, large and near pi."""
    robot, task = arm("panda"), mq.PoseTask()
    problem = compiled(robot, task)
    axes, origins, tool, e, J = kinematic_work(7)
    H, c, weighted = np.full((7, 7), np.nan), np.full(7, np.nan), np.full(6, np.nan)
    for q in configurations(robot, rng, few(20)):
        axis = rng.normal(size=3)
        vector = np.sin(0.5 * error) * axis / np.linalg.norm(axis)
        turn = mq.pose(error * rng.normal(size=3), quaternion=[np.cos(0.5 * error), *vector])
        target, at = turn.act(robot.forward(q)), robot.at(q)
        pose_cost(problem.chain, problem.settings, row_of(target), q, axes, origins, tool, e)
        jacobian(problem.chain, axes, origins, tool, J)
        newton_model(problem.settings, J, e, weighted, H, c)
        cost = TaskCost((task.of(robot).toward({robot.tip: target}),))
        assert np.abs(H - ExactTaskCost(cost).hessian(at)).max() < 1e-9
        assert np.abs(c - cost.level(at).c).max() < 1e-9
