"""XML from a path or from text, read with suspicion: regular files only, a size cap, no DTD, errors with their line.

Where robot files in circulation break the letter of XML and other programs read them all the same, so does this: the
encoding is what the bytes show where that is not what is declared, and comments may hold `--`.
"""

from __future__ import annotations

import codecs
import contextlib
import logging
import os
import re
from collections.abc import Iterator
from pathlib import Path
from typing import TypeGuard
from xml.etree import ElementTree
from xml.parsers import expat

from maira_qp.errors import RobotError
from maira_qp.regular_files import read_regular

log = logging.getLogger(__name__)

MAX_BYTES = 64 * 2**20
"""Largest description that is read [bytes]; the largest in common use are below 1 MB."""
MAX_DEPTH = 64
"""Deepest nesting of elements; URDF needs 6."""

BLANKS = "\ufeff \t\r\n"
"""What may stand before XML."""
_MARKS = {
    codecs.BOM_UTF8: "utf-8",
    codecs.BOM_UTF32_LE: "utf-32-le",  # before UTF-16, whose mark it begins with
    codecs.BOM_UTF32_BE: "utf-32-be",
    codecs.BOM_UTF16_LE: "utf-16-le",
    codecs.BOM_UTF16_BE: "utf-16-be",
}
_DECLARED = re.compile(rb"""\s*<\?xml[^>]*?\bencoding\s*=\s*["']([A-Za-z0-9._-]+)["']""")
_WORD_OF_TWO = re.compile(rb"[\xa1-\xfe]{4}")


def xml_root(source: str | os.PathLike[str]) -> ElementTree.Element:
    """The root element of XML text (anything that starts with `<`), or else of the file at that path.

    Raises `RobotError` if there is no such regular file, if it is too large, if the XML is malformed, or if it has a
    document type declaration: entities can expand without bound and can name other files, and URDF has no use for them.
    """
    if not isinstance(source, (str, os.PathLike)):
        raise RobotError(f"a robot description must be a path or XML text, not {type(source).__name__}")
    if is_text(source):
        if len(source) > MAX_BYTES:
            raise RobotError(f"the XML text is larger than {MAX_BYTES >> 20} MB")
        return _parse(source, "XML text")
    if isinstance(source, str) and not source.strip(BLANKS):
        raise RobotError("the robot description is empty text")
    name = Path(source).name
    try:
        content = read_regular(source, "the robot description", RobotError, MAX_BYTES)
    except RobotError as reason:
        hint = " (XML text would start with '<')" if str(reason).startswith("cannot open") else ""
        raise RobotError(f"{reason}{hint}") from None
    return _parse(_decoded(content, name), name)


def is_text(source: str | os.PathLike[str]) -> TypeGuard[str]:
    """Whether a description is XML text, and no path."""
    return isinstance(source, str) and source.lstrip(BLANKS).startswith("<")


def _decoded(content: bytes, what: str) -> str:
    """The bytes of a file as text: by their mark, by the zeros of UTF-16, as declared, or as the bytes allow."""
    for mark, encoding in _MARKS.items():
        if content.startswith(mark):
            return _decode(content[len(mark) :], encoding, what)
    if b"\0" in content[:2]:
        return _decode(content, "utf-16-be" if content[:1] == b"\0" else "utf-16-le", what)
    declared = _DECLARED.match(content[:1024])
    encoding = "utf-8" if declared is None else declared[1].decode()
    if not encoding.lower().startswith(("utf-16", "utf-32", "utf-8", "utf8")):
        return _decode(content, encoding, what)
    try:
        return content.decode()
    except UnicodeDecodeError:
        text, encoding = _guessed(content)
    log.warning("%s is not UTF-8 and declares no other encoding: it is read as %s", what, encoding)
    return text


def _guessed(content: bytes) -> tuple[str, str]:
    """Text that is not UTF-8, and its encoding: Chinese if it could be and has words of two signs, else Latin-1."""
    if _WORD_OF_TWO.search(content):
        with contextlib.suppress(UnicodeDecodeError):
            return content.decode("gb2312"), "gb2312"
    return content.decode("latin-1"), "latin-1"


def _decode(content: bytes, encoding: str, what: str) -> str:
    try:
        return content.decode(encoding)
    except (LookupError, UnicodeError) as reason:
        raise RobotError(f"{what} cannot be decoded: {reason}") from None


def _without_comments(text: str) -> str:
    """The text with only the line breaks of its comments; a comment ends at the first `-->`, whatever it holds."""
    return "".join(_outside_comments(text)) if "<!--" in text else text


def _outside_comments(text: str) -> Iterator[str]:
    end = 0
    while (begin := text.find("<!--", end)) >= 0:
        literal = text.find("<![CDATA[", end, begin)
        closed = text.find("]]>", literal) if literal >= 0 else -1
        if closed > begin:  # within a literal, a comment is text
            yield text[end : closed + 3]
            end = closed + 3
            continue
        close = text.find("-->", begin + 4)
        if close < 0:
            break
        yield text[end:begin]
        yield "\n" * text.count("\n", begin, close)
        end = close + 3
    yield text[end:]


def _parse(text: str, what: str) -> ElementTree.Element:
    """The element tree of XML text, whatever encoding it declares."""
    start = text.lstrip(BLANKS)
    skipped_lines = text.count("\n", 0, len(text) - len(start))  # they count in the line of an error
    parser = expat.ParserCreate("utf-8")
    builder = ElementTree.TreeBuilder()
    depth = 0

    def begin(tag: str, attributes: dict[str, str]) -> None:
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

    parser.StartElementHandler = begin
    parser.EndElementHandler = end
    parser.CharacterDataHandler = builder.data
    parser.StartDoctypeDeclHandler = refuse
    try:
        parser.Parse(_without_comments(start).encode("utf-8"), True)
    except expat.ExpatError as reason:
        line = reason.lineno + skipped_lines
        raise RobotError(f"{what} is not well-formed XML, line {line}: {expat.ErrorString(reason.code)}") from None
    except UnicodeEncodeError as reason:
        raise RobotError(f"{what} holds characters that are not valid Unicode: {reason}") from None
    return builder.close()
