"""Robot against the DH product, a plain walk along the URDF, finite differences, and callers' mistakes."""

import copy
import pickle
import sys
import threading
from functools import cache
from math import cos, pi, sin
from xml.etree import ElementTree

import numpy as np
import pinocchio as pin
import pytest
from support.made_robots import random_table
from support.robots import REAL_ROBOTS, load, urdf_file

import maira_qp as mq
from maira_qp.errors import ConfigurationError, FrameError, OptionError, RobotError
from maira_qp.orientation import orientation_error


def numbers(element, tag, key, default):
    found = element.find(tag)
    return np.array([float(word) for word in (default if found is None else found.get(key, default)).split()])


def turn(axis, angle):
    """Rotation about an axis, column by column as the quaternion sandwich q v q*."""
    axis = np.asarray(axis) / np.linalg.norm(axis)
    c, s = cos(angle), sin(angle)
    return np.array([v * c + np.cross(axis, v) * s + axis * (axis @ v) * (1 - c) for v in np.eye(3)]).T


@cache
def joints_of(path):
    """The joints of a file, each by the link that it moves."""
    joints = ElementTree.parse(path).getroot().iter("joint")
    return {joint.find("child").get("link"): joint for joint in joints if joint.find("child") is not None}


def walk(path, values, base, tip):
    """Pose (4, 4) of the tip in the base, straight from the file, joint values by name; others at zero, clamped."""
    joints = joints_of(path)
    by_name = {joint.get("name"): joint for joint in joints.values()}

    def value(joint):
        mimic = joint.find("mimic")
        if joint.get("name") in values:
            return values[joint.get("name")]
        if mimic is not None:
            return float(mimic.get("multiplier", 1)) * value(by_name[mimic.get("joint")]) + float(
                mimic.get("offset", 0)
            )
        limit = joint.find("limit")
        if limit is None or joint.get("type") == "continuous":
            return 0.0
        return float(np.clip(0, float(limit.get("lower", 0)), float(limit.get("upper", 0))))

    T, link = np.eye(4), tip
    while link != base and link in joints:
        joint = joints[link]
        roll, pitch, yaw = numbers(joint, "origin", "rpy", "0 0 0")
        A = np.eye(4)
        A[:3, :3] = turn([0, 0, 1], yaw) @ turn([0, 1, 0], pitch) @ turn([1, 0, 0], roll)
        A[:3, 3] = numbers(joint, "origin", "xyz", "0 0 0")
        axis = numbers(joint, "axis", "xyz", "1 0 0")
        if joint.get("type") in ("revolute", "continuous"):
            A[:3, :3] = A[:3, :3] @ turn(axis, value(joint))
        elif joint.get("type") == "prismatic":
            A[:3, 3] += A[:3, :3] @ axis / np.linalg.norm(axis) * value(joint)
        T, link = A @ T, joint.find("parent").get("link")
    return T


def difference_jacobian(robot, q, frame=None, step=1e-6):
    """Jacobian (6, n) by central differences of `forward` alone."""
    J = np.empty((6, robot.n))
    for i, dq in enumerate(step * np.eye(robot.n)):
        back, ahead = robot.forward(q - dq, frame), robot.forward(q + dq, frame)
        J[:3, i] = ahead.translation - back.translation
        J[3:, i] = orientation_error(back.rotation, ahead.rotation)
    return J / (2 * step)


@pytest.mark.parametrize("make", [mq.Robot.maira, mq.Robot.iiwa14])
def test_forward_equals_the_dh_product(make, rng):
    """On 3,000 random configurations, to 1e-12."""
    robot = make()
    worst = 0.0
    for _ in range(3_000):
        q = robot.random_configuration(rng)
        worst = max(worst, np.abs(robot.at(q).placement().homogeneous - robot.dh.forward(q)).max())
    assert worst < 1e-12


@pytest.mark.parametrize("make", [mq.Robot.maira, mq.Robot.iiwa14])
def test_jacobian_equals_both_dh_jacobians(make, rng):
    robot = make()
    for _ in range(300):
        q = robot.random_configuration(rng)
        J = robot.jacobian(q)
        assert np.abs(J - robot.dh.jacobian(q)).max() < 1e-12
        assert np.abs(J - robot.dh.finite_difference_jacobian(q)).max() < 1e-8


def test_random_dh_tables_of_all_kinds_of_links(rng):
    """Prismatic, continuous and fixed rows, offsets, right angles and a gimbal lock between rows: FK and Jacobian."""
    kinds = set()
    for _ in range(100):
        table = random_table(rng, int(rng.integers(1, 10)))
        kinds |= {link.kind for link in table.links}
        robot = mq.Robot.from_dh(table)
        assert robot.n == table.n == robot.model.nq == robot.model.nv
        for _ in range(30):
            q = robot.random_configuration(rng)
            assert np.abs(robot.forward(q).homogeneous - table.forward(q)).max() < 1e-12
        assert robot.jacobian(q).shape == (6, robot.n)
        assert np.abs(robot.jacobian(q) - table.jacobian(q)).max() < 1e-12
    assert kinds == {"revolute", "prismatic", "continuous", "fixed"}


@pytest.mark.parametrize("name", REAL_ROBOTS)
def test_forward_of_real_robots_equals_a_walk_along_their_file(name, rng):
    """The walk knows the file only, neither Pinocchio nor our reader."""
    robot = load(name)
    assert robot.n == REAL_ROBOTS[name].n
    for _ in range(20):
        q = robot.random_configuration(rng)
        tip = robot.tips[int(rng.integers(len(robot.tips)))]
        T = walk(urdf_file(name), dict(zip(robot.joint_names, q, strict=True)), robot.base, tip)
        assert np.abs(robot.forward(q, tip).homogeneous - T).max() < 1e-12


@pytest.mark.parametrize("name", REAL_ROBOTS)
def test_jacobian_of_real_robots_equals_finite_differences(name, rng):
    robot = load(name)
    for frame in (None, *rng.choice(robot.frames, 3)):
        q = robot.random_configuration(rng)
        assert np.abs(robot.jacobian(q, frame) - difference_jacobian(robot, q, frame)).max() < 1e-8


def test_every_frame_of_a_humanoid_stands_where_its_file_says(rng):
    """Links beside the chain stay, at rest; Talos has over 50, and joints whose range does not contain zero."""
    robot = load("talos_arm")
    q = robot.random_configuration(rng)
    values = dict(zip(robot.joint_names, q, strict=True))
    assert len(robot.frames) > 40
    for frame in robot.frames:
        T = walk(urdf_file("talos_arm"), values, robot.base, frame)
        assert np.abs(robot.forward(q, frame).homogeneous - T).max() < 1e-12


def test_a_base_inside_the_tree_moves_nothing_but_the_origin(pr2_arm, rng):
    """Poses in a base further up are those in the sub-base, one rigid step before."""
    whole = mq.Robot.from_urdf(urdf_file("pr2_arm"), tip=pr2_arm.tip, base="base_footprint")
    assert whole.joint_names[0] == "torso_lift_joint"
    assert whole.joint_names[1:] == pr2_arm.joint_names
    q = whole.random_configuration(rng)
    step = whole.forward(q, pr2_arm.base)
    assert np.abs((step * pr2_arm.forward(q[1:])).homogeneous - whole.forward(q).homogeneous).max() < 1e-12


def test_continuous_joints_are_one_number_without_limits(pr2_arm, rng):
    turns = np.isinf(pr2_arm.upper)
    assert turns.sum() == 2
    assert (pr2_arm.lower[turns] == -np.inf).all()
    assert (pr2_arm.model.upperPositionLimit == pr2_arm.upper).all()
    assert (pr2_arm.model.lowerPositionLimit == pr2_arm.lower).all()
    assert (pr2_arm.middle[turns] == 0).all()
    drawn = np.array([pr2_arm.random_configuration(rng) for _ in range(2000)])
    assert (np.abs(drawn[:, turns]) <= pi).all()
    assert np.ptp(drawn[:, turns], axis=0).min() > 6.2
    q = drawn[0]
    around = q + np.where(turns, 2 * pi, 0)
    assert np.abs(pr2_arm.forward(q).homogeneous - pr2_arm.forward(around).homogeneous).max() < 1e-12


@pytest.mark.parametrize("name", ["maira", "ur5", "pr2_arm", "panda"])
def test_random_configurations_are_within_the_limits_to_the_bit(name, request, rng):
    robot = request.getfixturevalue(name)
    drawn = np.array([robot.random_configuration(rng) for _ in range(5000)])
    assert (robot.lower <= drawn).all()
    assert (drawn <= robot.upper).all()
    middle, box = drawn.mean(0), np.minimum(robot.upper, pi) - np.maximum(robot.lower, -pi)
    assert (np.ptp(drawn, axis=0) > 0.99 * box).all()
    assert (np.abs(middle - robot.middle) < 0.03 * np.ptp(drawn, axis=0)).all()


def test_draws_of_narrow_and_locked_joints_are_within_the_limits_to_the_bit(rng):
    """Ranges of many sizes, of a few ulps, and of none, where rounding is as large as the range."""
    lower = rng.uniform(-3, 3, 100) * rng.choice([1e-6, 1, 1e6], 100)
    upper = lower + np.abs(lower) * rng.choice([0, 0, 2e-16, 5e-16, 1], 100)
    robot = mq.Robot.from_dh(
        [{"lower": float(ends[0]), "upper": float(ends[1])} for ends in zip(lower, upper, strict=True)]
    )
    for _ in range(200):
        q = robot.random_configuration(rng)
        assert (lower <= q).all()
        assert (q <= upper).all()


def test_a_locked_joint_stays_a_joint(rng):
    """lower == upper: it counts in n, never moves, and the rest is right."""
    robot = mq.Robot.from_dh([{"a": 1.0}, {"a": 1.0, "lower": 0.3, "upper": 0.3}, {"a": 0.5}])
    q = robot.random_configuration(rng)
    assert robot.n == 3
    assert q[1] == robot.middle[1] == 0.3
    assert robot.clip([0, 2, 0])[1] == 0.3
    assert np.abs(robot.forward(q).homogeneous - robot.dh.forward(q)).max() < 1e-12


def test_condition_number_and_manipulability(maira, rng):
    """Against J J^T, and inf where the arm is stretched or the frame does not move."""
    for _ in range(50):
        q = maira.random_configuration(rng)
        JJ = maira.dh.jacobian(q) @ maira.dh.jacobian(q).T
        assert maira.manipulability(q) == pytest.approx(np.sqrt(np.linalg.det(JJ)), rel=1e-9)
        assert maira.condition_number(q) == pytest.approx(np.sqrt(np.linalg.cond(JJ)), rel=1e-7)
    assert maira.condition_number(np.zeros(7)) == np.inf
    assert maira.manipulability(np.zeros(7)) < 1e-12
    assert maira.condition_number(q, "base_link") == np.inf


def test_fewer_than_six_joints():
    """A planar arm of two links with a closed form: w = product of the singular values of the 6 x 2 Jacobian."""
    robot = mq.Robot.from_dh([{"a": 0.7}, {"a": 0.4}])
    q = np.array([0.3, 1.1])
    J = np.zeros((6, 2))
    J[0] = [-0.7 * sin(0.3) - 0.4 * sin(1.4), -0.4 * sin(1.4)]
    J[1] = [0.7 * cos(0.3) + 0.4 * cos(1.4), 0.4 * cos(1.4)]
    J[5] = 1
    values = np.sqrt(np.linalg.eigvalsh(J.T @ J))
    assert robot.jacobian(q) == pytest.approx(J, abs=1e-14)
    assert robot.manipulability(q) == pytest.approx(values.prod(), rel=1e-12)
    assert robot.condition_number(q) == pytest.approx(values[1] / values[0], rel=1e-12)


def test_a_robot_with_one_joint():
    """Pinocchio's Jacobian of one joint can lose its second dimension; ours does not."""
    robot = mq.Robot.from_dh([{"a": 0.5, "alpha": pi / 2}])
    assert robot.jacobian([0.0]) == pytest.approx(np.array([[0, 0.5, 0, 0, 0, 1]]).T, abs=1e-15)
    assert robot.at(np.zeros(1)).jacobian().shape == (6, 1)
    assert robot.condition_number([0.2]) == 1
    assert robot.manipulability([0.2]) == pytest.approx(np.sqrt(1.25))


MIMIC = """<robot name="gripper">
  <link name="base"/><link name="a"/><link name="b"/><link name="c"/><link name="tip"/><link name="side"/>
  <joint name="zz_side" type="revolute"><parent link="base"/><child link="side"/><axis xyz="0 0 1"/>
    <limit lower="-1" upper="2" velocity="3" effort="1"/></joint>
  <joint name="lead" type="revolute"><parent link="base"/><child link="a"/><origin xyz="0 0 .3" rpy=".1 .2 .3"/>
    <axis xyz="0 1 1"/><limit lower="-2" upper="2" velocity="1" effort="1"/></joint>
  <joint name="follow" type="revolute"><parent link="a"/><child link="b"/><origin xyz=".2 0 0"/><axis xyz="0 1 0"/>
    <limit lower="-0.5" upper="1" velocity="1" effort="1"/><mimic joint="lead" multiplier="-2" offset="0.1"/></joint>
  <joint name="again" type="prismatic"><parent link="b"/><child link="c"/><origin xyz="0 .1 0"/><axis xyz="1 0 0"/>
    <limit lower="-9" upper="9" velocity="9" effort="1"/><mimic joint="follow" multiplier="0.5" offset="0.2"/></joint>
  <joint name="aside" type="revolute"><parent link="c"/><child link="tip"/><origin xyz="0 0 .1"/><axis xyz="1 0 0"/>
    <limit lower="-4" upper="4" velocity="1" effort="1"/><mimic joint="zz_side" multiplier="3" offset="-1"/></joint>
</robot>"""


@pytest.fixture
def gripper():
    return mq.Robot.from_urdf(MIMIC, tip="tip")


def test_mimic_joints_follow_their_leaders(gripper, tmp_path, rng):
    """A chain of mimics, a leader beside the path that Pinocchio would visit too late: FK and Jacobian are right."""
    path = tmp_path / "gripper.urdf"
    path.write_text(MIMIC)
    assert set(gripper.joint_names) == {"lead", "zz_side"}
    assert gripper.model.nq == gripper.model.nv == gripper.n == 2
    for _ in range(50):
        q = gripper.random_configuration(rng)
        values = dict(zip(gripper.joint_names, q, strict=True))
        for frame in ("tip", "c", "side"):
            T = walk(path, values, "base", frame)
            assert np.abs(gripper.forward(q, frame).homogeneous - T).max() < 1e-12
            assert np.abs(gripper.jacobian(q, frame) - difference_jacobian(gripper, q, frame)).max() < 1e-8


def test_leaders_keep_their_followers_within_limits(gripper):
    """lead: -0.5 <= -2 q + 0.1 <= 1, zz_side: -4 <= 3 q - 1 <= 4 as well as its own; speeds are shared out too."""
    limits = dict(
        zip(gripper.joint_names, zip(gripper.lower, gripper.upper, gripper.velocity_limit, strict=True), strict=True)
    )
    assert limits["lead"] == pytest.approx((-0.45, 0.3, 0.5))
    assert limits["zz_side"] == pytest.approx((-1, 5 / 3, 1 / 3))


def test_the_model_carries_names_limits_and_masses(panda):
    assert tuple(panda.model.names)[1:] == panda.joint_names
    assert (panda.model.velocityLimit == panda.velocity_limit).all()
    assert (panda.model.effortLimit == panda.effort_limit).all()
    assert panda.model.getFrameId("panda_hand", pin.FrameType.BODY) == panda.frame_id("panda_hand")
    assert panda.model.existFrame("panda_joint3")


def test_the_model_carries_the_masses_that_the_file_gives():
    """Links that are fixed to each other weigh what they weigh together; the base's own do not move."""
    talos = load("talos_arm")
    links = {link.get("name"): link for link in ElementTree.parse(urdf_file("talos_arm")).getroot().iter("link")}
    arm = [links[frame] for frame in talos.frames if "_left_" in frame]
    masses = [float(link.find("inertial/mass").get("value")) for link in arm if link.find("inertial") is not None]
    assert pin.computeTotalMass(talos.model) == pytest.approx(sum(masses))


def test_what_is_not_known_is_not_a_limit():
    """Many files write velocity 0 for unknown; that is no limit, not a robot that cannot move."""
    text = """<robot name="r"><link name="a"/><link name="b"/><joint name="j" type="revolute"><parent link="a"/>
      <child link="b"/><axis xyz="0 0 1"/><limit lower="-1" upper="1" velocity="0"/></joint></robot>"""
    robot = mq.Robot.from_urdf(text)
    assert robot.velocity_limit == robot.effort_limit == np.inf


def test_unknown_frames_are_named_and_the_valid_ones_listed(maira):
    for ask in (maira.forward, maira.jacobian, maira.condition_number, maira.manipulability):
        with pytest.raises(FrameError, match=r"'tool' is not a frame of maira; did you mean 'tool0'.*base_link, link1"):
            ask(np.zeros(7), frame="tool")
    for frame in (3, ["tool0"], b"tool0"):
        with pytest.raises(FrameError, match="is not a frame"):
            maira.frame_id(frame)


@pytest.mark.parametrize(
    "q",
    [
        np.zeros(6),
        np.zeros((1, 7)),
        0.0,
        [],
        None,
        "0000000",
        [[0] * 6, 0],
        [0] * 6 + [np.nan],
        [0] * 6 + [np.inf],
        np.zeros(7, complex),
        np.zeros(7, bool),
        ["0"] * 7,
    ],
)
def test_bad_configurations_are_refused(maira, q):
    for ask in (maira.forward, maira.jacobian, maira.condition_number, maira.manipulability, maira.clip):
        with pytest.raises(ConfigurationError, match="q "):
            ask(q)


def test_other_number_types_and_layouts_are_read_right(maira, rng):
    """Big-endian arrays, which Pinocchio reads raw, integers, float32, strides, lists."""
    q = np.round(maira.random_configuration(rng))
    T = maira.dh.forward(q)
    strided = np.zeros(14)
    strided[::2] = q
    for same in (
        q.astype(">f8"),
        q.astype("<i4"),
        q.astype(">i8"),
        q.astype(np.float32),
        strided[::2],
        list(q),
        q[::-1][::-1],
    ):
        assert np.abs(maira.forward(same).homogeneous - T).max() < 1e-12
        assert np.abs(maira.jacobian(same) - maira.dh.jacobian(q)).max() < 1e-12
    assert np.abs(maira.at(q.astype(">f8")).placement().homogeneous - T).max() < 1e-12


def test_answers_are_the_callers_own(maira):
    """Writing to what was returned, or to the argument, changes nothing."""
    q = np.full(7, 0.3)
    T, J = maira.forward(q), maira.jacobian(q)
    expected = T.homogeneous.copy(), J.copy()
    T.translation += 1.0
    J += 1.0
    assert (maira.forward(q).homogeneous == expected[0]).all()
    assert (maira.jacobian(q) == expected[1]).all()
    assert (q == 0.3).all()
    for limits in (maira.lower, maira.upper, maira.middle, maira.velocity_limit, maira.effort_limit):
        with pytest.raises(ValueError, match="read-only"):
            limits[0] = 0.0


def test_clip_is_the_nearest_configuration_within_the_limits(pr2_arm, rng):
    q = rng.uniform(-9, 9, pr2_arm.n)
    clipped = pr2_arm.clip(q)
    assert (pr2_arm.lower <= clipped).all()
    assert (clipped <= pr2_arm.upper).all()
    inside = (pr2_arm.lower <= q) & (q <= pr2_arm.upper)
    assert (clipped[inside] == q[inside]).all()
    assert 0 < inside.sum() < pr2_arm.n


def test_random_configurations_need_a_generator(maira):
    with pytest.raises(OptionError, match="default_rng"):
        maira.random_configuration(0)


@pytest.mark.parametrize("again", [copy.copy, copy.deepcopy, lambda robot: pickle.loads(pickle.dumps(robot))])
def test_robots_copy_and_pickle(again, maira, gripper, rng):
    for robot in (maira, gripper):
        q = robot.random_configuration(rng)
        robot.forward(q)
        other = again(robot)
        assert other == robot
        assert hash(other) == hash(robot)
        assert other.dh == robot.dh
        assert (other.forward(q).homogeneous == robot.forward(q).homogeneous).all()
        assert not other.lower.flags.writeable


def test_robots_compare_by_what_they_are(maira, iiwa14, ur5):
    assert maira == mq.Robot.maira()
    assert maira != iiwa14
    assert ur5 != mq.Robot.from_urdf(urdf_file("ur5"), tip="ee_link", base="base_link")
    assert maira != "maira"


def test_the_normalised_urdf_is_the_same_robot(maira, pr2_arm, gripper):
    """Reading what was written gives the same text, limits and kinematics: `urdf` is all of the robot."""
    for robot in (maira, pr2_arm, gripper, load("tiago")):
        again = mq.Robot.from_urdf(robot.urdf, tip=robot.tip, base=robot.base)
        assert again == robot
        assert again.joint_names == robot.joint_names
        for key in ("lower", "upper", "velocity_limit", "effort_limit"):
            assert (getattr(again, key) == getattr(robot, key)).all()


def test_repr_is_short(maira):
    assert maira.title == "Robot('maira', n=7, base='base_link', tip='tool0')"


def test_from_dh_takes_a_table_links_or_mappings(maira):
    assert mq.Robot.from_dh(maira.dh) == mq.Robot.from_dh(maira.dh.links, name="maira") == maira
    assert mq.Robot.from_dh(maira.dh, name="other").name == mq.Robot.from_dh(maira.dh, name="other").dh.name == "other"
    assert mq.Robot.from_dh([{"a": 1.0}]).name == "arm"
    with pytest.raises(RobotError, match="no moving joint"):
        mq.Robot.from_dh([{"kind": "fixed"}])


def test_threads_do_not_disturb_each_other(maira, rng):
    """One Pinocchio Data for two threads gives wrong answers in 1 % of calls; each thread has its own."""
    configurations = [maira.random_configuration(rng) for _ in range(400)]
    shared = [maira.at(q) for q in configurations]
    expected = [maira.dh.forward(q) for q in configurations]
    wrong = []

    def look(start):
        for k in range(len(configurations)):
            i = (start + k) % len(configurations)
            for T in (maira.forward(configurations[i]), shared[i].placement()):
                if np.abs(T.homogeneous - expected[i]).max() > 1e-12:
                    wrong.append(i)
            if np.abs(shared[i].jacobian() - maira.dh.jacobian(configurations[i])).max() > 1e-12:
                wrong.append(i)

    threads = [threading.Thread(target=look, args=(100 * k,)) for k in range(4)]
    interval = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)  # threads take turns within a call, not between calls
    try:
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
    finally:
        sys.setswitchinterval(interval)
    assert not wrong


def test_the_largest_robot_that_is_accepted_works(rng):
    """100 joints, the most that are supported."""
    robot = mq.Robot.from_dh([{"a": 0.01, "alpha": 0.5} for _ in range(100)])
    q = robot.random_configuration(rng)
    assert np.abs(robot.forward(q).homogeneous - robot.dh.forward(q)).max() < 1e-12
    assert np.abs(robot.jacobian(q) - robot.dh.jacobian(q)).max() < 1e-12
    with pytest.raises(RobotError, match="101 joints"):
        mq.Robot.from_dh([{"a": 0.01} for _ in range(101)])


def test_a_displacement_leads_from_one_configuration_to_another(maira, pr2_arm, gripper, rng):
    """`integrate` and `difference` undo each other, and those of Pinocchio on the model are the same."""
    for robot in (maira, pr2_arm, gripper):
        q0, q1 = robot.random_configuration(rng), robot.random_configuration(rng)
        dq = robot.difference(q0, q1)
        np.testing.assert_allclose(dq, pin.difference(robot.model, q0, q1), rtol=0, atol=1e-15)
        np.testing.assert_allclose(robot.integrate(q0, dq), q1, rtol=0, atol=1e-14)
        np.testing.assert_allclose(robot.at(q1).displacement(q0), dq, rtol=0, atol=1e-15)
        np.testing.assert_allclose(robot.at(q0).moved(dq).q, q1, rtol=0, atol=1e-14)
        for wrong in (dq[:-1], dq * np.nan, None):
            with pytest.raises(ConfigurationError, match="dq"):
                robot.integrate(q0, wrong)
            with pytest.raises(ConfigurationError, match="q1"):
                robot.difference(q0, wrong)


def test_a_robot_makes_its_arrays_once(maira):
    """Every solver of a robot works on the same arrays, and leaves them as they are."""
    before = maira.chain.copy()
    mq.Solver(maira, redundancy=mq.Strict(mq.Posture(np.full(7, 0.5)))).solve(maira.forward(np.full(7, 0.3)))
    assert maira.tree is maira.tree
    assert maira.chain is maira.chain
    assert (maira.chain == before).all()
