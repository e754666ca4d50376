"""Tools, bases, locked joints and joints at rest, against Pinocchio on the whole model and products of matrices."""

import pickle

import numpy as np
import pinocchio as pin
import pytest
from support.robots import REAL_ROBOTS, load, urdf_file
from support.whole_model import WholeModel

import maira_qp as mq
from maira_qp.errors import FrameError, OptionError, PoseError, RobotError
from maira_qp.robots.model.pinocchio_versions import HAS_MIMIC

TOOL = mq.pose([0.05, -0.02, 0.13], rpy=[0.4, -0.3, 0.9])
BASE = mq.pose([1.2, -0.7, 0.4], rpy=[0.2, 0.1, 2.0])
SOME = ("panda", "ur5", "talos_arm", "pr2_arm", "panda_finger", "pr2_fingers")


def adjoint(T):
    """Jacobian rows from one base to another one, in which the old one stands at T."""
    return np.kron(np.eye(2), T.rotation)


def offset(J, p):
    """The Jacobian of a point that is fixed to the frame, at p (3,) from its origin in base axes."""
    moved = J.copy()
    moved[:3] += np.cross(J[3:].T, p).T
    return moved


@pytest.mark.parametrize("name", SOME)
def test_a_tool_stands_in_the_tip_and_the_base_in_the_world(name, rng):
    robot = load(name)
    tool = TOOL if len(robot.tips) == 1 else {robot.tip: TOOL}
    made = robot.with_tool(tool).with_base(BASE)
    assert made.joint_names == robot.joint_names
    assert made.base == "world"
    for _ in range(3):
        q = robot.random_configuration(rng)
        T, J = robot.forward(q), robot.jacobian(q)
        np.testing.assert_allclose(made.forward(q).homogeneous, (BASE * T * TOOL).homogeneous, rtol=0, atol=1e-14)
        expected = adjoint(BASE) @ offset(J, T.rotation @ TOOL.translation)
        np.testing.assert_allclose(made.jacobian(q), expected, rtol=0, atol=1e-13)
        for frame in robot.frames[:: max(1, len(robot.frames) // 5)]:  # all frames stay, the old tip among them
            moved = (BASE * robot.forward(q, frame)).homogeneous
            np.testing.assert_allclose(made.forward(q, frame).homogeneous, moved, rtol=0, atol=1e-14)
    assert pickle.loads(pickle.dumps(made)) == made != robot


@pytest.mark.parametrize("name", SOME)
def test_the_urdf_shows_what_was_changed(name, rng):
    """Read again, by our reader and by Pinocchio, it is the same robot."""
    robot = load(name).limited(margin=1e-3)
    tool = TOOL if len(robot.tips) == 1 else {robot.tip: TOOL}
    made = robot.with_base(BASE).with_tool(tool).limited(velocity=0.1)
    again = mq.Robot.from_urdf(made.urdf, tip=list(made.tips))
    assert again == made
    for key in ("lower", "upper", "velocity_limit"):
        np.testing.assert_array_equal(getattr(again, key), getattr(made, key))
    q = robot.random_configuration(rng)
    whole = WholeModel(made.urdf)
    T, J = whole.look(robot.joints(q), "world", made.tip)
    np.testing.assert_allclose(made.forward(q).homogeneous, T, rtol=0, atol=1e-12)
    np.testing.assert_allclose(made.jacobian(q), J, rtol=0, atol=1e-12)


def test_tools_at_load(rng):
    file, tip = urdf_file("panda"), REAL_ROBOTS["panda"].tip
    plain = mq.Robot.from_urdf(file, tip=tip)
    assert mq.Robot.from_urdf(file, tip=tip, tool=TOOL) == plain.with_tool(TOOL)
    maira = mq.Robot.maira()
    assert mq.Robot.from_dh(maira.dh, tool=TOOL) == maira.with_tool(TOOL)
    assert maira.with_tool(TOOL).dh is None
    made = mq.Robot.from_model(plain.model, tip=tip, tool=TOOL)
    q = plain.random_configuration(rng)
    np.testing.assert_allclose(made.forward(q).homogeneous, (plain.forward(q) * TOOL).homogeneous, rtol=0, atol=1e-14)


def test_a_model_relative_to_its_universe_keeps_it_as_a_frame(panda, rng):
    model = panda.model.copy()
    for frame in model.frames:
        frame.placement = mq.pose([0.1, 0, 0]) * frame.placement if frame.parentJoint == 0 else frame.placement
    robot = mq.Robot.from_model(model, tip=panda.tip)
    assert robot.base == "universe"
    made, q = robot.with_base(BASE).with_tool(TOOL), robot.random_configuration(rng)
    np.testing.assert_allclose(made.forward(q, "universe").homogeneous, BASE.homogeneous, rtol=0, atol=1e-15)
    expected = (BASE * robot.forward(q) * TOOL).homogeneous
    np.testing.assert_allclose(made.forward(q).homogeneous, expected, rtol=0, atol=1e-14)
    assert pickle.loads(pickle.dumps(made)) == made
    with pytest.raises(RobotError, match="no URDF"):
        made.urdf  # noqa: B018


def test_tools_of_several_tips(rng):
    robot = load("baxter_arms")
    other = mq.pose([0, 0.1, 0])
    one = robot.with_tool({"right_gripper": TOOL})
    assert one.tips == ("left_gripper", "right_gripper_tool")
    both = one.with_tool({"left_gripper": other, "right_gripper_tool": other}, name={"left_gripper": "camera"})
    assert both.tips == ("camera", "right_gripper_tool_tool")
    q = robot.random_configuration(rng)
    for tip, expected in (
        ("camera", robot.forward(q, "left_gripper") * other),
        ("right_gripper_tool_tool", robot.forward(q, "right_gripper") * TOOL * other),
    ):
        np.testing.assert_allclose(both.forward(q, tip).homogeneous, expected.homogeneous, rtol=0, atol=1e-14)
    with pytest.raises(FrameError, match="several tips, name the one"):
        robot.with_tool(TOOL)
    with pytest.raises(FrameError, match=r"'elbow' is not a tip.*left_gripper, right_gripper"):
        robot.with_tool({"elbow": TOOL})


def test_names_and_poses_that_cannot_be(panda):
    with pytest.raises(FrameError, match=r"there is a link 'tool' already.*name='tool2'"):
        panda.with_tool(TOOL).with_tool(TOOL)
    assert panda.with_tool(TOOL).with_tool(TOOL, name="second").tip == "second"
    with pytest.raises(FrameError, match="there is a link 'world' already"):
        panda.with_base(BASE).with_base(BASE)
    for name in ("", 3, None, "a\nb"):
        with pytest.raises(FrameError, match="must be text"):
            panda.with_tool(TOOL, name=name)
    for wrong in (np.eye(3), np.full((4, 4), np.nan), "flange"):
        with pytest.raises(PoseError):
            panda.with_tool(wrong)
        with pytest.raises(PoseError):
            panda.with_base(wrong)


@pytest.mark.parametrize("name", ["maira", "iiwa14"])
def test_an_srs_arm_with_a_tool_on_a_base_is_solved_in_closed_form(name, rng):
    """The wrist is a sphere still: proofs and whole lists of solutions are there."""
    robot = getattr(mq.Robot, name)().with_tool(TOOL).with_base(BASE)
    solver = mq.Solver(robot)
    target = robot.forward(robot.random_configuration(rng))
    listed = solver.solutions(target)
    assert listed.is_complete
    for one in listed:
        np.testing.assert_allclose(robot.forward(one.q).homogeneous, target.homogeneous, rtol=0, atol=1e-9)
    away = mq.pose(np.array([9.0, 0, 0]), matrix=target.rotation)
    assert solver.solve(away).status is mq.Status.UNREACHABLE
    batch = solver.solve_batch([robot.forward(robot.random_configuration(rng)) for _ in range(50)])
    assert batch.success.all()
    assert batch.backend == "compiled"


@pytest.mark.parametrize("name", ["panda", "ur5", "talos_arms", "pr2_arm", "panda_finger"])
def test_locked_joints_stand_where_they_are_put(name, rng):
    robot = load(name)
    q = robot.random_configuration(rng)
    tool = TOOL if len(robot.tips) == 1 else {robot.tip: TOOL}
    picked = sorted(rng.choice(robot.n, 2, replace=False).tolist())
    values = {robot.joint_names[k]: q[k] for k in picked}
    for made in (
        robot.limited(margin=1e-4).with_tool(tool).with_base(BASE).locked(values),
        robot.locked(values).with_base(BASE).limited(margin=1e-4).with_tool(tool),
    ):
        left = [k for k in range(robot.n) if k not in picked]
        assert made.joint_names == tuple(robot.joint_names[k] for k in left)
        np.testing.assert_allclose(made.upper, robot.upper[left] - 1e-4)
        np.testing.assert_array_equal(made.velocity_limit, robot.velocity_limit[left])
        for tip, old in zip(made.tips, robot.tips, strict=True):
            expected = BASE * robot.forward(q, old) * (TOOL if tip != old else pin.SE3.Identity())
            np.testing.assert_allclose(made.forward(q[left], tip).homogeneous, expected.homogeneous, rtol=0, atol=1e-13)
            J = adjoint(BASE) @ robot.with_tool(tool).jacobian(q, tip)[:, left]
            np.testing.assert_allclose(made.jacobian(q[left], tip), J, rtol=0, atol=1e-12)
        assert mq.Robot.from_urdf(made.urdf, tip=list(made.tips)) == made
        assert pickle.loads(pickle.dumps(made)) == made


def test_a_locked_arm_stays_in_the_compiled_engine(panda, rng):
    """Six joints in place of seven; the answer is one of the whole arm."""
    made, held = panda.locked({"panda_joint3": 0.2}), panda.joint_names.index("panda_joint3")
    q = panda.random_configuration(rng)
    q[held] = 0.2
    s = mq.Solver(made).solve(panda.forward(q))
    assert s.success
    assert s.backend == "compiled"
    found = panda.configuration({**s.joints, "panda_joint3": 0.2})
    np.testing.assert_allclose(panda.forward(found).homogeneous, panda.forward(q).homogeneous, rtol=0, atol=1e-5)


def test_followers_are_locked_with_their_leader(rng):
    """Panda's second finger mimics the first."""
    robot = load("panda_finger")
    q = robot.random_configuration(rng)
    made = robot.locked({robot.joint_names[-1]: q[-1]})
    assert not made.kinematics.has_mimic
    assert made.is_chain
    np.testing.assert_allclose(made.forward(q[:-1]).homogeneous, robot.forward(q).homogeneous, rtol=0, atol=1e-14)
    again = mq.Robot.from_urdf(made.urdf, tip=made.tip)
    np.testing.assert_allclose(again.forward(q[:-1]).homogeneous, robot.forward(q).homogeneous, rtol=0, atol=1e-14)


def test_what_cannot_be_locked(panda):
    with pytest.raises(OptionError, match=r"locked: 9 is outside the range of joint 'panda_joint3', -2\.\d+ to 2\.\d+"):
        panda.locked({"panda_joint3": 9.0})
    with pytest.raises(OptionError, match=r"'panda_joint9' is not a joint.*valid names: panda_joint1"):
        panda.locked({"panda_joint9": 0.0})
    with pytest.raises(OptionError, match="takes a mapping"):
        panda.locked(["panda_joint1"])
    with pytest.raises(RobotError, match="no joint is left that moves the tip"):
        panda.locked(panda.joints(panda.middle))
    arms = load("baxter_arms")
    left = {name: 0.0 for name in arms.joint_names if name.startswith("left") and name != "left_e1"}
    assert arms.locked(left).n == 8
    with pytest.raises(RobotError, match="moves the tip 'left_gripper'"):
        arms.locked({**left, "left_e1": 0.5})
    finger = load("panda_finger")
    (follower,) = set(finger.model.names[1:]) - set(finger.joint_names)
    with pytest.raises(OptionError, match="follows"):
        finger.locked({follower: 0.01})


PLACED = {
    "baxter": {"right_s0": 0.4, "right_e1": 1.2, "head_pan": -0.3},
    "pr2_arm": {"l_shoulder_pan_joint": 0.7, "l_wrist_roll_joint": 4.0, "r_gripper_joint": 0.05, "head_pan_joint": 0.2},
    "talos_arm": {"arm_right_4_joint": -1.1, "head_1_joint": 0.1, "gripper_left_joint": -0.4},
    "tiago": {"head_1_joint": 0.5, "gripper_left_finger_joint": 0.02},
    "panda": {"panda_finger_joint1": 0.03},
}
"""Joints beside the chain: those of the other arm, of the head, continuous ones, and grippers with mimic joints."""


@pytest.mark.parametrize("name", PLACED)
def test_joints_at_rest_stand_where_they_are_put(name, rng):
    robot = load(name)
    text = urdf_file(name).read_text()
    whole = WholeModel(text)
    placed = {joint: value for joint, value in PLACED[name].items() if joint in whole.joints}
    assert len(placed) >= 1
    made = robot.with_tool(TOOL).with_base(BASE).limited(margin=0.01).at_rest(placed)
    assert made.joint_names == robot.joint_names
    np.testing.assert_allclose(made.upper, robot.upper - 0.01)
    q, moved = robot.random_configuration(rng), 0
    for frame in robot.frames:
        T, _ = whole.look({**placed, **robot.joints(q)}, robot.base, frame)
        actual = made.forward(q, frame).homogeneous
        np.testing.assert_allclose(actual, BASE.homogeneous @ T, rtol=0, atol=1e-11, err_msg=frame)
        moved += np.abs(T - robot.forward(q, frame).homogeneous).max() > 1e-3
    assert moved >= len(placed)
    assert mq.Solver(made).engine_for("solve") == mq.Solver(robot).engine_for("solve")
    assert mq.Robot.from_urdf(made.urdf, tip=made.tip) == made
    back = made.at_rest({joint: whole.rest(joint) for joint in placed})
    np.testing.assert_allclose(
        back.forward(q, robot.frames[-1]).homogeneous,
        (BASE * robot.forward(q, robot.frames[-1])).homogeneous,
        rtol=0,
        atol=1e-12,
    )


@pytest.mark.skipif(not HAS_MIMIC, reason="this Pinocchio has no mimic joints")
@pytest.mark.parametrize("name", ["baxter", "pr2_arm", "panda"])
def test_joints_of_a_model_at_rest(name, rng):
    """From a Pinocchio model, in which continuous joints are pairs and mimic joints follow by themselves."""
    real, whole = REAL_ROBOTS[name], WholeModel(urdf_file(name).read_text())
    robot = mq.Robot.from_model(pin.buildModelFromUrdf(str(urdf_file(name)), mimic=True), real.tip, real.base)
    placed = {joint: value for joint, value in PLACED[name].items() if joint in whole.joints}
    made = robot.with_tool(TOOL).at_rest(placed)
    q = robot.random_configuration(rng)
    for frame in robot.frames[:: max(1, len(robot.frames) // 40)]:
        T, _ = whole.look({**placed, **robot.joints(q)}, robot.base, frame)
        np.testing.assert_allclose(made.forward(q, frame).homogeneous, T, rtol=0, atol=1e-11, err_msg=frame)
    with pytest.raises(OptionError, match="outside the range"):
        made.at_rest({next(iter(placed)): 99.0} if name != "pr2_arm" else {"head_pan_joint": 99.0})
    assert pickle.loads(pickle.dumps(made)).at_rest({}).tips == made.tips


def test_joints_at_rest_on_the_way_from_hand_to_hand(rng):
    """The tree is turned round, and with it the lift under both arms, which is placed all the same."""
    file, (right, left) = urdf_file("tiago_arms"), ("arm_right_tool_link", "arm_left_tool_link")
    robot = mq.Robot.from_urdf(file, tip=right, base=left)
    placed = {"torso_lift_joint": 0.2, "head_1_joint": 0.5}
    made, q = robot.at_rest(placed), robot.random_configuration(rng)
    model = pin.buildModelFromUrdf(str(file))
    data, whole = model.createData(), pin.neutral(model)
    for joint, value in {**robot.joints(q), **placed}.items():
        whole[model.joints[model.getJointId(joint)].idx_q] = value
    pin.framesForwardKinematics(model, data, whole)
    for frame in ("base_footprint", "head_2_link", right, "torso_lift_link"):
        a, b = (data.oMf[model.getFrameId(each, pin.FrameType.BODY)] for each in (left, frame))
        expected = (a.inverse() * b).homogeneous
        np.testing.assert_allclose(made.forward(q, frame).homogeneous, expected, rtol=0, atol=1e-12, err_msg=frame)
    before, after = (each.forward(q, "base_footprint").translation for each in (robot, made))
    assert np.linalg.norm(after - before) > 0.1


def test_what_cannot_be_placed(panda):
    with pytest.raises(OptionError, match=r"the joint 'panda_joint3' moves; robot\.locked"):
        panda.at_rest({"panda_joint3": 0.1})
    with pytest.raises(OptionError, match="'panda_finger_joint2' follows 'panda_finger_joint1'"):
        panda.at_rest({"panda_finger_joint2": 0.1})
    with pytest.raises(OptionError, match=r"outside the range of joint 'panda_finger_joint1', 0 to 0\.04"):
        panda.at_rest({"panda_finger_joint1": 0.1})
    with pytest.raises(OptionError, match=r"'finger' is not a joint.*panda_finger_joint1"):
        panda.at_rest({"finger": 0.1})
    with pytest.raises(OptionError, match="'joint1' moves"):
        mq.Robot.maira().at_rest({"joint1": 0.1})
