"""The work of a worker: a shard of a job, computed and written into the job's folder."""

from __future__ import annotations

import time
from dataclasses import dataclass
from pathlib import Path

from maira_qp.scale.job import Job
from maira_qp.scale.shards import Shard, Shards


@dataclass(frozen=True)
class Work:
    """A job and its folder, as workers are given them. Pickles, for other processes and machines."""

    job: Job
    folder: Path
    """Absolute; on other machines the same folder, by a file system that is shared."""
    digest: str
    threads: int
    """Of the compiled engine, for each worker."""

    def __call__(self, shard: Shard) -> float:
        """Compute a shard and write it; returns how long that took [s]. Raises what the job raises, `OSError`."""
        begin = time.perf_counter()
        Shards(self.folder, self.digest).write(shard, self.job.compute(shard.first, shard.last, self.threads))
        return time.perf_counter() - begin
