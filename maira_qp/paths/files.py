"""Paths from files."""

from __future__ import annotations

from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from maira_qp.errors import OptionError, PoseError, shown
from maira_qp.io.poses import blocks, read_poses
from maira_qp.paths.arguments import flag
from maira_qp.paths.sampling import placed


def from_csv(
    file: str | PathLike[str],
    *,
    degrees: bool = False,
    millimetres: bool = False,
    project: bool = False,
    frame: Any = None,
) -> np.ndarray:
    """Read a path from a CSV file, one pose per line: poses (N, 4, 4).

    Args:
        file: its name. The first line names the columns: `x`, `y`, `z` [m] and `qw`, `qx`, `qy`, `qz` (scalar first)
            or `roll`, `pitch`, `yaw`; or `m00`, `m01`, ... `m23`, the matrix by rows. Further columns are ignored.
        degrees: roll, pitch and yaw are in degrees, else in radians.
        millimetres: positions are in millimetres, else in metres.
        project: take the nearest rotation to a rounded one, however far it is.
        frame: see `maira_qp.paths`.

    Raises `PoseError`, which names the line, `OptionError`.
    """
    if not isinstance(file, (str, PathLike)) or Path(file).suffix.lower() != ".csv":
        raise OptionError(f"file must be the name of a .csv file, got {shown(file)}")
    poses = read_poses(
        Path(file),
        None,
        radian=180.0 / np.pi if flag(degrees, "degrees") else 1.0,
        metre=1e3 if flag(millimetres, "millimetres") else 1.0,
        project=flag(project, "project"),
    )
    if not len(poses):
        raise PoseError(f"{file} holds no pose below its header")
    for i in np.flatnonzero(~poses.valid(slice(None)))[:1].tolist():
        raise PoseError(f"{poses.table.where(i)}: a pose of a path has an empty cell, NaN or inf")
    return placed(np.concatenate([poses.targets(rows) for rows in blocks(len(poses))]), frame)
