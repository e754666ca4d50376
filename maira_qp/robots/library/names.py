"""Which robot a name means. Each name means one robot of one package, whatever is installed.

A short name is that of the one package that is listed here for it; `<package>/<name>` says the package too. Names that
end with `_description` are the modules of `robot_descriptions`, of which there are more than are listed here.
"""

from __future__ import annotations

import difflib
from typing import NamedTuple

from maira_qp.errors import RobotError, shown

OWN, EXAMPLES, TOOLBOX, DESCRIPTIONS = "maira-qp", "example-robot-data", "rtb-data", "robot_descriptions"
PACKAGES = (OWN, EXAMPLES, TOOLBOX, DESCRIPTIONS)


class Entry(NamedTuple):
    """A robot of a package: its file within the package, and the part of it that is meant unless another is named."""

    package: str
    name: str
    path: str = ""
    tip: str | tuple[str, ...] | None = None
    base: str | None = None

    @property
    def qualified(self) -> str:
        """`<package>/<name>`"""
        return f"{self.package}/{self.name}"


def _examples(name: str, path: str, tip: str | tuple[str, ...], base: str | None = None) -> Entry:
    return Entry(EXAMPLES, name, path, tip, base)


def _toolbox(name: str, path: str, tip: str) -> Entry:
    return Entry(TOOLBOX, name, path, tip)


_FINGERS = ("link_3.0_tip", "link_7.0_tip", "link_11.0_tip", "link_15.0_tip")

ENTRIES = (
    Entry(OWN, "maira"),
    Entry(OWN, "iiwa14"),
    _examples("allegro_left", "allegro_hand_description/urdf/allegro_left_hand.urdf", _FINGERS),
    _examples("allegro_right", "allegro_hand_description/urdf/allegro_right_hand.urdf", _FINGERS),
    _examples("baxter", "baxter_description/urdf/baxter.urdf", ("left_gripper", "right_gripper")),
    _examples("g1", "g1_description/urdf/g1_29dof_rev_1_0.urdf", ("left_rubber_hand", "right_rubber_hand"), "pelvis"),
    _examples("kinova", "kinova_description/robots/kinova.urdf", "j2s6s200_end_effector"),
    _examples("panda", "panda_description/urdf/panda.urdf", "panda_hand_tcp"),
    _examples("pr2", "pr2_description/urdf/pr2.urdf", ("r_gripper_tool_frame", "l_gripper_tool_frame")),
    _examples("so100", "so_arm_description/urdf/so100.urdf", "gripper"),
    _examples("so101", "so_arm_description/urdf/so101.urdf", "gripper_frame_link"),
    _examples("talos", "talos_data/robots/talos_reduced.urdf", ("arm_left_7_link", "arm_right_7_link"), "base_link"),
    _examples("tiago", "tiago_description/robots/tiago.urdf", "arm_tool_link"),
    _examples("tiago_dual", "tiago_description/robots/tiago_dual.urdf", ("arm_left_tool_link", "arm_right_tool_link")),
    _examples(
        "tiago_pro", "tiago_pro_description/robots/tiago_pro.urdf", ("arm_left_tool_link", "arm_right_tool_link")
    ),
    _examples("ur3", "ur_description/urdf/ur3_robot.urdf", "tool0"),
    _examples("ur5", "ur_description/urdf/ur5_robot.urdf", "tool0"),
    _examples("ur10", "ur_description/urdf/ur10_robot.urdf", "tool0"),
    _examples("xarm7", "xarm_description/urdf/xarm7.urdf", "link_eef"),
    _examples("z1", "z1_description/urdf/z1.urdf", "link06"),
    _toolbox("al5d", "lynxmotion_al5d_description/urdf/al5d_robot.urdf", "link4"),
    _toolbox("irb140", "abb_irb140_description/urdf/irb140.urdf", "tool0"),
    _toolbox("kr16", "kuka_description/kuka_kr16/urdf/kr16_2.urdf", "tool0"),
    _toolbox("kr120", "kuka_description/kuka_kr120/urdf/kr120r2500pro.urdf", "tool0"),
    _toolbox("kr210", "kuka_description/kuka_kr210/urdf/kr210l150.urdf", "tool0"),
    _toolbox("lbr_iiwa14", "kuka_description/kuka_lbr_iiwa/urdf/lbr_iiwa_14_r820.urdf", "tool0"),
    _toolbox("puma560", "unimation_puma560_description/urdf/puma560_robot.urdf", "link7"),
)


def entry_of(name: object) -> Entry:
    """What a name, short or qualified, means, in upper or lower case.

    Raises `RobotError`, with the nearest names, where it means nothing.
    """
    known = {key: entry for entry in ENTRIES for key in (entry.name, entry.qualified)}
    if isinstance(name, str):
        if name.lower() in known:
            return known[name.lower()]
        short = name.removeprefix(f"{DESCRIPTIONS}/")
        if short.endswith("_description") and short.isidentifier():
            return Entry(DESCRIPTIONS, short)
    names = [entry.name for entry in ENTRIES]
    near = difflib.get_close_matches(str(name)[:200].rpartition("/")[2].lower(), names, n=3, cutoff=0.5)
    hint = f"did you mean {' or '.join(map(repr, near))}? " if near else ""
    raise RobotError(
        f"unknown robot {shown(name)}; {hint}valid names: {', '.join(names)}, and modules of {DESCRIPTIONS}, such "
        "as ur5e_description; a file goes to Robot.from_urdf or from_mjcf",
        shell="or a file: .urdf, .xacro, .xml, .toml, .yaml",
    )
