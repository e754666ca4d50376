"""Rows that stay on the disk: arrays larger than memory, read in pieces, and written one piece after another."""

from __future__ import annotations

import os
import tempfile
import weakref
from typing import Any

import numpy as np

LARGEST_READ = 2**30
"""Bytes that are asked of the system at a time."""


class DiskRows:
    """An array (N, ...) that begins at a place of a file, in C order. A slice of it is read when it is asked for."""

    def __init__(self, descriptor: int, offset: int, dtype: np.dtype, shape: tuple[int, ...]) -> None:
        """The file is kept open, by a descriptor of its own."""
        self.dtype, self.shape = dtype, shape
        self._offset, self._descriptor = offset, os.dup(descriptor)
        self._row = dtype.itemsize * int(np.prod(shape[1:], dtype=np.int64))
        weakref.finalize(self, os.close, self._descriptor)

    def __len__(self) -> int:
        return self.shape[0]

    @property
    def ndim(self) -> int:
        """How many dimensions."""
        return len(self.shape)

    def __getitem__(self, rows: slice) -> np.ndarray:
        """The rows of a slice without a step, a new array. Raises `OSError` where the file has become shorter."""
        begin, end, _ = rows.indices(len(self))
        count = max(0, end - begin)
        content = read_exactly(self._descriptor, self._offset + begin * self._row, count * self._row)
        return np.frombuffer(content, dtype=self.dtype).reshape(count, *self.shape[1:])

    def seen_as(self, dtype: np.dtype, shape: tuple[int, ...]) -> DiskRows:
        """The same bytes as an array of another kind."""
        return DiskRows(self._descriptor, self._offset, dtype, shape)


class Spool:
    """Rows that are collected on the disk, in a file that has no name and is gone with the process."""

    def __init__(self) -> None:
        self._file = tempfile.TemporaryFile()  # noqa: SIM115, it is open as long as this is
        self._parts: list[tuple[np.dtype, tuple[int, ...]]] = []
        weakref.finalize(self, self._file.close)

    def __len__(self) -> int:
        return sum(shape[0] for _, shape in self._parts)

    def append(self, rows: np.ndarray) -> None:
        """Rows (K, ...) after those that are there, of numbers or of text of any length. Raises `OSError`."""
        self._file.write(np.ascontiguousarray(rows).tobytes())
        dtype, shape = rows.dtype, rows.shape
        if self._parts and self._parts[-1][0] == dtype and self._parts[-1][1][1:] == shape[1:]:
            shape = (self._parts.pop()[1][0] + shape[0], *shape[1:])
        self._parts.append((dtype, shape))

    @property
    def dtype(self) -> np.dtype:
        """One for all rows."""
        return np.result_type(*(dtype for dtype, _ in self._parts))

    def rows(self) -> list[DiskRows]:
        """All rows, in arrays of one kind each, to be read. Raises `OSError`."""
        self._file.flush()
        found, offset = [], 0
        for dtype, shape in self._parts:
            found.append(DiskRows(self._file.fileno(), offset, dtype, shape))
            offset += dtype.itemsize * int(np.prod(shape, dtype=np.int64))
        return found


def spooled(parts: Any, dtype: np.dtype, width: tuple[int, ...]) -> DiskRows:
    """Arrays (K, ...) of one kind, one after another, as one array. Raises `OSError`."""
    spool = Spool()
    spool.append(np.empty((0, *width), dtype=dtype))
    for part in parts:
        spool.append(np.asarray(part, dtype=dtype))
    return spool.rows()[0]


def read_exactly(descriptor: int, begin: int, count: int) -> bytes:
    """So many bytes of a file, from a place on. Raises `OSError` where it ends before."""
    parts = []
    while count:
        part = os.pread(descriptor, min(count, LARGEST_READ), begin)
        if not part:
            raise OSError("a file has become shorter while it was read")
        parts.append(part)
        begin, count = begin + len(part), count - len(part)
    return parts[0] if len(parts) == 1 else b"".join(parts)
