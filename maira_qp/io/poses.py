"""Poses from a file: its numbers as transformations and starts, each row checked and, if it is bad, named."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

import numpy as np

from maira_qp.errors import OptionError, PoseError
from maira_qp.io.columns import Layout, layout
from maira_qp.io.csv_table import CsvTable
from maira_qp.io.npy_table import NpyTable
from maira_qp.io.npz_table import NpzTable
from maira_qp.io.parquet_table import ParquetTable, check_pyarrow
from maira_qp.io.table import Choose, Table
from maira_qp.orientation import ORTHONORMAL_WITHIN, ROUNDED_WITHIN, exact_rotation, matrix_from_quaternion

FORMATS = (".csv", ".npy", ".npz", ".parquet")
BLOCK = 20_000
"""Poses are made and solved in blocks of so many, which bounds the memory; no answer depends on it."""
Name = Callable[[int], str]
"""Where the i-th of some rows stands in the file, for a person."""
ON_PURPOSE = {
    "python": "to take the nearest rotation on purpose: project=True",
    "shell": "to take the nearest rotation on purpose: --project",
}


@dataclass(frozen=True)
class Poses:
    """What a file asks for: N poses, made from its numbers when they are wanted, a block at a time."""

    table: Table
    layout: Layout
    radian: float
    """One radian in the unit of the file."""
    scale: np.ndarray | float
    """(n,) one rad or m of each joint in the unit of the file."""
    metre: float
    """One metre in the unit of the file."""
    project: bool
    """Take the nearest rotation to a rounded one, however far it is."""

    def __len__(self) -> int:
        return len(self.table)

    def valid(self, rows: slice) -> np.ndarray:
        """Which rows (M,) hold a pose, and a start where there are any: no cell is empty, all numbers are finite."""
        return _are_finite(self.table.numbers(rows))

    def targets(self, rows: slice, valid: np.ndarray | None = None) -> np.ndarray:
        """Transformations (M, 4, 4) [m]; all NaN where there is no pose. Raises `PoseError`, which names the row."""
        return self.targets_and_deviations(rows, valid)[0]

    def targets_and_deviations(self, rows: slice, valid: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray]:
        """Transformations (M, 4, 4) [m], and how far (M,) their orientations are from rotations, 0 within 1e-5.

        `valid` (M,) says which rows hold a pose, None: `valid` of this. Raises `PoseError`, which names the row.
        """
        numbers = self.table.numbers(rows)
        valid = _are_finite(numbers) if valid is None else valid
        found = np.arange(*rows.indices(len(self)))[valid]
        T, deviations = np.full((len(numbers), 4, 4), np.nan), np.zeros(len(numbers))
        T[valid], deviations[valid] = _transformations(
            self.layout.form,
            numbers[valid, : len(self.layout.pose)],
            self.radian,
            self.metre,
            self.project,
            lambda i: self.table.where(int(found[i])),
        )
        return T, deviations

    def starts(self, rows: slice, valid: np.ndarray | None = None) -> np.ndarray | None:
        """Starts (M, n) [rad or m], zero where there is no pose; None: the file holds none."""
        if not self.layout.start:
            return None
        numbers = self.table.numbers(rows)
        valid = _are_finite(numbers) if valid is None else valid
        return np.where(valid[:, None], numbers[:, len(self.layout.pose) :], 0.0) / self.scale


def _are_finite(numbers: np.ndarray) -> np.ndarray:
    """Whether all numbers of each row (M, k) are."""
    return np.logical_and.reduce(np.isfinite(numbers), axis=1)


def check_format(path: Path) -> None:
    """Whether files of this name can be read and written. Raises `OptionError`."""
    if path.suffix.lower() not in FORMATS:
        raise OptionError(f"a file of poses ends in {', '.join(FORMATS)}, not {str(path)!r}")
    if path.suffix.lower() == ".parquet":
        check_pyarrow()


def read_poses(
    path: Path,
    joint_names: Sequence[str] | None,
    *,
    radian: float = 1.0,
    metre: float = 1.0,
    scale: np.ndarray | float = 1.0,
    farthest: float = math.inf,
    project: bool = False,
    position_only: bool = False,
    stream: BinaryIO | None = None,
) -> Poses:
    """The poses of a file.

    Args:
        path: .csv, .npy, .npz or .parquet.
        joint_names: n names, for the columns of the start; None: no column is one.
        radian: one radian in the unit of the file.
        metre: one metre in the unit of the file.
        scale: (n,) one rad or m of each joint in the unit of the file.
        farthest: a coordinate [m] beyond which a position is a mistake.
        project: take the nearest rotation to a rounded one, however far it is.
        position_only: a file may hold positions without orientations; those of its poses are then the base's.
        stream: where CSV comes from; `path` is then its name in messages. None: the file.

    Raises `PoseError`, which names the row or column, `OptionError`.
    """
    if stream is None:
        check_format(path)

    def choose(names: Sequence[str]) -> Sequence[str]:
        try:
            return layout(names, joint_names, position_only=position_only).names
        except PoseError as reason:
            raise reason.at(str(path)) from None

    table = _read(path, choose, joint_names or (), stream)
    found = layout(table.names, joint_names, position_only=position_only)
    poses = Poses(table, found, radian, scale, metre, project)
    for rows in blocks(len(poses)):
        T = poses.targets(rows)  # a bad one is told now, not after the rows before it were solved
        distance = np.abs(T[:, :3, 3]).max(axis=1, initial=0.0)
        for i in np.flatnonzero(distance > farthest)[:1].tolist():
            raise PoseError(f"{table.where(rows.start + i)}: {distance[i]:.3g} m away is no target for this arm")
    return poses


def blocks(count: int) -> list[slice]:
    """Rows in blocks, at least one of them."""
    return [slice(begin, begin + BLOCK) for begin in range(0, max(count, 1), BLOCK)]


def _read(path: Path, choose: Choose, joint_names: Sequence[str], stream: BinaryIO | None) -> Table:
    suffix = path.suffix.lower()
    if suffix == ".csv" or stream is not None:
        return CsvTable(path, choose, stream)
    if suffix == ".npz":
        return NpzTable(path, choose, joint_names)
    return NpyTable(path, choose) if suffix == ".npy" else ParquetTable(path, choose)


def _transformations(
    form: str, numbers: np.ndarray, radian: float, metre: float, project: bool, name: Name
) -> tuple[np.ndarray, np.ndarray]:
    """Transformations (N, 4, 4) from the numbers (N, k) of poses, and the deviations (N,) of their orientations."""
    T, deviation = np.zeros((len(numbers), 4, 4)), np.zeros(len(numbers))
    T[:, 3, 3] = 1.0
    if form == "matrix":
        T.reshape(-1, 16)[:, : numbers.shape[1]] = numbers
        for i in np.flatnonzero((T[:, 3] != (0.0, 0.0, 0.0, 1.0)).any(axis=1))[:1]:
            raise PoseError(f"{name(i)}: the last row of the matrix must be 0, 0, 0, 1, not {T[i, 3].tolist()}")
        T[:, :3, :3], deviation = _from_matrices(T[:, :3, :3], project, name)
    else:
        T[:, :3, 3], T[:, :3, :3] = numbers[:, :3], np.eye(3)
    T[:, :3, 3] /= metre
    if form == "quaternion":
        T[:, :3, :3], deviation = _from_quaternions(numbers[:, 3:], project, name)
    elif form == "rpy" and len(numbers):
        from scipy.spatial.transform import Rotation  # not at the top: takes a while to load

        T[:, :3, :3] = Rotation.from_euler("xyz", numbers[:, 3:] / radian).as_matrix()
    return T, np.where(deviation > ORTHONORMAL_WITHIN, deviation, 0.0)


def _from_matrices(M: np.ndarray, project: bool, name: Name) -> tuple[np.ndarray, np.ndarray]:
    """Rotations (N, 3, 3) from matrices, those that are rounded made exact, and their deviations (N,)."""
    scale = np.abs(M).max(axis=(1, 2), initial=0.0)[:, None, None]
    with np.errstate(over="ignore", invalid="ignore"):
        deviation = np.abs(M @ M.swapaxes(1, 2) - np.eye(3)).max(axis=(1, 2), initial=0.0)
        off, far = ~(deviation <= ORTHONORMAL_WITHIN), ~(deviation <= ROUNDED_WITHIN)
    R = M / np.where(scale > 0, scale, 1.0)
    if not project:
        for i in np.flatnonzero(far)[:1]:
            raise PoseError(f"{name(i)}: max |R R^T - I| = {deviation[i]:.3g}: not orthonormal", **ON_PURPOSE)
    U, S, Vt = np.linalg.svd(R[off])
    singular = np.zeros(len(M), dtype=bool)
    singular[off] = S[:, 2] <= 1e-6 * S[:, 0]
    for i in np.flatnonzero(singular | (np.linalg.det(R) <= 0)).tolist():
        try:
            exact_rotation(M[i], "pose", project=True)
        except PoseError as reason:
            raise reason.at(name(i)) from None
    R[~off] = M[~off]
    R[off] = U @ Vt
    return R, deviation


def _from_quaternions(q: np.ndarray, project: bool, name: Name) -> tuple[np.ndarray, np.ndarray]:
    """Rotations (N, 3, 3) from quaternions (N, 4), of unit length unless `project`, and their deviations (N,)."""
    largest = np.abs(q).max(axis=1, initial=0.0)
    for i in np.flatnonzero(largest == 0)[:1]:
        raise PoseError(f"{name(i)}: a zero quaternion has no direction")
    unit = q / largest[:, None]
    length = np.linalg.norm(unit, axis=1)
    deviation = np.abs(largest * length - 1)
    if not project:
        for i in np.flatnonzero(deviation > ROUNDED_WITHIN)[:1]:
            raise PoseError(
                f"{name(i)}: the quaternion's norm is {largest[i] * length[i]:.6g}, not 1 (scalar first)", **ON_PURPOSE
            )
    return np.moveaxis(matrix_from_quaternion((unit / length[:, None]).T), 2, 0), deviation
