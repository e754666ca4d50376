"""Files from callers, read with suspicion: regular files only, so that no pipe or device is waited for; a size cap."""

from __future__ import annotations

import os
import stat
from pathlib import Path
from typing import BinaryIO

from maira_qp.errors import MairaError, shown

LARGEST_TABLE = 2 * 2**30
"""Largest part of a file of poses that is unpacked at a time [bytes]."""
LARGEST_FILE = 2**63 - 1
"""Of what is read in pieces [bytes]: any."""


def open_regular(path: str | os.PathLike[str], what: str, error: type[MairaError], largest: int) -> BinaryIO:
    """A regular file of at most `largest` bytes, open to be read; `what` it is, for the message. Raises `error`."""
    if not isinstance(path, (str, os.PathLike)):
        raise error(f"{what} must be a path, got {shown(path)}")
    name = os.fspath(path)
    told = f"{what} {name!r}" if len(name) <= 200 else f"{what} {name[:200]!r}..."
    try:  # without O_NONBLOCK a pipe would wait for its writer
        descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
    except (OSError, ValueError) as reason:
        raise error(f"cannot open {told}: {getattr(reason, 'strerror', None) or reason}") from None
    status = os.fstat(descriptor)
    if stat.S_ISREG(status.st_mode) and status.st_size <= largest:
        return os.fdopen(descriptor, "rb")
    os.close(descriptor)
    wrong = f"larger than {_size(largest)}" if stat.S_ISREG(status.st_mode) else "not a regular file"
    raise error(f"{told} is {wrong}")


def read_regular(path: str | os.PathLike[str], what: str, error: type[MairaError], largest: int) -> bytes:
    """The content of such a file. Raises `error`."""
    with open_regular(path, what, error, largest) as file:
        try:
            content = file.read(largest + 1)
        except OSError as reason:
            raise error(f"cannot read {what} {os.fspath(path)!r:.200}: {reason.strerror}") from None
    if len(content) > largest:  # it grew, or the system does not tell the sizes of such files
        raise error(f"{what} {os.fspath(path)!r:.200} is larger than {_size(largest)}")
    return content


def read_text(path: str | os.PathLike[str], what: str, error: type[MairaError], largest: int) -> str:
    """The same as text in UTF-8, with or without a byte order mark. Raises `error`."""
    try:
        return read_regular(path, what, error, largest).decode("utf-8-sig")
    except UnicodeDecodeError as reason:
        raise error(f"{Path(path).name} is not UTF-8 text: {reason}") from None


def _size(count: int) -> str:
    return f"{count >> 20} MB" if count >= 2**20 else f"{count >> 10} kB"
