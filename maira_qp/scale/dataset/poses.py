"""Where the poses of a data set come from: the workspace, configurations, paths, a file.

Random poses come in groups, each with a stream of its own, so that a row depends on the seed and its index alone.
"""

from __future__ import annotations

import hashlib
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from maira_qp.errors import JobError, PoseError
from maira_qp.io.poses import read_poses
from maira_qp.robots.model.robot import Robot, drawn

RANDOM = ("workspace", "configurations", "paths")
GROUP = 1024
"""Rows with one random stream."""
PATH = 128
"""Poses of a path; a whole number of paths make a group."""
CORNERS = 4
"""Configurations that a path goes through."""
PIECE = 2**20
"""How much of a file is read at a time [bytes]."""


def group(source: str, robot: Robot, centre: tuple[float, ...], radius: float, seed: int, k: int) -> np.ndarray:
    """The random poses (GROUP, 4, 4) of the k-th group."""
    rng = np.random.default_rng((seed, k))
    if source == "workspace":
        return _in_ball(rng, np.array(centre), radius)
    q = drawn(rng, *robot.drawn_range, GROUP) if source == "configurations" else _along_paths(rng, robot)
    return np.array([robot.at(each).placement(None).homogeneous for each in q])


def _in_ball(rng: np.random.Generator, centre: np.ndarray, radius: float) -> np.ndarray:
    from scipy.spatial.transform import Rotation  # not at the top: takes a while to load

    T = np.tile(np.eye(4), (GROUP, 1, 1))
    direction, quaternions = rng.normal(size=(GROUP, 3)), rng.normal(size=(GROUP, 4))
    away = radius * rng.random(GROUP) ** (1 / 3) / np.linalg.norm(direction, axis=1)
    T[:, :3, 3] = centre + away[:, None] * direction
    T[:, :3, :3] = Rotation.from_quat(quaternions).as_matrix()
    return T


def _along_paths(rng: np.random.Generator, robot: Robot) -> np.ndarray:
    """Configurations (GROUP, n) of paths one after another, each a Bezier curve, which stays within the limits for
    it is a mean of its corners everywhere."""
    t = np.linspace(0.0, 1.0, PATH)[:, None]
    weights = np.hstack([(1 - t) ** 3, 3 * t * (1 - t) ** 2, 3 * t * t * (1 - t), t**3])
    corners = drawn(rng, *robot.drawn_range, GROUP // PATH * CORNERS).reshape(-1, CORNERS, robot.n)
    return np.clip((weights @ corners).reshape(-1, robot.n), robot.lower, robot.upper)


def described(path: Path) -> dict[str, Any]:
    """What a manifest says of a file of poses: where it is, its checksum, its rows.

    Raises `PoseError`, `OptionError`.
    """
    path = path.absolute()
    poses = _read(str(path))
    if not len(poses):
        raise PoseError(f"{path} holds no pose")
    return {"path": str(path), "sha256": _sum(path), "rows": len(poses)}


def of_file(path: str, sha256: str, first: int, last: int) -> np.ndarray:
    """Poses (last - first, 4, 4) of a file; NaN where a row has none. Raises `JobError` if it is not the same file."""
    return opened(path, sha256).targets(slice(first, last))


@lru_cache(maxsize=1)
def opened(path: str, sha256: str) -> Any:
    """The poses of a file, if it is the one of that checksum. Raises `JobError`."""
    if not Path(path).exists():
        raise JobError(f"{path}, the poses of this job, is not there")
    if _sum(Path(path)) != sha256:
        raise JobError(f"{path} is not the file any more that this job was begun with: its checksum is another")
    return _read(path)


def _read(path: str) -> Any:
    return read_poses(Path(path), None)


def _sum(path: Path) -> str:
    total = hashlib.sha256()
    with open(path, "rb") as file:
        while piece := file.read(PIECE):
            total.update(piece)
    return total.hexdigest()
