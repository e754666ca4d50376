"""SRDF: groups that choose base and tips, named states, links that may touch."""

import pickle

import numpy as np
import pytest
from support.robots import urdf_file

import maira_qp as mq
from maira_qp.errors import ConfigurationError, FrameError, OptionError, RobotError

ARM = """<robot name="arm"><link name="base"/><link name="l1"/><link name="l2"/><link name="hand"/><link name="left"/>
  <link name="right"/><link name="camera"/>
  <joint name="j1" type="revolute"><parent link="base"/><child link="l1"/><axis xyz="0 0 1"/>
  <limit lower="-2" upper="2"/></joint>
  <joint name="j2" type="revolute"><parent link="l1"/><child link="l2"/><origin xyz="0 0 1"/><axis xyz="0 1 0"/>
  <limit lower="-2" upper="2"/></joint>
  <joint name="mount" type="fixed"><parent link="l2"/><child link="hand"/><origin xyz="0 0 1"/></joint>
  <joint name="eye" type="fixed"><parent link="hand"/><child link="camera"/></joint>
  <joint name="jl" type="prismatic"><parent link="hand"/><child link="left"/><limit lower="0" upper="1"/></joint>
  <joint name="jr" type="prismatic"><parent link="hand"/><child link="right"/><limit lower="0" upper="1"/></joint>
</robot>"""
SRDF = """<robot name="arm">
  <group name="arm"><chain base_link="base" tip_link="hand"/></group>
  <group name="joints"><joint name="j1"/><joint name="j2"/><joint name="mount"/></group>
  <group name="fingers"><link name="hand"/><link name="left"/><link name="right"/><link name="camera"/></group>
  <group name="grip"><joint name="jr"/></group>
  <group name="all"><group name="arm"/><group name="fingers"/></group>
  <group name="circle"><group name="circle"/></group>
  <group name="lost"><group name="nowhere"/></group>
  <group name="still"><joint name="mount"/></group>
  <group_state name="ready" group="arm"><joint name="j1" value="0.1"/><joint name="j2" value="0.2"/></group_state>
  <group_state name="open" group="fingers"><joint name="jl" value="0.5"/><joint name="jr" value="0.6"/></group_state>
  <group_state name="ready" group="all"><joint name="j1" value="1.1"/><joint name="jl" value="1"/></group_state>
  <group_state name="up"><joint name="j1" value="0"/><joint name="j2" value="-1e-1"/><joint name="root" value="0 0 0"/>
  </group_state>
  <disable_collisions link1="l1" link2="hand" reason="Never"/></robot>"""


@pytest.mark.parametrize(
    ("group", "base", "tips", "joints"),
    [
        ("arm", "base", ("hand",), ("j1", "j2")),
        ("joints", "base", ("hand",), ("j1", "j2")),
        ("fingers", "l2", ("left", "right"), ("jl", "jr")),
        ("grip", "hand", ("right",), ("jr",)),
        ("all", "base", ("left", "right", "camera"), ("j1", "j2", "jl", "jr")),
    ],
)
def test_a_group_chooses_base_and_tips(group, base, tips, joints):
    """Of a chain, of joints, of links and of other groups; what does not move is no tip."""
    robot = mq.Robot.from_urdf(ARM, srdf=SRDF, group=group)
    assert (robot.base, robot.tips, robot.joint_names) == (base, tips, joints)


@pytest.mark.parametrize(
    ("group", "error", "message"),
    [
        ("amr", FrameError, "no group 'amr'; did you mean 'arm'"),
        ("circle", RobotError, "the group 'circle', a subgroup of 'circle', holds itself"),
        ("lost", RobotError, "the group 'nowhere', a subgroup of 'lost', is not there"),
        ("still", RobotError, "no joint of the group 'still' moves"),
        (3, FrameError, "no group 3"),
    ],
)
def test_groups_that_cannot_be_used(group, error, message):
    with pytest.raises(error, match=message):
        mq.Robot.from_urdf(ARM, srdf=SRDF, group=group)
    with pytest.raises(FrameError, match=r"the description names none; srdf=\.\.\. may"):
        mq.Robot.from_urdf(ARM, group="arm")
    with pytest.raises(OptionError, match="a group has its own tip and base"):
        mq.Robot.from_urdf(ARM, tip="hand", srdf=SRDF, group="arm")
    for wrong in ('<joint name="j9"/>', '<link name="l9"/>', '<chain base_link="l2" tip_link="l1"/><joint name="j1"/>'):
        with pytest.raises((RobotError, FrameError), match=r"j9|l9|does not carry"):
            mq.Robot.from_urdf(ARM, srdf=f'<robot><group name="g">{wrong}</group></robot>', group="g")


def test_states_are_configurations():
    robot = mq.Robot.from_urdf(ARM, tip="hand", srdf=SRDF)
    assert robot.states == ("ready", "up")
    assert robot.state("arm/ready").tolist() == [0.1, 0.2]
    assert robot.state("up").tolist() == [0.0, -0.1]
    with pytest.raises(ConfigurationError, match="several values for 'j1'; name one of all/ready, arm/ready"):
        robot.state("ready")
    with pytest.raises(ConfigurationError, match="j2"):
        robot.state("all/ready")
    with pytest.raises(ConfigurationError, match="no state 'op'; valid names: ready, up"):
        robot.state("op")
    with pytest.raises(ConfigurationError, match="its description names none"):
        mq.Robot.maira().state("home")
    assert mq.Robot.from_urdf(ARM, srdf=SRDF, group="fingers").state("open").tolist() == [0.5, 0.6]


def test_an_srdf_is_kept(tmp_path):
    """With other limits and in a pickle; of a file; of a DH table; a second one is added to the first."""
    (tmp_path / "arm.srdf").write_text(SRDF)
    robot = mq.Robot.from_urdf(ARM, tip="hand").with_srdf(tmp_path / "arm.srdf").limited(margin=0.1)
    again = pickle.loads(pickle.dumps(robot))
    assert again.state("up").tolist() == robot.state("up").tolist() == [0.0, -0.1]
    more = (
        '<robot><group_state name="low"><joint name="j1" value="1"/><joint name="j2" value="1"/></group_state></robot>'
    )
    assert robot.with_srdf(more).states == ("ready", "up", "low")
    table = mq.Robot.from_dh([{}, {}]).with_srdf(more.replace("j1", "joint1").replace("j2", "joint2"))
    assert table.state("low").tolist() == [1, 1]
    assert table.dh is not None
    model = mq.Robot.from_model(robot.model, tip="hand").with_srdf(SRDF)
    assert pickle.loads(pickle.dumps(model)).state("up").tolist() == [0.0, -0.1]
    assert robot.with_tool(mq.pose([0, 0, 0.1])).state("up").tolist() == [0.0, -0.1]
    assert model != mq.Robot.from_model(robot.model, tip="hand")


def test_links_that_may_touch_are_left_to():
    """The pairs of the Panda's SRDF, without naming it in the limit."""
    urdf = urdf_file("panda")
    srdf = urdf.parents[1] / "srdf" / "panda.srdf"
    plain = mq.Robot.from_urdf(urdf, tip="panda_hand_tcp")
    told = mq.Robot.from_urdf(urdf, srdf=srdf, tip="panda_hand_tcp")
    assert told.state("default").shape == (7,)
    meshes = [urdf.parents[4]]

    def pairs(robot, **options):
        scene = mq.CollisionLimit(meshes=meshes, **options).of(robot).scene
        return {frozenset((scene.parts[i].name, scene.parts[j].name)) for i, j in scene.pairs}

    assert pairs(told) == pairs(plain, allowed=srdf) < pairs(plain)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("<mujoco/>", "not an SRDF: the outermost element is <mujoco>"),
        ("<robot><group/></robot>", "a <group> of the SRDF lacks name"),
        ("<robot><group name='g'><chain base_link='a'/></group></robot>", "a <chain> of the SRDF lacks tip_link"),
        ("<robot><group_state name='s'><joint name='j' value='x'/></group_state></robot>", "'j' in a state.*'x'"),
        (
            "<robot><group_state name='s'><joint name='j' value='nan'/></group_state></robot>",
            "joint 'j' in a state.*nan",
        ),
    ],
)
def test_what_is_no_srdf_is_refused(text, message):
    with pytest.raises(RobotError, match=message):
        mq.Robot.maira().with_srdf(text)


def test_a_state_is_a_start():
    robot = mq.Robot.from_urdf(ARM, tip="hand", srdf=SRDF)
    s = mq.Solver(robot, task=mq.PositionTask()).solve(robot.forward(robot.state("up")), q0=robot.state("up"))
    assert np.abs(s.q - [0.0, -0.1]).max() < 1e-6
