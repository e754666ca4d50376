"""Files that are whole or not there: written beside their place, forced to disk, and renamed into it."""

from __future__ import annotations

import contextlib
import errno
import os
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import BinaryIO


@contextlib.contextmanager
def replacing(path: str | Path, *, interrupted: Sequence[Path] = ()) -> Iterator[BinaryIO]:
    """A file to write bytes to: it takes the place of `path` if the block ends well, and is removed if not.

    Whoever reads `path` finds the old file or the new one, never a part. Where Ctrl-C ends the block, the file goes to
    the path that is in `interrupted` by then, if there is one. Raises `OSError`.
    """
    path = Path(path)
    if not path.name:  # the root, or the working directory
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(path))
    path.parent.mkdir(parents=True, exist_ok=True)
    beside = path.with_name(f"{path.name}.{os.getpid()}.part")
    try:
        with open(beside, "wb") as file:
            try:
                yield file
            except KeyboardInterrupt:
                if interrupted:
                    _move(file, beside, interrupted[0])
                raise
            _move(file, beside, path)
    finally:
        with contextlib.suppress(FileNotFoundError):
            os.unlink(beside)


def _move(file: BinaryIO, beside: Path, path: Path) -> None:
    """Force a file to disk, and rename it."""
    file.flush()
    os.fsync(file.fileno())
    os.replace(beside, path)


def replace_text(path: str | Path, text: str) -> None:
    """Writes a text file, UTF-8, whole or not at all. Raises `OSError`."""
    with replacing(path) as file:
        file.write(text.encode())
