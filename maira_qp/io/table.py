"""What a file of any format is to the rest: rows with named columns."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

Choose = Callable[[Sequence[str]], Sequence[str]]
"""From the names of all columns, the names of those that must hold numbers. May raise `PoseError`."""

ALL = slice(None)


class Table(ABC):
    """A file that was looked through; its rows stay where they are until they are asked for."""

    path: Path
    names: Sequence[str]
    """Of its columns, in their order."""

    @abstractmethod
    def __len__(self) -> int: ...

    @abstractmethod
    def numbers(self, rows: slice = ALL) -> np.ndarray:
        """The columns (M, k) that were chosen, of some rows, NaN where a cell is empty."""

    @abstractmethod
    def where(self, row: int) -> str:
        """The file and the place of a row in it, for a person."""

    @abstractmethod
    def columns(self, rows: slice = ALL) -> dict[str, Any]:
        """All columns by name, each an array or a list, of some rows."""


class ColumnTable(Table):
    """Columns (N,) in memory, by name."""

    def __init__(self, columns: Mapping[str, np.ndarray]) -> None:
        """All of them are of one length."""
        self._columns = columns
        self.names = list(columns)

    def __len__(self) -> int:
        return len(next(iter(self._columns.values()), ()))

    def numbers(self, rows: slice = ALL) -> np.ndarray:
        """None was chosen."""
        return np.empty((len(range(*rows.indices(len(self)))), 0))

    def where(self, row: int) -> str:
        """Its index."""
        return f"row {row} (counted from 0)"

    def columns(self, rows: slice = ALL) -> dict[str, Any]:
        """Views of the arrays."""
        return {name: column[rows] for name, column in self._columns.items()}


def one_line(reason: BaseException) -> str:
    """What a library says, on one line."""
    return " ".join(str(reason).split())
