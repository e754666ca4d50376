"""The arms of the race: for each the judge's model, ours, and one lean URDF from which every peer loads its own."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from dataclasses import dataclass
from functools import cached_property
from importlib.metadata import distribution
from pathlib import Path

import numpy as np

import maira_qp as mq
from maira_qp.evaluation.judge import Judge
from maira_qp.evaluation.targets import TargetSource

EXAMPLES = "example-robot-data"
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
    """The chain as URDF text without shapes and masses, which no inverse kinematics needs."""
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


def load(name: str, folder: Path) -> Arm:
    """One of `ARMS`; its lean URDF is written into a folder that exists."""
    source, tip, sampled = _sources()[name]
    robot = mq.Robot.from_urdf(source, tip=tip)
    judge = Judge(source, robot.base, tip, robot.joint_names)
    path = folder / f"{name}.urdf"
    lean = _lean(robot.urdf)
    path.write_text(lean)
    return Arm(name, robot, judge, lean, path, sampled)


ARMS = ("maira", "panda", "iiwa14", "ur5")
"""MAIRA and iiwa14 have spherical shoulders and wrists, Panda has offsets; UR5 has six joints, of one turn each."""


def _sources() -> dict[str, tuple[str, str, int | None]]:
    """URDF text, tip, and the joint to sample: the one whose sampling solved most of 400 trial targets."""
    return {
        "maira": ((REPOSITORY / "maira.urdf").read_text(), "tool0", 2),
        "panda": (_example("panda_description/urdf/panda.urdf"), "panda_hand_tcp", 6),
        "iiwa14": (mq.Robot.iiwa14().urdf, "tool0", 2),
        "ur5": (_example("ur_description/urdf/ur5_joint_limited_robot.urdf"), "tool0", None),
    }


def _example(path: str) -> str:
    robots = Path(str(distribution(EXAMPLES).locate_file("cmeel.prefix/share/example-robot-data/robots")))
    return (robots / path).read_text()


def _lean(urdf: str) -> str:
    root = ElementTree.fromstring(urdf)
    for link in root.findall("link"):
        link[:] = []
    return ElementTree.tostring(root, encoding="unicode")
