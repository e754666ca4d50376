"""Tools, frames and rooms that are given with a call, in every verb: products of matrices are the truth."""

import pickle

import numpy as np
import pytest
from support.robots import load

import maira_qp as mq
from maira_qp.errors import ConfigurationError, FrameError, OptionError, PoseError

TOOL = mq.pose([0.05, -0.02, 0.13], rpy=[0.4, -0.3, 0.9])
ROOM = mq.pose([1.2, -0.7, 0.4], rpy=[0.2, 0.1, 2.0])


def off(T, target):
    """Largest error of a pose [m, rad]."""
    return np.abs(mq.pose_error(T, target)).max()


@pytest.fixture(scope="module")
def arm():
    return mq.Robot.maira()


@pytest.fixture(scope="module")
def solver(arm):
    return mq.Solver(arm)


def test_every_verb_takes_a_tool(arm, solver, rng):
    """The tool's frame, by forward kinematics of the plain arm, is at the target."""
    q = arm.random_configuration(rng) * 0.5
    target = arm.forward(q) * TOOL
    s = solver.solve(target, tool=TOOL)
    assert s.success
    assert s.backend == "compiled"
    assert off(arm.forward(s.q) * TOOL, target) < 1e-6
    assert s.robot.tip == "tool"
    b = solver.solve_batch([target, target * TOOL], tool=TOOL.homogeneous)
    assert b.success.all()
    assert off(arm.forward(b.q[1]) * TOOL, target * TOOL) < 1e-6
    t = solver.step(q + 0.01, target, 0.1, tool=TOOL)
    assert t.backend == "compiled"
    assert off(arm.forward(t.q) * TOOL, target) < 1e-3
    for one in solver.solutions(target, tool=TOOL):
        assert off(arm.forward(one.q) * TOOL, target) < 1e-6
    path = mq.paths.line(target, arm.forward(q + 0.02) * TOOL, step=0.01)
    followed = solver.track(path, q, tool=TOOL)
    assert followed
    assert max(off(arm.forward(q) * TOOL, mq.pose(matrix=T)) for q, T in zip(followed.q, path, strict=True)) < 1e-6


def test_a_tool_given_with_a_call_is_the_solver_with_the_tool(arm, solver, rng):
    """Errors are those of the tool's point, which is what tells a tool from a moved target, where one is missed."""
    made, far = solver.with_tool(TOOL), mq.pose([3.0, 0.5, 0.5], rpy=[0.3, 0.2, 0.1])
    assert made.robot == arm.with_tool(TOOL)
    a, b = solver.solve(far, tool=TOOL), made.solve(far)
    np.testing.assert_array_equal(a.q, b.q)
    assert a.status is mq.Status.UNREACHABLE
    reached = (arm.forward(a.q) * TOOL).translation
    assert a.position_error == pytest.approx(np.linalg.norm(far.translation - reached), rel=1e-9)
    assert solver.solve(far * TOOL.inverse()).position_error != pytest.approx(a.position_error, rel=1e-3)
    again = pickle.loads(pickle.dumps(made))
    np.testing.assert_array_equal(again.solve(far).q, b.q)
    np.testing.assert_array_equal(pickle.loads(pickle.dumps(solver)).solve(far, tool=TOOL).q, b.q)


def test_what_is_asked_of_the_tip_is_asked_of_the_tool(arm, rng):
    tasks = [mq.PositionTask(frame="tool0"), mq.AxisTask(frame="tool0", direction=[0, 0, -1], priority=2)]
    elbow = mq.PositionTask(frame="link4", target=arm.forward(arm.middle, "link4"), priority=3)
    objective = mq.Strict(mq.Manipulability(frame="tool0"))
    made = mq.Solver(arm, task=tasks, tasks=[elbow], redundancy=objective).with_tool(TOOL, name="nozzle")
    assert [task.frame for task in made.problem.hierarchy.all_tasks] == ["nozzle", "nozzle", "link4"]
    assert made.redundancy.objectives[0].frame == "nozzle"
    relative = mq.Solver(arm, task=mq.RelativePoseTask(frame="link4", reference="tool0")).with_tool(TOOL)
    assert relative.tasks[0].reference == "tool"


def test_tools_of_two_hands_keep_the_names_of_the_targets(rng):
    robot = load("baxter_arms")
    solver, q = mq.Solver(robot), robot.middle
    targets = {
        "left_gripper": robot.forward(q, "left_gripper"),
        "right_gripper": robot.forward(q, "right_gripper") * TOOL,
    }
    t = solver.step(q, targets, 0.01, tool={"right_gripper": TOOL})
    assert np.abs(t.velocity).max() < 1e-6
    with pytest.raises(FrameError, match="several tips"):
        solver.step(q, targets, 0.01, tool=TOOL)
    with pytest.raises(FrameError, match="not a tip"):
        solver.step(q, targets, 0.01, tool={"elbow": TOOL})


def test_a_target_in_a_frame_that_moves(arm, solver, rng):
    """The camera is on link5, where the robot stands."""
    q = arm.random_configuration(rng) * 0.5
    seen = arm.forward(q, "link5").inverse() * arm.forward(q + 0.05)
    target = arm.forward(q + 0.05)
    s = solver.solve(seen, q, in_frame="link5")
    assert off(arm.forward(s.q), target) < 1e-6
    np.testing.assert_allclose(s.q, solver.solve(target, q).q, atol=1e-8)
    by_name = solver.solve(seen.homogeneous, arm.joints(q), in_frame="link5")
    np.testing.assert_allclose(by_name.q, s.q, atol=1e-12)
    t = solver.step(arm.joints(q), seen, 0.01, in_frame="link5")
    np.testing.assert_allclose(t.q, solver.step(q, target, 0.01).q, atol=1e-12)
    starts = np.array([q, q + 0.1, q - 0.1])
    b = solver.solve_batch([seen] * 3, starts, in_frame="link5")
    for start, found in zip(starts, b.q, strict=True):
        assert off(arm.forward(found), arm.forward(start, "link5") * seen) < 1e-6
    path = solver.track([seen.homogeneous, seen.homogeneous], q, in_frame="link5")
    assert off(arm.forward(path.q[0]), target) < 1e-6
    with pytest.raises(ConfigurationError, match=r"'link5' moves with the joints, so that in_frame needs q0"):
        solver.solve(seen, in_frame="link5")
    with pytest.raises(FrameError, match="'camera' is not a frame"):
        solver.solve(seen, in_frame="camera")


def test_a_target_in_a_frame_that_stands(arm, rng):
    """Of a robot on a base the old base is a frame that needs no q0; with a tool too."""
    robot = arm.with_base(ROOM)
    solver, q = mq.Solver(robot), robot.random_configuration(rng)
    for tool, offset in ((None, mq.pose()), (TOOL, TOOL)):
        s = solver.solve(arm.forward(q) * offset, in_frame="base_link", tool=tool)
        assert s.success
        assert off(robot.forward(s.q) * offset, ROOM * arm.forward(q) * offset) < 1e-6


def test_a_base_for_each_target(arm, solver, rng):
    """What a cart that drives about can reach: targets in a room, bases in it, and one base for all."""
    configurations = [arm.random_configuration(rng) for _ in range(4)]
    bases = [ROOM * mq.pose(rng.uniform(-1, 1, 3), rpy=rng.uniform(-1, 1, 3)) for _ in configurations]
    targets = [base * arm.forward(q) for base, q in zip(bases, configurations, strict=True)]
    plain = solver.solve_batch([arm.forward(q) for q in configurations])
    for given in (bases, np.array([base.homogeneous for base in bases])):
        b = solver.solve_batch(targets, base=given)
        assert b.success.all()
        np.testing.assert_allclose(b.q, plain.q, atol=1e-6)
    one = solver.solve_batch(targets[0].homogeneous, base=bases)
    assert len(one) == 4
    assert one.success[0]
    np.testing.assert_allclose(solver.solve(targets[1], base=bases[1]).q, b.q[1], atol=1e-6)
    t = solver.step(configurations[2], targets[2], 0.01, base=bases[2])
    np.testing.assert_allclose(t.velocity, 0.0, atol=1e-6)
    bases[3] = np.full((4, 4), np.nan)
    assert solver.solve_batch(targets, base=bases).status[3] == mq.Status.INVALID_TARGET
    with pytest.raises(PoseError, match="2 bases, or configurations of the frame, for 4 targets"):
        solver.solve_batch(targets, base=bases[:2])
    with pytest.raises(OptionError, match="not both"):
        solver.solve(targets[0], base=ROOM, in_frame="base_link")
    with pytest.raises(PoseError, match="base"):
        solver.solve(targets[0], base=np.eye(3))


def test_targets_by_frame_move_with_the_base(rng):
    robot = load("baxter_arms")
    solver, q = mq.Solver(robot), robot.middle
    targets = {tip: ROOM * robot.forward(q, tip) for tip in robot.tips}
    assert np.abs(solver.step(q, targets, 0.01, base=ROOM).velocity).max() < 1e-6
    b = solver.solve_batch([targets, targets], q, base=np.array([ROOM.homogeneous] * 2))
    assert b.success.all()
    np.testing.assert_allclose(b.q, np.array([q, q]), atol=1e-6)


def test_data_by_name_are_given_in_the_frame_or_room_too(arm, rng):
    """The pose of a task with a target of its own, a gaze point, a direction; each call as with the data in the base.

    A pose that one hand has in the other, and a posture, stand in no base, whatever their shape is.
    """
    q, goal = arm.middle + 0.2, arm.forward(arm.middle + 0.3)
    point, direction = np.array([1.0, 0.3, 0.2]), np.array([0.3, 0.1, -1.0])
    tasks = [
        mq.LookAtTask(frame="link5", name="gaze", point=[1, 0, 0], priority=2),
        mq.AxisTask(name="up", direction=[0, 0, 1], priority=3),
    ]
    solver = mq.Solver(arm, task=mq.PositionTask(name="hand", target=arm.forward(q)), tasks=tasks)
    target = {"hand": goal, "gaze": point, "up": direction}
    eye, want = arm.forward(q, "link5"), solver.solve(target, q)
    for given, T in (({"base": ROOM}, ROOM), ({"in_frame": "link5"}, eye.inverse())):
        moved = {"hand": T * goal, "gaze": T * point, "up": T.rotation @ direction}
        np.testing.assert_allclose(solver.solve(moved, q, **given).q, want.q, atol=1e-5)
        np.testing.assert_allclose(solver.solve(moved, np.array([q]), **given).q, want.q, atol=1e-5)
        a, b = solver.step(q, moved, 0.01, **given), solver.step(q, target, 0.01)
        np.testing.assert_allclose(a.q, b.q, atol=1e-10)
    moved = {"hand": ROOM * goal, "gaze": ROOM * point, "up": ROOM.rotation @ direction}
    for many in ({key: [value] for key, value in moved.items()}, [moved]):
        np.testing.assert_allclose(solver.solve_batch(many, q, base=ROOM).q, [want.q], atol=1e-5)


def test_what_stands_in_no_base_is_not_moved(rng):
    """The pose of one hand in the other is the same in every room; (4, 4) is also four postures of four joints."""
    arms = load("baxter_arms")
    left, right = arms.tips
    held = arms.forward(arms.middle, right).inverse() * arms.forward(arms.middle, left)
    solver = mq.Solver(arms, task=mq.RelativePoseTask(frame=left, reference=right))
    for target in (held, {left: held}):
        assert np.abs(solver.step(arms.middle, target, 0.01, base=ROOM).velocity).max() < 1e-6
    four = mq.Robot.from_dh([mq.DHLink(a=0.3, lower=-2, upper=2)] * 4)
    solver, q = mq.Solver(four, task=mq.PositionTask(), redundancy=mq.Strict(mq.Posture())), four.middle + 0.3
    targets = {"tool0": [four.forward(q)] * 4, "posture": rng.uniform(-1, 1, (4, 4))}
    moved = {**targets, "tool0": [ROOM * four.forward(q)] * 4}
    np.testing.assert_allclose(solver.solve_batch(moved, base=ROOM).q, solver.solve_batch(targets).q, atol=1e-6)


@pytest.mark.parametrize("base", ["x", {}, 3])
def test_what_is_no_base_is_refused_by_that_name(solver, base):
    with pytest.raises(PoseError, match=r"^base must be a pose"):
        solver.solve(ROOM, base=base)
