"""The arms of the race: for each the judge's model, ours, and one lean URDF from which every peer loads its own."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, partial
from importlib.metadata import distribution
from importlib.util import find_spec
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np

import maira_qp as mq
from maira_qp.evaluation.judge import Judge
from maira_qp.evaluation.targets import TargetSource

REPOSITORY = Path(__file__).parents[2]


@dataclass(frozen=True)
class Questions:
    """Targets (N, 4, 4) and starts (N, n) for them, the same for all."""

    targets: np.ndarray
    starts: np.ndarray


@dataclass(frozen=True)
class Arm:
    """One arm; base is the root of its URDF."""

    name: str
    robot: mq.Robot
    judge: Judge
    urdf: str
    """The chain alone as URDF text, without shapes and masses, which no inverse kinematics needs."""
    path: Path
    """A file that holds `urdf`."""
    sampled: int | None
    """The joint of a redundant arm that a closed form samples; None for six joints."""

    @property
    def lower(self) -> np.ndarray:
        """Lower limits (n,) [rad]."""
        return self.judge.lower

    @property
    def upper(self) -> np.ndarray:
        """Upper limits (n,) [rad]."""
        return self.judge.upper

    @cached_property
    def targets(self) -> TargetSource:
        """Where the targets on it are drawn."""
        return TargetSource(self.robot, self.judge)

    def ask(self, stratum: str, count: int, seed: int) -> Questions:
        """So many targets of a stratum of `TargetSource`."""
        return Questions(*self.targets.batch(stratum, count, seed))

    def screws(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The chain as a product of exponentials: axes (n, 3), a point (n, 3) [m] on each, tool pose (4, 4), at 0."""
        before, home = self.judge.frames(np.zeros(self.robot.n))
        moving = [k for k, joint in enumerate(self.judge.path) if joint.driver is not None]
        axes = [before[k, :3, :3] @ self.judge.path[k].axis for k in moving]
        return np.array(axes), before[moving, :3, 3], home

    def configurations(self, count: int, rng: np.random.Generator) -> np.ndarray:
        """Configurations (count, n) [rad], uniform within the limits."""
        return rng.uniform(self.lower, self.upper, (count, self.robot.n))


def load(name: Name, folder: Path) -> Arm:
    """One of the arms; its lean URDF is written into a folder that exists."""
    source = SOURCES[name]
    text = source.read()
    robot = mq.Robot.from_urdf(text, tip=source.tip, base=source.base)
    judge = Judge(text, robot.base, robot.tip, robot.joint_names)
    path = folder / f"{name}.urdf"
    lean = _lean(robot.urdf, robot.base, robot.tip)
    path.write_text(lean)
    return Arm(name, robot, judge, lean, path, source.sampled)


Name = Literal["maira", "panda", "iiwa14", "ur5", "xarm7", "talos_arm", "kr210"]
"""The arms, by name."""
ARMS: tuple[Name, ...] = ("maira", "panda", "iiwa14", "ur5")
"""MAIRA and iiwa14 have spherical shoulders and wrists, Panda has offsets; UR5 has six joints, of one turn each."""


class Source(NamedTuple):
    """Where an arm comes from."""

    read: Callable[[], str]
    """Its URDF text."""
    tip: str
    base: str | None
    """None: the root of the URDF."""
    sampled: int | None
    """The joint to sample, see `Arm`: the one whose sampling solved most of 400 trial targets."""


def _example(path: str) -> str:
    robots = Path(str(distribution("example-robot-data").locate_file("cmeel.prefix/share/example-robot-data/robots")))
    return (robots / path).read_text()


def _toolbox(path: str) -> str:
    found = find_spec("rtbdata")
    if found is None or not found.submodule_search_locations:
        raise ModuleNotFoundError("its URDF is in rtb-data (pip install rtb-data)")
    return (Path(found.submodule_search_locations[0]) / "xacro" / path).read_text()


SOURCES: dict[Name, Source] = {
    "maira": Source((REPOSITORY / "maira.urdf").read_text, "tool0", None, 2),
    "panda": Source(partial(_example, "panda_description/urdf/panda.urdf"), "panda_hand_tcp", None, 6),
    "iiwa14": Source(lambda: mq.Robot.iiwa14().urdf, "tool0", None, 2),
    "ur5": Source(partial(_example, "ur_description/urdf/ur5_joint_limited_robot.urdf"), "tool0", None, None),
    "xarm7": Source(partial(_example, "xarm_description/urdf/xarm7.urdf"), "link_eef", None, 2),  # no joint helps
    "talos_arm": Source(
        partial(_example, "talos_data/robots/talos_reduced.urdf"), "arm_left_7_link", "torso_2_link", 0
    ),
    "kr210": Source(partial(_toolbox, "kuka_description/kuka_kr210/urdf/kr210l150.urdf"), "tool0", None, None),
}


def _lean(urdf: str, base: str, tip: str) -> str:
    """The links and joints from base to tip alone, without shapes and masses."""
    root = ElementTree.fromstring(urdf)
    into = {_end(joint, "child"): joint for joint in root.findall("joint")}
    links, joints = [tip], []
    while links[-1] != base:
        joints.append(into[links[-1]])
        links.append(_end(joints[-1], "parent"))
    lean = ElementTree.Element("robot", root.attrib)
    lean.extend(ElementTree.Element("link", name=link) for link in reversed(links))
    lean.extend(reversed(joints))
    return ElementTree.tostring(lean, encoding="unicode")


def _end(joint: ElementTree.Element, which: str) -> str:
    """The link at an end of a joint, its parent or its child."""
    element = joint.find(which)
    return "" if element is None else element.get("link", "")
