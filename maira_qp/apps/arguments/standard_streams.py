"""`-` in place of a file of poses: CSV from standard input, CSV to standard output."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import BinaryIO

from maira_qp.errors import PoseError

STANDARD = Path("-")
STANDARD_INPUT = Path("standard input")
"""What messages call it."""


def name_and_stream(path: Path) -> tuple[Path, BinaryIO | None]:
    """What messages call a file of poses, and standard input where it is that. Raises `PoseError`."""
    if path != STANDARD:
        return path, None
    if sys.stdin is None:
        raise PoseError("standard input is closed")
    return STANDARD_INPUT, sys.stdin.buffer


def beside(path: Path, middle: str) -> Path:
    """Where answers go if nothing is said: a file beside that of the poses, standard output for standard input."""
    return path if path == STANDARD else path.with_suffix(f".{middle}{path.suffix}")
