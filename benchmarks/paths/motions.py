"""Paths: those of random smooth joint motions, which can be followed since they were, and those in files."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path as Folder

import numpy as np
from peers.arms import Arm

from maira_qp.errors import OptionError
from maira_qp.paths import from_csv

POSES, AT_LIMITS = 200, 4
"""Poses a path; every so many-th motion has control points at the limits."""


@dataclass(frozen=True)
class Path:
    """Poses in order, and, where they were made from one, a joint motion that takes the tool through them."""

    name: str
    poses: np.ndarray
    """(N, 4, 4)"""
    motion: np.ndarray | None = None
    """(N, n) [rad]"""

    @property
    def start(self) -> np.ndarray | None:
        """The configuration (n,) at the first pose [rad], where it is known."""
        return None if self.motion is None else self.motion[0]


def made(arm: Arm, count: int, poses: int, seed: int) -> list[Path]:
    """So many paths of so many poses; each has a random stream of its own, and every fourth touches limits."""
    return [_made(arm, number, poses, seed) for number in range(count)]


def _made(arm: Arm, number: int, poses: int, seed: int) -> Path:
    """A cubic Bezier curve, which stays in the box of its control points; clipped, for it is rounded.

    Control points are uniform within the limits. In every `AT_LIMITS`-th motion each of their joints is, by the toss of
    a coin, at one of its limits.
    """
    rng = np.random.default_rng((seed, number))
    points = arm.configurations(4, rng)
    if number % AT_LIMITS == AT_LIMITS - 1:
        ends = np.where(rng.random(points.shape) < 0.5, arm.lower, arm.upper)
        points = np.where(rng.random(points.shape) < 0.5, ends, points)
    t = np.linspace(0.0, 1.0, poses)[:, None]
    weights = np.hstack([(1 - t) ** 3, 3 * t * (1 - t) ** 2, 3 * t**2 * (1 - t), t**3])
    motion = np.clip(weights @ points, arm.lower, arm.upper)
    return Path(f"{arm.name} {number}", arm.judge.forward(motion), motion)


def read(folder: Folder) -> list[Path]:
    """The paths in the CSV files of a folder, by name; rotations may be rounded. Raises `OptionError`, `PoseError`."""
    files = sorted(folder.glob("*.csv"))
    if not files:
        raise OptionError(f"{folder} holds no .csv file")
    return [Path(file.stem, from_csv(file, project=True)) for file in files]
