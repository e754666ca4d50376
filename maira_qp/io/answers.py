"""The answers to a file's poses: named columns, and how they get into a file behind what was asked."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, BinaryIO, Protocol

import numpy as np

from maira_qp.errors import OptionError
from maira_qp.io.atomic_write import replacing
from maira_qp.io.csv_table import CsvWriter
from maira_qp.io.npy_table import NpyWriter
from maira_qp.io.npz_table import NpzTable, NpzWriter
from maira_qp.io.parquet_table import ParquetWriter
from maira_qp.io.poses import check_format
from maira_qp.io.table import Table
from maira_qp.results.answer import unknown_errors
from maira_qp.results.batch import BatchSolution
from maira_qp.results.status import Status

NUMBERS = ("position_error", "orientation_error", "iterations", "restarts", "condition_number")
STAYING = ("left_q0", "max_joint_change")
COLUMNS = ("success", "status", *NUMBERS, *STAYING, "active_limits")
REMARKS = ("optimal", "start_projected")
"""Fields of a batch that are summed up and not written."""
Answered = tuple[slice, Mapping[str, np.ndarray]]
"""Some rows of a table, and the answers to them."""
Names = Callable[[bool], Sequence[str]]
"""The names of answers, in an archive (True) or as columns (False)."""
WRITERS = {".csv": CsvWriter, ".npy": NpyWriter, ".npz": NpzWriter, ".parquet": ParquetWriter}
"""By the end of a file's name."""


def columns(batch: BatchSolution) -> dict[str, np.ndarray]:
    """The answers of a batch as `COLUMNS` and `REMARKS` (N,), and q (N, n) [rad or m]; text as objects."""
    limits = np.empty(len(batch), dtype=object)
    limits[:] = [sys.intern(";".join(each)) for each in batch.active_limits]  # a few texts, many times
    found = {"success": batch.success, "status": batch.status_names.astype(object)}
    fields = {name: getattr(batch, name) for name in (*NUMBERS, *STAYING, *REMARKS)}
    fields |= {name: np.full(len(batch), np.nan) for name in unknown_errors(batch.left_free)}
    return found | fields | {"active_limits": limits, "q": batch.q}


class RowWriter(Protocol):
    """Writes answers behind the rows that asked for them, one block after another."""

    done: int
    """Rows that are written"""

    def write(self, rows: slice, answers: Any) -> None:
        """Some rows, and the answers to them. Raises `OSError`, `PoseError`."""

    def close(self) -> None:
        """Write what comes after the last row. Raises `OSError`."""


def check_output(path: Path, table: Table, names: Names) -> None:
    """Before a long run: whether the answers can go there, beside what was asked. Raises `OptionError`."""
    check_format(path)
    check_place(path, table)
    check_names(path.suffix.lower(), table, names)


def check_names(suffix: str, table: Table, names: Names) -> None:
    """Before a long run: whether the names of the answers are free in a file of that kind. Raises `OptionError`."""
    is_archive = suffix == ".npz"
    asked = table.arrays if is_archive and isinstance(table, NpzTable) else table.names
    for name in names(is_archive):
        if name in asked:
            raise OptionError(f"{table.path} has {name!r} already, which is a name of an answer; rename or remove it")


def check_place(path: Path, table: Table) -> None:
    """Before a long run: whether a file can be written there that is not that of the table. Raises `OptionError`."""
    folder = next(each for each in path.absolute().parents if each.exists())
    if path.exists() and not path.is_file():
        raise OptionError(f"{path} is no file that can be replaced")
    if not (folder.is_dir() and os.access(folder, os.W_OK)):
        raise OptionError(f"{path} cannot be written: {folder} is no folder that can be written to")
    if path.exists() and table.path.exists() and path.samefile(table.path):
        raise OptionError(f"{path} is the file of the poses; name another one with --output")


def write_answers(path: Path, answered: Iterable[tuple[slice, Any]], begin: Callable[[BinaryIO], RowWriter]) -> None:
    """Write a file: what a table holds, then the answers, as they come, by a writer that is begun there.

    It takes the place of `path` when it is whole; where Ctrl-C ends it before, the rows that were answered are in
    `partial(path)`. Raises `OSError`, `PoseError`, and `KeyboardInterrupt` as it was.
    """
    kept: list[Path] = []
    with replacing(path, interrupted=kept) as file:
        writer = begin(file)
        try:
            for rows, answers in answered:
                writer.write(rows, answers)
        except KeyboardInterrupt:
            if writer.done:
                writer.close()
                kept.append(partial(path))
            raise
        writer.close()


def partial(path: Path) -> Path:
    """Where the answers are that there were when a run was interrupted."""
    return path.with_suffix(f".partial{path.suffix}")


class AnswerWriter:
    """Writes answers behind the rows that asked for them, one block after another, to a file or a stream."""

    def __init__(self, file: BinaryIO, suffix: str, table: Table, joint_names: Sequence[str]) -> None:
        """In the format of files that end in `suffix`. Raises `OSError`."""
        self._is_archive, self._joints = suffix == ".npz", joint_names
        names = names_of(joint_names)(self._is_archive)
        self._writer = WRITERS[suffix](file, table, names[:-1] if self._is_archive else names)
        self._names = names
        self.done = 0
        """Rows that are written"""

    def write(self, rows: slice, answers: Mapping[str, np.ndarray]) -> None:
        """Some rows, and what `columns` says of them. Raises `OSError`, `PoseError`."""
        arrays = [answers[name] for name in COLUMNS]
        arrays += [answers["q"]] if self._is_archive else list(answers["q"].T)
        named = dict(zip(self._names, arrays, strict=False))
        if not self._is_archive:
            invalid = answers["status"] == Status.INVALID_TARGET.name
            named = {name: _known(array, invalid) for name, array in named.items()}
        self._writer.write(rows, named)
        self.done += len(answers["status"])

    def close(self) -> None:
        """Write what comes after the last row. Raises `OSError`."""
        if isinstance(self._writer, NpzWriter):
            self._writer.close({"joint_names": np.array(self._joints, dtype=str)})
        else:
            self._writer.close()


def _known(array: np.ndarray, invalid: np.ndarray) -> np.ndarray:
    """A column (N,) whose numbers are masked where there was nothing to answer, (N,), or they are NaN."""
    unknown = np.isnan(array) if array.dtype.kind == "f" else invalid
    return np.ma.masked_array(array, mask=unknown) if array.dtype.kind in "if" and unknown.any() else array


def left_out(path: Path, table: Table) -> Sequence[str]:
    """Arrays of an archive that have no place in a file of rows."""
    return table.left_out if isinstance(table, NpzTable) and path.suffix.lower() != ".npz" else ()


def names_of(joint_names: Sequence[str]) -> Names:
    """The names of the answers in a file, q as a whole array or a column a joint."""
    return lambda whole: (*COLUMNS, "q", "joint_names") if whole else (*COLUMNS, *(f"q_{j}" for j in joint_names))
