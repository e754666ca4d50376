"""Robots with several tips: real ones and random ones against Pinocchio's own model of their whole file."""

import copy
import pickle
from xml.etree import ElementTree

import numpy as np
import pytest
from support.derivatives import assert_close, difference_jacobian
from support.made_robots import random_table
from support.robots import REAL_ROBOTS, TREES, load, urdf_file
from support.whole_model import WholeModel

import maira_qp as mq
from maira_qp.errors import BackendError, RobotError
from maira_qp.orientation import orientation_error

LIMIT = '<limit lower="-3" upper="2.5" velocity="1" effort="1"/>'
KINDS = ("revolute", "continuous", "prismatic", "fixed")


def random_tree(rng, joints=14, mimics=0.0):
    """URDF of a tree of all kinds of joints, branches of all lengths, some joints mimicking some before them."""
    parts, leaders = ['<link name="l0"/>'], []
    for k in range(joints):
        kind = str(rng.choice(KINDS, p=(0.4, 0.2, 0.25, 0.15)))
        parent = k if rng.random() < 0.5 else int(rng.integers(k + 1))
        xyz, rpy, axis = (" ".join(map(repr, map(float, rng.normal(size=3)))) for _ in range(3))
        inside = f'<origin xyz="{xyz}" rpy="{rpy}"/><axis xyz="{axis}"/>{LIMIT}'
        if kind != "fixed" and leaders and rng.random() < mimics:
            multiplier, offset = rng.uniform(0.3, 1.2) * rng.choice([-1, 1]), rng.uniform(-0.5, 0.5)
            inside += f'<mimic joint="{rng.choice(leaders)}" multiplier="{multiplier}" offset="{offset}"/>'
        elif kind != "fixed":
            leaders.append(f"j{k}")
        ends = f'<parent link="l{parent}"/><child link="l{k + 1}"/>'
        parts.append(f'<link name="l{k + 1}"/><joint name="j{k}" type="{kind}">{ends}{inside}</joint>')
    return '<robot name="tree">' + "".join(parts) + "</robot>"


def ways(text):
    """Joint elements from the root to each link, by link."""
    above = {joint.find("child").get("link"): joint for joint in ElementTree.fromstring(text.encode()).iter("joint")}

    def way(link):
        return [*way(above[link].find("parent").get("link")), above[link]] if link in above else []

    return {link.get("name"): way(link.get("name")) for link in ElementTree.fromstring(text.encode()).iter("link")}


def moving(way):
    return [joint.get("name") for joint in way if joint.get("type") != "fixed"]


def random_tips(rng, text):
    able = [link for link, way in ways(text).items() if moving(way)]
    return [str(tip) for tip in rng.choice(able, min(len(able), int(rng.integers(1, 5))), replace=False)]


def robot_or_none(text, tips):
    """The robot; None if it has two branches that lead each other, which Pinocchio cannot put in order."""
    try:
        return mq.Robot.from_urdf(text, tip=tips)
    except RobotError as reason:
        if "mimic each other" not in str(reason):
            raise
        return None


def second_derivative(robot, q, frame, weights, a, h=1e-3):
    """a^T C a of the `kinematic_hessian_product` C along a direction a (n,), by differences of `forward` alone."""
    R = robot.forward(q, frame).rotation

    def f(s):
        T = robot.forward(q + s * h * a, frame)
        return weights[:3] @ T.translation + weights[3:] @ orientation_error(R, T.rotation)

    return (16 * (f(1) + f(-1)) - f(2) - f(-2) - 30 * f(0)) / (12 * h * h)


def check_frame(robot, whole, frame, rng):
    """Pose and Jacobian as the whole model's, the derivatives as differences of its Jacobian and of the pose."""
    q = robot.random_configuration(rng)

    def look(q):
        return whole.look(dict(zip(robot.joint_names, q, strict=True)), robot.base, frame)

    T, J = look(q)
    at = robot.at(q)
    assert_close(at.placement(frame).homogeneous, T, 1e-12)
    assert_close(at.jacobian(frame), J, 1e-12)
    differences = difference_jacobian(lambda q: look(q)[1].ravel(), q, step=1e-5).T.reshape(robot.n, 6, robot.n)
    assert_close(at.jacobian_derivative(frame), differences, 1e-8)
    weights = rng.normal(size=6)
    C = at.kinematic_hessian_product(frame, weights)
    weighted = np.tensordot(weights, differences, (0, 1))
    assert (C == C.T).all()
    assert_close(C, 0.5 * (weighted + weighted.T), 1e-8)
    a = rng.normal(size=robot.n)
    a /= np.linalg.norm(a)
    assert_close(a @ C @ a, second_derivative(robot, q, frame, weights, a), 1e-7)


@pytest.mark.parametrize("name", REAL_ROBOTS)
def test_every_tip_of_a_real_robot_moves_as_in_the_model_of_its_whole_file(name, rng):
    """Pose, Jacobian and second derivatives; all joints that are not ours rest."""
    robot = load(name)
    whole = WholeModel(urdf_file(name).read_text(encoding="utf-8"))
    for tip in robot.tips:
        check_frame(robot, whole, tip, rng)


def test_every_frame_of_random_trees_moves_as_in_the_model_of_the_whole_file(rng):
    """Revolute, prismatic, continuous and fixed joints; tips behind tips, and frames beside the way to any tip."""
    counts = set()
    for _ in range(20):
        text = random_tree(rng)
        robot = mq.Robot.from_urdf(text, tip=random_tips(rng, text))
        assert not robot.kinematics.has_mimic
        for frame in {*robot.tips, *map(str, rng.choice(robot.frames, 3))}:
            check_frame(robot, WholeModel(text), frame, rng)
        counts.add(len(robot.tips))
    assert counts == {1, 2, 3, 4}


def test_every_tip_of_random_trees_with_mimic_joints_moves_as_in_the_model_of_the_whole_file(rng):
    """Leaders on the way to the tip, beside it, and on the way to another tip."""
    refused = trees = 0
    for _ in range(40):
        text = random_tree(rng, mimics=0.3)
        robot = robot_or_none(text, random_tips(rng, text))
        if robot is None:
            refused += 1
            continue
        trees += robot.kinematics.has_mimic and len(robot.tips) > 1
        for tip in robot.tips:
            check_frame(robot, WholeModel(text), tip, rng)
    assert trees > 10 > refused


def test_the_joints_that_move_are_those_on_the_way_to_a_tip(rng):
    """Once each, parents before children, those to the first tip before all others; and q of one tip is its way."""
    for _ in range(200):
        text = random_tree(rng)
        tips = random_tips(rng, text)
        robot = mq.Robot.from_urdf(text, tip=tips)
        paths = [moving(ways(text)[tip]) for tip in tips]
        assert robot.tips == tuple(tips)
        assert robot.tip == tips[0]
        assert sorted(robot.joint_names) == sorted(set().union(*paths))
        assert list(robot.joint_names[: len(paths[0])]) == paths[0]
        for path in paths:
            assert path == [joint for joint in robot.joint_names if joint in path]
        assert robot.is_chain == (set(robot.joint_names) == set(paths[0]))


def test_a_tree_is_its_arms_on_their_trunk(rng):
    """PR2: each arm alone, on the torso that both share, gives the same poses and columns."""
    both = load("pr2_arms")
    assert both.joint_names[0] == "torso_lift_joint"
    q = both.random_configuration(rng)
    for tip in both.tips:
        arm = mq.Robot.from_urdf(urdf_file("pr2_arms"), tip=tip)
        mine = [both.joint_names.index(joint) for joint in arm.joint_names]
        assert np.abs(arm.forward(q[mine]).homogeneous - both.forward(q, tip).homogeneous).max() < 1e-14
        assert np.abs(arm.jacobian(q[mine]) - both.jacobian(q, tip)[:, mine]).max() < 1e-14
        assert (np.delete(both.jacobian(q, tip), mine, axis=1) == 0).all()
        assert (arm.lower == both.lower[mine]).all()


@pytest.mark.parametrize("name", [*TREES, "panda", "tiago", "panda_finger", "pr2_arm"])
def test_the_moved_links_are_those_directly_behind_the_joints(name):
    robot = load(name)
    joints = {joint.get("name"): joint for joint in ElementTree.fromstring(robot.urdf).iter("joint")}
    names = list(robot.model.names)[1:]
    assert robot.moved_links == tuple(joints[joint].find("child").get("link") for joint in names)
    assert set(robot.joint_names) <= set(names)
    assert len(names) == robot.n or robot.kinematics.has_mimic


def test_a_chain_has_no_joint_beside_the_way_to_its_tip_and_no_mimics():
    chains = {name for name in REAL_ROBOTS if load(name).is_chain}
    assert chains == set(REAL_ROBOTS) - set(TREES) - {"panda_finger", "talos_finger"}
    panda = urdf_file("panda")
    assert mq.Robot.from_urdf(panda, tip=["panda_hand", "panda_link4"]).is_chain
    assert not mq.Robot.from_urdf(panda, tip=["panda_link4", "panda_hand"]).is_chain


@pytest.mark.parametrize("name", ["tiago_arms", "pr2_fingers", "allegro"])
def test_many_jacobians_of_a_tree_are_those_of_its_first_tip(name, rng):
    robot = load(name)
    q = np.array([robot.random_configuration(rng) for _ in range(5)])
    J = robot.jacobians(q)
    assert J.shape == (5, 6, robot.n)
    for each, found in zip(q, J, strict=True):
        assert (found == robot.jacobian(each)).all()
    assert robot.jacobians(q[:0]).shape == (0, 6, robot.n)


def test_a_tree_is_solved_by_the_general_engine():
    """The kernels would take its joints for one chain."""
    with pytest.raises(BackendError, match=r"cannot take this: .*(the robot is a tree|more than one task)"):
        mq.Solver(load("pr2_arms"), backend="compiled")


def test_the_length_is_that_of_the_longest_arm():
    """A slide counts as much as the links at most, here 2.5 m of its range."""
    text = """<robot name="r"><link name="a"/><link name="b"/><link name="c"/><link name="d"/>
      <joint name="ab" type="continuous"><parent link="a"/><child link="b"/><origin xyz="0 0 9"/></joint>
      <joint name="bc" type="continuous"><parent link="b"/><child link="c"/><origin xyz="0 2 0"/></joint>
      <joint name="bd" type="prismatic"><parent link="b"/><child link="d"/><origin xyz="2.5 0 0"/>
        <limit lower="-1" upper="3"/></joint></robot>"""
    lengths = {
        tips: mq.Robot.from_urdf(text, tip=tips).length for tips in ("c", "d", ("c", "d"), ("d", "c"), ("b", "c"))
    }
    assert lengths == {"c": 2, "d": 5, ("c", "d"): 5, ("d", "c"): 5, ("b", "c"): 2}


@pytest.mark.parametrize("again", [copy.copy, copy.deepcopy, lambda robot: pickle.loads(pickle.dumps(robot))])
def test_trees_copy_pickle_and_compare(again, rng):
    robot = load("pr2_fingers")
    other = again(robot)
    assert other == robot
    assert hash(other) == hash(robot)
    assert other.tips == robot.tips
    q = robot.random_configuration(rng)
    for tip in robot.tips:
        assert (other.forward(q, tip).homogeneous == robot.forward(q, tip).homogeneous).all()


def test_trees_compare_by_their_tips_too():
    arms = load("g1_arms")
    swapped = mq.Robot.from_urdf(urdf_file("g1_arms"), tip=arms.tips[::-1], base="pelvis")
    assert arms != swapped
    assert arms != mq.Robot.from_urdf(urdf_file("g1_arms"), tip=arms.tip, base="pelvis")
    assert arms.title == f"Robot('{arms.name}', n=17, base='pelvis', tips=('left_rubber_hand', 'right_rubber_hand'))"


@pytest.mark.parametrize("name", TREES)
def test_the_normalised_urdf_is_the_same_tree(name):
    robot = load(name)
    again = mq.Robot.from_urdf(robot.urdf, tip=robot.tips, base=robot.base)
    assert again == robot
    assert again.joint_names == robot.joint_names
    assert again.frames == robot.frames
    for key in ("lower", "upper", "velocity_limit", "effort_limit"):
        assert (getattr(again, key) == getattr(robot, key)).all()


def test_one_tip_in_a_list_is_that_tip(rng):
    text = mq.Robot.from_dh(random_table(rng, 4)).urdf
    assert mq.Robot.from_urdf(text, tip=["tool0"]) == mq.Robot.from_urdf(text)
