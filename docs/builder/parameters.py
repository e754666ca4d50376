"""Docstrings describe several parameters in one entry, `step, turn, frame: ...`; the reference lists each of them."""

from __future__ import annotations

import re
from typing import Any

from griffe import Extension, Function

ENTRY = re.compile(r"^(    )?(\w+(?:, \w+)+): (.*(?:\n(?:\1)?        .*)*)", re.MULTILINE)


class EachParameter(Extension):
    """Split entries of several parameters."""

    def on_function_instance(self, *, func: Function, **_: Any) -> None:
        """Called for every function of the package."""
        if func.docstring is not None:
            func.docstring.value = ENTRY.sub(split, func.docstring.value)


def split(match: re.Match) -> str:
    """One entry for each name: the first with the description, the others refer to it."""
    indent = match[1] or ""
    first, *others = match[2].split(", ")
    entries = [f"{indent}{first}: {match[3]}", *(f"{indent}{name}: see `{first}`." for name in others)]
    return "\n".join(entries)
