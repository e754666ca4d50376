"""The work of a worker: shards of a job, computed into files of its folder, or blocks of its output, made of them."""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from dataclasses import dataclass
from pathlib import Path

from maira_qp.scale.job import Job
from maira_qp.scale.shards import Shard, Shards


@dataclass(frozen=True)
class Work(ABC):
    """A job and its folder, as workers are given them. Pickles, for other processes and machines."""

    job: Job
    folder: Path
    """Absolute; on other machines the same folder, by a file system that is shared."""
    digest: str
    threads: int
    """Of the compiled engine, for each worker."""

    def __call__(self, shard: Shard) -> float:
        """Do a part; returns how long that took [s]. Raises what the job raises, `JobError`, `OSError`."""
        begin = time.perf_counter()
        self.do(Shards(self.folder, self.digest), shard)
        return time.perf_counter() - begin

    @abstractmethod
    def do(self, shards: Shards, shard: Shard) -> None:
        """Do a part. Raises what the job raises, `JobError`, `OSError`."""


class ShardWork(Work):
    """Parts are shards: items that are computed, and written into a file."""

    def do(self, shards: Shards, shard: Shard) -> None:
        """Compute a shard and write it."""
        shards.write(shard, self.job.compute(shard.first, shard.last, self.threads))


class BlockWork(Work):
    """Parts are blocks of the output, which are made from shards that answer all of their items."""

    def do(self, shards: Shards, shard: Shard) -> None:
        """Write blocks. Raises `DamagedShard`, `OSError`."""
        first, last = (min(k * self.job.block, self.job.count) for k in shard)
        for at, arrays in shards.blocks(first, last, self.job.block):
            self.job.write_block(self.folder, at, arrays)
