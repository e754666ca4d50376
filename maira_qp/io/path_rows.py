"""Many paths in one table, told apart by a column, and the answers to each behind its rows."""

from __future__ import annotations

from array import array
from collections.abc import Sequence
from typing import Any, BinaryIO

import numpy as np

from maira_qp.errors import PoseError, listed
from maira_qp.io.answers import WRITERS, Names
from maira_qp.io.poses import blocks
from maira_qp.io.save import TableUnits, about_joints, flat_columns, in_units
from maira_qp.io.table import Table
from maira_qp.results.path_solution import PathSolution

ANSWERS = ("success", "reconfiguration", "position_error", "orientation_error")
"""Of each pose, before the joint values"""


class PathRows(Sequence[slice]):
    """The rows of each path of a table: those that follow one another with the same value in a column."""

    def __init__(self, table: Table, column: str) -> None:
        """Looks through the column. Raises `PoseError` where a cell is empty, and for a path that begins twice."""
        if column not in table.names:
            raise PoseError(
                f"{table.path} has no column {column!r} that tells paths apart; {listed(table.names, column)}"
            )
        self._table, self._column = table, column
        self._ends, seen, last = array("q", [0]), set[Any](), object()
        for rows in blocks(len(table)):
            for row, value in enumerate(_plain(table.columns(rows)[column]), rows.start):
                if value == last:
                    continue
                if value is None or value == "" or value != value:
                    raise PoseError(f"{table.where(row)}: the cell of {column!r}, which tells paths apart, is empty")
                if value in seen:
                    where = table.where(row)
                    raise PoseError(f"{where}: path {value!r} begins anew; the rows of a path follow one another")
                seen.add(value)
                last = value
                if row:
                    self._ends.append(row)
        if len(table):
            self._ends.append(len(table))

    def __len__(self) -> int:
        return len(self._ends) - 1

    def __getitem__(self, k: Any) -> Any:
        """The rows of a path; of a slice, a list of them."""
        if isinstance(k, slice):
            return [self[i] for i in range(*k.indices(len(self)))]
        if not -len(self) <= k < len(self):
            raise IndexError(k)
        k %= len(self)
        return slice(self._ends[k], self._ends[k + 1])

    def name(self, k: int) -> Any:
        """What the column says of a path."""
        return _plain(self._table.columns(slice(self[k].start, self[k].start + 1))[self._column])[0]


def _plain(values: Any) -> Sequence[Any]:
    """A column as values of Python's, None where a cell is empty."""
    return values.tolist() if isinstance(values, np.ndarray) else values


def names_of(joint_names: Sequence[str], slides: Sequence[bool], units: TableUnits) -> Names:
    """The names of the answers in a file, q as a whole array or a column a joint, with their units in columns."""
    joints = [units.heading(f"q_{name}", slide) for name, slide in zip(joint_names, slides, strict=True)]
    errors = units.heading("position_error", True), units.heading("orientation_error", False)
    return lambda whole: (*ANSWERS, "q", "q_units", "joint_names") if whole else (*ANSWERS[:2], *errors, *joints)


class PathWriter:
    """Writes the answers to paths behind the rows that asked for them, one path after another."""

    def __init__(self, file: BinaryIO, suffix: str, table: Table, names: Names, units: TableUnits) -> None:
        """In the format of files that end in `suffix`. Raises `OSError`."""
        self._is_archive, self._units = suffix == ".npz", units
        names_here = names(self._is_archive)
        self._writer = WRITERS[suffix](file, table, names_here[:-2] if self._is_archive else names_here)
        self._last: PathSolution | None = None
        self.done = 0
        """Rows that are written"""

    def write(self, rows: slice, answers: PathSolution) -> None:
        """The rows of a path, and the answer to them. Raises `OSError`, `PoseError`."""
        found = in_units(answers, self._units) if self._is_archive else flat_columns(answers, self._units)
        self._writer.write(rows, {name: values for name, values in found.items() if name not in ("pose", "time")})
        self._last, self.done = answers, self.done + len(answers)

    def close(self) -> None:
        """Write what comes after the last row. Raises `OSError`."""
        if not self._is_archive:
            self._writer.close()
        elif self._last is not None:
            self._writer.close(about_joints(self._last, self._units))
