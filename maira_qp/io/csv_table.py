"""Comma-separated values: a header, then one pose per line.

Columns may be separated by semicolons or tabs instead, with decimals written with a comma, and the text may be UTF-8 or
UTF-16: what spreadsheets write in other countries. An answer is written behind the line that asked for it, in the same
manner, so that every further column comes back unchanged. The file is looked through once, and stays on the disk; what
is kept of it, the numbers and where each row is, is on the disk too.
"""

from __future__ import annotations

import codecs
import csv
import itertools
import math
import tempfile
import weakref
from collections.abc import Iterable, Iterator, Mapping, Sequence
from operator import itemgetter
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from maira_qp.errors import PoseError
from maira_qp.io.disk_rows import Spool, read_exactly
from maira_qp.io.table import ALL, Choose, Table
from maira_qp.regular_files import LARGEST_FILE, open_regular

CHUNK = 2_000
"""So many rows are taken apart into cells at a time; more at a time are slower, and take memory."""
LINE_END = b"\n"
PIECE = 2**20
"""Bytes that are read at a time, where lines do not matter."""
LONGEST_LINE = 16 * 2**20
"""[bytes]"""
SEPARATORS = {",": "commas", ";": "semicolons", "\t": "tabs"}
OTHERS = {"|": "bars", " ": "blanks"}
"""What some people separate columns by, and is not taken."""


class CsvTable(Table):
    """A CSV file."""

    def __init__(self, path: Path, choose: Choose, stream: BinaryIO | None = None) -> None:
        """Looks through a file, or what a stream holds. Raises `PoseError`, naming the line, for what is not a table or
        not a number; `OSError`."""
        self.path = path
        self._file = _as_file(path, stream)
        weakref.finalize(self, self._file.close)
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
        spans, numbers = Spool(), Spool()
        spans.append(np.empty((0, 2), dtype=np.int64))
        numbers.append(np.empty((0, len(place))))
        while chunk := list(itertools.islice(records, CHUNK)):
            spans.append(np.array([each[:2] for each in chunk]))
            numbers.append(self._parsed(chunk, place))
        (self._spans,), (self._numbers,) = spans.rows(), numbers.rows()

    def __len__(self) -> int:
        return len(self._spans)

    def numbers(self, rows: slice = ALL) -> np.ndarray:
        """See `Table.numbers`."""
        return self._numbers[rows]

    def where(self, row: int) -> str:
        """File and line."""
        return self._line(int(self._spans[row : row + 1][0, 0]))

    def columns(self, rows: slice = ALL) -> dict[str, Any]:
        """Numbers where numbers were asked for, else text."""
        columns: dict[str, Any] = {name: [] for name in self.names}
        columns |= zip(self._numeric, self.numbers(rows).T, strict=True)
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
        spans = self._spans[rows].tolist()
        if not spans:
            return []
        first = spans[0][0]
        content = read_exactly(self._file.fileno(), first, spans[-1][1] - first)
        return [content[begin - first : end - first].rstrip(b"\r\n").decode() for begin, end in spans]

    def _raw(self, begin: int, end: int) -> str:
        return read_exactly(self._file.fileno(), begin, end - begin).rstrip(b"\r\n").decode()

    def _line(self, begin: int) -> str:
        count = 1
        for at in range(0, begin, PIECE):
            count += read_exactly(self._file.fileno(), at, min(PIECE, begin - at)).count(LINE_END)
        return f"{self.path}, line {count}"

    def _separator(self) -> str:
        """What separates the names of columns: the sign that is there most often, outside quotes."""
        for _, line in self._lines():
            unquoted = b"".join(line.split(b'"')[::2])
            if unquoted.strip():
                return max(SEPARATORS, key=lambda sign: unquoted.count(sign.encode()))
        return ","

    def _lines(self) -> Iterator[tuple[int, bytes]]:
        """Where each line ends, and the line; a mark at the beginning aside. Raises `PoseError`."""
        self._file.seek(0)
        end = len(codecs.BOM_UTF8) if self._file.read(len(codecs.BOM_UTF8)) == codecs.BOM_UTF8 else 0
        self._file.seek(end)
        while line := self._file.readline(LONGEST_LINE + 1):
            if len(line) > LONGEST_LINE:
                raise PoseError(f"{self._line(end)} is longer than {LONGEST_LINE >> 20} MB")
            end += len(line)
            yield end, line

    def _records(self) -> Iterator[tuple[int, int, list[str]]]:
        """Begin and end in the bytes, and the cells, of each row that is not blank; the header is the first."""
        begin = end = 0

        def lines() -> Iterator[str]:
            nonlocal begin, end
            for at, line in self._lines():
                if not end:
                    begin = end = at - len(line)
                text = line.decode()
                end = at
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


class CsvWriter:
    """Writes rows of a table, each with its answer behind it, one block after another."""

    def __init__(self, file: BinaryIO, table: Table, names: Sequence[str]) -> None:
        """The header, with the names of the answers. Raises `OSError`."""
        self._file, self._table = file, table
        self._separator, self._decimal = (table.separator, table.decimal) if isinstance(table, CsvTable) else (",", ".")
        header = table.header if isinstance(table, CsvTable) else ",".join(map(_quoted, table.names))
        file.write(self._separator.join([header, *(_quoted(name, self._separator) for name in names)]).encode() + b"\n")

    def write(self, rows: slice, answers: Mapping[str, np.ndarray]) -> None:
        """Some rows, and their answers. Raises `OSError`."""
        begin, end, _ = rows.indices(len(self._table))
        for first in range(begin, end, CHUNK):
            last = min(first + CHUNK, end)
            asked = _asked(self._table, slice(first, last))
            some = slice(first - begin, last - begin)
            answered = [_texts(column[some], self._separator, self._decimal) for column in answers.values()]
            lines = map(self._separator.join, zip(*asked, *answered, strict=True))
            self._file.write("".join(f"{line}\n" for line in lines).encode())

    def close(self) -> None:
        """Nothing is left to be written."""


def write_csv(file: BinaryIO, table: Table, answers: Mapping[str, np.ndarray]) -> None:
    """The rows of a table, each with its answer behind it. Raises `OSError`."""
    CsvWriter(file, table, list(answers)).write(ALL, answers)


def _asked(table: Table, rows: slice) -> list[Iterable[str]]:
    """What stands before the answers, as texts."""
    if isinstance(table, CsvTable):
        return [table.records(rows)]
    return [_texts(column) for column in table.columns(rows).values()]


def _as_file(path: Path, stream: BinaryIO | None) -> BinaryIO:
    """A file in UTF-8 that can be read anywhere, from the beginning: the one that is there, or one without a name.

    Raises `PoseError` for what is no regular file, and for text in UTF-16 that is broken off; `OSError`.
    """
    source = open_regular(path, "the table", PoseError, LARGEST_FILE) if stream is None else stream
    begin = source.read(2)
    is_utf16 = begin in (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)
    if stream is None and not is_utf16:
        return source
    target = tempfile.TemporaryFile()  # noqa: SIM115, the table closes it
    try:
        decoder = codecs.getincrementaldecoder("utf-16")()
        piece = begin
        while True:
            more = source.read(PIECE)
            target.write(decoder.decode(piece, final=not more).encode() if is_utf16 else piece)
            if not more:
                break
            piece = more
        target.flush()
    except UnicodeDecodeError as reason:
        target.close()
        raise PoseError(f"{path} is not text in UTF-16: {reason}") from None
    except BaseException:
        target.close()
        raise
    finally:
        if stream is None:
            source.close()
    return target


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
