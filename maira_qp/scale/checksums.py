"""Checksums of a finished output, in the format of `sha256sum`: written last, so that what has them is whole."""

from __future__ import annotations

import hashlib
import os
import re
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from maira_qp.io.atomic_write import replace_text
from maira_qp.scale.ownership import LOCK
from maira_qp.scale.shards import FOLDER

SUMS = "SHA256SUMS"
COUNT, LINE = "# {} files", re.compile("[0-9a-f]{64}  [^/].*")
"""The first line, by which a list that was cut off is known and which `sha256sum` passes over, and the others."""
PIECE = 2**20
"""How much of a file is read at a time [bytes]."""


def remove_parts(folder: Path) -> None:
    """Remove what workers that were killed have begun below a folder, by the names that they and Zarr give it."""
    for path in folder.rglob("*"):
        if path.suffix in (".part", ".partial") and path.is_file():
            path.unlink()


def write_sums(folder: Path, threads: int = 1) -> None:
    """Write the checksums of all files below a folder. Raises `OSError`."""
    names = list(_files(folder))
    with ThreadPoolExecutor(threads) as pool:
        sums = list(pool.map(_sum, [folder / name for name in names]))
    listed = "".join(f"{each}  {name}\n" for each, name in zip(sums, names, strict=True))
    replace_text(folder / SUMS, f"{COUNT.format(len(names))}\n{listed}")


def is_finished(folder: Path) -> bool:
    """Whether the output is whole."""
    return (folder / SUMS).is_file()


def changed(folder: Path) -> list[str]:
    """The files of a finished output that are not what was written, or are missing. Raises `OSError`."""
    lines = _lines(folder)
    if not lines or lines[0] != COUNT.format(len(lines) - 1) or not all(LINE.fullmatch(line) for line in lines[1:]):
        return [SUMS]
    found = []
    for line in lines[1:]:
        wanted, _, name = line.partition("  ")
        path = folder / name
        if not path.is_file() or _sum(path) != wanted:
            found.append(name)
    return found


def count_of(folder: Path) -> int:
    """How many files a finished output has beside the checksums. Raises `OSError`."""
    return max(0, len(_lines(folder)) - 1)


def _lines(folder: Path) -> list[str]:
    return (folder / SUMS).read_bytes().decode(errors="replace").splitlines()


def _files(folder: Path) -> Iterator[str]:
    """Names relative to the folder, in order; shards and what else comes and goes aside."""
    names = sorted(path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file())
    for name in names:
        if name not in (SUMS, LOCK) and not name.startswith(f"{FOLDER}/") and not name.endswith(".part"):
            yield name


def _sum(path: Path) -> str:
    total = hashlib.sha256()
    with open(path, "rb") as file:
        os.fsync(file.fileno())  # what has a checksum is on the disk
        while piece := file.read(PIECE):
            total.update(piece)
    return total.hexdigest()
