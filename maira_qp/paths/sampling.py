"""How many poses a path needs, and where: no two neighbours farther apart than `step` and `turn` allow."""

from __future__ import annotations

from typing import Any

import numpy as np

from maira_qp.errors import OptionError
from maira_qp.paths.arguments import checked_pose, checked_poses, positive
from maira_qp.paths.interpolation import angles, distances, interpolate

STEP = 0.005
"""Default of `step` [m]."""
TURN = 0.05
"""Default of `turn` [rad]."""
MOST = 10**7
"""Most poses of a path: more are a mistake, and beyond the memory."""
SAME = 1e-12
"""Distance [m] and rotation [rad] up to which a pose repeats the one before, as after a change of frame."""
ROUNDING = 1e-12
"""The share of a length that is no reason for one more interval."""


def resampled(poses: Any, *, step: float = STEP, turn: float = TURN, frame: Any = None) -> np.ndarray:
    """Sample a path evenly along its length: poses (M, 4, 4) on the straight lines between the given ones.

    A leg is as long as the more demanding of its distance over `step` and its rotation over `turn`; in this measure
    the poses are equally far apart. Ends are kept, repeated poses are not; one pose gives one pose.

    Args:
        poses: (N, 4, 4), N >= 1.
        step, turn, frame: see `maira_qp.paths`.

    Raises `PoseError`, `OptionError`.
    """
    path, costs = distinct(checked_poses(poses), checked_spacing(step, turn))
    reached = np.concatenate([[0.0], np.cumsum(costs)])
    count = int(intervals(reached[-1:])[0])
    at = np.interp(np.linspace(0.0, reached[-1], count + 1), reached, np.arange(len(path)))
    return placed(interpolate(path, at), frame)


def in_frame(poses: Any, frame: Any) -> np.ndarray:
    """Move a path (N, 4, 4) that is given in a frame, whose pose is `frame`, into the base: `frame @ poses`.

    Raises `PoseError`.
    """
    return checked_pose(frame, "frame") @ checked_poses(poses)


def length(poses: Any) -> float:
    """Compute the length [m] of the straight lines between the poses (N, 4, 4) of a path. Raises `PoseError`."""
    return float(distances(checked_poses(poses)).sum())


def placed(path: np.ndarray, frame: Any) -> np.ndarray:
    """A path in the base, given in a frame or (None) in the base. Raises `PoseError`."""
    return path if frame is None else checked_pose(frame, "frame") @ path


def checked_spacing(step: Any, turn: Any) -> tuple[float, float]:
    """Both as floats. Raises `OptionError`."""
    return positive(step, "step", "metres"), positive(turn, "turn", "radians")


def distinct(path: np.ndarray, spacing: tuple[float, float]) -> tuple[np.ndarray, np.ndarray]:
    """A path (N, 4, 4) without repeated poses, and the intervals (N - 1,) that its legs need, > 0 and not rounded."""
    legs, turns = distances(path), angles(path)
    moved = (legs > SAME) | (turns > SAME)
    kept = path[np.concatenate([[True], moved])]
    if len(kept) > 1:
        kept[-1] = path[-1]
    costs = np.maximum(legs / spacing[0], turns / spacing[1])[moved]
    return kept, np.maximum(costs, np.finfo(float).tiny)


def intervals(costs: np.ndarray) -> np.ndarray:
    """Whole numbers (N,) of intervals that are enough. Raises `OptionError` if they are too many altogether."""
    total = costs.sum()
    if not total <= MOST:
        raise OptionError(
            f"step, turn or dt make {total:.3g} poses of this path, {MOST} are allowed: choose larger ones"
        )
    return np.ceil(costs * (1.0 - ROUNDING)).astype(np.int64)


def along(counts: np.ndarray) -> np.ndarray:
    """Places on pieces (N,) with so many intervals each: piece i from i to i + 1; the last is N."""
    piece = np.repeat(np.arange(len(counts)), counts)
    within = np.arange(len(piece)) - np.repeat(np.cumsum(counts) - counts, counts)
    return np.append(piece + within / counts[piece], len(counts))
