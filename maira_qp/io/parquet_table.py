"""Parquet, by pyarrow, with the column names of a CSV file; the types of all columns are kept."""

from __future__ import annotations

import importlib.util
import weakref
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from maira_qp.errors import OptionError, PoseError
from maira_qp.io.table import ALL, Choose, Table, one_line
from maira_qp.regular_files import LARGEST_FILE, LARGEST_TABLE, open_regular

LEAST = 10_000
"""Rows of a group that is written, but for the last one."""


def check_pyarrow() -> None:
    """Whether Parquet can be read and written. Raises `OptionError`."""
    if importlib.util.find_spec("pyarrow") is None:
        raise OptionError("Parquet needs pyarrow: install maira-qp[parquet]")


class ParquetTable(Table):
    """A Parquet file, of which one group of rows is in memory at a time."""

    def __init__(self, path: Path, choose: Choose) -> None:
        """Looks through a file. Raises `PoseError` for what is no Parquet and for columns without numbers."""
        import pyarrow as pa
        from pyarrow import parquet

        self.path = path
        self._file = open_regular(path, "the table", PoseError, LARGEST_FILE)
        weakref.finalize(self, self._file.close)
        try:
            self._stored = parquet.ParquetFile(self._file)
        except (pa.ArrowException, OSError, ValueError) as reason:
            raise PoseError(f"{path} cannot be read as Parquet: {one_line(reason)}") from None
        metadata = self._stored.metadata
        for k in range(metadata.num_row_groups):
            unpacked = _unpacked(metadata.row_group(k))
            if unpacked > LARGEST_TABLE:
                raise PoseError(
                    f"{path}: a group of rows unpacks to {unpacked} bytes, more than the {LARGEST_TABLE} that are read"
                )
        self._ends = np.cumsum([0, *(metadata.row_group(k).num_rows for k in range(metadata.num_row_groups))])
        self._kept: tuple[int, Any] = -1, None
        self.schema = self._stored.schema_arrow
        self.names = [name.strip() for name in self.schema.names]
        self._chosen = [self.names.index(name) for name in choose(self.names)]
        for k in self._chosen:
            if not _numeric(self.schema.field(k).type):
                kind = self.schema.field(k).type
                raise PoseError(f"{path}: column {self.names[k]!r} must hold numbers, not {kind}")

    def __len__(self) -> int:
        return int(self._ends[-1])

    def table(self, rows: slice = ALL) -> Any:
        """Some rows, as pyarrow has them. Raises `PoseError` where they are damaged."""
        import pyarrow as pa

        begin, end, _ = rows.indices(len(self))
        parts = [self.schema.empty_table()]
        for k in range(int(np.searchsorted(self._ends, begin, side="right")) - 1, len(self._ends) - 1):
            first = int(self._ends[k])
            if first >= end:
                break
            part = self._group(k)
            parts.append(part.slice(max(0, begin - first), min(end, int(self._ends[k + 1])) - max(begin, first)))
        return pa.concat_tables(parts)

    def _group(self, k: int) -> Any:
        import pyarrow as pa

        if self._kept[0] != k:
            self._kept = -1, None
            try:
                self._kept = k, self._stored.read_row_group(k)
            except (pa.ArrowException, OSError, ValueError) as reason:
                raise PoseError(f"{self.path} cannot be read as Parquet: {one_line(reason)}") from None
        return self._kept[1]

    def numbers(self, rows: slice = ALL) -> np.ndarray:
        """See `Table.numbers`."""
        import pyarrow as pa

        table = self.table(rows)
        numbers = np.empty((table.num_rows, len(self._chosen)))
        for i, k in enumerate(self._chosen):
            numbers[:, i] = table.column(k).cast(pa.float64(), safe=False).to_numpy()
        return numbers

    def where(self, row: int) -> str:
        """File and index."""
        return f"{self.path}, row {row} (counted from 0)"

    def columns(self, rows: slice = ALL) -> dict[str, Any]:
        """Arrays of numbers, masked where a cell is empty, else lists of Python's values, None for an empty cell."""
        return {name: _values(column) for name, column in zip(self.names, self.table(rows).columns, strict=True)}


class ParquetWriter:
    """Writes the columns of a table, and those of the answers, in groups of rows that are not small."""

    def __init__(self, file: BinaryIO, table: Table, names: Sequence[str]) -> None:
        """Nothing is written before the first block, which says what the columns are."""
        self._file, self._table, self._writer = file, table, None
        self._waiting: list[Any] = []

    def write(self, rows: slice, answers: Mapping[str, np.ndarray]) -> None:
        """Some rows, and their answers. Raises `OSError`, `PoseError`."""
        import pyarrow as pa
        from pyarrow import parquet

        table = self._table
        whole = table.table(rows) if isinstance(table, ParquetTable) else _arrow(table.columns(rows))
        for name, values in answers.items():
            mask = np.ma.getmaskarray(values) if isinstance(values, np.ma.MaskedArray) else None
            text = pa.string() if values.dtype.kind == "O" else None
            whole = whole.append_column(name, pa.array(np.asarray(values), text, mask=mask))
        if self._writer is None:
            self._writer = parquet.ParquetWriter(self._file, whole.schema)
        self._waiting.append(whole)
        if sum(part.num_rows for part in self._waiting) >= LEAST:
            self._write_waiting()

    def close(self) -> None:
        """Write the end of the file. Raises `OSError`."""
        if self._writer is not None:
            self._write_waiting()
            self._writer.close()

    def _write_waiting(self) -> None:
        import pyarrow as pa

        if self._waiting and self._writer is not None:
            self._writer.write_table(pa.concat_tables(self._waiting))
        self._waiting = []


def write_parquet(file: BinaryIO, table: Table, answers: Mapping[str, np.ndarray]) -> None:
    """The columns of a table, and those of the answers. Raises `OSError`."""
    writer = ParquetWriter(file, table, list(answers))
    writer.write(ALL, answers)
    writer.close()


def _arrow(columns: Mapping[str, Any]) -> Any:
    import pyarrow as pa

    arrays = {}
    for name, values in columns.items():
        try:
            mask = np.ma.getmaskarray(values) if isinstance(values, np.ma.MaskedArray) else None
            arrays[name] = pa.array(np.asarray(values) if mask is not None else values, mask=mask)
        except pa.ArrowException as reason:
            raise PoseError(f"column {name!r} cannot be written as Parquet: {one_line(reason)}") from None
    return pa.table(arrays)


def _unpacked(group: Any) -> int:
    """How many bytes a group of rows takes in memory, at the least."""
    return max(group.total_byte_size, 8 * group.num_rows * group.num_columns)


def _numeric(kind: Any) -> bool:
    from pyarrow import types

    return types.is_floating(kind) or types.is_integer(kind) or types.is_decimal(kind)


def _values(column: Any) -> Any:
    import pyarrow as pa
    from pyarrow import types

    if types.is_floating(column.type) or types.is_integer(column.type) or types.is_boolean(column.type):
        if not column.null_count:
            return column.to_numpy()
        if not types.is_boolean(column.type):
            gone = column.is_null().to_numpy()
            return np.ma.masked_array(column.fill_null(0).to_numpy(), mask=gone)
    return (column.cast(pa.string()) if types.is_temporal(column.type) else column).to_pylist()
