"""Bases, ranked: where each is, what a solver found from there, and the scores of all that were compared."""

from __future__ import annotations

import json
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, overload

import numpy as np
import pinocchio as pin

from maira_qp.arrays import plain
from maira_qp.display import Card, Shown
from maira_qp.errors import OptionError, shown
from maira_qp.io.atomic_write import replacing
from maira_qp.io.csv_table import write_csv
from maira_qp.io.table import ColumnTable
from maira_qp.results.batch import BatchSolution
from maira_qp.results.status import Reach, reach_of
from maira_qp.robots.model.robot import Robot
from maira_qp.scale.placement.candidates import poses_of_bases
from maira_qp.wording import fixed

FORMATS = (".csv", ".json")
LINES = 10
"""Bases that a terminal is shown."""


@dataclass(frozen=True, eq=False, repr=False)
class Placement(Shown):
    """A base, and what the arm reaches from there. True where it reaches all poses."""

    values: np.ndarray
    """(4,) x, y, z [m] and yaw [rad] of the base, in the frame of the poses"""
    estimate: float
    """The share of the poses that were expected to be reached before they were solved"""
    share: float
    """The share that is reached"""
    least: float
    """The smallest quality of the configurations that reach a pose; NaN: none does"""
    mean: float
    """Their mean quality"""
    solution: BatchSolution
    """Of the poses relative to this base"""

    @property
    def base(self) -> pin.SE3:
        """The pose of the base."""
        return pin.SE3(poses_of_bases(self.values[None])[0])

    @property
    def reached(self) -> int:
        """How many poses are reached."""
        return int(self.solution.success.sum())

    @property
    def unreachable(self) -> int:
        """How many are proved to be out of reach from here."""
        return int((reach_of(self.solution.status) == Reach.UNREACHABLE).sum())

    def __bool__(self) -> bool:
        return bool(self.solution.success.all())

    def as_dict(self) -> dict[str, Any]:
        """Plain data; what is not known is None."""
        base = dict(zip(("x", "y", "z", "yaw"), self.values, strict=True))
        counts = {"poses": len(self.solution), "reached": self.reached, "unreachable": self.unreachable}
        return plain({**base, **counts, "least": self.least, "mean": self.mean, "estimate": self.estimate})

    def _card(self) -> Card:
        x, y, z, yaw = self.values
        return Card(
            title=f"Placement: {self.reached} of {len(self.solution)} poses reached",
            facts=(
                ("base [m]", f"x {x:.4g}, y {y:.4g}, z {z:.4g}"),
                ("yaw [rad]", f"{yaw:.4g}"),
                ("proved out of reach", str(self.unreachable)),
                ("smallest and mean quality", f"{self.least:.4g}, {self.mean:.4g}"),
                ("share expected", f"{self.estimate:.4g}"),
            ),
        )


class Placements(Shown, Sequence[Placement]):
    """Bases in the order of their rank, the best first. True where the best reaches all poses."""

    def __init__(
        self,
        robot: Robot,
        poses: np.ndarray,
        axes: tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray],
        estimates: np.ndarray,
        quality: str,
        ranked: tuple[Placement, ...],
    ) -> None:
        """Made by `place`."""
        self.robot = robot
        self.poses = poses
        """(N, 4, 4) the tool poses"""
        self.axes = axes
        """Values of x, y, z [m] and yaw [rad] of all bases that were compared"""
        self.estimates = estimates
        """(X, Y, Z, YAW) the share of the poses expected to be reached from each of them"""
        self.quality = quality
        """What `least` and `mean` are of"""
        self._ranked = ranked

    def __len__(self) -> int:
        return len(self._ranked)

    @overload
    def __getitem__(self, index: int) -> Placement: ...

    @overload
    def __getitem__(self, index: slice) -> tuple[Placement, ...]: ...

    def __getitem__(self, index: int | slice) -> Placement | tuple[Placement, ...]:
        return self._ranked[index]

    def __bool__(self) -> bool:
        return bool(self._ranked[0])

    @property
    def floor(self) -> np.ndarray:
        """(X, Y) the largest share expected at each x and y, over z and yaw."""
        return self.estimates.max(axis=(2, 3))

    def as_dict(self) -> dict[str, Any]:
        """Plain data."""
        about = {"robot": self.robot.name, "tip": self.robot.tip, "poses": len(self.poses)}
        bases = [placement.as_dict() for placement in self]
        return {**about, "compared": self.estimates.size, "quality": self.quality, "bases": bases}

    def save(self, file: str | os.PathLike[str]) -> Path:
        """Write the ranked bases to a file, whole or not at all: .csv, a row each, or .json. Returns its path.

        Args:
            file: path to write to.

        Raises `OptionError` for another name, `OSError`.
        """
        path = checked_file(file)
        with replacing(path) as opened:
            if path.suffix.lower() == ".json":
                opened.write((json.dumps(self.as_dict(), allow_nan=False, indent=2) + "\n").encode())
            else:
                rows = [placement.as_dict() for placement in self]
                columns = {name: np.array([row[name] for row in rows], dtype=float) for name in rows[0]}
                for name in ("poses", "reached", "unreachable"):
                    columns[name] = columns[name].astype(int)
                for name in ("least", "mean"):  # an empty cell where nothing is reached
                    columns[name] = np.ma.masked_invalid(columns[name])
                write_csv(opened, ColumnTable({"rank": np.arange(1, len(self) + 1), **columns}), {})
        return path

    def _card(self) -> Card:
        headings = ("rank", "reached", "x [m]", "y [m]", "z [m]", "yaw [rad]", "least", "mean")
        rows = [
            (str(k), f"{each.reached}", *(fixed(value, 3) for value in (*each.values, each.least, each.mean)))
            for k, each in enumerate(self, start=1)
        ]
        lines = ["".join(f"{cell:>10}" for cell in row) for row in (headings, *rows[:LINES])]
        return Card(
            title=f"Placements of {self.robot.name} for {len(self.poses)} poses, the best of {self.estimates.size}",
            facts=(("least and mean of", self.quality.replace("_", " ")),),
            lines=lines,
            headings=headings,
            rows=rows,
        )


def checked_file(file: Any) -> Path:
    """Where bases can be written to. Raises `OptionError`."""
    if not isinstance(file, (str, os.PathLike)):
        raise OptionError(f"bases are saved to the path of a file, not {shown(file)}")
    path = Path(file)
    if path.suffix.lower() not in FORMATS:
        raise OptionError(f"a file of bases ends in {' or '.join(FORMATS)}, not {path.name!r}")
    return path
