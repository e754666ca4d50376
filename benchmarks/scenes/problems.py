"""What is asked of everybody: a robot, a start, a target for every tick, and when the target can be reached."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from importlib.metadata import distribution
from pathlib import Path

import numpy as np
import pinocchio as pin

import maira_qp as mq

DT = 0.005
"""Length of a tick [s], as in the examples of both peers."""
HOME = (0.0, -0.785398, 0.0, -2.35619, 0.0, 1.5707, 0.785398)
"""Panda's rest [rad], the start of its published examples."""
MARGIN = 0.02
"""Distance that the links are to keep from each other [m]."""
CAMERA = np.array([0.0, 0.0, 1.0])
"""The axis of the hand that looks."""


@dataclass(frozen=True)
class Scene:
    """One scene; all libraries get the same URDF text, start and targets."""

    name: str
    title: str
    robot: mq.Robot
    start: np.ndarray
    """(n,) [rad]"""
    targets: Sequence[dict[str, pin.SE3]] | np.ndarray
    """For every tick a pose for each tip, or a point (3,) [m] to look at."""
    counted: np.ndarray
    """(ticks,) of bool: whether the target can be reached, so that the error there means something."""
    ends: np.ndarray
    """The ticks at whose end the target has stood still for long; the last one, where it never does."""
    dt: float = DT
    package: Path | None = None
    """Directory of the meshes, where shapes are needed."""
    srdf: Path | None = None
    """Which pairs of links are left out, where shapes are needed."""

    @property
    def tips(self) -> tuple[str, ...]:
        """The frames that have targets."""
        return self.robot.tips

    @property
    def looks(self) -> bool:
        """Whether the target is a point to look at."""
        return isinstance(self.targets, np.ndarray)

    @property
    def margin(self) -> float:
        """Distance that the links are to keep [m]."""
        return MARGIN

    def poses(self, tip: str) -> np.ndarray:
        """The targets (ticks, 4, 4) of a tip."""
        return np.array([target[tip].homogeneous for target in self.targets])

    def summary(self, errors: np.ndarray) -> tuple[float, float, float]:
        """Of errors (ticks,): mean and largest while the target can be reached, and the largest at the ends."""
        counted = errors[self.counted]
        return float(counted.mean()), float(counted.max()), float(errors[self.ends].max())

    @cached_property
    def urdf(self) -> str:
        """The description that all load; with shapes only where they are needed."""
        return self.robot.urdf if self.srdf is not None else lean(self.robot.urdf)


def lean(urdf: str) -> str:
    """URDF text without shapes and masses, which no inverse kinematics needs."""
    from xml.etree import ElementTree

    root = ElementTree.fromstring(urdf)
    for link in root.findall("link"):
        link[:] = []
    return ElementTree.tostring(root, encoding="unicode")


def reach() -> Scene:
    """Panda: poses that jump every 2 s, the third out of reach."""
    robot = _panda()
    down = [0.0, 1.0, 0.0, 0.0]
    poses = [
        mq.pose([0.5, 0.3, 0.4], quaternion=down),
        mq.pose([0.3, -0.4, 0.6], rpy=[np.pi, 0.4, 0.6]),
        mq.pose([1.1, 0.4, 0.5], quaternion=down),
        mq.pose([0.55, 0.0, 0.25], quaternion=down),
    ]
    hold = round(2.0 / DT)
    targets = [{robot.tip: pose} for pose in poses for _ in range(hold)]
    counted = np.repeat([True, True, False, True], hold)
    ends = np.array([1, 2, 4]) * hold - 1
    return Scene("reach", "arm reach, Panda", robot, np.array(HOME), targets, counted, ends)


def dual() -> Scene:
    """Baxter: both hands on smooth curves of their own."""
    urdf = _robots() / "baxter_description/urdf/baxter.urdf"
    robot = mq.Robot.from_urdf(urdf, tip=["left_gripper", "right_gripper"])
    start = robot.middle.copy()
    time = _times(6.0)
    poses = {tip: robot.forward(start, tip) for tip in robot.tips}
    targets = []
    for t in time:
        sway = np.array([0.1 * (np.cos(t) - 1), 0.15 * np.sin(t), 0.1 * np.sin(2 * t)])
        turn = pin.exp3(np.array([0.0, 0.0, 0.3 * np.sin(t)]))
        targets.append(
            {tip: pin.SE3(turn @ pose.rotation, pose.translation + sway) for tip, pose in poses.items()},
        )
    return _followed("dual", "two arms, Baxter", robot, start, targets)


def circle() -> Scene:
    """Panda: the tool goes round a circle of 15 cm in 4 s and points down."""
    robot = _panda()
    start, centre = np.array(HOME), np.array([0.45, 0.0, 0.4])
    down = mq.pose(quaternion=[0.0, 1.0, 0.0, 0.0]).rotation
    angles = 0.5 * np.pi * _times(8.0)
    points = centre + 0.15 * np.stack([np.cos(angles), np.sin(angles), np.zeros(len(angles))], axis=1)
    targets = [{robot.tip: pin.SE3(down, point)} for point in points]
    scene = _followed("circle", "end-effector circle, Panda", robot, start, targets)
    scene.counted[: round(1.0 / DT)] = False  # the way to the circle
    return scene


def collision() -> Scene:
    """Panda: the hand is pulled into the arm's own base and let go again, three times."""
    robot = _panda()
    start, down = np.array(HOME), mq.pose(quaternion=[0.0, 1.0, 0.0, 0.0]).rotation
    inward = 0.5 * (1 - np.cos(np.pi * _times(6.0)))
    far, near = np.array([0.4, 0.0, 0.4]), np.array([0.02, 0.05, 0.3])
    targets = [{robot.tip: pin.SE3(down, far + share * (near - far))} for share in inward]
    robots = _robots()
    scene = Scene(
        "collision",
        "self-collision, Panda",
        robot,
        start,
        targets,
        inward < 0.2,
        np.array([len(targets) - 1]),
        package=robots.parent.parent,
        srdf=robots / "panda_description/srdf/panda.srdf",
    )
    scene.counted[: round(0.5 / DT)] = False  # the way to the first target
    return scene


def look() -> Scene:
    """Panda: the hand looks at a point that runs around."""
    robot = _panda()
    time = _times(8.0)
    points = np.stack([0.7 + 0.2 * np.cos(time), 0.5 * np.sin(time), 0.2 + 0.15 * np.sin(2 * time)], axis=1)
    scene = _followed("look", "look-at, Panda", robot, np.array(HOME), points)
    scene.counted[: round(1.0 / DT)] = False  # the turn toward it
    return scene


SCENES: dict[str, Callable[[], Scene]] = {f.__name__: f for f in (reach, dual, circle, collision, look)}
"""By their names, in the order of the tables."""


def _followed(name: str, title: str, robot: mq.Robot, start: np.ndarray, targets: Sequence | np.ndarray) -> Scene:
    """A scene whose targets move all the time and can be reached."""
    count = len(targets)
    return Scene(name, title, robot, start, targets, np.ones(count, dtype=bool), np.array([count - 1]))


def _times(duration: float) -> np.ndarray:
    return DT * np.arange(1, round(duration / DT) + 1)


def _panda() -> mq.Robot:
    return mq.Robot.from_urdf(_robots() / "panda_description/urdf/panda.urdf", tip="panda_hand_tcp")


def _robots() -> Path:
    """Where the package example-robot-data keeps its robots."""
    return Path(str(distribution("example-robot-data").locate_file("cmeel.prefix/share/example-robot-data/robots")))
