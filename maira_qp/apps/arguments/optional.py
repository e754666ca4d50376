"""Flags and commands as the help shows them: sentences in one piece, and no default where words say what it means."""

from __future__ import annotations

import inspect
import textwrap
from dataclasses import fields
from shutil import get_terminal_size
from typing import Annotated, Any, TypeVar, get_type_hints

import tyro

from maira_qp.field_docs import docs_of_fields

T = TypeVar("T")
Kind = TypeVar("Kind", bound=type)
UNSAID = tyro.conf.arg(help_behavior_hint="")
"""No default is shown."""
Flag = Annotated[bool, tyro.conf.FlagCreatePairsOff, UNSAID]
"""A switch, off unless it is given."""
Maybe = Annotated[T | None, UNSAID]
"""A value, None unless it is given."""
WIDEST = 100
"""Columns of text at most, however wide the terminal is."""


_to_be_explained: list[type] = []


def explained(kind: Kind) -> Kind:
    """A data class whose flags `explain_flags` is to explain."""
    _to_be_explained.append(kind)
    return kind


def explain_flags() -> None:
    """Give flags the docstrings of their fields as their help, without the line breaks in them.

    Sources are read for it, which takes a tenth of a second: only where help is asked for.
    """
    while _to_be_explained:
        kind = _to_be_explained.pop()
        told, hints = docs_of_fields(kind), get_type_hints(kind, include_extras=True)
        for name in [one.name for one in fields(kind) if one.name in told]:
            kind.__annotations__[name] = Annotated[hints[name], tyro.conf.arg(help=" ".join(told[name].split()))]


def summary(kind: type) -> str:
    """The first paragraph of a command's docstring, a line."""
    return " ".join(inspect.cleandoc(kind.__doc__ or "").split("\n\n")[0].split())


def details(kind: type) -> str:
    """What of a command's docstring is behind the summary: paragraphs as wide as the terminal, indented lines as is."""
    width = min(get_terminal_size((80, 24)).columns, WIDEST)
    parts = inspect.cleandoc(kind.__doc__ or "").split("\n\n")[1:]
    wrapped = [part if part.startswith("    ") else textwrap.fill(" ".join(part.split()), width) for part in parts]
    return "\n\n".join(wrapped).replace(":\n\n    ", ":\n    ")


def command(kind: type, name: str) -> Any:
    """The class of a command as a member of tyro's union of commands."""
    return Annotated[kind, tyro.conf.subcommand(name, description=summary(kind))]  # type: ignore[valid-type]
