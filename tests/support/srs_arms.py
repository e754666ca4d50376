"""What the tests of the compiled closed form share: S-R-S arms, poses for them, and their kernels."""

from dataclasses import replace
from functools import cache
from typing import NamedTuple

import numpy as np
import pinocchio as pin

import maira_qp as mq
from maira_qp.analytic.srs.arrays import srs_array
from maira_qp.analytic.srs.geometry import SRS
from maira_qp.kernels.srs.feasible_configuration import start
from maira_qp.kernels.srs.swivel_intervals import INTERVALS, PIECES
from maira_qp.kernels.srs.unreachability import verdicts
from maira_qp.orientation import pose_error
from support.compiled_problems import row_of, rubbish
from support.robots import urdf_file

PI = np.pi
LIMITS = {
    "narrow": [(-1.0, 1.5)] * 7,
    "more than a turn": [
        (-4.0, 4.0),
        (-2.0, 3.0),
        (-3.3, 3.2),
        (-7.0, 7.0),
        (-np.pi, np.pi),
        (-2.8, 2.0),
        (-2 * np.pi, 2 * np.pi),
    ],
    "continuous": [None, (-2.0, 2.5), None, (-2.5, 2.0), None, None, (-3.0, 1.0)],
    "wrapped": [(2.0, 6.0), (-5.0, -1.0), (1.0, 6.5), (0.5, 5.5), (-9.0, -4.0), (3.0, 7.0), (1.0, 5.0)],
}
"""Of the joints of random arms: (lower, upper) [rad], or None: continuous."""
ARMS = ["maira", "iiwa14", "urdf", "no tool", *LIMITS]
"""Arms of the catalog, of a URDF, with the tip in the wrist, and at random: axes that are not at right angles, and
limits of all kinds."""


class Arm(NamedTuple):
    """An S-R-S arm, and what the kernels know of it."""

    robot: mq.Robot
    srs: SRS
    array: np.ndarray


@cache
def srs_arm(name: str) -> Arm:
    """One of `ARMS`."""
    pin.seed(ARMS.index(name))
    rng = np.random.default_rng(ARMS.index(name))
    if name == "no tool":
        links = list(mq.Robot.iiwa14().dh.links)
        narrow = mq.Robot.from_dh([*links[:-1], replace(links[-1], d=0.0)])
        return prepared(narrow.limited(lower={"joint5": -1.0, "joint6": 0.3}, upper={"joint5": 0.8, "joint7": 0.5}))
    known = {"maira": mq.Robot.maira, "iiwa14": mq.Robot.iiwa14, "urdf": iiwa14_without_offset}
    return prepared(known[name]() if name in known else random_arm(rng, LIMITS[name]))


def prepared(robot: mq.Robot) -> Arm:
    srs = SRS.of(robot)
    assert srs is not None
    return Arm(robot, srs, srs_array(srs))


def memory() -> tuple[np.ndarray, ...]:
    """Floats and integers to work in, which hold rubbish."""
    return rubbish(INTERVALS)


def codes_of(arm: Arm, poses: np.ndarray, position: float = 1e-6, orientation: float = 1e-6) -> np.ndarray:
    """Verdicts (N,) on poses (N, 4, 4)."""
    codes, rows = np.full(len(poses), -1), np.array([row_of(T) for T in poses])
    verdicts(arm.array, rows, position, orientation, *memory(), np.full((8, PIECES, 3), np.nan), codes)
    return codes


def starts_of(arm: Arm, poses: np.ndarray, offset: float = 0.3) -> tuple[np.ndarray, np.ndarray]:
    """Configurations (N, 7) for poses (N, 4, 4), and which were found (N,)."""
    q, found, rows = np.full((len(poses), 7), np.nan), np.zeros(len(poses), bool), np.array([row_of(T) for T in poses])
    work = INTERVALS.plain(*memory())
    for k, row in enumerate(rows):
        found[k] = start(arm.array, row, offset, work, q[k])
    return q, found


def poses_of(robot: mq.Robot, q: np.ndarray) -> np.ndarray:
    """The tip's poses (N, 4, 4) at configurations (N, n)."""
    return np.array([robot.forward(each).homogeneous for each in q])


def anywhere(arm: Arm, rng: np.random.Generator, count: int) -> np.ndarray:
    """Poses (count, 4, 4) of any orientation, with the wrist around the shoulder, a little beyond reach too."""
    poses = np.tile(np.eye(4), (count, 1, 1))
    tip = arm.srs.tip
    lever = tip[:3, :3].T @ (arm.srs.wrist - tip[:3, 3])
    for T in poses:
        line = rng.normal(size=3)
        distance = rng.uniform(0.95 * arm.srs.reach[0], 1.03 * arm.srs.reach[1])
        T[:3, :3] = random_rotation(rng, np.pi)
        T[:3, 3] = arm.srs.shoulder + distance * line / np.linalg.norm(line) - T[:3, :3] @ lever
    return poses


def random_rotation(rng: np.random.Generator, angle: float) -> np.ndarray:
    """About any axis, by up to an angle [rad], most often nearly that."""
    axis = rng.normal(size=3)
    return pin.exp3(angle * rng.random() ** 0.2 * axis / np.linalg.norm(axis))


def moved(poses: np.ndarray, rng: np.random.Generator, position: float, orientation: float) -> np.ndarray:
    """Poses (N, 4, 4), each moved by up to the tolerances [m, rad], often nearly by both."""
    poses = poses.copy()
    for T in poses:
        step = rng.normal(size=3)
        T[:3, :3] = random_rotation(rng, 0.999 * orientation) @ T[:3, :3]
        T[:3, 3] += 0.999 * position * rng.random() ** 0.2 * step / np.linalg.norm(step)
    return poses


def hard_configurations(arm: Arm, rng: np.random.Generator, count: int) -> np.ndarray:
    """Configurations (count, 7) within the limits: joints on them, stretched, folded, singular shoulders and wrists."""
    robot, srs = arm.robot, arm.srs
    q = np.array([robot.random_configuration(rng) for _ in range(count)])
    lower, upper = robot.drawn_range
    at_limit = rng.random((count, 7)) < rng.choice([0.0, 0.2, 0.5, 1.0], (count, 1))
    q = np.where(at_limit, np.where(rng.random((count, 7)) < 0.5, lower, upper), q)
    angles = [(3, srs.phase), (3, srs.phase + np.pi)]
    angles += [(k, joint.phase + t) for k, joint in zip((1, 5), srs.joints, strict=True) for t in (0.0, np.pi)]
    for each in q:
        for joint, angle in angles:
            if rng.random() < 0.1:
                each[joint] = angle + rng.choice([0.0, 1e-9, -1e-6, 1e-4])
    return np.clip(q, robot.lower, robot.upper)


def iiwa14_without_offset() -> mq.Robot:
    """The iiwa 14 of its URDF, whose A2 stands 0.44 mm beside A1, without that offset."""
    text = urdf_file("iiwa14_urdf").read_text()
    assert text.count("-0.00043624 0 0.36") == 1
    return mq.Robot.from_urdf(text.replace("-0.00043624 0 0.36", "0 0 0.36"), tip="tool0")


def random_direction(rng: np.random.Generator) -> np.ndarray:
    v = rng.normal(size=3)
    return v / np.linalg.norm(v)


def random_arm(rng: np.random.Generator, limits: list[tuple[float, float] | None] | None = None, **offsets) -> mq.Robot:
    """An S-R-S arm whose axes, frames, base and tool point anywhere: no right angles, no plane.

    limits: for each joint (lower, upper) [rad], or None: continuous. offsets: joint1=(3,) [m] moves that joint's axis.
    """
    axes = np.array([random_direction(rng) for _ in range(7)])
    centres = [rng.normal(size=3) for _ in range(3)]
    points = [centres[(0, 0, 0, 1, 2, 2, 2)[i]] + rng.normal() * axes[i] for i in range(7)]
    for name, offset in offsets.items():
        points[int(name[-1]) - 1] = points[int(name[-1]) - 1] + np.array(offset)
    frames = [pin.SE3.Identity(), *(pin.SE3(pin.SE3.Random().rotation, p) for p in points), pin.SE3.Random()]
    links = [f'<link name="l{i}"/>' for i in range(9)]
    limits = [(-2.5, 2.9)] * 7 if limits is None else limits
    for i in range(8):
        placement = frames[i].actInv(frames[i + 1])
        xyz, rpy = (
            " ".join(map(repr, v.tolist())) for v in (placement.translation, pin.rpy.matrixToRpy(placement.rotation))
        )
        kind, inner = "fixed", ""
        if i < 7:
            limit = limits[i]
            kind = "continuous" if limit is None else "revolute"
            axis = " ".join(map(repr, (frames[i + 1].rotation.T @ axes[i]).tolist()))
            inner = f'<axis xyz="{axis}"/>'
            lower, upper = limit or (-1, 1)
            inner += f'<limit lower="{lower!r}" upper="{upper!r}" velocity="1" effort="1"/>'
        links.append(
            f'<joint name="j{i + 1}" type="{kind}"><parent link="l{i}"/><child link="l{i + 1}"/>'
            f'<origin xyz="{xyz}" rpy="{rpy}"/>{inner}</joint>'
        )
    return mq.Robot.from_urdf(f'<robot name="random">{"".join(links)}</robot>')


def worst_error(robot: mq.Robot, q: np.ndarray, T: np.ndarray) -> float:
    """Largest entry of the pose errors [m, rad] of configurations (k, 7)."""
    return max((float(np.abs(pose_error(robot.forward(each), T)).max()) for each in q), default=0.0)


def swivel_of(srs: SRS, q: np.ndarray) -> float:
    """The swivel angle [rad] of q (7,), from the elbow's axis as Pinocchio has it."""
    robot, data = srs.robot, srs.robot.model.createData()
    pin.forwardKinematics(robot.model, data, np.zeros(7))
    own = data.oMi[4].rotation.T @ srs.axes[3]
    pin.forwardKinematics(robot.model, data, q)
    axis = data.oMi[4].rotation @ own
    line = srs.wrist_centre(robot.forward(q).homogeneous) - srs.shoulder
    line /= np.linalg.norm(line)
    up = srs.reference - (line @ srs.reference) * line
    across = -np.sign(np.sin(q[3] - srs.phase)) * np.cross(axis, line)
    return float(np.arctan2(across @ np.cross(line, up), across @ up))
