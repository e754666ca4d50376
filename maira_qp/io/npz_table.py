"""NumPy's archives: `targets` (N, 4, 4), if you like `q0` (N, n), and further arrays, which are carried along."""

from __future__ import annotations

import itertools
import math
import zipfile
import zlib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from maira_qp.errors import PoseError
from maira_qp.io.columns import LAST_ROW, MATRIX, START
from maira_qp.io.disk_rows import DiskRows, Spool, read_exactly, spooled
from maira_qp.io.table import ALL, Choose, Table, one_line
from maira_qp.regular_files import LARGEST_FILE, LARGEST_TABLE, open_regular

PIECE = 2**20
"""Bytes that are read at a time."""
ROWS = 20_000
"""Rows that are copied at a time."""
UNREADABLE = (ValueError, EOFError, KeyError, OSError, RuntimeError, MemoryError, zipfile.BadZipFile, zlib.error)
"""What NumPy and zipfile raise for an archive that is damaged, encrypted, or packed in a way unknown to them."""


class NpzTable(Table):
    """An archive, looked through. Its columns are the entries of a row: m00 to m33, q0_<joint>, and those of other
    arrays."""

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
            check_numbers(self.arrays[name], shape, f"{path}: array {name!r}")
        self._count = len(self.arrays[poses])
        rows = {name: array for name, array in self.arrays.items() if array.shape[:1] == (self._count,)}
        self.left_out = [name for name in self.arrays if name not in rows]
        """Arrays without an entry for each row: no columns, and so not in a file of another format."""
        self._labels = {name: labels.get(name) or labels_of(name, array.shape) for name, array in rows.items()}
        self.names = [label for each in self._labels.values() for label in each]
        self._chosen = tuple(choose(self.names))

    def __len__(self) -> int:
        return self._count

    def numbers(self, rows: slice = ALL) -> np.ndarray:
        """See `Table.numbers`."""
        needed = [name for name, each in self._labels.items() if not set(each).isdisjoint(self._chosen)]
        columns = self._of(needed, rows)
        return np.column_stack([columns[name] for name in self._chosen]).astype(float, copy=False)

    def where(self, row: int) -> str:
        """File and index."""
        return f"{self.path}, target {row} (counted from 0)"

    def columns(self, rows: slice = ALL) -> dict[str, Any]:
        """Arrays."""
        return self._of(list(self._labels), rows)

    def _of(self, names: Sequence[str], rows: slice) -> dict[str, np.ndarray]:
        """The columns of some arrays."""
        found = {}
        for name in names:
            some = self.arrays[name][rows]
            flat = some.reshape(len(some), len(self._labels[name]))
            found |= zip(self._labels[name], flat.T, strict=True)
        return found


class NpzWriter:
    """Writes the arrays or columns of a table, and those of the answers: they are collected on the disk first, for an
    archive has one after another."""

    def __init__(self, file: BinaryIO, table: Table, names: Sequence[str]) -> None:
        """Nothing is written yet."""
        self._file, self._table, self._done = file, table, 0
        self._whole = table.arrays if isinstance(table, NpzTable) else {}
        asked = [] if isinstance(table, NpzTable) else table.names
        self._spools = {name: Spool() for name in (*asked, *names)}

    def write(self, rows: slice, answers: Mapping[str, np.ndarray]) -> None:
        """Some rows, and their answers. Raises `OSError`."""
        asked = {} if isinstance(self._table, NpzTable) else self._table.columns(rows)
        self._done = rows.indices(len(self._table))[1]
        for name, values in itertools.chain(asked.items(), answers.items()):
            self._spools[name].append(without_objects(values))

    def close(self, extra: Mapping[str, np.ndarray] | None = None) -> None:
        """Write the archive, with further arrays. Raises `OSError`."""
        with zipfile.ZipFile(self._file, "w", zipfile.ZIP_STORED) as archive:
            for name, array in self._whole.items():
                is_column = array.shape[:1] == (len(self._table),)
                _write_array(archive, name, [array], self._done if is_column else None)
            for name, spool in self._spools.items():
                _write_array(archive, name, spool.rows(), None, spool.dtype)
            for name, array in (extra or {}).items():
                _write_array(archive, name, [without_objects(array)], None)


def write_npz(file: BinaryIO, table: Table, answers: Mapping[str, np.ndarray]) -> None:
    """The arrays or columns of a table, and those of the answers. Raises `OSError`."""
    writer = NpzWriter(file, table, ())
    writer.write(ALL, {})
    writer.close(answers)


def _write_array(
    archive: zipfile.ZipFile, name: str, parts: Sequence[Any], count: int | None, dtype: np.dtype | None = None
) -> None:
    """An entry from arrays one after another, or from the first `count` rows. Raises `OSError`."""
    kind = parts[0].dtype if dtype is None else dtype
    rows = sum(len(part) for part in parts) if parts[0].ndim and count is None else count
    shape = parts[0].shape if rows is None else (rows, *parts[0].shape[1:])
    header = {"descr": np.lib.format.dtype_to_descr(kind), "fortran_order": False, "shape": shape}
    with archive.open(f"{name}.npy", "w", force_zip64=True) as entry:
        np.lib.format.write_array_header_1_0(entry, header)
        for part in parts:
            if not part.ndim:
                entry.write(np.ascontiguousarray(part).tobytes())
                continue
            end = len(part) if count is None else min(count, len(part))
            for first in range(0, end, ROWS):
                entry.write(np.ascontiguousarray(part[first : min(first + ROWS, end)], dtype=kind).tobytes())


def _load(path: Path) -> dict[str, Any]:
    """The arrays of an archive, those with a dimension as rows on the disk. Raises `PoseError`."""
    with open_regular(path, "the archive", PoseError, LARGEST_FILE) as file:
        if not zipfile.is_zipfile(file):
            raise PoseError(f"{path} is no archive of arrays, or not the whole of one")
        file.seek(0)
        try:
            with zipfile.ZipFile(file) as archive:
                packed = [entry for entry in archive.infolist() if entry.compress_type != zipfile.ZIP_STORED]
                unpacked = sum(entry.file_size for entry in packed)
                if unpacked > LARGEST_TABLE:
                    raise PoseError(
                        f"{path} unpacks to {unpacked} bytes, more than the {LARGEST_TABLE} that are read; "
                        "np.savez in place of np.savez_compressed has no such limit"
                    )
                return {
                    entry.filename.removesuffix(".npy"): _array(archive, entry, file)
                    for entry in archive.infolist()
                    if entry.filename.endswith(".npy")
                }
        except PoseError:
            raise
        except UNREADABLE as reason:
            raise PoseError(f"{path} cannot be read as an archive of arrays: {one_line(reason)}") from None


def _array(archive: zipfile.ZipFile, entry: zipfile.ZipInfo, file: BinaryIO) -> Any:
    """An entry, in place where it is not packed; read whole once, which checks it. Raises what `UNREADABLE` lists."""
    with archive.open(entry) as stream:
        version = np.lib.format.read_magic(stream)
        read = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
        shape, in_columns, dtype = read(stream)
        if dtype.hasobject:
            raise ValueError("Object arrays cannot be loaded when allow_pickle=False")
        begin, size = stream.tell(), dtype.itemsize * math.prod(shape)
        if size != entry.file_size - begin:
            raise ValueError(f"{entry.filename} holds {entry.file_size - begin} bytes, not the {size} of its header")
        if in_columns or not shape:
            array = np.frombuffer(stream.read(), dtype=dtype)
            return array.reshape(shape[::-1]).T if in_columns else array.reshape(shape)
        if entry.compress_type == zipfile.ZIP_STORED and not entry.flag_bits & 1:
            while stream.read(PIECE):
                pass
            return DiskRows(file.fileno(), _place(file, entry) + begin, dtype, shape)
        bytes_of = iter(lambda: stream.read(PIECE), b"")
        found = spooled((np.frombuffer(piece, np.uint8) for piece in bytes_of), np.dtype(np.uint8), ())
        return found.seen_as(dtype, shape)


def _place(file: BinaryIO, entry: zipfile.ZipInfo) -> int:
    """Where the content of an entry begins: behind its own header, whose length the entry does not know."""
    header = read_exactly(file.fileno(), entry.header_offset, 30)
    return entry.header_offset + 30 + int.from_bytes(header[26:28], "little") + int.from_bytes(header[28:30], "little")


def check_numbers(array: Any, shape: tuple[int | None, ...], name: str) -> None:
    """Shape and kind; what the numbers are is the matter of each row."""
    fits = array.ndim == len(shape) and all(n in (None, m) for n, m in zip(shape, array.shape, strict=True))
    if not fits or array.dtype.kind not in "iuf":
        wanted = ", ".join("N" if n is None else str(n) for n in shape)
        raise PoseError(f"{name} must hold numbers ({wanted}), not {array.dtype.name} {array.shape}")


def labels_of(name: str, shape: tuple[int, ...]) -> Sequence[str]:
    """The names of the columns that an array (N, ...) makes."""
    if len(shape) == 1:
        return [name]
    return ["_".join([name, *map(str, place)]) for place in itertools.product(*map(range, shape[1:]))]


def without_objects(values: Any) -> np.ndarray:
    """Values as an array that needs no pickle: numbers, NaN where there is none, or else text."""
    if isinstance(values, np.ma.MaskedArray):
        return values.astype(float).filled(np.nan)
    if isinstance(values, np.ndarray) and values.dtype.kind != "O":
        return values
    kinds = {type(value) for value in values}
    if kinds & {int, float} and kinds <= {int, float, type(None)}:
        return np.array(values, dtype=float)
    return np.array(["" if value is None else str(value) for value in values], dtype=str)
