"""The reference's parameters: each of several that share an entry (`step, turn, frame: ...`), no private one."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any

from griffe import Class, Extension, Function, Module

ENTRY = re.compile(r"^(    )?(\w+(?:, \w+)+): (.*(?:\n(?:\1)?        .*)*)", re.MULTILINE)


class EachParameter(Extension):
    """Split entries of several parameters, and hide private ones."""

    def on_function_instance(self, *, func: Function, **_: Any) -> None:
        """Called for every function of the package."""
        if func.docstring is not None:
            func.docstring.value = ENTRY.sub(split, func.docstring.value)

    def on_package(self, *, pkg: Module, **_: Any) -> None:
        """Called once the package is read, after the parameters of dataclasses are known."""
        for each in classes(pkg):
            init = each.members.get("__init__")
            if isinstance(init, Function):
                for name in [parameter.name for parameter in init.parameters if parameter.name.startswith("_")]:
                    del init.parameters[name]


def classes(room: Module | Class) -> Iterator[Class]:
    """All classes of a package."""
    for member in room.members.values():
        if isinstance(member, Class):
            yield member
        if isinstance(member, (Module, Class)):
            yield from classes(member)


def split(match: re.Match) -> str:
    """One entry for each name: the first with the description, the others refer to it."""
    indent = match[1] or ""
    first, *others = match[2].split(", ")
    entries = [f"{indent}{first}: {match[3]}", *(f"{indent}{name}: see `{first}`." for name in others)]
    return "\n".join(entries)
