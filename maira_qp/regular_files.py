"""Files from callers, read with suspicion: regular files only, so that no pipe or device is waited for; a size cap."""

from __future__ import annotations

import os
import stat
from pathlib import Path

from maira_qp.errors import MairaError

LARGEST_TABLE = 2 * 2**30
"""Largest file of poses, packed or unpacked [bytes]: some ten million of them."""


def read_regular(path: str | os.PathLike[str], what: str, error: type[MairaError], largest: int) -> bytes:
    """The content of a regular file of at most `largest` bytes; `what` it is, for the message. Raises `error`."""
    name = os.fspath(path)
    shown = f"{what} {name!r}" if len(name) <= 200 else f"{what} {name[:200]!r}..."
    try:  # without O_NONBLOCK a pipe would wait for its writer
        descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
    except (OSError, ValueError) as reason:
        raise error(f"cannot open {shown}: {getattr(reason, 'strerror', None) or reason}") from None
    try:
        status = os.fstat(descriptor)
        if not stat.S_ISREG(status.st_mode):
            raise error(f"{shown} is not a regular file")
        if status.st_size > largest:
            raise error(f"{shown} is larger than {_size(largest)}")
        with os.fdopen(descriptor, "rb", closefd=False) as file:
            content = file.read(largest + 1)
    except OSError as reason:
        raise error(f"cannot read {shown}: {reason.strerror}") from None
    finally:
        os.close(descriptor)
    if len(content) > largest:  # it grew, or the system does not tell the sizes of such files
        raise error(f"{shown} is larger than {_size(largest)}")
    return content


def read_text(path: str | os.PathLike[str], what: str, error: type[MairaError], largest: int) -> str:
    """The same as text in UTF-8, with or without a byte order mark. Raises `error`."""
    try:
        return read_regular(path, what, error, largest).decode("utf-8-sig")
    except UnicodeDecodeError as reason:
        raise error(f"{Path(path).name} is not UTF-8 text: {reason}") from None


def _size(count: int) -> str:
    return f"{count >> 20} MB" if count >= 2**20 else f"{count >> 10} kB"
