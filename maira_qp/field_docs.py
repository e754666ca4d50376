"""Docstrings of data classes for `help()`: those of their fields, which Python does not keep, are read from the source
when they are first asked for."""

from __future__ import annotations

import ast
import inspect
import itertools
import textwrap
from dataclasses import fields, is_dataclass
from functools import cache

WIDTH = 100
"""Columns of the text."""


class WithFields:
    """In place of a class's `__doc__`: its own docstring, and behind it a paragraph for each of its fields."""

    def __init__(self, text: str) -> None:
        """The docstring that the class has."""
        self.text = text

    def __get__(self, instance: object, owner: type) -> str:
        """The docstring, as attribute access asks for it."""
        if owner.__dict__.get("__doc__") is not self:
            return self.text
        return "\n\n".join([inspect.cleandoc(self.text), *_paragraphs(owner)])


def show_fields(kinds: list[object]) -> None:
    """Make `help()` show the fields of those that are data classes."""
    for kind in kinds:
        if isinstance(kind, type) and is_dataclass(kind) and isinstance(kind.__doc__, str):
            kind.__doc__ = WithFields(kind.__doc__)  # type: ignore[assignment]


@cache
def _paragraphs(kind: type) -> list[str]:
    """The heading, and name and docstring of each public field that has one."""
    told = docs_of_fields(kind)
    names = [one.name for one in fields(kind) if not one.name.startswith("_") and one.name in told]  # type: ignore[arg-type]
    made = [f"{name}: {' '.join(told[name].split())}" for name in names]
    return ["Fields:"] * bool(made) + [textwrap.indent("\n".join(textwrap.wrap(one, WIDTH)), "    ") for one in made]


def docs_of_fields(kind: type) -> dict[str, str]:
    """The docstrings of a data class's fields, those that it has inherited too, by their names."""
    told = dict[str, str]()
    for each in reversed(kind.__mro__):
        told.update(_of_own_fields(each))
    return told


def _of_own_fields(kind: type) -> dict[str, str]:
    """The docstrings under the fields that a class itself has, by their names; none without its source."""
    if not is_dataclass(kind):
        return {}
    try:
        tree = ast.parse(textwrap.dedent(inspect.getsource(kind)))
    except (OSError, TypeError, SyntaxError):
        return {}
    body, found = tree.body[0].body, {}  # type: ignore[attr-defined]
    for field, below in itertools.pairwise(body):
        if isinstance(field, ast.AnnAssign) and isinstance(field.target, ast.Name) and isinstance(below, ast.Expr):
            text = getattr(below.value, "value", None)
            if isinstance(text, str):
                found[field.target.id] = text
    return found
