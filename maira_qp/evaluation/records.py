"""The rows of a benchmark in a file that survives a crash: JSON lines, the settings first.

Line 1 holds the settings; every other line is one row. Rows are appended and forced to disk in batches. A process that
is killed leaves at most one torn line, the last, which the next one cuts off. A file of other settings is refused.
"""

from __future__ import annotations

import csv
import fcntl
import io
import json
import logging
import os
import time
from collections.abc import Iterable, Mapping
from pathlib import Path
from types import TracebackType
from typing import Any

from maira_qp.arrays import plain
from maira_qp.errors import OptionError
from maira_qp.io.atomic_write import replace_text

BATCH_SECONDS = 1.0
"""Rows younger than this may be lost when the machine stops [s]; when only the process stops, none is."""

log = logging.getLogger(__name__)


class RowFile:
    """An open file of rows, held by one process at a time. Use as a context manager."""

    def __init__(self, path: str | Path, settings: Mapping[str, Any]) -> None:
        """Opens the file, or makes it, and reads what is there.

        Raises `OptionError` if it holds other settings, something else, or another process writes it; `OSError` if it
        cannot be opened.
        """
        self.path = Path(path)
        self.path.parent.mkdir(parents=True, exist_ok=True)
        self._file = open(self.path, "a+b")  # noqa: SIM115 - closed by close()
        try:
            self._lock()
            self.rows = self._take_up(plain(settings))
        except BaseException:
            self._file.close()
            raise
        self._synced = time.monotonic()

    def append(self, row: Mapping[str, Any]) -> None:
        """Adds a row. What is not finite is written as null."""
        self.rows.append(plain(row))
        self._write(self.rows[-1])
        if time.monotonic() - self._synced > BATCH_SECONDS:
            self._sync()

    def close(self) -> None:
        """Forces what is written to disk and lets go of the file."""
        if not self._file.closed:
            self._sync()
            self._file.close()

    def __enter__(self) -> RowFile:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self.close()

    def _lock(self) -> None:
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise OptionError(f"{self.path} is being written by another process") from None

    def _take_up(self, settings: dict[str, Any]) -> list[dict[str, Any]]:
        """The rows that are there already; the settings are written to a file that has none."""
        self._file.seek(0)
        content = self._file.read()
        whole = content.rfind(b"\n") + 1
        if whole < len(content):
            log.warning("%s: cut off a torn last line of %d bytes", self.path, len(content) - whole)
            self._file.truncate(whole)
        lines = [self._parsed(line, number) for number, line in enumerate(content[:whole].splitlines(), start=1)]
        if not lines:
            self._write({"settings": settings})
            self._sync()
            return []
        if "settings" not in lines[0]:
            raise OptionError(f"{self.path} is not a file of benchmark rows: its first line holds no settings")
        self._compare(lines[0]["settings"], settings)
        return lines[1:]

    def _parsed(self, line: bytes, number: int) -> dict[str, Any]:
        try:
            value = json.loads(line)
        except ValueError:
            value = None
        if not isinstance(value, dict):
            raise OptionError(f"{self.path}: line {number} is not a row of a benchmark")
        return value

    def _compare(self, old: Mapping[str, Any], new: Mapping[str, Any]) -> None:
        differing = [key for key in {**old, **new} if old.get(key) != new.get(key)]
        if differing:
            changes = ", ".join(f"{key}: {old.get(key)!r:.60} there, {new.get(key)!r:.60} here" for key in differing)
            raise OptionError(f"{self.path} holds rows of other settings ({changes}); choose another file or remove it")

    def _write(self, value: Mapping[str, Any]) -> None:
        self._file.write(json.dumps(value, allow_nan=False, separators=(",", ":")).encode() + b"\n")
        self._file.flush()

    def _sync(self) -> None:
        self._file.flush()
        os.fsync(self._file.fileno())
        self._synced = time.monotonic()


def write_csv(path: str | Path, rows: Iterable[Mapping[str, Any]]) -> None:
    """The rows as a table of comma-separated values, whole or not at all; a vector is one cell."""
    rows = list(rows)
    text = io.StringIO(newline="")
    writer = csv.DictWriter(text, list(rows[0]) if rows else [], lineterminator="\n")
    writer.writeheader()
    for row in rows:
        writer.writerow({key: _cell(value) for key, value in row.items()})
    replace_text(path, text.getvalue())


def _cell(value: Any) -> Any:
    if isinstance(value, Mapping):
        return " ".join(f"{key}={entry}" for key, entry in value.items())
    return " ".join(repr(entry) for entry in value) if isinstance(value, (list, tuple)) else value
