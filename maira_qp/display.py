"""What an object shows of itself: text for a terminal of 80 columns, and HTML for a notebook, from one `Card`."""

from __future__ import annotations

import textwrap
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape

WIDTH = 80
"""Columns of a terminal."""
LINES = 8
"""Lines of entries that a terminal is given, and lines of a fact."""
ROWS = 30
"""Rows of a table in a notebook."""
LONGEST = 34
"""Characters of an entry, and of the title's parts: what is longer loses its middle."""


@dataclass(frozen=True, kw_only=True)
class Card:
    """What there is to show of an object."""

    title: str
    words: str = ""
    """Sentences"""
    facts: Sequence[tuple[str, str]] = ()
    """Labels with their values, a line each; an empty value is left out"""
    entries: Sequence[str] = ()
    """In a terminal: short texts side by side in columns"""
    lines: Sequence[str] = ()
    """In a terminal: lines of a table that fits"""
    headings: Sequence[str] = ()
    rows: Sequence[Sequence[str]] = ()
    """In a notebook: a table"""
    further_rows: int = 0
    """How many rows it would have beyond these"""

    @property
    def text(self) -> str:
        """For a terminal, without a line that is wider."""
        lines = textwrap.wrap(self.title, WIDTH, subsequent_indent="  ")
        lines += textwrap.wrap(self.words, WIDTH, initial_indent="  ", subsequent_indent="  ")
        for label, value in self.facts:
            if value:
                lines += _cut(textwrap.wrap(f"{label}: {value}", WIDTH, initial_indent="  ", subsequent_indent="    "))
        return "\n".join([*lines, *columns([shortened(entry) for entry in self.entries]), *self.lines])

    @property
    def html(self) -> str:
        """For a notebook. Names come from files: all of it is escaped."""
        facts = "".join(f"<div><b>{escape(label)}</b>: {escape(value)}</div>" for label, value in self.facts if value)
        parts = [f"<div><b>{escape(self.title)}</b></div><div>{escape(self.words)}</div>{facts}"]
        if self.rows:
            head = "".join(f"<th>{escape(heading)}</th>" for heading in self.headings)
            body = "".join(
                f"<tr>{''.join(f'<td>{escape(cell)}</td>' for cell in row)}</tr>" for row in self.rows[:ROWS]
            )
            parts.append(f"<table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>")
        left = max(len(self.rows) - ROWS, 0) + self.further_rows
        if left:
            parts.append(f"<div>and {left:,} more</div>")
        return "".join(parts)


class Shown(ABC):
    """An object whose `repr` and notebook view are those of its card."""

    @abstractmethod
    def _card(self) -> Card: ...

    def __repr__(self) -> str:
        return self._card().text

    def _repr_html_(self) -> str:
        return self._card().html


def shortened(text: str, longest: int = LONGEST) -> str:
    """A text without its middle if it is longer than so many characters."""
    if len(text) <= longest:
        return text
    tail = (longest - 1) // 2
    return f"{text[: longest - 1 - tail]}…{text[len(text) - tail :]}"


def joint_entries(names: Sequence[str], values: Sequence[str]) -> list[str]:
    """Entries "joint1 0.123"; a long name is shortened, a value is not."""
    room = LONGEST - 1 - max(map(len, values), default=0)
    return [f"{shortened(name, max(room, 8))} {value}" for name, value in zip(names, values, strict=True)]


def columns(entries: Sequence[str], width: int = WIDTH, most: int = LINES) -> list[str]:
    """Entries in columns, read line by line; after so many lines it says how many are left out."""
    if not entries:
        return []
    wide = max(map(len, entries))
    each = max(1, width // (wide + 2))
    lines = [
        "".join(f"  {entry:<{wide}}" for entry in entries[i : i + each]).rstrip() for i in range(0, len(entries), each)
    ]
    left = len(entries) - most * each
    return lines if left <= 0 else [*lines[:most], f"  ... and {left} more"]


def _cut(lines: list[str]) -> list[str]:
    return lines if len(lines) <= LINES else [*lines[:LINES], "    ..."]
