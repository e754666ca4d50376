"""Answers to the rows of a file, as they come: into a file, or to standard output as long as somebody reads there."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any, BinaryIO

from maira_qp.apps.arguments.standard_streams import STANDARD
from maira_qp.apps.left_pipes import reader_may_leave
from maira_qp.io.answers import Names, RowWriter, check_names, check_output, partial, write_answers
from maira_qp.io.table import Table

Begin = Callable[[BinaryIO, str], RowWriter]
"""Begins a writer in a file, for files that end so."""


def check_answers(output: Path, table: Table, names: Names) -> None:
    """Before a long run: whether the answers can go there, beside what was asked. Raises `OptionError`."""
    if output == STANDARD:
        check_names(".csv", table, names)
    else:
        check_output(output, table, names)


def write(output: Path, answered: Iterable[tuple[slice, Any]], begin: Begin, unit: str) -> None:
    """Write answers as they come. After Ctrl-C stderr says where those are that there were, and of how many `unit`.

    Raises `OSError`, `PoseError`, and `KeyboardInterrupt` as it was.
    """
    writer: RowWriter | None = None

    def began(file: BinaryIO) -> RowWriter:
        nonlocal writer
        writer = begin(file, ".csv" if output == STANDARD else output.suffix.lower())
        return writer

    if output == STANDARD:
        for rows, answers in answered:
            with reader_may_leave():
                one = writer or began(sys.stdout.buffer)
                one.write(rows, answers)
                sys.stdout.buffer.flush()
        return
    try:
        write_answers(output, answered, began)
    except KeyboardInterrupt:
        if writer is not None and writer.done:
            sys.stderr.write(f"the answers to the first {writer.done} {unit} are in {partial(output)}\n")
        raise
