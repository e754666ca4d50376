"""Robots from Pinocchio models: what `from_model` takes, what it makes of it, and what it refuses."""

import copy
import pickle
from math import inf, nan

import numpy as np
import pinocchio as pin
import pytest
from support.robots import REAL_ROBOTS, load, urdf_file

import maira_qp as mq
from maira_qp.errors import FrameError, OptionError, RobotError
from maira_qp.robots.model import pinocchio_versions
from maira_qp.robots.model.pinocchio_versions import HAS_MIMIC

AT = pin.SE3(pin.utils.rpyToMatrix(0.3, -0.2, 0.5), np.array([0.1, 0.2, 0.3]))
RUB = pin.JointModelRUBZ
SOME = ("panda", "panda_finger", "ur5", "pr2_arm", "irb140", "iiwa14_urdf", "talos_arms", "allegro", "pr2_fingers")
"""Chains and trees, continuous joints, mimic joints, bases on the way."""
LIMITS = ("lower", "upper", "velocity_limit", "effort_limit")


def model_of(*joints, limits=(-1.0, 2.0), frames=True) -> pin.Model:
    """A chain of joints j1, j2, ..., each at `AT` on the one before it and with a link l1, l2, ..."""
    model = pin.Model()
    for i, joint in enumerate(joints, start=1):
        lower, upper = ([end] * joint.nq for end in limits)
        model.addJoint(i - 1, joint, AT, f"j{i}", *map(np.array, ([7.0] * joint.nv, [3.0] * joint.nv, lower, upper)))
        if frames:
            model.addJointFrame(i, 0)
            model.addFrame(pin.Frame(f"l{i}", i, 0, AT, pin.FrameType.BODY))
    return model


def in_pinocchio(model: pin.Model, robot: mq.Robot, q: np.ndarray) -> np.ndarray:
    """The configuration of a model (nq,) in which the robot's joints stand at q, all others at zero."""
    whole = pin.neutral(model)
    for name, value in zip(robot.joint_names, q, strict=True):
        joint = model.joints[model.getJointId(name)]
        whole[joint.idx_q : joint.idx_q + joint.nq] = [value] if joint.nq == 1 else [np.cos(value), np.sin(value)]
    return whole


def frame_of(model: pin.Model, q: np.ndarray, name: str) -> pin.SE3:
    data = model.createData()
    pin.framesForwardKinematics(model, data, q)
    return data.oMf[model.getFrameId(name, pin.FrameType.BODY)]


def read_by_pinocchio(name: str) -> pin.Model:
    """One of the real robots, with mimic joints where this version of Pinocchio has them."""
    return pin.buildModelFromUrdf(str(urdf_file(name)), **({"mimic": True} if HAS_MIMIC else {}))


@pytest.mark.parametrize("name", SOME)
def test_a_model_of_a_real_robot_is_the_robot_of_its_urdf(name, rng):
    """Read by Pinocchio alone, continuous and mimic joints among its joints: same kinematics, limits, frames."""
    real = REAL_ROBOTS[name]
    model = read_by_pinocchio(name)
    made, expected = mq.Robot.from_model(model, real.tip, real.base), load(name)
    order = [expected.joint_names.index(joint) for joint in made.joint_names]
    assert sorted(order) == list(range(expected.n))
    assert made.tips == expected.tips
    assert set(expected.tips) <= set(made.frames)
    if not expected.kinematics.has_mimic:  # whose limits the reader narrows to what followers allow
        for key in LIMITS:
            np.testing.assert_array_equal(getattr(made, key), getattr(expected, key)[order])
        assert made.length == pytest.approx(expected.length)
    for _ in range(3):
        q = expected.random_configuration(rng)
        for tip in made.tips:
            T, J = made.forward(q[order], tip).homogeneous, made.jacobian(q[order], tip)
            np.testing.assert_allclose(T, expected.forward(q, tip).homogeneous, rtol=0, atol=1e-12)
            np.testing.assert_allclose(J, expected.jacobian(q, tip)[:, order], rtol=0, atol=1e-12)
        if real.base is None:
            plain = frame_of(model, in_pinocchio(model, made, q[order]), made.tip).homogeneous
            np.testing.assert_allclose(made.forward(q[order]).homogeneous, plain, rtol=0, atol=1e-12)


@pytest.mark.parametrize("name", ["panda", "pr2_arm", "panda_finger"])
def test_a_model_is_solved_as_its_urdf_is(name, rng):
    """From the same starts the answers differ by rounding alone."""
    real, expected = REAL_ROBOTS[name], load(name)
    made = mq.Robot.from_model(read_by_pinocchio(name), real.tip, real.base)
    order = [expected.joint_names.index(joint) for joint in made.joint_names]
    if name == "panda_finger":
        made = made.limited(lower=np.maximum(made.lower, expected.lower[order]))
    q, q0 = expected.random_configuration(rng), 0.9 * expected.middle
    targets = {tip: expected.forward(q, tip) for tip in expected.tips}
    target = targets if len(targets) > 1 else targets[expected.tip]
    a, b = mq.Solver(expected).solve(target, q0), mq.Solver(made).solve(target, q0[order])
    assert a.success
    assert (a.status, a.backend) == (b.status, b.backend)
    np.testing.assert_allclose(b.q, a.q[order], rtol=0, atol=1e-6)


def test_a_model_made_by_hand_needs_no_frames(rng):
    """Joints without links are frames by their names; limits that were not given are none."""
    model = pin.Model()
    base = model.addJoint(0, pin.JointModelRZ(), AT, "turn")
    model.addJoint(base, pin.JointModelRUBX(), AT, "spin")
    model.addJoint(2, pin.JointModelRevoluteUnaligned(np.array([0.6, 0.0, 0.8])), AT, "tilt")
    robot = mq.Robot.from_model(model, name="hand made")
    assert (robot.base, robot.tip, robot.frames) == ("universe", "tilt", ("universe", "turn", "spin", "tilt"))
    assert robot.joint_names == ("turn", "spin", "tilt")
    assert (robot.n, robot.model.nq, robot.name, robot.moved_links) == (3, 3, "hand made", robot.joint_names)
    for key, values in zip(LIMITS, ([-inf] * 3, [inf] * 3, [inf] * 3, [inf] * 3), strict=True):
        assert getattr(robot, key).tolist() == values
    q, data = rng.uniform(-3, 3, 3), model.createData()
    pin.forwardKinematics(model, data, in_pinocchio(model, robot, q))
    np.testing.assert_allclose(robot.forward(q).homogeneous, data.oMi[3].homogeneous, rtol=0, atol=1e-14)
    s = mq.Solver(robot, task=mq.OrientationTask()).solve(robot.forward(q))
    assert s.success
    assert s.backend == "compiled"


def test_the_model_that_is_given_stays_as_it_is():
    model = model_of(pin.JointModelRX(), RUB(), pin.JointModelPY())
    before = model.copy()
    robot = mq.Robot.from_model(model, limits={"j1": (-0.5, 0.5)})
    assert model == before
    assert robot.lower.tolist() == [-0.5, -inf, -1.0]
    assert robot.upper.tolist() == [0.5, inf, 2.0]
    assert robot.velocity_limit.tolist() == [3.0] * 3
    assert robot.effort_limit.tolist() == [7.0] * 3
    model.lowerPositionLimit = model.lowerPositionLimit - 1
    assert robot.lower.tolist() == [-0.5, -inf, -1.0]


def test_a_base_on_the_way_is_the_origin(rng):
    """Poses are relative to it, the joints before it are gone, and so are the links beside it."""
    model = model_of(pin.JointModelFreeFlyer(), pin.JointModelRY(), pin.JointModelRZ(), pin.JointModelRX())
    robot = mq.Robot.from_model(model, "l4", "l2")
    assert (robot.joint_names, robot.frames) == (("j3", "j4"), ("l2", "l3", "l4"))
    q, other = rng.uniform(-1, 1, 2), pin.randomConfiguration(model, -np.ones(model.nq), np.ones(model.nq))
    for start in (pin.neutral(model), other):
        whole = np.concatenate([start[:8], q])
        T = frame_of(model, whole, "l2").actInv(frame_of(model, whole, "l4")).homogeneous
        np.testing.assert_allclose(robot.forward(q).homogeneous, T, rtol=0, atol=1e-14)


def test_joints_beside_the_way_stand_at_zero_or_at_the_limit_nearest_to_it(rng):
    model = model_of(pin.JointModelRX(), pin.JointModelRY(), pin.JointModelRZ())
    side = model.addJoint(1, pin.JointModelPX(), AT, "side", *map(np.array, ([1.0], [1.0], [0.25], [1.0])))
    model.addFrame(pin.Frame("aside", side, 0, AT, pin.FrameType.BODY))
    model.appendBodyToJoint(side, pin.Inertia.Random(), AT)
    robot = mq.Robot.from_model(model, "l3")
    q = rng.uniform(-1, 1, 3)
    whole = np.append(q, 0.25)
    for frame in ("l3", "aside"):
        T = frame_of(model, whole, frame).homogeneous
        np.testing.assert_allclose(robot.forward(q, frame).homogeneous, T, rtol=0, atol=1e-14)
    mass = pin.centerOfMass(robot.model, robot.model.createData(), q)
    np.testing.assert_allclose(mass, pin.centerOfMass(model, model.createData(), whole), rtol=0, atol=1e-12)


def test_joints_can_be_coupled_when_the_model_is_taken(rng):
    """The follower is where the independent joint of the model would be at multiplier q + offset."""
    joints = pin.JointModelRX(), pin.JointModelRevoluteUnaligned(np.array([0.6, 0.8, 0.0])), pin.JointModelPZ()
    model = model_of(*joints)
    robot = mq.Robot.from_model(model, mimic={"j3": ("j1", -2.0, 0.1)})
    assert robot.joint_names == ("j1", "j2")
    assert (robot.n, robot.model.nq, robot.model.nv) == (2, 2, 2)
    again = mq.Robot.from_model(robot.model)
    for _ in range(3):
        q = rng.uniform(-1, 1, 2)
        T = frame_of(model, np.append(q, -2 * q[0] + 0.1), "l3").homogeneous
        for each in (robot, again, pickle.loads(pickle.dumps(robot)), robot.limited(margin=0.1)):
            np.testing.assert_allclose(each.forward(q).homogeneous, T, rtol=0, atol=1e-13)


@pytest.mark.parametrize("again", [copy.copy, copy.deepcopy, lambda robot: pickle.loads(pickle.dumps(robot))])
def test_robots_of_models_copy_pickle_and_compare(again, rng):
    model = model_of(pin.JointModelRX(), RUB(), pin.JointModelPY(), pin.JointModelRY())
    robot = mq.Robot.from_model(model, acceleration=2.0, mimic={"j4": ("j1", 0.5, 0.0)})
    other, q = again(robot), robot.random_configuration(rng)
    assert other == robot == mq.Robot.from_model(model, acceleration=2.0, mimic={"j4": ("j1", 0.5, 0.0)})
    assert hash(other) == hash(robot)
    assert not other.lower.flags.writeable
    assert (other.forward(q).homogeneous == robot.forward(q).homogeneous).all()
    for key in (*LIMITS, "acceleration_limit"):
        assert (getattr(other, key) == getattr(robot, key)).all()
    assert robot != mq.Robot.from_model(model, acceleration=2.0, mimic={"j4": ("j1", 0.25, 0.0)})
    assert robot != robot.limited(velocity=1.0)
    assert robot != mq.Robot.from_model(model, acceleration=2.0)


def test_limits_of_a_model_are_set_and_released():
    robot = mq.Robot.from_model(model_of(pin.JointModelRX(), RUB(), pin.JointModelPY()))
    tight = robot.limited(lower={"j1": -0.5, "j2": -1}, upper={"j2": 1}, velocity=1, acceleration=5)
    assert tight.lower.tolist() == tight.model.lowerPositionLimit.tolist() == [-0.5, -1.0, -1.0]
    assert tight.upper.tolist() == tight.model.upperPositionLimit.tolist() == [2.0, 1.0, 2.0]
    assert tight.velocity_limit.tolist() == tight.model.velocityLimit.tolist() == [1.0] * 3
    assert tight.acceleration_limit.tolist() == [5.0] * 3
    assert tight.effort_limit.tolist() == [7.0] * 3
    free = tight.released(["j1 upper"])
    assert free.upper[0] == pytest.approx(2 + 2 * np.pi)
    assert robot.lower.tolist() == [-1.0, -inf, -1.0]
    with pytest.raises(OptionError, match="loosen"):
        robot.limited(upper=3)


def test_a_model_has_no_urdf():
    robot = mq.Robot.from_model(model_of(pin.JointModelRX()))
    assert robot.dh is None
    with pytest.raises(RobotError, match=r"made from a Pinocchio model.*from_urdf"):
        _ = robot.urdf
    with pytest.raises(RobotError, match="Pinocchio model"):
        mq.Solver(robot, limits=[mq.CollisionLimit()])


def test_tool_frames_can_be_tips(rng):
    """Several frames at the end of the joints: one must be named, unless it is carried by the others."""
    model = model_of(pin.JointModelRX(), pin.JointModelRY())
    model.addFrame(pin.Frame("tcp", 2, model.getFrameId("l2"), AT, pin.FrameType.OP_FRAME))
    robot, q = mq.Robot.from_model(model), rng.uniform(-1, 1, 2)
    assert robot.tip == "tcp"
    data = model.createData()
    pin.framesForwardKinematics(model, data, q)
    assert (robot.forward(q).homogeneous == data.oMf[model.getFrameId("tcp")].homogeneous).all()
    model.addFrame(pin.Frame("camera", 2, 0, AT, pin.FrameType.OP_FRAME))
    with pytest.raises(FrameError, match=r"2 tips, choose one .*tcp, camera"):
        mq.Robot.from_model(model)
    assert mq.Robot.from_model(model, ["camera", "l1"]).tips == ("camera", "l1")


@pytest.mark.parametrize(
    ("keys", "error", "message"),
    [
        ({"tip": "l9"}, FrameError, "the tip 'l9' is not a link.*l1, l2, l3"),
        ({"tip": 3}, FrameError, "the tip 3 is not"),
        ({"tip": []}, FrameError, "the list of tips is empty"),
        ({"tip": ["l3", "l3"]}, FrameError, "named twice"),
        ({"base": "l9"}, FrameError, "the base 'l9' is not.*universe"),
        ({"tip": "l1", "base": "l2"}, FrameError, "the tip 'l1' does not hang on the base 'l2'"),
        ({"tip": "l2", "base": "l2"}, RobotError, "no joint moves between base and tip 'l2'"),
        ({"limits": {"j9": (0, 1)}}, OptionError, "limits: 'j9' is not a joint that moves.*j1, j2, j3"),
        ({"limits": {"j1": (1, 0)}}, OptionError, "inverted"),
        ({"limits": {"j1": (nan, 0)}}, OptionError, "finite"),
        ({"limits": "j1"}, OptionError, "mapping"),
        ({"acceleration": -1}, OptionError, "acceleration limit must be positive"),
        ({"acceleration": [1, 2]}, OptionError, "acceleration must be real numbers of shape"),
        ({"name": " "}, RobotError, "name must be text"),
        ({"mimic": {"j1": ("j2", 1.0, 0.0)}}, RobotError, "'j1' mimics 'j2', which must .* come before it"),
        ({"mimic": {"j2": ("j9", 1.0, 0.0)}}, RobotError, "'j9' is not a joint"),
        ({"mimic": {"j2": ("j1", nan, 0.0)}}, RobotError, "finite"),
        ({"mimic": {"j2": "j1"}}, RobotError, "leader, multiplier, offset"),
        ({"mimic": ["j2"]}, RobotError, "mapping"),
        ({"base": "l1", "mimic": {"j2": ("j1", 1.0, 0.0)}}, RobotError, "'j1', which the base stands on"),
    ],
)
def test_what_makes_no_sense_is_refused(keys, error, message):
    with pytest.raises(error, match=message):
        mq.Robot.from_model(model_of(pin.JointModelRX(), pin.JointModelRY(), pin.JointModelRZ()), **keys)


@pytest.mark.parametrize("joint", [pin.JointModelFreeFlyer, pin.JointModelSpherical, pin.JointModelPlanar])
def test_joints_of_several_numbers_are_refused_with_a_way_out(joint, rng):
    model = model_of(joint(), pin.JointModelRX())
    with pytest.raises(RobotError, match=r"joint 'j1' is a .*not supported.*start behind it.*buildReducedModel"):
        mq.Robot.from_model(model)
    assert mq.Robot.from_model(model, base="l1").joint_names == ("j2",)
    fixed = pin.buildReducedModel(model, [1], pin.neutral(model))
    assert mq.Robot.from_model(fixed).joint_names == ("j2",)


@pytest.mark.parametrize(
    ("joint", "limits", "message"),
    [
        (pin.JointModelRX(), (1.0, -1.0), "'j1' has inverted limits, or NaN: 1 and -1; give it some, limits="),
        (pin.JointModelRX(), (nan, 1.0), "or NaN: nan and 1"),
        (pin.JointModelRX(), (-1.0, nan), "or NaN: -1 and nan"),
        (pin.JointModelRX(), (-1.0, inf), "'j1' has no lower and upper limit: -1 and inf"),
        (pin.JointModelPX(), (-inf, inf), "'j1' has no lower and upper limit"),
        (pin.JointModelPX(), (-1e308, 1e308), "'j1' has no lower and upper limit"),
    ],
)
def test_limits_that_make_no_sense_are_refused_unless_others_are_given(joint, limits, message):
    model = model_of(joint, limits=limits)
    with pytest.raises(RobotError, match=message):
        mq.Robot.from_model(model)
    assert mq.Robot.from_model(model, limits={"j1": (-1, 1)}).upper.tolist() == [1]


def test_models_that_cannot_be_used_are_refused():
    for wrong in (None, "arm.urdf", mq.Robot.maira()):
        with pytest.raises(RobotError, match=r"model must be a pinocchio\.Model"):
            mq.Robot.from_model(wrong)
    with pytest.raises(FrameError, match="0 tips"):
        mq.Robot.from_model(pin.Model())
    same = model_of(pin.JointModelRX(), pin.JointModelRY())
    same.names[2] = "j1"
    with pytest.raises(RobotError, match="names that differ, got 'j1', 'j1'"):
        mq.Robot.from_model(same)
    nowhere = model_of(pin.JointModelRX())
    nowhere.jointPlacements[1] = pin.SE3(np.eye(3), np.array([0, nan, 0]))
    with pytest.raises(RobotError, match="the placement of joint 'j1' is not finite"):
        mq.Robot.from_model(nowhere)
    fast = model_of(pin.JointModelRX())
    fast.velocityLimit = np.array([nan])
    with pytest.raises(RobotError, match="joint 'j1': its velocityLimit is NaN"):
        mq.Robot.from_model(fast)
    with pytest.raises(RobotError, match="101 joints move"):
        mq.Robot.from_model(model_of(*[pin.JointModelRX()] * 101))


def test_a_follower_beside_the_way_stands_where_its_leader_at_rest_has_it(rng):
    model = model_of(pin.JointModelRX(), pin.JointModelRY())
    side = model.addJoint(1, pin.JointModelPX(), AT, "side")
    model.addFrame(pin.Frame("aside", side, 0, AT, pin.FrameType.BODY))
    model.lowerPositionLimit = np.array([0.25, -1, -1])
    robot = mq.Robot.from_model(model, "l2", mimic={"side": ("j1", 2.0, 0.1)})
    q = rng.uniform(0.3, 1, 2)
    T = frame_of(model, np.append(q, 2.0 * 0.25 + 0.1), "aside").homogeneous
    np.testing.assert_allclose(robot.forward(q, "aside").homogeneous, T, rtol=0, atol=1e-14)


def test_a_pinocchio_without_mimic_joints_says_so(monkeypatch):
    """Robots without them are the same there; one with them names the joints and the remedy."""
    plain = load("panda")
    monkeypatch.setattr(pinocchio_versions, "HAS_MIMIC", False)
    assert load("panda") == plain
    mq.Solver(plain, limits=[mq.CollisionLimit(margin=0.01, missing="ignore")])
    with pytest.raises(RobotError, match=r"'panda_finger_joint2' mimics 'panda_finger_joint1'.*pin>=3\.7"):
        load("panda_finger")


def test_pickled_models_keep_what_is_infinite():
    """And all other numbers of their joints: versions of Pinocchio before 4 cannot read inf back."""
    model = model_of(pin.JointModelRZ(), pin.JointModelPX())
    model.velocityLimit, model.armature = np.array([inf, 2.0]), np.array([0.3, 0.4])
    model.lowerPositionLimit, model.upperPositionLimit = np.array([-inf, -1.0]), np.array([inf, 1.0])
    sent = pickle.loads(pickle.dumps(pinocchio_versions.model_to_pickle(model)))
    assert pinocchio_versions.model_from_pickle(*sent) == model
