"""Configurations to start a search from, and which of them are preferred where several are as near to the target."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from maira_qp.kernels.jit.simd import LANES
from maira_qp.kernels.layout import Feature, Setting
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


Window = tuple[np.ndarray, np.ndarray]
"""What is sampled of the limits, from (n,) to (n,) [rad or m]"""


@dataclass(frozen=True, eq=False)
class SeedLibrary:
    """Configurations within a range, and their features for some weights of the pose and a posture."""

    known: KnownPoses
    settings: np.ndarray
    """(16,) see `kernels.layout.Setting`"""
    posture: Posture | None
    range: Window | None = None
    """What the configurations are clipped to, whose features stay those of the whole; None: they are not"""

    @staticmethod
    def build(robot: Robot, window: Window, settings: np.ndarray, posture: Posture | None) -> SeedLibrary:
        """For what is sampled of the limits."""
        return SeedLibrary(KnownPoses(robot, *window), settings, posture)

    def changed(self, window: Window, settings: np.ndarray, posture: Posture | None) -> SeedLibrary:
        """The same where another range is sampled, or weights or posture are others."""
        if self.range is not None:
            return SeedLibrary(self.known, settings, posture, window)
        known = self.known
        if not (np.array_equal(window[0], known.lower) and np.array_equal(window[1], known.upper)):
            known = KnownPoses(known.robot, *window)
        return SeedLibrary(known, settings, posture)

    @property
    def configurations(self) -> np.ndarray:
        """(LIBRARY, n)"""
        return self.known.configurations if self.range is None else self._clipped

    @cached_property
    def _clipped(self) -> np.ndarray:
        assert self.range is not None
        return np.clip(self.known.configurations, *self.range)

    def clipped(self, window: Window) -> SeedLibrary:
        """The same with configurations clipped to a range."""
        library = SeedLibrary(self.known, self.settings, self.posture, window)
        library.__dict__["features"] = self.features
        return library

    @cached_property
    def features(self) -> np.ndarray:
        """(LIBRARY / LANES, 13, LANES), see `kernels.search.seeds`.

        Their square counts the distance from the posture too, or from the middle. Slides that are placed by the target
        count in neither.
        """
        known, share = self.known, POSTURE_SHARE if self.posture is not None else MIDDLE_SHARE
        posture = known.middle if self.posture is None else self.posture
        distance = np.square(known.configurations - posture.q_ref) @ (posture.joint_weights * ~known.turns.long_slides)
        mean = distance.mean()
        features, spread = known.features(self.settings)
        if mean <= 0.0:
            return features
        features = features.copy()
        distance = np.minimum(distance, mean)  # nothing else is near a target in a corner of the limits
        features[:, Feature.SQUARE] += (share * spread / distance.mean()) * distance.reshape(-1, LANES)
        return features


@dataclass(frozen=True, eq=False)
class KnownPoses:
    """Configurations between lower and upper (n,), and their poses."""

    robot: Robot
    lower: np.ndarray
    upper: np.ndarray

    @cached_property
    def configurations(self) -> np.ndarray:
        """(LIBRARY, n)"""
        return starting_library(self.robot, self.lower, self.upper)

    @cached_property
    def turns(self) -> WholeTurns:
        """Of the robot's joints."""
        return WholeTurns(self.robot, self.robot.middle)

    @cached_property
    def rows(self) -> np.ndarray:
        """Poses (LIBRARY, 12), R by rows, then p, of which long slides change nothing."""
        rows = np.array([row_of(self.robot.at(q).placement(None)) for q in self.configurations])
        if self.turns.long_slides.any():
            rows[:, 9:] = rows[:, 9:] @ _across_slides(self.robot, self.turns.long_slides)
        return rows

    @cached_property
    def middle(self) -> Posture:
        """The middle of the limits, where joints have less than a turn."""
        return Posture(weights=(~self.turns.everywhere).astype(float)).of(self.robot)

    def features(self, settings: np.ndarray) -> tuple[np.ndarray, float]:
        """Features (LIBRARY / LANES, 13, LANES) of the poses alone, and their spread; not to be written to."""
        weights = settings[[Setting.POSITION_WEIGHT, Setting.ORIENTATION_WEIGHT]].tobytes()
        kept = self._features.get(weights)
        if kept is None:
            features = np.empty((LIBRARY // LANES, Feature.WIDTH, LANES))
            fill_library(settings, self.rows, features)
            poses = features[:, : Feature.SQUARE]
            spread = np.square(poses - poses.mean(axis=(0, 2), keepdims=True)).sum(axis=1).mean()
            kept = features, float(spread)
            self._features.clear()
            self._features[weights] = kept
        return kept

    @cached_property
    def _features(self) -> dict[bytes, tuple[np.ndarray, float]]:
        """Those for the weights of the last call."""
        return {}


def starting_library(robot: Robot, lower: np.ndarray, upper: np.ndarray) -> np.ndarray:
    """Configurations (LIBRARY, n): corners of lower and upper (n,), the others spread evenly between them."""
    n = robot.n
    all_of_them = 2**n <= CORNERS
    pick = np.arange(2**n)[:, None] >> np.arange(n) & 1 if all_of_them else spread(CORNERS, n) > 0.5
    corners = np.where(pick, upper, lower)
    share = spread(LIBRARY - len(corners), n)
    return np.concatenate([corners, np.clip((1 - share) * lower + share * upper, lower, upper)])


def _across_slides(robot: Robot, slides: np.ndarray) -> np.ndarray:
    """Projection (3, 3) of positions onto what long slides (n,) cannot change; of slides behind other joints: zero."""
    if slides[np.argmin(robot.slides) :].any() and not robot.slides.all():
        return np.zeros((3, 3))
    directions = robot.jacobian(robot.middle)[:3, slides]
    return np.eye(3) - directions @ np.linalg.pinv(directions)
