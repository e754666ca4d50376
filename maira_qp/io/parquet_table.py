"""Parquet, by pyarrow, with the column names of a CSV file; the types of all columns are kept."""

from __future__ import annotations

import importlib.util
from collections.abc import Mapping
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from maira_qp.errors import OptionError, PoseError
from maira_qp.io.table import ALL, Choose, Table, one_line
from maira_qp.regular_files import LARGEST_TABLE, open_regular


def check_pyarrow() -> None:
    """Whether Parquet can be read and written. Raises `OptionError`."""
    if importlib.util.find_spec("pyarrow") is None:
        raise OptionError("Parquet needs pyarrow: install maira-qp[parquet]")


class ParquetTable(Table):
    """A Parquet file in memory."""

    def __init__(self, path: Path, choose: Choose) -> None:
        """Reads a file. Raises `PoseError` for what is no Parquet and for columns without numbers."""
        import pyarrow as pa
        from pyarrow import parquet

        self.path = path
        with open_regular(path, "the table", PoseError, LARGEST_TABLE) as file:
            try:
                stored = parquet.ParquetFile(file)
                unpacked = _unpacked(stored.metadata)
                if unpacked > LARGEST_TABLE:
                    raise PoseError(f"{path} unpacks to {unpacked} bytes, more than the {LARGEST_TABLE} that are read")
                self.table = stored.read()
            except PoseError:
                raise
            except (pa.ArrowException, OSError, ValueError) as reason:
                raise PoseError(f"{path} cannot be read as Parquet: {one_line(reason)}") from None
        self.names = [name.strip() for name in self.table.column_names]
        chosen = choose(self.names)
        self.numbers = np.empty((self.table.num_rows, len(chosen)))
        for number, name in enumerate(chosen):
            column = self.table.column(self.names.index(name))
            if not _numeric(column.type):
                raise PoseError(f"{path}: column {name!r} must hold numbers, not {column.type}")
            self.numbers[:, number] = column.cast(pa.float64(), safe=False).to_numpy()

    def where(self, row: int) -> str:
        """File and index."""
        return f"{self.path}, row {row} (counted from 0)"

    def columns(self, rows: slice = ALL) -> dict[str, Any]:
        """Arrays of numbers where no cell is empty, else lists of Python's values, None for an empty cell."""
        begin, end, _ = rows.indices(len(self))
        return {
            name: _values(column.slice(begin, end - begin))
            for name, column in zip(self.names, self.table.columns, strict=True)
        }


def write_parquet(file: BinaryIO, table: Table, answers: Mapping[str, np.ndarray]) -> None:
    """The columns of a table, and those of the answers. Raises `OSError`."""
    import pyarrow as pa
    from pyarrow import parquet

    whole = table.table if isinstance(table, ParquetTable) else _arrow(table.columns())
    for name, values in answers.items():
        mask = values.mask if isinstance(values, np.ma.MaskedArray) else None
        text = pa.string() if values.dtype.kind == "O" else None
        whole = whole.append_column(name, pa.array(np.asarray(values), text, mask=mask))
    parquet.write_table(whole, file)


def _arrow(columns: Mapping[str, Any]) -> Any:
    import pyarrow as pa

    arrays = {}
    for name, values in columns.items():
        try:
            arrays[name] = pa.array(values)
        except pa.ArrowException as reason:
            raise PoseError(f"column {name!r} cannot be written as Parquet: {one_line(reason)}") from None
    return pa.table(arrays)


def _unpacked(metadata: Any) -> int:
    """How many bytes a table takes in memory, at the least."""
    groups = (metadata.row_group(i).total_byte_size for i in range(metadata.num_row_groups))
    return max(sum(groups), 8 * metadata.num_rows * metadata.num_columns)


def _numeric(kind: Any) -> bool:
    from pyarrow import types

    return types.is_floating(kind) or types.is_integer(kind) or types.is_decimal(kind)


def _values(column: Any) -> Any:
    import pyarrow as pa
    from pyarrow import types

    plain = types.is_floating(column.type) or types.is_integer(column.type) or types.is_boolean(column.type)
    if plain and not column.null_count:
        return column.to_numpy()
    return (column.cast(pa.string()) if types.is_temporal(column.type) else column).to_pylist()
