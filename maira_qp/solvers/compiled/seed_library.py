"""Configurations to start a search from, and which of them are preferred where several are as near to the target."""

from __future__ import annotations

import numpy as np

from maira_qp.kernels.jit.simd import LANES
from maira_qp.kernels.layout import Feature
from maira_qp.kernels.search.seeds import fill_library
from maira_qp.problem.objectives import Posture
from maira_qp.problem.targets import row_of
from maira_qp.robots.model.revolutions import WholeTurns
from maira_qp.robots.model.robot import Robot
from maira_qp.solvers.spread import spread

LIBRARY, CORNERS = 512, 128
"""Configurations to start from whose poses are known, and how many of them at most have every joint on a limit.

A pass over them costs a fraction of an iteration. Targets near a corner of the limits are the hardest to find."""

MIDDLE_SHARE, POSTURE_SHARE = 0.3, 1.0
"""What it counts that a start is near the middle of the limits, and near a posture that is to be settled for, beside
the pose: means over the library in units of each other.

From the middle fewer descents run into the limits. Nearer to the posture the self-motion is shorter, and mostly ends at
a better optimum."""


def starting_library(robot: Robot, lower: np.ndarray, upper: np.ndarray) -> np.ndarray:
    """Configurations (LIBRARY, n): corners of lower and upper (n,), the others spread evenly between them."""
    n = robot.n
    all_of_them = 2**n <= CORNERS
    pick = np.arange(2**n)[:, None] >> np.arange(n) & 1 if all_of_them else spread(CORNERS, n) > 0.5
    corners = np.where(pick, upper, lower)
    share = spread(LIBRARY - len(corners), n)
    return np.concatenate([corners, np.clip((1 - share) * lower + share * upper, lower, upper)])


def library_features(robot: Robot, library: np.ndarray, settings: np.ndarray, posture: Posture | None) -> np.ndarray:
    """Features (LIBRARY / LANES, 13, LANES) of a library, see `kernels.search.seeds`.

    Their square counts the distance from a posture too, or from the middle. Slides that are placed by the target count
    in neither.
    """
    features, turns = np.empty((LIBRARY // LANES, Feature.WIDTH, LANES)), WholeTurns(robot, robot.middle)
    poses = np.array([row_of(robot.at(q).placement(None)) for q in library])
    if turns.long_slides.any():
        poses[:, 9:] = poses[:, 9:] @ _across_slides(robot, turns.long_slides)
    fill_library(settings, poses, features)
    share = POSTURE_SHARE
    if posture is None:
        posture, share = Posture(weights=(~turns.everywhere).astype(float)).of(robot), MIDDLE_SHARE
    distance = np.square(library - posture.q_ref) @ (posture.joint_weights * ~turns.long_slides)
    distance = np.minimum(distance, distance.mean())  # nothing else is near a target in a corner of the limits
    poses = features[:, : Feature.SQUARE]
    spread = np.square(poses - poses.mean(axis=(0, 2), keepdims=True)).sum(axis=1).mean()
    if distance.mean() > 0.0:
        features[:, Feature.SQUARE] += (share * spread / distance.mean()) * distance.reshape(-1, LANES)
    return features


def _across_slides(robot: Robot, slides: np.ndarray) -> np.ndarray:
    """Projection (3, 3) of positions onto what long slides (n,) cannot change; of slides behind other joints: zero."""
    if slides[np.argmin(robot.slides) :].any() and not robot.slides.all():
        return np.zeros((3, 3))
    directions = robot.jacobian(robot.middle)[:3, slides]
    return np.eye(3) - directions @ np.linalg.pinv(directions)
