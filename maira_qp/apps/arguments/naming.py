"""Which flag a message is about: errors of the library name arguments of Python, the command line has flags."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence

SYNONYMS = {"target": ("--position", "--matrix"), "weight": ("--weight", "--weights")}
"""Flags by what a message calls it that they give, where it is not their own name."""


def in_flags(message: str, arguments: Sequence[str]) -> str:
    """A message with the flag that it is about, if that is among the arguments and the message names none of them.

    It is about the flag whose name it begins with, or whose value it shows.
    """
    given = dict(_given(arguments))
    if any(re.search(rf"{flag}(?![\w-])", message) for flag in given):
        return message
    begin = re.match(r"(?:the )?([a-z]\w*)", message)
    for flag in () if begin is None else SYNONYMS.get(begin[1], (f"--{begin[1].replace('_', '-')}",)):
        if begin is not None and flag in given:
            return flag + message[begin.end() :]
    for flag, values in given.items():
        if any((value and message.startswith(value)) or _quoted(value) in message for value in values):
            return f"{flag}: {message}"
    return message


def _given(arguments: Sequence[str]) -> Iterator[tuple[str, list[str]]]:
    """The flags among arguments as the help spells them, with the words that follow each."""
    flag, values = "", list[str]()
    for word in [*arguments, "--"]:
        if not word.startswith("--"):
            values.append(word)
            continue
        if flag:
            yield flag, values
        name, _, value = word.partition("=")
        flag, values = name.replace("_", "-"), [value] * bool(value)


def _quoted(value: str) -> str:
    """How a message begins to show a value; that of a folder is shown with what is in it."""
    return repr(value)[:30] if len(value) > 30 else repr(value)[:-1] if len(value) > 1 else repr(value)
