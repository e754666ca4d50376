"""Poses from a file: its numbers as transformations and starts, each row checked and, if it is bad, named."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from maira_qp.apps.pose_files.columns import layout
from maira_qp.apps.pose_files.csv_table import CsvTable
from maira_qp.apps.pose_files.npz_table import NpzTable
from maira_qp.apps.pose_files.parquet_table import ParquetTable, check_pyarrow
from maira_qp.apps.pose_files.table import Choose, Table
from maira_qp.errors import OptionError, PoseError
from maira_qp.orientation import ORTHONORMAL_WITHIN, exact_rotation, matrix_from_quaternion

FORMATS = (".csv", ".npz", ".parquet")
BLOCK = 50_000
"""Rows are worked on in blocks of so many, which bounds the memory in between."""
Name = Callable[[int], str]
"""Where the i-th of some rows stands in the file, for a person."""
ON_PURPOSE = "--project takes the nearest rotation on purpose"


@dataclass(frozen=True)
class Poses:
    """What a file asks for."""

    table: Table
    targets: np.ndarray
    """(N, 4, 4), rotations to `ORTHONORMAL_WITHIN`; a row with an empty cell, or one that is not finite, is all NaN."""
    q0: np.ndarray | None
    """(N, n) [rad or m], finite; zero where the target is NaN"""
    valid: np.ndarray
    """(N,) the row holds a pose"""


def check_format(path: Path) -> None:
    """Whether files of this name can be read and written. Raises `OptionError`."""
    if path.suffix.lower() not in FORMATS:
        raise OptionError(f"a file of poses ends in {', '.join(FORMATS)}, not {path.name!r}")
    if path.suffix.lower() == ".parquet":
        check_pyarrow()


def read_poses(
    path: Path, joint_names: Sequence[str], *, radian: float, scale: np.ndarray, project: bool = False
) -> Poses:
    """The poses of a file.

    Args:
        path: .csv, .npz or .parquet.
        joint_names: n names, for the columns of the start.
        radian: one radian in the unit of the file.
        scale: (n,) one rad or m of each joint in the unit of the file.
        project: take the nearest rotation to a rounded one, however far it is.

    Raises `PoseError`, which names the row or column, `OptionError`, `OSError`.
    """
    check_format(path)

    def choose(names: Sequence[str]) -> Sequence[str]:
        try:
            return layout(names, joint_names).names
        except PoseError as reason:
            raise PoseError(f"{path}: {reason}") from None

    table = _read(path, choose, joint_names)
    found = layout(table.names, joint_names)
    width = len(found.pose)
    valid = np.logical_and.reduce(np.isfinite(table.numbers), axis=1)
    targets = np.full((len(table), 4, 4), np.nan)
    for begin in range(0, len(table), BLOCK):
        rows = begin + np.flatnonzero(valid[begin : begin + BLOCK])
        name = _names(table, rows)
        targets[rows] = _transformations(found.form, table.numbers[rows, :width], radian, project, name)
    q0 = np.where(valid[:, None], table.numbers[:, width:], 0.0) / scale if found.start else None
    return Poses(table, targets, q0, valid)


def _read(path: Path, choose: Choose, joint_names: Sequence[str]) -> Table:
    suffix = path.suffix.lower()
    if suffix == ".csv":
        return CsvTable(path, choose)
    return NpzTable(path, choose, joint_names) if suffix == ".npz" else ParquetTable(path, choose)


def _names(table: Table, rows: np.ndarray) -> Name:
    return lambda i: table.where(int(rows[i]))


def _transformations(form: str, numbers: np.ndarray, radian: float, project: bool, name: Name) -> np.ndarray:
    """Transformations (N, 4, 4) from the numbers (N, k) of poses."""
    T = np.zeros((len(numbers), 4, 4))
    T[:, 3, 3] = 1.0
    if form == "matrix":
        T.reshape(-1, 16)[:, : numbers.shape[1]] = numbers
        for i in np.flatnonzero((T[:, 3] != (0.0, 0.0, 0.0, 1.0)).any(axis=1))[:1]:
            raise PoseError(f"{name(i)}: the last row of the matrix must be 0, 0, 0, 1, not {T[i, 3].tolist()}")
        T[:, :3, :3] = _from_matrices(T[:, :3, :3], project, name)
        return T
    T[:, :3, 3] = numbers[:, :3]
    if form == "quaternion":
        T[:, :3, :3] = _from_quaternions(numbers[:, 3:], project, name)
    elif len(numbers):
        from scipy.spatial.transform import Rotation  # not at the top: takes a while to load

        T[:, :3, :3] = Rotation.from_euler("xyz", numbers[:, 3:] / radian).as_matrix()
    return T


def _from_matrices(M: np.ndarray, project: bool, name: Name) -> np.ndarray:
    """Rotations (N, 3, 3) from matrices, those that are rounded made exact if `project`."""
    scale = np.abs(M).max(axis=(1, 2), initial=0.0)[:, None, None]
    with np.errstate(over="ignore", invalid="ignore"):
        deviation = np.abs(M @ M.swapaxes(1, 2) - np.eye(3)).max(axis=(1, 2), initial=0.0)
        off = ~(deviation <= ORTHONORMAL_WITHIN)
    R = M / np.where(scale > 0, scale, 1.0)
    if not project:
        for i in np.flatnonzero(off)[:1]:
            raise PoseError(f"{name(i)}: max |R R^T - I| = {deviation[i]:.3g}: not orthonormal; {ON_PURPOSE}")
    U, S, Vt = np.linalg.svd(R[off])
    singular = np.zeros(len(M), dtype=bool)
    singular[off] = S[:, 2] <= 1e-6 * S[:, 0]
    for i in np.flatnonzero(singular | (np.linalg.det(R) <= 0)).tolist():
        try:
            exact_rotation(M[i], "pose", project=True)
        except PoseError as reason:
            raise PoseError(f"{name(i)}: {reason}") from None
    R[~off] = M[~off]
    R[off] = U @ Vt
    return R


def _from_quaternions(q: np.ndarray, project: bool, name: Name) -> np.ndarray:
    """Rotations (N, 3, 3) from quaternions (N, 4), of unit length unless `project`."""
    largest = np.abs(q).max(axis=1, initial=0.0)
    for i in np.flatnonzero(largest == 0)[:1]:
        raise PoseError(f"{name(i)}: a zero quaternion has no direction")
    unit = q / largest[:, None]
    length = np.linalg.norm(unit, axis=1)
    if not project:
        for i in np.flatnonzero(np.abs(largest * length - 1) > ORTHONORMAL_WITHIN)[:1]:
            raise PoseError(
                f"{name(i)}: the quaternion's norm is {largest[i] * length[i]:.6g}, not 1 (scalar first); {ON_PURPOSE}"
            )
    return np.moveaxis(matrix_from_quaternion((unit / length[:, None]).T), 2, 0)
