"""Which pose: a position with an orientation, or a file with the matrix."""

from __future__ import annotations

import io
import json
import logging
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from maira_qp.apps.arguments.numbers import Position, Quaternion, Rpy
from maira_qp.apps.arguments.optional import Flag, Maybe, explained
from maira_qp.arrays import real_array
from maira_qp.errors import PoseError
from maira_qp.regular_files import read_regular

if TYPE_CHECKING:
    import pinocchio as pin

    from maira_qp.apps.arguments.output import Units

log = logging.getLogger(__name__)

MAX_BYTES = 2**20
"""Largest file of a matrix that is read [bytes]."""


@explained
@dataclass(frozen=True, kw_only=True)
class PoseChoice:
    """Where the tool is to be."""

    position: Position = None
    """Wanted position of the tool in the base [m, or mm with --mm]; must be given unless --matrix holds it."""
    quaternion: Quaternion = None
    """Wanted orientation as a unit quaternion, scalar first; without any orientation: that of the base."""
    rpy: Rpy = None
    """Wanted orientation as roll, pitch, yaw about fixed axes [rad, or deg with --deg]."""
    matrix: Maybe[Path] = None
    """File with the wanted pose as 4x4 numbers (or 3x3, the orientation alone): text, .json or .npy; its position in m,
    or mm with --mm."""
    project: Flag = False
    """Take the nearest rotation to a rounded matrix or quaternion, on purpose."""

    @property
    def deviation(self) -> float:
        """How far the orientation is from a rotation, see `deviation_of`; of a pose that was loaded."""
        from maira_qp.problem.pose import deviation_of

        return deviation_of(self.quaternion, None if self.matrix is None else read_matrix(self.matrix))

    @property
    def given(self) -> list[str]:
        """The flags that were given."""
        names = ("position", "quaternion", "rpy", "matrix")
        return [f"--{name}" for name in names if getattr(self, name) is not None]

    def hint(self, units: Units) -> str:
        """What to say if --rpy looks like degrees and is read as radians; else empty."""
        from maira_qp.robots.unit_hints import degrees_hint_of_angles

        hint = "" if self.rpy is None or units.angle == "deg" else degrees_hint_of_angles(self.rpy, "--rpy")
        return f"{hint} (--deg)" if hint else ""

    def load(self, units: Units, others: str = "", *, log_hint: bool = True) -> pin.SE3:
        """The wanted pose; `others` are other ways to give it, for the message; `log_hint`: log `hint`.

        Raises `PoseError` if it is not given, or given twice.
        """
        from maira_qp.problem.pose import pose
        from maira_qp.robots.urdf.rpy import matrix_from_rpy

        matrix = None if self.matrix is None else read_matrix(self.matrix)
        whole = matrix is not None and matrix.shape == (4, 4)
        if whole and matrix is not None and units.metre != 1.0:
            matrix = matrix / np.array([[1.0, 1.0, 1.0, units.metre]] * 3 + [[1.0] * 4])
        if self.position is None and not whole:
            raise PoseError(f"where to? give --position X Y Z, or --matrix FILE with a 4x4 pose{others}")
        if self.position is not None and whole:
            raise PoseError("--position and a 4x4 --matrix both give a position; leave one out")
        rpy = None if self.rpy is None else real_array(self.rpy, (3,), "--rpy", PoseError) / units.radian
        if rpy is not None and matrix is None and self.quaternion is None:
            matrix, rpy = matrix_from_rpy(rpy), None  # `pose` would take large angles in degrees for a mistake
            if log_hint and self.hint(units):
                log.warning(self.hint(units))
        return pose(
            (0.0, 0.0, 0.0) if self.position is None else np.array(self.position) / units.metre,
            quaternion=self.quaternion,
            rpy=rpy,
            matrix=matrix,
            project=self.project,
        )


def read_matrix(path: Path) -> np.ndarray:
    """Numbers from a file: .npy, .json, or text with blanks or commas between. Raises `PoseError`."""
    content = read_regular(path, "the matrix", PoseError, MAX_BYTES)
    try:
        if path.suffix.lower() == ".npy":
            with io.BytesIO(content) as file:
                return np.lib.format.read_array(file, allow_pickle=False)
        text = content.decode("utf-8-sig")
        if path.suffix.lower() == ".json":
            return np.array(json.loads(text), dtype=float)
        rows = [row for line in text.splitlines() if (row := line.replace(",", " ").split())]
        if not rows:
            raise ValueError("it is empty")
        return np.array([[float(word) for word in row] for row in rows])
    except (ValueError, TypeError, EOFError, OverflowError, RecursionError, MemoryError) as reason:
        raise PoseError(f"{path} does not hold a matrix of numbers: {reason!s:.300}") from None
