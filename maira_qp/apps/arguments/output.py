"""How a command says what it found: JSON for machines, tables for people, angles in the unit that was asked for."""

from __future__ import annotations

import contextlib
import json
import math
import os
import re
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from shutil import get_terminal_size
from typing import TYPE_CHECKING, Any, TextIO

import numpy as np
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table

from maira_qp.arrays import plain, real_array
from maira_qp.errors import ConfigurationError, OptionError
from maira_qp.wording import SentenceUnits, fixed

if TYPE_CHECKING:
    from maira_qp.robots.model.robot import Robot

VERDICTS = {"CONVERGED": 0, "NEAREST": 1, "UNREACHABLE": 3, "BUDGET_SPENT": 4, "INVALID_TARGET": 5, "LIMITS_BROKEN": 6}
"""Exit codes by the name of the status."""

PICTURES = (".png", ".svg", ".pdf")
NO_PICTURE = "pictures need matplotlib: pip install 'maira-qp[plot]'"
WIDTH_OF_NAMES = 24
"""Columns of a name in a table."""
WIDTH_OF_FILES = 160
"""Columns of a table that goes into a file or a pipe, where no terminal tells."""


class _Console(Console):
    """One that does not end the process where the reader has gone away."""

    def on_broken_pipe(self) -> None:
        raise BrokenPipeError


def console(*, stderr: bool = False) -> Console:
    """A console on stdout or stderr, as wide as the terminal or as COLUMNS says; wide where there is neither."""
    stream = sys.stderr if stderr else sys.stdout
    width = None if stream.isatty() or "COLUMNS" in os.environ else WIDTH_OF_FILES
    return _Console(file=stream, width=width, markup=False, highlight=False)


def console_of_help(stream: TextIO, widest: int) -> Console:
    """A console on a stream, as wide as the terminal, or as COLUMNS says, within limits; 80 where there is neither."""
    return _Console(file=stream, width=min(get_terminal_size((80, 24)).columns, widest), highlight=False)


def picture_is_possible(path: Path) -> bool:
    """Before a long run: whether matplotlib is there. Raises `OptionError` for a name that no picture can have."""
    if path.suffix.lower() not in PICTURES:
        raise OptionError(f"a picture's name ends in {', '.join(PICTURES)}, not {path.name!r}")
    try:
        import matplotlib  # noqa: F401
    except ImportError:
        return False
    return True


def check_picture(path: Path) -> None:
    """Before a long run: whether a picture can be drawn, of the kind that its name asks for. Raises `OptionError`."""
    if not picture_is_possible(path):
        raise OptionError(NO_PICTURE)


def print_json(value: Any, *, stderr: bool = False) -> None:
    """One JSON value on stdout, or on stderr; numbers that are not finite are null."""
    (sys.stderr if stderr else sys.stdout).write(json.dumps(plain(value), allow_nan=False, indent=2) + "\n")


class Units:
    """Units of what goes in and out: radians or degrees, metres or millimetres."""

    def __init__(self, robot: Robot, degrees: bool, millimetres: bool = False) -> None:
        """For the joints of one robot."""
        self.angle, self.length = "deg" if degrees else "rad", "mm" if millimetres else "m"
        self.radian, self.metre = 180.0 / math.pi if degrees else 1.0, 1000.0 if millimetres else 1.0
        """One rad and one m in these units."""
        self.sentences = SentenceUnits(
            (lambda metres: f"{metres * self.metre:.4g} mm") if millimetres else None,
            (lambda radians: f"{radians * self.radian:.4g} deg") if degrees else None,
        )
        """What sentences are written in, where a flag has asked for it"""
        self.joints = [self.length if slides else self.angle for slides in robot.slides]
        self._names = robot.joint_names
        self.scale = np.where(robot.slides, self.metre, self.radian)
        """One rad or m of each joint (n,) in these units."""

    def read(self, values: Any, name: str) -> np.ndarray:
        """Joint values (n,) as given, in rad and m. Raises `ConfigurationError` if they are not n finite numbers."""
        if len(values) != len(self._names):
            count, names = len(self._names), ", ".join(self._names)
            raise ConfigurationError(f"{name}: give {count} joint values, not {len(values)}: those of {names}")
        return real_array(values, self.scale.shape, name, ConfigurationError) / self.scale

    def write(self, q: np.ndarray) -> np.ndarray:
        """Joint values (n,) in rad and m, in the units asked for."""
        return q * self.scale

    def errors(self, position: float | None, orientation: float | None) -> list[tuple[str, str]]:
        """What tables say of errors [m] and [rad], with a heading each; None: free."""
        each = (("position", position, self.metre, self.length), ("orientation", orientation, self.radian, self.angle))
        return [
            (f"{name} error [{unit}]", "free" if error is None else f"{error * one:.3g}")
            for name, error, one, unit in each
        ]

    def hints(self, hints: Iterable[str]) -> list[str]:
        """Hints at other units, each with the flag that asks for them; none at those that were asked for."""
        flags = {"degrees": "--deg"} if self.angle == "rad" else {}
        flags |= {"millimetres": "--mm"} if self.length == "m" else {}
        return [f"{hint} ({flag})" for hint in hints for word, flag in flags.items() if word in hint]


def numbers(values: Any) -> str:
    """Numbers in columns, six decimals."""
    return " ".join(f"{fixed(value, 6):>11}" for value in values)


def folded(name: str, width: int = WIDTH_OF_NAMES) -> str:
    """A name in lines of so many columns, broken behind its underscores where that is possible; none of it is left out.

    For tables of 80 columns: names of joints and links are as long as 60 characters.
    """
    lines = [""]
    for part in re.findall(r"[^_/.-]+[_/.-]*|[_/.-]+", name):
        if len(lines[-1]) + len(part) > width and lines[-1]:
            lines.append("")
        while len(part) > width:
            lines[-1], part = part[:width], part[width:]
            lines.append("")
        lines[-1] += part
    return "\n".join(lines)


def joint_table(names: Sequence[str], q: np.ndarray, units: Sequence[str], limits: Sequence[str] = ()) -> Table:
    """Joint values, a row each; `limits` says for each joint which of its limits it stands on, if any."""
    table = Table()
    table.add_column("joint")
    table.add_column("value", justify="right", no_wrap=True)
    if any(limits):
        table.add_column("limit")
    for i, name in enumerate(names):
        table.add_row(folded(name), f"{q[i]:.9g} {units[i]}", *([limits[i]] if any(limits) else []))
    return table


@contextlib.contextmanager
def progress_bar(label: str) -> Iterator[Callable[[int, int], None]]:
    """A bar on stderr with count, rate and time left; call what it gives with what is done and what there is in all.

    The rate counts what is done from now on, not what an earlier run had done. Nothing is drawn where stderr is no
    terminal.
    """
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn("{task.fields[rate]}"),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=console(stderr=True), disable=not sys.stderr.isatty(), transient=True) as bar:
        task = bar.add_task(label, total=None, rate="")
        begin, before = time.monotonic(), None

        def show(done: int, total: int) -> None:
            nonlocal before
            before = done if before is None else before
            rate = (done - before) / max(time.monotonic() - begin, 1e-9)
            bar.update(task, completed=done, total=total, rate=f"{rate:.0f} a second")

        yield show
