"""Shards: the results of ranges of items, each a file of its own, named by the job and the range that it answers.

A file is whole or absent, and begins with its checksum. Whoever computes the same range of the same job writes the same
file: nothing is lost or there twice, whatever happens to those who write.
"""

from __future__ import annotations

import contextlib
import hashlib
import io
import math
import re
import shutil
import zipfile
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np

from maira_qp.errors import JobError
from maira_qp.io.atomic_write import replacing

FOLDER = "shards"
CHECKSUM = hashlib.sha256
NAME = re.compile(r"(\d{12,})-(\d{12,})-([0-9a-f]{16})\.shard")


class Shard(NamedTuple):
    """The items first, ..., last - 1 of a job."""

    first: int
    last: int

    @property
    def length(self) -> int:
        """How many items."""
        return self.last - self.first


class DamagedShard(JobError):
    """The file of a shard is not what was written. Its `path` is to be removed, and the shard done again."""

    def __init__(self, path: Path) -> None:
        super().__init__(f"{path} is damaged: its checksum is another")
        self.path = path

    def __reduce__(self) -> tuple[type[DamagedShard], tuple[Path]]:
        return DamagedShard, (self.path,)


class Shards:
    """The shards of one job in its folder."""

    def __init__(self, folder: Path, digest: str) -> None:
        """The job is known by its digest."""
        self.folder = folder / FOLDER
        self._digest = digest

    def path(self, shard: Shard) -> Path:
        """Where the result of a shard is."""
        asked = hashlib.sha256(f"{self._digest} {shard.first} {shard.last}".encode()).hexdigest()
        return self.folder / f"{shard.first:012d}-{shard.last:012d}-{asked[:16]}.shard"

    def write(self, shard: Shard, arrays: Mapping[str, np.ndarray]) -> None:
        """Write the arrays (last - first, ...) of a shard, whole or not at all. Raises `OSError`."""
        content = io.BytesIO()
        np.savez(content, allow_pickle=False, **arrays)
        data = content.getvalue()
        with replacing(self.path(shard)) as file:
            file.write(self._checksum(shard, data) + data)

    def read(self, shard: Shard) -> dict[str, np.ndarray]:
        """The arrays of a shard. Raises `DamagedShard`, `OSError`."""
        path = self.path(shard)
        content = path.read_bytes()
        data = content[CHECKSUM().digest_size :]
        if content[: CHECKSUM().digest_size] != self._checksum(shard, data):
            raise DamagedShard(path)
        try:
            with np.load(io.BytesIO(data), allow_pickle=False) as arrays:
                found = {name: arrays[name] for name in arrays.files}
        except (ValueError, zipfile.BadZipFile):
            raise DamagedShard(path) from None
        return found

    def _checksum(self, shard: Shard, data: bytes) -> bytes:
        """Of the content and of what it answers: a file under another's name is as damaged as one that was changed."""
        return CHECKSUM(f"{self._digest} {shard.first} {shard.last} ".encode() + data).digest()

    def there(self, begin: int = 0, end: float = math.inf) -> list[Shard]:
        """The shards of the job that have a file and answer items from begin to end - 1, in order; they may overlap,
        where work was cut anew."""
        if not self.folder.is_dir():
            return []
        matches = [NAME.fullmatch(entry.name) for entry in self.folder.iterdir()]
        shards = sorted(Shard(int(match[1]), int(match[2])) for match in matches if match)
        return [shard for shard in shards if shard.last > begin and shard.first < end and self.path(shard).exists()]

    def gaps(self, first: int, last: int) -> list[Shard]:
        """The ranges of items from first to last - 1 that no file answers."""
        found, at = [], first
        for shard in self.there():
            if shard.first > at:
                found.append(Shard(at, min(shard.first, last)))
            at = max(at, shard.last)
            if at >= last:
                return found
        return [*found, Shard(at, last)]

    def blocks(self, begin: int, end: int, block: int) -> Iterator[tuple[int, dict[str, np.ndarray]]]:
        """Blocks of the items begin to end - 1, gathered from shards that answer all of them: the first item, arrays.

        Raises `DamagedShard`, `JobError`, `OSError`.
        """
        pieces = self._pieces(begin, end)
        shard, at, arrays = next(pieces)
        for first in range(begin, end, block):
            last, parts = min(first + block, end), []
            while True:
                stop = min(last, shard.last)
                parts.append({name: values[at - shard.first : stop - shard.first] for name, values in arrays.items()})
                at = stop
                if at == shard.last and at < end:
                    shard, at, arrays = next(pieces)
                if stop == last:
                    break
            yield first, {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}

    def _pieces(self, begin: int, end: int) -> Iterator[tuple[Shard, int, dict[str, np.ndarray]]]:
        """Shards that follow one another, each with its arrays and the first item that is taken of it.

        Raises `DamagedShard`, `JobError` where one is missing, `OSError`.
        """
        at = begin
        for shard in self.there(begin, end):
            if shard.first > at:
                break
            if shard.last > at:
                yield shard, at, self.read(shard)
                at = shard.last
            if at >= end:
                return
        raise JobError(f"{self.folder} holds no shard of the item {at} any more: resume the job, which does it again")

    def damaged(self) -> Iterable[Path]:
        """The files whose checksum is another."""
        for shard in self.there():
            try:
                self.read(shard)
            except DamagedShard as damage:
                yield damage.path

    def size(self) -> int:
        """Bytes of all files."""
        return sum(self.path(shard).stat().st_size for shard in self.there())

    def forget_parts(self) -> None:
        """Remove what was begun and not finished by processes that are no more."""
        if self.folder.is_dir():
            for part in self.folder.glob("*.part"):
                with contextlib.suppress(FileNotFoundError):
                    part.unlink()

    def remove(self) -> None:
        """Remove all shards, once the output is whole."""
        shutil.rmtree(self.folder, ignore_errors=True)
