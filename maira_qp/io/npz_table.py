"""NumPy's archives: `targets` (N, 4, 4), if you like `q0` (N, n), and further arrays, which are carried along."""

from __future__ import annotations

import itertools
import zipfile
import zlib
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from maira_qp.errors import PoseError
from maira_qp.io.columns import LAST_ROW, MATRIX, START
from maira_qp.io.table import ALL, Choose, Table, one_line
from maira_qp.regular_files import LARGEST_TABLE, open_regular

UNREADABLE = (ValueError, EOFError, KeyError, OSError, RuntimeError, MemoryError, zipfile.BadZipFile, zlib.error)
"""What NumPy and zipfile raise for an archive that is damaged, encrypted, or packed in a way unknown to them."""


class NpzTable(Table):
    """An archive in memory. Its columns are the entries of a row: m00 to m33, q0_<joint>, and those of other arrays."""

    def __init__(self, path: Path, choose: Choose, joint_names: Sequence[str]) -> None:
        """Reads a file. Raises `PoseError` for what is no archive and for missing or misshapen arrays."""
        self.path = path
        self.arrays = _load(path)
        if len(self.arrays) != 1 and "targets" not in self.arrays:
            raise PoseError(f"{path} holds no array 'targets' (N, 4, 4) but {', '.join(self.arrays) or 'nothing'}")
        poses = "targets" if "targets" in self.arrays else next(iter(self.arrays))
        shapes: dict[str, tuple[int | None, ...]] = {poses: (None, 4, 4)}
        labels: dict[str, tuple[str, ...]] = {poses: (*MATRIX, *LAST_ROW)}
        if "q0" in self.arrays:
            shapes["q0"] = (len(self.arrays[poses]) if self.arrays[poses].ndim else None, len(joint_names))
            labels["q0"] = tuple(START + joint for joint in joint_names)
        for name, shape in shapes.items():
            _check_numbers(self.arrays[name], shape, f"{path}: array {name!r}")
        count = len(self.arrays[poses])
        rows = {name: array for name, array in self.arrays.items() if array.shape[:1] == (count,)}
        self.left_out = [name for name in self.arrays if name not in rows]
        """Arrays without an entry for each row: no columns, and so not in a file of another format."""
        named = [pair for name, array in rows.items() for pair in _columns(name, array, labels.get(name))]
        self.names = [name for name, _ in named]
        chosen = choose(self.names)
        self._columns = dict(named)
        self.numbers = np.column_stack([self._columns[name] for name in chosen]).astype(float, copy=False)

    def where(self, row: int) -> str:
        """File and index."""
        return f"{self.path}, target {row} (counted from 0)"

    def columns(self, rows: slice = ALL) -> dict[str, Any]:
        """Views of the arrays."""
        return {name: column[rows] for name, column in self._columns.items()}


def write_npz(file: BinaryIO, table: Table, answers: Mapping[str, np.ndarray]) -> None:
    """The arrays or columns of a table, and those of the answers. Raises `OSError`."""
    asked = table.arrays if isinstance(table, NpzTable) else table.columns()
    with zipfile.ZipFile(file, "w", zipfile.ZIP_STORED) as archive:
        for name, values in itertools.chain(asked.items(), answers.items()):
            with archive.open(f"{name}.npy", "w", force_zip64=True) as entry:
                np.lib.format.write_array(entry, _without_objects(values), allow_pickle=False)


def _load(path: Path) -> dict[str, np.ndarray]:
    with open_regular(path, "the archive", PoseError, LARGEST_TABLE) as file:
        if not zipfile.is_zipfile(file):
            raise PoseError(f"{path} is no archive of arrays, or not the whole of one")
        file.seek(0)
        try:
            with zipfile.ZipFile(file) as archive:
                unpacked = sum(entry.file_size for entry in archive.infolist())
            if unpacked > LARGEST_TABLE:
                raise PoseError(f"{path} unpacks to {unpacked} bytes, more than the {LARGEST_TABLE} that are read")
            file.seek(0)
            with np.load(file, allow_pickle=False) as archive:
                return {name: archive[name] for name in archive.files}
        except PoseError:
            raise
        except UNREADABLE as reason:
            raise PoseError(f"{path} cannot be read as an archive of arrays: {one_line(reason)}") from None


def _check_numbers(array: np.ndarray, shape: tuple[int | None, ...], name: str) -> None:
    """Shape and kind; what the numbers are is the matter of each row."""
    fits = array.ndim == len(shape) and all(n in (None, m) for n, m in zip(shape, array.shape, strict=True))
    if not fits or array.dtype.kind not in "iuf":
        wanted = ", ".join("N" if n is None else str(n) for n in shape)
        raise PoseError(f"{name} must hold numbers ({wanted}), not {array.dtype.name} {array.shape}")


def _columns(name: str, array: np.ndarray, labels: Sequence[str] | None) -> Iterable[tuple[str, np.ndarray]]:
    """An array (N, ...) as named columns (N,)."""
    if array.ndim == 1:
        return [(name, array)]
    if labels is None:
        places = itertools.product(*map(range, array.shape[1:]))
        labels = ["_".join([name, *map(str, place)]) for place in places]
    return zip(labels, array.reshape(len(array), len(labels)).T, strict=True)


def _without_objects(values: Any) -> np.ndarray:
    """Values as an array that needs no pickle: numbers, NaN where there is none, or else text."""
    if isinstance(values, np.ndarray) and values.dtype.kind != "O":
        return values
    kinds = {type(value) for value in values}
    if kinds & {int, float} and kinds <= {int, float, type(None)}:
        return np.array(values, dtype=float)
    return np.array(["" if value is None else str(value) for value in values], dtype=str)
