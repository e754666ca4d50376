"""What the tests of the compiled closed form share: S-R-S arms, poses for them, and their kernels."""

from dataclasses import replace
from functools import cache
from typing import NamedTuple

import numpy as np
import pinocchio as pin
from compiled_problems import row_of
from test_arcs import LIMITS
from test_srs import iiwa14_without_offset, random_arm

import maira_qp as mq
from maira_qp.analytic.srs.arrays import srs_array
from maira_qp.analytic.srs.geometry import SRS
from maira_qp.kernels.srs.feasible_configuration import start
from maira_qp.kernels.srs.swivel_intervals import ARCS, CRITICAL, FLOATS, INTEGERS, PIECES, Work
from maira_qp.kernels.srs.unreachability import verdicts

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


def memory() -> tuple[np.ndarray, np.ndarray]:
    """Floats and integers to work in, which hold rubbish."""
    return np.full(FLOATS, np.nan), np.full(INTEGERS, -(2**62))


def codes_of(arm: Arm, poses: np.ndarray, position: float = 1e-6, orientation: float = 1e-6) -> np.ndarray:
    """Verdicts (N,) on poses (N, 4, 4)."""
    codes, rows = np.full(len(poses), -1), np.array([row_of(T) for T in poses])
    verdicts(arm.array, rows, position, orientation, *memory(), np.full((8, PIECES, 3), np.nan), codes)
    return codes


def starts_of(arm: Arm, poses: np.ndarray, offset: float = 0.3) -> tuple[np.ndarray, np.ndarray]:
    """Configurations (N, 7) for poses (N, 4, 4), and which were found (N,)."""
    q, found, rows = np.full((len(poses), 7), np.nan), np.zeros(len(poses), bool), np.array([row_of(T) for T in poses])
    floats = (np.full(shape, np.nan) for shape in ((2, 9), (2, 2, 15), (CRITICAL, 4), (2, 2, ARCS, 3)))
    work = Work(*floats, np.full((2, 2), -(2**62)))
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
