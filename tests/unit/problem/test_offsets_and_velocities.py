"""Offsets of frame tasks, relative poses with weights an axis, and joints that move: against independent truth."""

import numpy as np
import pinocchio as pin
import pytest
from support.robots import load

import maira_qp as mq
from maira_qp.errors import OptionError, PoseError

OFFSET = pin.SE3(pin.exp3(np.array([0.4, -0.2, 0.7])), np.array([0.05, -0.1, 0.2]))
TARGET = pin.SE3(pin.exp3(np.array([0.3, -0.9, 0.5])), np.array([0.4, 0.2, 0.8]))
DT = 0.01

OFFSET_TASKS = {
    "pose": mq.PoseTask(target=TARGET, offset=OFFSET),
    "uneven pose": mq.PoseTask(target=TARGET, offset=OFFSET, orientation_weight=[1, 0.3, 0], axes="target"),
    "position": mq.PositionTask(frame="link5", target=TARGET, offset=[0.05, -0.1, 0.2]),
    "orientation": mq.OrientationTask(target=TARGET, offset=OFFSET),
    "axis": mq.AxisTask(frame="link6", direction=[1, 2, 3], offset=OFFSET),
    "look": mq.LookAtTask(point=[1, 0.5, 0.3], offset=OFFSET),
    "relative": mq.RelativePoseTask(frame="tool0", reference="link3", target=TARGET, offset=OFFSET),
    "relative position": mq.RelativePoseTask(frame="tool0", reference="link3", target=TARGET, orientation_weight=0),
    "relative uneven": mq.RelativePoseTask(
        reference="link2", target=TARGET, offset=OFFSET, position_weight=[1, 0, 2], orientation_weight=[0.5, 0, 1]
    ),
}


@pytest.fixture
def q(maira):
    return maira.random_configuration(np.random.default_rng(8))


@pytest.mark.parametrize("label", OFFSET_TASKS)
def test_the_gradient_and_the_curvature_are_those_of_differences(maira, label, q):
    task, step = OFFSET_TASKS[label].of(maira), 1e-6

    def cost(q):
        r = task.weighted_error(maira.at(q))
        return 0.5 * float(r @ r)

    at = maira.at(q)
    A, r = task.rows(at)
    slopes = [(cost(q + dq) - cost(q - dq)) / (2 * step) for dq in step * np.eye(7)]
    np.testing.assert_allclose(-A.T @ r, slopes, atol=2e-7)
    pull = np.random.default_rng(1).normal(size=len(r))
    nudges = 1e-5 * np.eye(7)
    weights = np.asarray(task.weights) * np.ones(len(r))
    C = np.array([weights * pull @ (task.jacobian(at.moved(d)) - task.jacobian(at.moved(-d))) for d in nudges]) / 2e-5
    np.testing.assert_allclose(task.curvature(at, pull), 0.5 * (C + C.T), atol=1e-6)


def test_a_task_with_an_offset_is_that_of_a_frame_that_stands_there(maira, q):
    there = maira.forward(q, "link5") * OFFSET
    task = mq.PoseTask(frame="link5", offset=OFFSET, target=there).of(maira)
    np.testing.assert_allclose(task.error(maira.at(q)), 0.0, atol=1e-12)
    point = mq.PositionTask(offset=OFFSET.translation, target=TARGET).of(maira)
    expected = TARGET.translation - maira.forward(q).act(OFFSET.translation)
    np.testing.assert_allclose(point.error(maira.at(q)), expected, atol=1e-12)
    for wrong in ([1, 2], np.full(3, np.nan), np.full((4, 4), 2.0)):
        with pytest.raises((OptionError, PoseError), match="offset"):
            mq.PoseTask(offset=wrong)


def test_a_solve_brings_the_offset_to_the_target_and_its_derivative_is_that_of_differences(maira, q):
    solver = mq.Solver(maira, task=mq.PoseTask(offset=OFFSET), redundancy=mq.Strict(mq.Posture()))
    target = maira.forward(q) * OFFSET
    solution = solver.solve(target, maira.clip(q + 0.1))
    assert solution.success
    there = maira.forward(solution.q) * OFFSET
    np.testing.assert_allclose(there.homogeneous, target.homogeneous, atol=3e-6)
    step = 1e-4
    twists = step * np.eye(6)

    def moved(twist):
        return pin.SE3(pin.exp3(twist[3:]) @ target.rotation, target.translation + twist[:3])

    D = np.array([solver.solve(moved(t), solution.q).q - solver.solve(moved(-t), solution.q).q for t in twists]).T
    np.testing.assert_allclose(solution.jacobian(), D / (2 * step), atol=2e-2)
    assert "reached" in str(solution.explain())


@pytest.mark.parametrize("name", ["maira", "panda", "ur5"])
def test_an_offset_of_the_tip_is_that_of_a_tool_in_every_verb(maira, name, rng):
    """Compiled, in closed form, proved, and named as the task is: the same as for an arm with that tool."""
    robot = maira if name == "maira" else load(name)
    solver = mq.Solver(robot, task=mq.PoseTask(name="grip", offset=OFFSET, position_weight=2.0))
    of_tool = mq.Solver(robot.with_tool(OFFSET), task=mq.PoseTask(position_weight=2.0))
    assert solver.engine_for("solve").engine == "compiled"
    target = of_tool.robot.forward(robot.middle + 0.3 * rng.normal(size=robot.n))
    for wishes in ({}, {"q0": robot.middle}, {"accept": lambda q: q[0] > 0}, {"q0": robot.middle, "prefer": "closest"}):
        s, other = solver.solve({"grip": target}, **wishes), of_tool.solve(target, **wishes)
        assert s.status is other.status
        assert s.q == pytest.approx(other.q, abs=1e-6)
        assert mq.pose_error(robot.forward(s.q) * OFFSET, target) == pytest.approx(np.zeros(6), abs=1e-6)
    assert len(solver.solutions(target)) == len(of_tool.solutions(target))
    far = mq.pose([9.0, 0.0, 0.0])
    assert solver.solve(far).status is of_tool.solve(far).status
    assert (solver.solve(far).proof is None) == (of_tool.solve(far).proof is None)
    path = mq.paths.line(target, target * mq.pose([0.02, 0.0, 0.0]))
    p = solver.track(path, q0=s.q)
    assert p.success.all() == of_tool.track(path, q0=s.q).success.all()
    assert p.success.any()


@pytest.mark.parametrize(
    "options", [{"backend": "daqp"}, {"limits": [mq.HalfSpaceLimit(normal=[0, 0, -1], point=[0, 0, 9.0])]}]
)
def test_what_is_proved_of_a_tool_is_proved_of_an_offset(maira, options):
    far = pin.SE3(np.eye(3), np.array([4.0, 0.0, 0.5]))
    of_tool = mq.Solver(maira.with_tool(OFFSET), **options).solve(far)
    of_offset = mq.Solver(maira, task=mq.PoseTask(offset=OFFSET), **options).solve(far)
    assert of_offset.status == of_tool.status == mq.Status.UNREACHABLE


@pytest.mark.parametrize("acceleration", [None, 8.0])
@pytest.mark.parametrize("label", OFFSET_TASKS)
def test_compiled_ticks_are_those_of_the_reference(maira, label, acceleration):
    robot = maira if acceleration is None else maira.limited(acceleration=acceleration)
    wish, rng = mq.Strict(mq.Posture()), np.random.default_rng(4)
    compiled, general = (
        mq.Solver(robot, task=OFFSET_TASKS[label], redundancy=wish, backend=backend) for backend in (None, "daqp")
    )
    for dt in (0.001, 0.01, 0.1):
        q, v = robot.random_configuration(rng), 0.1 * rng.normal(size=7)
        fast, slow = (solver.step(q, None, dt, velocity=v) for solver in (compiled, general))
        assert fast.backend == "compiled"
        np.testing.assert_allclose(fast.q, slow.q, rtol=0, atol=1e-7)
        assert fast.position_error == pytest.approx(slow.position_error, abs=1e-7)
        assert fast.orientation_error == pytest.approx(slow.orientation_error, abs=1e-7)


def test_a_free_relative_orientation_stays_free(maira, q):
    goal = maira.clip(q + 0.2)
    target = maira.forward(goal, "link2").actInv(maira.forward(goal))
    task = mq.RelativePoseTask(frame="tool0", reference="link2", orientation_weight=0)
    solution = mq.Solver(maira, task=task).solve(target, q)
    assert solution.success
    seen = maira.forward(solution.q, "link2").actInv(maira.forward(solution.q))
    np.testing.assert_allclose(seen.translation, target.translation, atol=2e-6)
    assert np.linalg.norm(pin.log3(seen.rotation.T @ target.rotation)) > 1e-2


@pytest.mark.parametrize("backend", [None, "daqp"])
def test_joints_move_at_their_velocity_where_nothing_hinders_them(maira, backend):
    v = np.array([0.3, -0.2, 0.1, 0.05, 0.0, -0.4, 0.2])
    solver = mq.Solver(maira, task=mq.JointVelocityTask(velocity=v), backend=backend)
    step = solver.step(maira.middle, None, DT)
    np.testing.assert_allclose(step.velocity, v, atol=1e-6)
    assert step.status is mq.StepStatus.MOVING
    moved = solver.step(maira.middle, {"joint_velocity": -v}, DT)
    np.testing.assert_allclose(moved.velocity, -v, atol=1e-6)
    assert not solver.step(maira.middle, {"joint_velocity": 0 * v}, DT).velocity.any()
    named = mq.Solver(maira, task=mq.JointVelocityTask(velocity={"joint3": 0.5}), backend=backend)
    np.testing.assert_allclose(named.step(maira.middle, None, DT).velocity, 0.5 * np.eye(7)[2], atol=1e-6)


@pytest.mark.parametrize("backend", [None, "daqp"])
def test_a_velocity_below_a_pose_is_that_of_the_self_motion_nearest_to_it(maira, q, backend):
    v = 0.2 * np.ones(7)
    solver = mq.Solver(maira, tasks=[mq.JointVelocityTask(velocity=v, priority=2)], backend=backend)
    step = solver.step(q, maira.forward(q), 1e-3)
    J = maira.jacobian(q)
    expected = v - np.linalg.pinv(J) @ (J @ v)
    np.testing.assert_allclose(step.velocity, expected, atol=2e-4)
    assert step.position_error < 1e-5


@pytest.mark.parametrize("backend", [None, "daqp"])
def test_with_limits_on_acceleration_a_velocity_is_reached_and_kept(maira, backend):
    robot = maira.limited(acceleration=5.0)
    v = np.array([0.5, -0.3, 0.2, 0.1, 0.0, -0.4, 0.05])
    solver = mq.Solver(robot, task=mq.JointVelocityTask(velocity=v), backend=backend)
    q, velocity = robot.middle, np.zeros(7)
    for _ in range(25):
        step = solver.step(q, None, DT, velocity=velocity)
        assert np.abs(step.velocity - velocity).max() <= 5.0 * DT + 1e-9
        q, velocity = step.q, step.velocity
    np.testing.assert_allclose(velocity, v, atol=1e-3)


def test_solves_know_nothing_of_velocities(maira, q):
    task = mq.JointVelocityTask(velocity=np.ones(7), priority=2)
    solver, plain = mq.Solver(maira, tasks=[task]), mq.Solver(maira)
    T = maira.forward(q)
    np.testing.assert_array_equal(solver.solve(T, q).q, plain.solve(T, q).q)
    assert solver.engine_for("solve").engine == "compiled"
    assert solver.solve({"tool0": T, "joint_velocity": np.zeros(7)}).success
    alone = mq.Solver(maira, task=mq.JointVelocityTask(velocity=np.ones(7)))
    np.testing.assert_array_equal(alone.solve(None, q).q, q)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"velocity": np.ones(6)}, "velocity of 'joint_velocity'"),
        ({"velocity": {"elbow": 1.0}}, "'elbow' is not a joint of maira"),
        ({"velocity": [1.0], "joints": "joint1"}, "must be a list of names"),
        ({"velocity": {"joint1": 1.0}, "joints": ["joint2"]}, "must name each of joint2"),
    ],
)
def test_what_is_no_velocity_is_said(maira, arguments, words):
    with pytest.raises(OptionError, match=words):
        mq.Solver(maira, task=mq.JointVelocityTask(**arguments))
