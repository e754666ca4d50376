"""NumPy's single arrays: poses (N, 4, 4), or a structured array (N,) whose fields are the columns of a CSV file."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from maira_qp.errors import OptionError, PoseError
from maira_qp.io.columns import LAST_ROW, MATRIX
from maira_qp.io.disk_rows import DiskRows, Spool
from maira_qp.io.npz_table import ROWS, UNREADABLE, check_numbers, labels_of, without_objects
from maira_qp.io.table import ALL, Choose, Table, one_line
from maira_qp.regular_files import LARGEST_FILE, LARGEST_TABLE, open_regular


class NpyTable(Table):
    """An array, of which some rows are in memory at a time."""

    def __init__(self, path: Path, choose: Choose) -> None:
        """Reads the head of a file. Raises `PoseError` for what is no array of poses or columns."""
        self.path, self._rows = path, _open(path)
        fields, shape = self._rows.dtype.fields, self._rows.shape
        if fields is None:
            check_numbers(self._rows, (None, 4, 4), f"{path}: the array")
            self._labels: dict[str, Sequence[str]] = {"": (*MATRIX, *LAST_ROW)}
        elif len(shape) != 1:
            raise PoseError(f"{path}: an array with fields must be (N,), not {shape}")
        else:
            self._labels = {name: labels_of(name, (*shape, *kind[0].shape)) for name, kind in fields.items()}
        self.names = [label for each in self._labels.values() for label in each]
        self._chosen = tuple(choose(self.names))
        self._needed = [name for name, each in self._labels.items() if not set(each).isdisjoint(self._chosen)]
        for name in self._needed if fields is not None else ():
            kind = self._rows.dtype[name].base
            if kind.kind not in "iuf":
                raise PoseError(f"{path}: column {name!r} must hold numbers, not {kind.name}")

    def __len__(self) -> int:
        return self._rows.shape[0]

    def numbers(self, rows: slice = ALL) -> np.ndarray:
        """See `Table.numbers`."""
        columns = self._of(self._needed, rows)
        return np.column_stack([columns[name] for name in self._chosen]).astype(float, copy=False)

    def where(self, row: int) -> str:
        """File and index."""
        return f"{self.path}, row {row} (counted from 0)"

    def columns(self, rows: slice = ALL) -> dict[str, Any]:
        """Arrays."""
        return self._of(list(self._labels), rows)

    def _of(self, names: Sequence[str], rows: slice) -> dict[str, np.ndarray]:
        """The columns of some fields."""
        found, some = {}, self._rows[rows]
        for name in names:
            flat = (some[name] if name else some).reshape(len(some), len(self._labels[name]))
            found |= zip(self._labels[name], flat.T, strict=True)
        return found


class NpyWriter:
    """Writes the columns of a table, and those of the answers, as fields of one array: they are collected on the disk
    first, for how long a text may be is known at the end."""

    def __init__(self, file: BinaryIO, table: Table, names: Sequence[str]) -> None:
        """Nothing is written yet. Raises `OptionError` for names that the head of such a file cannot hold."""
        self._file, self._table = file, table
        for name in (*table.names, *names):
            if not name or not name.isascii():
                raise OptionError(f".npy takes names of columns in ASCII letters alone, not {name!r}")
        self._spools = {name: Spool() for name in (*table.names, *names)}

    def write(self, rows: slice, answers: Mapping[str, np.ndarray]) -> None:
        """Some rows, and their answers. Raises `OSError`."""
        for name, values in (self._table.columns(rows) | dict(answers)).items():
            self._spools[name].append(without_objects(values))

    def close(self) -> None:
        """Write the array. Raises `OSError`."""
        dtype = np.dtype([(name, spool.dtype) for name, spool in self._spools.items()])
        total = len(next(iter(self._spools.values())))
        head = {"descr": np.lib.format.dtype_to_descr(dtype), "fortran_order": False, "shape": (total,)}
        np.lib.format.write_array_header_2_0(self._file, head)
        columns = {name: _Column(spool) for name, spool in self._spools.items()}
        for first in range(0, total, ROWS):
            block = np.empty(min(ROWS, total - first), dtype=dtype)
            for name, column in columns.items():
                block[name] = column.take(len(block))
            self._file.write(block.tobytes())


class _Column:
    """A column, read from its beginning on."""

    def __init__(self, spool: Spool) -> None:
        self._parts, self._at = spool.rows(), 0

    def take(self, count: int) -> np.ndarray:
        """The next rows. Raises `OSError`."""
        found = []
        while count:
            part = self._parts[0]
            end = min(self._at + count, len(part))
            found.append(part[self._at : end])
            count, self._at = count - (end - self._at), end
            if end == len(part):
                self._parts, self._at = self._parts[1:], 0
        return np.concatenate(found)


def write_npy(file: BinaryIO, table: Table, answers: Mapping[str, np.ndarray]) -> None:
    """The columns of a table, and those of the answers. Raises `OSError`, `OptionError`."""
    writer = NpyWriter(file, table, list(answers))
    writer.write(ALL, answers)
    writer.close()


def _open(path: Path) -> Any:
    """The array of a file, its rows on the disk. Raises `PoseError`."""
    with open_regular(path, "the array", PoseError, LARGEST_FILE) as file:
        try:
            version = np.lib.format.read_magic(file)
            read = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
            shape, in_columns, dtype = read(file)
            begin, size = file.tell(), dtype.itemsize * math.prod(shape)
            left = file.seek(0, 2) - begin
            if dtype.hasobject:
                raise ValueError("it holds Python's objects")
            if not shape or size != left:
                raise ValueError(f"it holds {left} bytes, not the {size} of its shape {shape}")
            if not in_columns:
                return DiskRows(file.fileno(), begin, dtype, shape)
            if size > LARGEST_TABLE:
                raise ValueError(f"in the order of columns at most {LARGEST_TABLE} bytes are read, not {size}")
            file.seek(begin)
            return np.frombuffer(file.read(), dtype=dtype).reshape(shape[::-1]).T
        except UNREADABLE as reason:
            raise PoseError(f"{path} cannot be read as an array: {one_line(reason)}") from None
