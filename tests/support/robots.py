"""Robots that are sold, from the packages that carry their URDFs."""

from importlib.metadata import distribution
from importlib.util import find_spec
from pathlib import Path
from typing import NamedTuple

import maira_qp as mq


class RealRobot(NamedTuple):
    """A robot that is sold: its URDF within the package that carries it, and the chain or tree that is looked at."""

    package: str
    path: str
    tip: str | tuple[str, ...]
    base: str | None
    n: int


EXAMPLES, TOOLBOX = "example-robot-data", "rtb-data"


REAL_ROBOTS = {
    "panda": RealRobot(EXAMPLES, "panda_description/urdf/panda.urdf", "panda_hand_tcp", None, 7),
    "panda_finger": RealRobot(EXAMPLES, "panda_description/urdf/panda.urdf", "panda_rightfinger", None, 8),
    "xarm7": RealRobot(EXAMPLES, "xarm_description/urdf/xarm7.urdf", "link_eef", None, 7),
    "ur5": RealRobot(EXAMPLES, "ur_description/urdf/ur5_robot.urdf", "tool0", "base_link", 6),
    "ur5_limited": RealRobot(EXAMPLES, "ur_description/urdf/ur5_joint_limited_robot.urdf", "tool0", None, 6),
    "ur10": RealRobot(EXAMPLES, "ur_description/urdf/ur10_robot.urdf", "tool0", None, 6),
    "kinova": RealRobot(EXAMPLES, "kinova_description/robots/kinova.urdf", "j2s6s200_end_effector", None, 6),
    "talos_arm": RealRobot(EXAMPLES, "talos_data/robots/talos_reduced.urdf", "arm_left_7_link", "torso_2_link", 7),
    "talos_finger": RealRobot(
        EXAMPLES, "talos_data/robots/talos_full_v2.urdf", "gripper_left_fingertip_3_link", "torso_2_link", 8
    ),
    "pr2_arm": RealRobot(EXAMPLES, "pr2_description/urdf/pr2.urdf", "r_gripper_tool_frame", "torso_lift_link", 7),
    "tiago": RealRobot(EXAMPLES, "tiago_description/robots/tiago.urdf", "arm_tool_link", None, 8),
    "baxter": RealRobot(EXAMPLES, "baxter_description/urdf/baxter.urdf", "left_gripper", None, 7),
    "g1_arm": RealRobot(EXAMPLES, "g1_description/urdf/g1_29dof_rev_1_0.urdf", "left_rubber_hand", "pelvis", 10),
    "iiwa14_urdf": RealRobot(TOOLBOX, "kuka_description/kuka_lbr_iiwa/urdf/lbr_iiwa_14_r820.urdf", "tool0", None, 7),
    "irb140": RealRobot(TOOLBOX, "abb_irb140_description/urdf/irb140.urdf", "tool0", None, 6),
    "kr210": RealRobot(TOOLBOX, "kuka_description/kuka_kr210/urdf/kr210l150.urdf", "tool0", None, 6),
    "puma560": RealRobot(TOOLBOX, "unimation_puma560_description/urdf/puma560_robot.urdf", "link7", None, 6),
    "tiago_arms": RealRobot(
        EXAMPLES, "tiago_description/robots/tiago_dual.urdf", ("arm_left_tool_link", "arm_right_tool_link"), None, 15
    ),
    "tiago_pro_arms": RealRobot(
        EXAMPLES, "tiago_pro_description/robots/tiago_pro.urdf", ("arm_right_tool_link", "arm_left_tool_link"), None, 15
    ),
    "talos_arms": RealRobot(
        EXAMPLES, "talos_data/robots/talos_reduced.urdf", ("arm_left_7_link", "arm_right_7_link"), "base_link", 16
    ),
    "talos_whole": RealRobot(
        EXAMPLES,
        "talos_data/robots/talos_reduced.urdf",
        ("arm_left_7_link", "arm_right_7_link", "left_sole_link", "right_sole_link", "head_2_link"),
        "base_link",
        30,
    ),
    "baxter_arms": RealRobot(
        EXAMPLES, "baxter_description/urdf/baxter.urdf", ("left_gripper", "right_gripper"), None, 14
    ),
    "pr2_arms": RealRobot(
        EXAMPLES, "pr2_description/urdf/pr2.urdf", ("r_gripper_tool_frame", "l_gripper_tool_frame"), None, 15
    ),
    "pr2_fingers": RealRobot(
        EXAMPLES,
        "pr2_description/urdf/pr2.urdf",
        ("r_gripper_r_finger_tip_link", "r_gripper_l_finger_tip_frame"),
        "r_wrist_flex_link",
        2,
    ),
    "allegro": RealRobot(
        EXAMPLES,
        "allegro_hand_description/urdf/allegro_left_hand.urdf",
        ("link_3.0_tip", "link_7.0_tip", "link_11.0_tip", "link_15.0_tip"),
        None,
        16,
    ),
    "g1_arms": RealRobot(
        EXAMPLES,
        "g1_description/urdf/g1_29dof_rev_1_0.urdf",
        ("left_rubber_hand", "right_rubber_hand"),
        "pelvis",
        17,
    ),
}


TREES = [name for name, real in REAL_ROBOTS.items() if isinstance(real.tip, tuple)]


def urdf_file(name: str) -> Path:
    """The URDF of one of `REAL_ROBOTS`, within the installed package."""
    package, path = REAL_ROBOTS[name][:2]
    if package == TOOLBOX:
        return Path(find_spec("rtbdata").submodule_search_locations[0]) / "xacro" / path
    return Path(distribution(package).locate_file("cmeel.prefix/share/example-robot-data/robots")) / path


def load(name: str) -> mq.Robot:
    """One of `REAL_ROBOTS`."""
    return mq.Robot.from_urdf(urdf_file(name), tip=REAL_ROBOTS[name].tip, base=REAL_ROBOTS[name].base)
