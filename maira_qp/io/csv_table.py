"""Comma-separated values: a header, then one pose per line.

Columns may be separated by semicolons or tabs instead, with decimals written with a comma, and the text may be UTF-8 or
UTF-16: what spreadsheets write in other countries. The file stays in memory as it is: an answer is written behind the
line that asked for it, in the same manner, so that every further column comes back unchanged.
"""

from __future__ import annotations

import codecs
import csv
import io
import itertools
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from operator import itemgetter
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from maira_qp.errors import PoseError
from maira_qp.io.table import ALL, Choose, Table
from maira_qp.regular_files import LARGEST_TABLE, read_regular

CHUNK = 2_000
"""So many rows are taken apart into cells at a time; more at a time are slower, and take memory."""
LINE_END = b"\n"
SEPARATORS = {",": "commas", ";": "semicolons", "\t": "tabs"}
OTHERS = {"|": "bars", " ": "blanks"}
"""What some people separate columns by, and is not taken."""


class CsvTable(Table):
    """A CSV file in memory, as its bytes."""

    def __init__(self, path: Path, choose: Choose, content: bytes | None = None) -> None:
        """Reads a file, or takes its content. Raises `PoseError`, naming the line, for what is not a table or not a
        number."""
        self.path = path
        content = read_regular(path, "the table", PoseError, LARGEST_TABLE) if content is None else content
        self._content = self._in_utf8(content)
        self.separator = self._separator()
        """Of columns: a comma, a semicolon or a tab."""
        self.decimal = "."
        """What decimals are written with: a point or a comma."""
        records = self._records()
        begin, end, cells = next(records, (0, 0, []))
        self.header = self._raw(begin, end)
        """As it is in the file."""
        self.names = self._named(cells)
        self._numeric = tuple(choose(self.names))
        place = [self.names.index(name) for name in self._numeric]
        spans = [np.empty((0, 2), dtype=np.int64)]
        numbers = [np.empty((0, len(place)))]
        while chunk := list(itertools.islice(records, CHUNK)):
            spans.append(np.array([each[:2] for each in chunk]))
            numbers.append(self._parsed(chunk, place))
        self._spans = np.concatenate(spans)
        """(N, 2) begin and end in the bytes"""
        self.numbers = np.concatenate(numbers)

    def where(self, row: int) -> str:
        """File and line."""
        return self._line(int(self._spans[row, 0]))

    def columns(self, rows: slice = ALL) -> dict[str, Any]:
        """Numbers where numbers were asked for, else text."""
        columns: dict[str, Any] = {name: [] for name in self.names}
        columns |= zip(self._numeric, self.numbers[rows].T, strict=True)
        text = [(i, columns[name]) for i, name in enumerate(self.names) if name not in self._numeric]
        begin, end, _ = rows.indices(len(self))
        for first in range(begin, end, CHUNK):
            rows_of_chunk = self.records(slice(first, min(first + CHUNK, end)))
            chunk = csv.reader(rows_of_chunk, delimiter=self.separator, skipinitialspace=True)
            cells = list(zip(*chunk, strict=True))
            for i, column in text:
                column.extend(cells[i])
        return columns

    def records(self, rows: slice = ALL) -> list[str]:
        """The rows as they are in the file, without the ends of their lines."""
        return [self._raw(begin, end) for begin, end in self._spans[rows].tolist()]

    def _raw(self, begin: int, end: int) -> str:
        return self._content[begin:end].rstrip(b"\r\n").decode()

    def _line(self, begin: int) -> str:
        return f"{self.path}, line {self._content.count(LINE_END, 0, begin) + 1}"

    def _in_utf8(self, content: bytes) -> bytes:
        """The text in UTF-8. Raises `PoseError` for text in UTF-16 that is broken off."""
        if not content.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
            return content
        try:
            return content.decode("utf-16").encode()
        except UnicodeDecodeError as reason:
            raise PoseError(f"{self.path} is not text in UTF-16: {reason}") from None

    def _separator(self) -> str:
        """What separates the names of columns: the sign that is there most often, outside quotes."""
        for line in io.BytesIO(self._content):
            unquoted = b"".join(line.split(b'"')[::2])
            if unquoted.strip():
                return max(SEPARATORS, key=lambda sign: unquoted.count(sign.encode()))
        return ","

    def _records(self) -> Iterator[tuple[int, int, list[str]]]:
        """Begin and end in the bytes, and the cells, of each row that is not blank; the header is the first."""
        begin = end = len(codecs.BOM_UTF8) if self._content.startswith(codecs.BOM_UTF8) else 0
        file = io.BytesIO(self._content)
        file.seek(begin)

        def lines() -> Iterator[str]:
            nonlocal end
            for line in file:
                text = line.decode()
                end += len(line)
                yield text

        try:
            for cells in csv.reader(lines(), delimiter=self.separator, skipinitialspace=True, strict=True):
                if len(cells) > 1 or (cells and cells[0].strip()):
                    yield begin, end, cells
                begin = end
        except UnicodeDecodeError as reason:
            raise PoseError(f"{self._line(end)} is not text in UTF-8: {reason}") from None
        except csv.Error as reason:
            raise PoseError(f"{self._line(begin)}: {reason}") from None

    def _named(self, cells: Sequence[str]) -> list[str]:
        names = [cell.strip() for cell in cells]
        if not names:
            raise PoseError(f"{self.path} is empty: a header that names the columns is needed")
        if len(names) == 1:
            for separator, word in OTHERS.items():
                if separator in names[0]:
                    known = f"{', '.join([*SEPARATORS.values()][:-1])} or {[*SEPARATORS.values()][-1]}"
                    raise PoseError(f"{self.path} is separated by {word}; columns are separated by {known}")
        if all(_is_number(name) for name in names):
            raise PoseError(f"{self.path}: a header that names the columns is needed; the first line holds numbers")
        return names

    def _parsed(self, chunk: Sequence[tuple[int, int, list[str]]], place: Sequence[int]) -> np.ndarray:
        """The numbers (rows, columns) of a chunk."""
        width = len(self.names)
        for begin, _, cells in chunk:
            if len(cells) != width:
                raise PoseError(f"{self._line(begin)} has {len(cells)} values for {width} columns ({self._manner})")
        chosen = list(itertools.chain.from_iterable(map(itemgetter(*place), map(itemgetter(2), chunk))))
        if self.separator != "," and any("," in cell for cell in chosen):
            self.decimal = ","
        try:
            values = list(map(float, map(self._with_point, chosen)))
            if "_" in "".join(chosen):
                raise ValueError("Python's 1_000 is no number in a table")
        except ValueError:
            values = [
                self._number(cell, chunk[i // len(place)][0], self.names[place[i % len(place)]])
                for i, cell in enumerate(chosen)
            ]
        return np.array(values).reshape(len(chunk), len(place))

    def _with_point(self, cell: str) -> str:
        """A number as Python writes it."""
        return cell if self.decimal == "." else cell.replace(",", ".")

    @property
    def _manner(self) -> str:
        """How numbers and columns are written, for a message."""
        if self.separator == ",":
            return "decimals are written with a point, columns are separated by commas"
        return f"columns are separated by {SEPARATORS[self.separator]}, thousands by nothing"

    def _number(self, cell: str, begin: int, column: str) -> float:
        if not cell.strip():
            return math.nan
        if not _is_number(self._with_point(cell)):
            hint = self._manner if "," in cell else "without a number, leave the cell empty"
            raise PoseError(f"{self._line(begin)}, column {column!r}: {cell!r:.40} is not a number ({hint})")
        return float(self._with_point(cell))


def write_csv(file: BinaryIO, table: Table, answers: Mapping[str, np.ndarray]) -> None:
    """The rows of a table, each with its answer behind it. Raises `OSError`."""
    separator, decimal = (table.separator, table.decimal) if isinstance(table, CsvTable) else (",", ".")
    header = table.header if isinstance(table, CsvTable) else ",".join(map(_quoted, table.names))
    file.write(separator.join([header, *(_quoted(name, separator) for name in answers)]).encode() + b"\n")
    for begin in range(0, len(table), CHUNK):
        rows = slice(begin, begin + CHUNK)
        if isinstance(table, CsvTable):
            asked = [table.records(rows)]
        else:
            asked = [_texts(column) for column in table.columns(rows).values()]
        answered = [_texts(column[rows], separator, decimal) for column in answers.values()]
        lines = map(separator.join, zip(*asked, *answered, strict=True))
        file.write("".join(f"{line}\n" for line in lines).encode())


def _texts(column: Any, separator: str = ",", decimal: str = ".") -> Iterable[str]:
    """Cells: numbers so that they read back exactly, true and false, text in quotes where it needs them."""
    number = repr if decimal == "." else lambda value: repr(value).replace(".", decimal)
    if isinstance(column, np.ma.MaskedArray):  # an empty cell where it is masked
        masked = np.ma.getmaskarray(column).tolist()
        return ["" if gone else number(value) for value, gone in zip(column.data.tolist(), masked, strict=True)]
    if isinstance(column, np.ndarray):
        if column.dtype.kind in "iuf":
            return map(number, column.tolist())
        column = column.tolist()
    if all(isinstance(value, str) for value in column):
        quoted = {text: _quoted(text, separator) for text in set(column)}
        return map(quoted.__getitem__, column)
    return (_cell(value, separator) for value in column)


def _cell(value: Any, separator: str) -> str:
    if value is None:
        return ""
    if isinstance(value, bool):
        return "true" if value else "false"
    return _quoted(value if isinstance(value, str) else str(value), separator)


def _quoted(text: str, separator: str = ",") -> str:
    needed = any(sign in text for sign in (separator, *'"\r\n')) or text != text.strip()
    return '"' + text.replace('"', '""') + '"' if needed else text


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return "_" not in text
