"""A finished map, opened: verdicts on poses in microseconds, what is known of places, and planes for pictures."""

from __future__ import annotations

import os
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from maira_qp.display import Card, Shown
from maira_qp.errors import JobError, OptionError, PoseError, listed, shown
from maira_qp.problem.targets import poses_of_batch
from maira_qp.results.status import Reach
from maira_qp.robots.model.robot import Robot
from maira_qp.scale.checksums import is_finished
from maira_qp.scale.job import job_of
from maira_qp.scale.manifest import read_manifest
from maira_qp.scale.reach import store
from maira_qp.scale.reach.job import ReachJob
from maira_qp.scale.reach.surface import MapSurface, surface_at

PLANES = {"xy": (0, 1, 2), "xz": (0, 2, 1), "yz": (1, 2, 0)}
"""Planes by their axes, the third of which is across."""
POSES = 8_192
"""Poses that are looked up together: what fits into the caches."""


class MapSlice(NamedTuple):
    """A plane of cells."""

    x: np.ndarray
    """(K,) [m] centres along the plane's first axis"""
    y: np.ndarray
    """(L,) [m] centres along its second"""
    values: np.ndarray
    """(L, K)"""
    at: float
    """[m] centre of the cells along the third axis"""


class ReachMap(Shown):
    """A map of what an arm reaches. It reads an array from its folder when it is first asked for, and keeps it."""

    def __init__(self, folder: Path, job: ReachJob) -> None:
        """See `open`."""
        self.folder = folder
        self.job = job
        """What was computed: grids, robot, options."""

    @staticmethod
    def open(folder: str | os.PathLike[str]) -> ReachMap:
        """Open the finished map of a folder. Raises `JobError` if it holds none, `OptionError` without zarr."""
        store.check_zarr()
        path = Path(folder)
        job = job_of(read_manifest(path))
        if not isinstance(job, ReachJob):
            raise JobError(f"{path} holds a job {job.kind!r}, and no map")
        if not is_finished(path):
            raise JobError(f"the map in {path} is not finished: maira-qp job resume {path}")
        return ReachMap(path, job)

    @cached_property
    def robot(self) -> Robot:
        """The arm, with the limits that held."""
        return Robot.from_urdf(self.job.urdf, tip=self.job.tip, base=self.job.base)

    @cached_property
    def verdict(self) -> np.ndarray:
        """Values of `Reach` (X, Y, Z, directions, rolls), of int8."""
        return store.open_arrays(self.folder)[store.VERDICT][...]

    def values(self, quantity: str) -> np.ndarray:
        """A quantity of the cells (X, Y, Z), such as "reachable". Raises `OptionError` for another name."""
        if not isinstance(quantity, str) or quantity not in store.CELLS:
            raise OptionError(f"no quantity {shown(quantity)}; {listed(store.CELLS, quantity)}")
        if quantity not in self._kept:
            self._kept[quantity] = store.open_arrays(self.folder)[quantity][...]
        return self._kept[quantity]

    def query(self, poses: Any, *, nearest: bool = False) -> np.ndarray:
        """What the map says of poses: values of `Reach` (N,), of int8, by the poses of the grid around each.

        What these say with more than half of their weight; UNDECIDED where nothing has as much. A weight is a product:
        of that of the eight cells around the position in trilinear interpolation, and of that of the orientation, see
        `Orientations.around`. So this is an estimate, wrong of some poses near the edge of what is reached, and never a
        proof. `nearest` gives the verdict of the nearest pose of the grid, which is wrong two to three times as often;
        then UNREACHABLE is proved of that pose, and not of the one that is asked for, which may be half a cell and half
        a step of the orientations away.

        Outside of the grid it is UNREACHABLE where the tip cannot be that far, and else UNDECIDED, as a pose with NaN
        or inf in it is.

        Args:
            poses: (N, 4, 4), or a sequence of `pin.SE3` and (4, 4) arrays; rotations are not checked.
            nearest: the position is taken to the centre of its cell, the z axis of the tool to the nearest direction,
                the roll about it to the nearest roll.

        Raises `PoseError`.
        """
        T = poses_of_batch(poses, "pose", "for one pose: query([pose])")
        points, job = T[:, :3, 3], self.job
        cell = job.positions.index(points)
        found, is_finite = np.full(len(T), Reach.UNDECIDED, dtype=np.int8), np.isfinite(T).all(axis=(1, 2))
        inside, outside = np.flatnonzero(is_finite & (cell >= 0)), np.flatnonzero(is_finite & (cell < 0))
        if nearest:
            found[inside] = self._flat[cell[inside], job.orientations.nearest(T[inside, :3, :3])]
        else:
            for some in (inside[first : first + POSES] for first in range(0, len(inside), POSES)):
                found[some] = self._around(T[some])
        if job.radius is not None:
            with np.errstate(over="ignore"):
                away = np.linalg.norm(points[outside] - np.array(job.centre), axis=1)
            found[outside[away > job.radius + job.options["position_tolerance"]]] = Reach.UNREACHABLE
        return found

    def _around(self, T: np.ndarray) -> np.ndarray:
        """What has most of the weight (N,) around poses (N, 4, 4)."""
        cells, shares = self.job.positions.around(T[:, :3, 3])
        orientations, weights = self.job.orientations.around(T[:, :3, :3])
        verdict, cells = self._flat.reshape(-1), cells * self.job.units_per_item
        reached, proved = np.zeros(len(T)), np.zeros(len(T))
        for cell, share in zip(cells, shares, strict=True):
            for orientation, weight in zip(orientations, weights, strict=True):
                said, both = verdict[cell + orientation], share * weight
                reached += both * (said == Reach.REACHABLE)
                proved += both * (said == Reach.UNREACHABLE)
        kinds = [reached > 0.5, proved > 0.5]
        return np.select(kinds, [Reach.REACHABLE, Reach.UNREACHABLE], Reach.UNDECIDED).astype(np.int8)

    def at(self, positions: Any, quantity: str = "reachable") -> np.ndarray:
        """A quantity (N,) of the cells that hold positions (N, 3) [m]; NaN outside of the grid.

        Raises `OptionError` for another name, `PoseError`.
        """
        points = np.asarray(positions, dtype=float)
        if points.ndim != 2 or points.shape[1] != 3:
            raise PoseError(f"positions must be (N, 3), not {points.shape}")
        cell = self.job.positions.index(points)
        values = self.values(quantity).ravel()[np.maximum(cell, 0)].astype(float)
        values[cell < 0] = np.nan
        return values

    def slice(self, plane: str = "xz", at: float = 0.0, quantity: str = "reachable") -> MapSlice:
        """A quantity on a plane of cells: "xy", "xz" or "yz", the one that holds `at` [m] along the third axis.

        Raises `OptionError` for another plane or quantity, and for a plane outside of the grid.
        """
        if not isinstance(plane, str) or plane not in PLANES:
            raise OptionError(f"no plane {shown(plane)}; {listed(PLANES, plane)}")
        first, second, across = PLANES[plane]
        grid = self.job.positions
        low = grid.lower[across] * grid.cell
        k = int(np.floor(at / grid.cell)) - grid.lower[across] if np.isfinite(at) else -1
        if not 0 <= k < grid.shape[across]:
            high = low + grid.shape[across] * grid.cell
            raise OptionError(f"at must be from {low:g} to {high:g} m, where the map is, got {at}")
        values = np.take(self.values(quantity), k, axis=across).T
        return MapSlice(grid.axis(first), grid.axis(second), values, float(grid.axis(across)[k]))

    def surface(self, quantity: str = "reachable", level: float = 0.5) -> MapSurface:
        """The closed surface on which a quantity of the cells has a value, `level`: cells inside have more.

        Between the centres of cells it is interpolated; cells without a value count as 0. Needs scikit-image,
        `maira-qp[surface]`. Raises `OptionError` for another quantity, and for a level that no surface has.
        """
        return surface_at(self.values(quantity), level, self.job.positions)

    @cached_property
    def _flat(self) -> np.ndarray:
        return self.verdict.reshape(self.job.count, -1)

    @cached_property
    def _kept(self) -> dict[str, np.ndarray]:
        return {}

    def _card(self) -> Card:
        job = self.job
        size = " x ".join(map(str, job.shape))
        return Card(
            title=f"ReachMap of {self.robot.name}, {size} cells of {job.cell:g} m",
            facts=(
                ("directions, rolls", f"{job.directions}, {job.rolls}"),
                ("poses", str(job.count * job.units_per_item)),
                ("quantities", ", ".join((*store.CELLS, store.VERDICT))),
                ("folder", str(self.folder)),
            ),
        )

    def __reduce__(self) -> tuple[type[ReachMap], tuple[Path, ReachJob]]:
        return ReachMap, (self.folder, self.job)
