"""`-` in place of a file of poses: CSV from standard input, CSV to standard output."""

from __future__ import annotations

import sys
from pathlib import Path

from maira_qp.errors import PoseError
from maira_qp.regular_files import LARGEST_TABLE

STANDARD = Path("-")
STANDARD_INPUT = Path("standard input")
"""What messages call it."""


def name_and_content(path: Path) -> tuple[Path, bytes | None]:
    """What messages call a file of poses, and all of standard input where it is that. Raises `PoseError`."""
    if path != STANDARD:
        return path, None
    if sys.stdin is None:
        raise PoseError("standard input is closed")
    content = sys.stdin.buffer.read(LARGEST_TABLE + 1)
    if len(content) > LARGEST_TABLE:
        raise PoseError(f"standard input is larger than {LARGEST_TABLE >> 20} MB")
    return STANDARD_INPUT, content


def beside(path: Path, middle: str) -> Path:
    """Where answers go if nothing is said: a file beside that of the poses, standard output for standard input."""
    return path if path == STANDARD else path.with_suffix(f".{middle}{path.suffix}")
