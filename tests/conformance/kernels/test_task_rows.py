"""The errors, rows and models of a tick's tasks, kind by kind, against the tasks' own classes and differences."""

from typing import NamedTuple

import numpy as np
import pinocchio as pin
import pytest
from numba import njit
from support.compiled_problems import arm, few, first_in_plain_python
from support.derivatives import assert_close, difference_gradient, difference_jacobian

import maira_qp as mq
from maira_qp.kernels.control.level_models import (
    add_curvature,
    level_costs,
    level_model,
    note_start,
    note_where,
    row_changes,
)
from maira_qp.kernels.control.step_workspace import carve_step_work
from maira_qp.kernels.layout import Place, Step, TaskRow
from maira_qp.kernels.spatial.so3 import bend_of_logarithm, inverse_right_jacobian
from maira_qp.problem.qp.costs import TaskCost
from maira_qp.problem.tasks import frame
from maira_qp.problem.tasks.task import Task

pytestmark = pytest.mark.xdist_group("task rows")  # `model_into` takes long to compile: once will do

ROBOTS = ["panda", "tiago_arms", "allegro"]


class Model(NamedTuple):
    """What the kernel makes of a task at a configuration."""

    numbers: np.ndarray
    """(2,) cost, damping asked for"""
    e: np.ndarray
    """(6,)"""
    gradient: np.ndarray
    pull: np.ndarray
    rows: np.ndarray
    curvature: np.ndarray
    """(n, n) of the cost, beside `rows^T rows`, where all of the error stays"""
    bend: np.ndarray
    """(n, n) of the rows, times the multipliers `rows x`"""


@njit(_nrt=False)
def copy(source, out):
    for index in np.ndindex(source.shape):
        out[index] = source[index]


@njit(_nrt=False)
def model_into(tree, parents, tasks, places, objectives, targets, q, x, memory, index, out):
    """The model of the first level, and how its rows bend, as a level below it feels that."""
    n, m = len(q), len(out.rows)
    work = carve_step_work(n, len(tasks), m, len(objectives), memory, index)
    copy(targets, work.targets)
    work.fade[0] = 1.0
    level_costs(tree, parents, tasks, places, objectives, work, q, work.values)
    out.numbers[0] = work.values[0]
    out.numbers[1] = level_model(tree, parents, tasks, places, objectives, 0, work, q)
    copy(work.e[0], out.e)
    copy(work.g, out.gradient)
    copy(work.c[0], out.pull)
    out.rows[:] = 0.0
    for k in range(work.ends[0]):
        work.weights[k], work.left[k] = 0.0, work.errors[k]
        for i in range(n):
            out.rows[k, i] = work.rows[k, i]
            work.weights[k] += work.rows[k, i] * x[i]
    work.H[1][:] = 0.0
    add_curvature(tree, parents, tasks, places, 1, False, work, q)
    add_curvature(tree, parents, tasks, places, 0, True, work, q)
    copy(work.H[0], out.curvature)
    copy(work.H[1], out.bend)


@njit(_nrt=False)
def changes_into(tree, parents, tasks, places, objectives, targets, q, there, ahead, memory, index, changes):
    """What the way from there to ahead changes of the rows of the first level at q."""
    work = carve_step_work(len(q), len(tasks), len(changes), len(objectives), memory, index)
    copy(targets, work.targets)
    work.fade[0] = 1.0
    level_costs(tree, parents, tasks, places, objectives, work, q, work.values)
    level_model(tree, parents, tasks, places, objectives, 0, work, q)
    note_start(work)
    level_costs(tree, parents, tasks, places, objectives, work, there, work.values)
    note_where(work)
    level_costs(tree, parents, tasks, places, objectives, work, ahead, work.values)
    changes[:] = 0.0
    row_changes(tasks, places, 1, work, changes)


class Kernel:
    """The kernel's view of one task with a target of its own, above a posture."""

    def __init__(self, robot: mq.Robot, task: Task) -> None:
        self.problem = mq.Solver(robot, task=task, redundancy=mq.Strict(mq.Posture())).engines.compiled_tick
        assert self.problem is not None
        assert (self.problem.places[:, Place.SOURCE] == -1).all()

    def __call__(self, q: np.ndarray, x: np.ndarray | None = None) -> Model:
        """The model at q, from work that holds rubbish."""
        p, n = self.problem, self.problem.n
        shapes = (2,), (6,), (n,), (n,), (int(p.numbers[Step.ROWS]), n), (n, n), (n, n)
        out = Model(*(np.full(shape, np.nan) for shape in shapes))
        floats, integers = p.sizes
        targets = np.ascontiguousarray(p.tasks[:, TaskRow.TARGET : TaskRow.TARGET + 12])
        work = np.full(floats, np.nan), np.full(integers, -(2**62))
        x = np.zeros(n) if x is None else x
        model_into(p.tree, p.parents, p.tasks, p.places, p.objectives, targets, q, x, *work, out)
        return out

    def changes(self, q: np.ndarray, there: np.ndarray, ahead: np.ndarray) -> np.ndarray:
        """What a way from there to ahead changes of its weighted errors, from work that holds rubbish."""
        p = self.problem
        floats, integers = p.sizes
        targets = np.ascontiguousarray(p.tasks[:, TaskRow.TARGET : TaskRow.TARGET + 12])
        work, changes = (np.full(floats, np.nan), np.full(integers, -(2**62))), np.empty(int(p.numbers[Step.ROWS]))
        changes_into(p.tree, p.parents, p.tasks, p.places, p.objectives, targets, q, there, ahead, *work, changes)
        return changes


def tasks_of(robot: mq.Robot, rng: np.random.Generator, target: pin.SE3) -> dict[str, Task]:
    """One of each kind, with the target as their own."""
    tip, links = robot.tips[0], robot.moved_links
    middle = links[len(links) // 2]
    placed, away = {"frame": tip, "target": target}, pin.SE3(target.rotation, target.translation + rng.normal(size=3))
    uneven = {"position_weight": [1, 0, 2], "orientation_weight": [0, 0.5, 1]}
    coupling = dict(zip(robot.joint_names, rng.normal(size=robot.n), strict=True))
    swivel = {"shoulder": links[1], "elbow": middle, "wrist": links[-1]}
    tasks = {
        "pose": mq.PoseTask(**placed, damping=0.3, gain=0.7),
        "pose in the target": mq.PoseTask(**placed, axes="target"),
        "position": mq.PositionTask(**placed),
        "position by axis": mq.PositionTask(**placed, position_weight=[0, 1, 2], axes="target"),
        "uneven": mq.PoseTask(**placed, **uneven, gain=0.5),
        "uneven in the target": mq.PoseTask(**placed, **uneven, axes="target"),
        "orientation by axis": mq.OrientationTask(**placed, orientation_weight=[1, 1, 0]),
        "axis": mq.AxisTask(**placed, axis=rng.normal(size=3), weight=2.0),
        "direction": mq.AxisTask(frame=tip, direction=rng.normal(size=3)),
        "look": mq.LookAtTask(frame=tip, target=away, axis=rng.normal(size=3), damping=0.1, gain=0.3),
        "point": mq.LookAtTask(frame=tip, point=rng.normal(size=3)),
        "relative": mq.RelativePoseTask(**placed, reference=middle, position_weight=2.0, orientation_weight=0.5),
        "coupling": mq.JointCouplingTask(coefficients=coupling, value=0.3, weight=2.0),
        "damping": mq.DampingTask(weight=np.arange(robot.n) % 3, priority=1),
        "swivel": mq.SwivelTask(**swivel, angle=1.0, priority=1, weight=0.5),
        "swivel from a direction": mq.SwivelTask(**swivel, angle=-9.0, reference=(0.6, 0.8, 0), priority=1),
    }
    return {name: task.of(robot) for name, task in tasks.items()}


def cases(robot: mq.Robot, rng: np.random.Generator, count: int):
    """Configurations and targets of the first tip: far from each other, by nearly half a turn, near, and the same."""
    for k in range(count):
        q = robot.random_configuration(rng)
        here = robot.forward(q, robot.tips[0])
        turn, away = rng.normal(size=(2, 3))
        angle, shift = [(1.0, 0.3), (np.pi - 1e-3, 1.0), (1e-3, 1e-2), (1e-9, 1e-9), (0.0, 0.0)][k % 5]
        R = pin.exp3(angle * turn / np.linalg.norm(turn)) @ here.rotation
        yield q, pin.SE3(R, here.translation + shift * away)


@pytest.mark.parametrize("name", ROBOTS)
def test_each_kind_is_the_task_of_its_class(name, rng):
    """Cost, error, gradient, pull, rows, curvature of the cost and of the rows, damping; some by differences."""
    robot = arm(name)
    for q, target in cases(robot, rng, few(10)):
        at, x = robot.at(q), rng.normal(size=robot.n)
        for label, task in tasks_of(robot, rng, target).items():
            model, cost = Kernel(robot, task)(q, x), TaskCost((task,))
            gauss_newton, (value, asked) = model.rows.T @ model.rows, model.numbers
            rows, r = cost.rows(at)
            by_differences = type(task).curvature is Task.curvature
            for found, expected in (
                (value, cost.value(at)),
                (np.linalg.norm(model.e.reshape(2, 3), axis=1), np.array(task.residual(at))),
                (model.gradient, -rows.T @ r),
                (model.pull, cost.pull(at)),
                (gauss_newton, rows.T @ rows),
                (asked, cost.damping(at)),
            ):
                assert np.abs(found - expected).max() < 1e-11 * max(1.0, np.abs(expected).max()), label
            for found, expected in (
                (model.curvature, task.residual_curvature(at, r)),
                (model.bend, task.curvature(at, rows @ x)),
            ):
                within = 1e-4 if by_differences else 1e-11
                assert np.abs(found - expected).max() < within * max(1.0, np.abs(expected).max()), label


@pytest.mark.parametrize("name", first_in_plain_python(*ROBOTS))
def test_changes_are_those_of_the_class(name, rng):
    """Of short and of long ways. The rows may have other axes, so what counts is what they pull at the joints."""
    robot = arm(name)
    for k, (q, target) in enumerate(cases(robot, rng, few(10))):
        there = q + (0.0, 0.1, 1.0)[k % 3] * rng.normal(size=robot.n)
        ahead = there + (1e-4, 0.1, 1.0)[k % 3] * rng.normal(size=robot.n)
        for label, task in tasks_of(robot, rng, target).items():
            kernel = Kernel(robot, task)
            rows, change = task.rows(robot.at(q))[0], task.weighted_change(*map(robot.at, (q, there, ahead)))
            told, changed = kernel(q).rows, kernel.changes(q, there, ahead)
            off = told.T @ changed[: len(told)] - rows.T @ change
            assert np.abs(off).max() < 1e-11 * max(1.0, np.abs(rows.T @ change).max()), label


@pytest.mark.parametrize("name", first_in_plain_python(*ROBOTS))
def test_gradients_are_differences_of_costs_and_hessians_of_gradients(name, rng):
    robot = arm(name)
    for q, target in cases(robot, rng, few(3)):
        for task in tasks_of(robot, rng, target).values():
            kernel = Kernel(robot, task)
            model = kernel(q)
            if np.abs(model.e[3:]).max() > 3.1:
                continue  # the short way round changes sides
            assert_close(model.gradient, difference_gradient(lambda q, f=kernel: f(q).numbers[0], q), 1e-5)
            if isinstance(task, frame.FrameTask):
                H = model.rows.T @ model.rows + model.curvature
                assert_close(H, difference_jacobian(lambda q, f=kernel: f(q).gradient, q), 1e-5)


def test_an_axis_that_points_away_turns_about_any_other_and_a_point_at_the_frame_is_in_no_direction(panda):
    q = panda.middle
    here = panda.forward(q)
    for axis in np.eye(3):
        task = mq.AxisTask(axis=axis, direction=-here.rotation @ axis).of(panda)
        assert np.linalg.norm(Kernel(panda, task)(q).e) == pytest.approx(np.pi)
    task = mq.LookAtTask(point=here.translation).of(panda)
    model = Kernel(panda, task)(q)
    assert np.linalg.norm(model.e) == pytest.approx(np.linalg.norm(task.error(panda.at(q))))
    assert np.isfinite(model.gradient).all()


def test_a_stretched_arm_has_no_swivel_angle():
    robot = mq.Robot.maira()
    links = robot.moved_links
    task = mq.SwivelTask(shoulder=links[1], elbow=links[3], wrist=links[5], angle=1.0, priority=1).of(robot)
    q = np.zeros(robot.n)
    assert task.swivel(robot.at(q)) is None
    model = Kernel(robot, task)(q)
    assert not any(part.any() for part in model)


@pytest.mark.parametrize("angle", [0.0, 1e-9, 1e-3, 9.9e-3, 1.1e-2, 0.09, 0.11, 1.0, 3.0, np.pi - 1e-4])
def test_derivatives_of_the_rotation_vector_are_those_of_the_frame_task(angle, rng):
    for _ in range(5):
        phi, u = rng.normal(size=(2, 3))
        phi *= angle / np.linalg.norm(phi)
        M, S = np.full((2, 3, 3), np.nan)
        inverse_right_jacobian(phi, M)
        bend_of_logarithm(phi, u, M, S)
        expected = frame.inverse_right_jacobian(phi)
        pull, G = frame.pull_of_logarithm(phi, u)
        np.testing.assert_allclose(M, expected, rtol=0, atol=1e-13 * np.abs(expected).max())
        np.testing.assert_allclose(M.T @ u, pull, rtol=0, atol=1e-13 * np.abs(pull).max())
        bend = -G @ expected
        np.testing.assert_allclose(S, 0.5 * (bend + bend.T), rtol=0, atol=1e-11 * max(1, np.abs(bend).max()))


def test_what_is_reported_is_of_the_first_priority_alone(panda):
    tasks = [mq.PositionTask(equality=True), mq.OrientationTask(), mq.LookAtTask(point=[1, 0, 1], priority=2)]
    problem = mq.Solver(panda, task=tasks).engines.compiled_tick
    assert problem is not None
    assert problem.numbers[Step.FIRST] == 2
