"""XML from a path or from text, read with suspicion: regular files only, a size cap, no DTD, errors with their line."""

from __future__ import annotations

import os
import stat
from pathlib import Path
from xml.etree import ElementTree
from xml.parsers import expat

from maira_qp.errors import RobotError

MAX_BYTES = 64 * 2**20
"""Largest description that is read [bytes]; the largest in common use are below 1 MB."""
MAX_DEPTH = 64
"""Deepest nesting of elements; URDF needs 6."""


def xml_root(source: str | os.PathLike[str]) -> ElementTree.Element:
    """The root element of XML text (anything that starts with `<`), or else of the file at that path.

    Raises `RobotError` if there is no such regular file, if it is too large, if the XML is malformed, or if it has a
    document type declaration: entities can expand without bound and can name other files, and URDF has no use for them.
    """
    if not isinstance(source, (str, os.PathLike)):
        raise RobotError(f"a robot description must be a path or XML text, not {type(source).__name__}")
    if isinstance(source, str):
        text = source.lstrip("\ufeff \t\r\n")
        if text.startswith("<"):
            skipped = source[: len(source) - len(text)].count("\n")
            if len(text) > MAX_BYTES:
                raise RobotError(f"the XML text is larger than {MAX_BYTES >> 20} MB")
            try:
                return _parse(text.encode("utf-8"), "XML text", skipped, encoding="utf-8")
            except UnicodeEncodeError as reason:
                raise RobotError(f"XML text holds characters that are not valid Unicode: {reason}") from None
        if not text:
            raise RobotError("the robot description is empty text")
    content = _read(source)
    body = content.removeprefix(b"\xef\xbb\xbf")
    start = body.lstrip(b" \t\r\n")
    return _parse(start, Path(source).name, body[: len(body) - len(start)].count(b"\n"))


def _read(path: str | os.PathLike[str]) -> bytes:
    """The content of a regular file; a pipe or a device is refused without waiting for it."""
    shown = repr(str(path)) if len(str(path)) <= 200 else f"{str(path)[:200]!r}..."
    try:  # without O_NONBLOCK a pipe would wait for its writer
        descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
    except (OSError, ValueError) as reason:
        why = getattr(reason, "strerror", None) or str(reason)
        raise RobotError(f"cannot open the robot description {shown}: {why} (XML text would start with '<')") from None
    try:
        if not stat.S_ISREG(os.fstat(descriptor).st_mode):
            raise RobotError(f"the robot description {shown} is not a regular file")
        with os.fdopen(descriptor, "rb", closefd=False) as file:
            content = file.read(MAX_BYTES + 1)
    finally:
        os.close(descriptor)
    if len(content) > MAX_BYTES:
        raise RobotError(f"the robot description {shown} is larger than {MAX_BYTES >> 20} MB")
    return content


def _parse(content: bytes, what: str, skipped_lines: int, encoding: str | None = None) -> ElementTree.Element:
    """The element tree of XML bytes; `skipped_lines` were cut before them and count in the line of an error."""
    parser = expat.ParserCreate(encoding)
    builder = ElementTree.TreeBuilder()
    depth = 0

    def start(tag: str, attributes: dict[str, str]) -> None:
        nonlocal depth
        depth += 1
        if depth > MAX_DEPTH:
            raise RobotError(f"{what}: elements are nested deeper than {MAX_DEPTH}")
        builder.start(tag, attributes)

    def end(tag: str) -> None:
        nonlocal depth
        depth -= 1
        builder.end(tag)

    def refuse(*_: object) -> None:
        raise RobotError(f"{what}: document type and entity declarations are refused; remove the <!DOCTYPE ...> part")

    parser.StartElementHandler = start
    parser.EndElementHandler = end
    parser.CharacterDataHandler = builder.data
    parser.StartDoctypeDeclHandler = refuse
    try:
        parser.Parse(content, True)
    except expat.ExpatError as reason:
        line = reason.lineno + skipped_lines
        raise RobotError(f"{what} is not well-formed XML, line {line}: {expat.ErrorString(reason.code)}") from None
    except (ValueError, LookupError) as reason:
        if isinstance(reason, RobotError):
            raise
        raise RobotError(f"{what} cannot be decoded: {reason}") from None
    return builder.close()
