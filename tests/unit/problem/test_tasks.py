"""Tasks: error, Jacobian, weights, and the exactness of the cost's derivatives, for all of them on many robots."""

import numpy as np
import pytest
from support.derivatives import assert_close, difference_gradient, difference_jacobian
from support.own_tasks import height_task
from support.robots import load

import maira_qp as mq
from maira_qp.errors import OptionError, PoseError
from maira_qp.problem.qp.costs import ExactTaskCost, LevelObjective, TaskCost, WeightedCost
from maira_qp.solvers.solver import Solver

ROBOTS = ["maira", "panda", "pr2_arm", "tiago", "ur5", "talos_finger"]
POSES = [
    mq.PoseTask(),
    mq.PositionTask(),
    mq.OrientationTask(),
    mq.PoseTask(position_weight=0.5, orientation_weight=3.0),
    mq.PoseTask(position_weight=[1, 0, 2], orientation_weight=[0, 0.5, 1]),
    mq.PoseTask(position_weight=[1, 2, 0], orientation_weight=0.7, axes="target"),
    mq.OrientationTask(orientation_weight=[1, 1, 0], axes="target"),
    mq.PositionTask(position_weight=[0, 0, 1]),
]
"""What a target pose is asked for, by the same name in both axes."""


def others(robot, rng) -> list:
    """One of each of the other tasks, made for a robot, with random targets of their own."""
    middle = robot.moved_links[len(robot.moved_links) // 2]
    first, last = robot.moved_links[0], robot.moved_links[-1]
    target = robot.forward(robot.random_configuration(rng))
    coefficients = dict(zip(robot.joint_names, rng.normal(size=robot.n), strict=True))
    tasks = [
        mq.AxisTask(axis=rng.normal(size=3), direction=rng.normal(size=3)),
        mq.AxisTask(axis=[0, 1, 0], target=target, weight=2.0),
        mq.LookAtTask(axis=rng.normal(size=3), point=3 * rng.normal(size=3)),
        mq.LookAtTask(frame=middle, target=target),
        mq.RelativePoseTask(reference=middle, target=target, position_weight=2.0, orientation_weight=0.5),
        mq.RelativePoseTask(frame=first, reference=robot.tip, target=target),
        mq.JointCouplingTask(coefficients=coefficients, value=0.3, weight=2.0),
        mq.DampingTask(weight=rng.uniform(0.1, 1, robot.n)),
        mq.SwivelTask(shoulder=first, elbow=middle, wrist=last, angle=1.0),
        mq.SwivelTask(shoulder=first, elbow=middle, wrist=last, angle=-3.0, reference=(0.6, 0.8, 0.0), weight=0.5),
        mq.LimitTask(limit=mq.LinearLimit(rng.normal(size=(2, robot.n)), rng.normal(size=2))),
        height_task(),
    ]
    return [task.of(robot) for task in tasks]


@pytest.fixture(scope="module", params=ROBOTS)
def robot(request) -> mq.Robot:
    return mq.Robot.maira() if request.param == "maira" else load(request.param)


def named(task) -> str:
    return type(task).__name__


@pytest.mark.parametrize("task", POSES, ids=named)
def test_the_gradient_is_that_of_the_true_cost_at_any_error(robot, task, rng):
    """`c = -J^T W^2 e` against differences of `1/2 |W e|^2`, targets near and far, the orientation off by up to pi."""
    for _ in range(10):
        target = robot.forward(robot.random_configuration(rng))
        cost = TaskCost((task.of(robot).toward({robot.tip: target}),))
        q = robot.random_configuration(rng)
        assert_close(cost.level(robot.at(q)).c, difference_gradient(lambda q, c=cost: c.value(robot.at(q)), q), 1e-6)


def test_the_gradient_of_every_other_task_is_that_of_its_true_cost_too(robot, rng):
    compared = 0
    for _ in range(10):
        for task in others(robot, rng):
            cost, q = TaskCost((task,)), robot.random_configuration(rng)
            at = robot.at(q)
            if isinstance(task, mq.SwivelTask) and abs(float(task.error(at)[0])) > 3.1:
                continue  # the short way round changes sides
            compared += 1
            assert_close(cost.level(at).c, difference_gradient(lambda q, c=cost: c.value(robot.at(q)), q), 1e-5)
            assert np.array_equal(task.toward({}).error(at), task.error(at))
    assert compared > 100


@pytest.mark.parametrize("task", POSES, ids=named)
def test_the_jacobian_is_minus_the_errors_derivative_at_the_target(robot, task, rng):
    for _ in range(5):
        q = robot.random_configuration(rng)
        bound = task.of(robot).toward({robot.tip: robot.forward(q)})
        moved = difference_jacobian(lambda q, t=bound: t.error(robot.at(q)), q)
        assert_close(bound.jacobian(robot.at(q)), -moved, 1e-7)


@pytest.mark.parametrize("task", [POSES[i] for i in (0, 1, 2, 3, 5, 7)], ids=named)
def test_the_exact_hessian_is_the_derivative_of_the_gradient(robot, task, rng):
    for _ in range(5):
        target = robot.forward(robot.random_configuration(rng))
        tasks = TaskCost((task.of(robot).toward({robot.tip: target}),))
        q = robot.random_configuration(rng)
        H = ExactTaskCost(tasks).hessian(robot.at(q))
        assert_close(H, difference_jacobian(lambda q, t=tasks: t.level(robot.at(q)).c, q), 1e-5)


def test_the_change_by_a_short_motion_is_what_the_rows_tell(robot, rng):
    """`change = -J dq` at errors of any size, where rows and the error's own derivative differ; nothing by none."""
    for _ in range(5):
        target = robot.forward(robot.random_configuration(rng))
        bound = [task.of(robot).toward({robot.tip: target}) for task in POSES]
        for task in [*bound, *others(robot, rng)]:
            q, dq = robot.random_configuration(rng), 1e-5 * rng.normal(size=robot.n)
            at = robot.at(q)
            change, told = task.change(at, at, at.moved(dq)), -task.jacobian(at) @ (at.moved(dq).q - q)
            assert np.abs(task.change(at, at, at)).max() <= 1e-12
            if type(task) not in (mq.DampingTask, mq.LimitTask):  # one has no error, the other one to one side
                assert np.abs(change - told).max() <= 1e-7 * max(1.0, np.abs(task.jacobian(at)).max()), task


def test_a_level_below_the_first_is_the_sum_of_its_tasks_and_objectives(robot, rng):
    tasks = TaskCost((mq.PoseTask(target=robot.forward(robot.random_configuration(rng))).of(robot),))
    parts = (mq.ObjectiveTask(mq.Posture(), 0.3).of(robot), mq.ObjectiveTask(mq.Manipulability(), 2.0).of(robot))
    level, q = LevelObjective(tasks, parts), robot.random_configuration(rng)
    at = robot.at(q)
    total = tasks.value(at) + 0.3 * parts[0].objective.cost(at) + 2 * parts[1].objective.cost(at)
    assert level.cost(at) == pytest.approx(total)
    assert_close(level.gradient(at), difference_gradient(lambda q: level.cost(robot.at(q)), q), 1e-6)
    assert_close(level.hessian(at), difference_jacobian(lambda q: level.gradient(robot.at(q)), q), 1e-4)


def test_the_weighted_cost_is_the_sum_and_its_gradient_too(robot, rng):
    objective = mq.Posture().of(robot)
    tasks = TaskCost((mq.PoseTask(target=robot.forward(robot.random_configuration(rng))).of(robot),))
    cost = WeightedCost(tasks, objective, 0.3)
    q = robot.random_configuration(rng)
    at = robot.at(q)
    assert cost.value(at) == pytest.approx(tasks.value(at) + 0.3 * objective.cost(at))
    assert_close(cost.level(at).c, difference_gradient(lambda q: cost.value(robot.at(q)), q), 1e-6)
    assert np.linalg.eigvalsh(cost.level(at).H).min() > 0


def test_several_tasks_stack(maira, rng):
    q, goal = maira.random_configuration(rng), maira.random_configuration(rng)
    tip = mq.PoseTask(target=maira.forward(goal)).of(maira)
    elbow = mq.PositionTask(frame="link4", target=maira.forward(goal, "link4")).of(maira)
    both, at = TaskCost((tip, elbow)), maira.at(q)
    assert both.value(at) == pytest.approx(TaskCost((tip,)).value(at) + TaskCost((elbow,)).value(at))
    assert both.level(at).rows.shape == (9, 7)
    assert_close(both.level(at).c, difference_gradient(lambda q: both.value(maira.at(q)), q), 1e-6)


def test_the_residual_is_in_metres_and_radians_whatever_the_weights(maira):
    target = mq.pose([0.3, 0, 0.4], quaternion=[np.cos(0.1), 0, 0, np.sin(0.1)]) * maira.forward(np.zeros(7))
    at = maira.at(np.zeros(7))
    position, orientation = mq.PoseTask(target=target, position_weight=7.0).residual(at)
    assert orientation == pytest.approx(0.2)
    assert position == pytest.approx(np.linalg.norm(target.translation - maira.forward(np.zeros(7)).translation))
    assert mq.PositionTask(target=target).of(maira).residual(at) == (pytest.approx(position), 0.0)
    assert mq.OrientationTask(target=target).of(maira).residual(at) == (0.0, pytest.approx(0.2))


@pytest.mark.parametrize("weight", [[1, 2], [1, -1, 1], [1, np.nan, 1], -1, np.nan, np.inf, "2", True])
def test_a_weight_is_a_number_that_is_not_negative(weight):
    with pytest.raises(OptionError, match="position_weight"):
        mq.PoseTask(position_weight=weight)
    with pytest.raises(OptionError, match="orientation_weight"):
        mq.OrientationTask(orientation_weight=weight)


def test_a_metre_counts_by_the_arms_length(maira):
    """4 rad for the length of the arm, which is 1.953 m for MAIRA: an arm of any size is the same problem."""
    assert maira.length == pytest.approx(0.438 + 0.7 + 0.7 + 0.115)
    assert mq.PoseTask().of(maira).weights[0] == pytest.approx(4 / 1.953)
    assert mq.PoseTask(position_weight=3).of(maira).weights[0] == 3
    with pytest.raises(OptionError, match="weight"):
        _ = mq.PoseTask().weights


def test_a_target_of_its_own_is_checked_and_kept(maira):
    with pytest.raises(PoseError):
        mq.PoseTask(target=np.zeros((4, 4)))
    own = mq.PoseTask(target=np.eye(4))
    assert own.toward({"tool0": maira.forward(np.zeros(7))}) is own


def test_position_and_orientation_can_be_asked_for_alone(maira, rng):
    for task, free in ((mq.PositionTask(), "orientation"), (mq.OrientationTask(), "position")):
        solver = Solver(maira, task=task)
        for k in range(10):
            target = maira.forward(maira.random_configuration(rng))
            s = solver.solve(target, rng=k)
            assert s.success
            assert getattr(s, f"{free}_error") == 0.0
            found = maira.forward(s.q)
            if free == "orientation":
                assert np.linalg.norm(found.translation - target.translation) <= 1e-6
            else:
                assert np.abs(found.rotation - target.rotation).max() <= 1e-6
