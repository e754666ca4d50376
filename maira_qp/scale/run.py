"""Run a job: its shards by an engine, then its output from the shards; and what became of a job in a folder.

`run` can be interrupted at any moment, by whatever: the next `run` or `resume` goes on where it ended. The output is
the same, byte for byte, for any engine, number of workers, and lengths of shards.
"""

from __future__ import annotations

import contextlib
import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from maira_qp.arrays import check_callable, is_count
from maira_qp.errors import OptionError, shown
from maira_qp.scale import checksums
from maira_qp.scale.engines.engine import Engine, engine_of
from maira_qp.scale.job import Job, digest_of, job_of
from maira_qp.scale.manifest import begin, job_in, read_manifest
from maira_qp.scale.output import write_output
from maira_qp.scale.ownership import owned, owner_of
from maira_qp.scale.plan import Plan
from maira_qp.scale.shards import Shard, Shards
from maira_qp.scale.work import BlockWork, ShardWork

Progress = Callable[[int, int], object]


@dataclass(frozen=True)
class JobState:
    """What became of a job in a folder."""

    folder: Path
    kind: str
    unit: str
    """What is counted, such as poses."""
    total: int
    """How many there are."""
    done: int
    """How many of them are done; what is done twice counts once."""
    finished: bool
    """The output is whole."""
    owner: dict[str, Any] | None = None
    """The process that works on it now, its `pid` and `host`."""

    def as_dict(self) -> dict[str, Any]:
        """Plain data."""
        return {name: str(value) if name == "folder" else value for name, value in vars(self).items()}


@dataclass(frozen=True)
class Verification:
    """Whether the files of a job are what was written."""

    folder: Path
    checked: int
    """Files that were read."""
    damaged: tuple[str, ...]
    """Those that are not what was written, or are missing, relative to the folder."""

    def __bool__(self) -> bool:
        return not self.damaged


def run(
    job: Job,
    folder: str | os.PathLike[str],
    *,
    engine: str | Engine = "processes",
    workers: int | None = None,
    address: str = "",
    threads: int = 1,
    part: tuple[int, int] | None = None,
    shard: int | None = None,
    time_limit: float | None = None,
    progress: Progress | None = None,
) -> JobState:
    """Do what is left of a job in its folder, and write its output there.

    Args:
        job: such as `ReachJob.of(robot, ...)`.
        folder: new, empty, or that of the same job. All workers must see it.
        engine: "processes" (of this machine), "here" (this process), "dask", "ray", or an `Engine`.
        workers: at a time; None: one per processor, or as many as the cluster has.
        address: of a scheduler that runs already, for "dask" and "ray"; none: a cluster of this machine.
        threads: of the compiled engine, for each worker.
        part: (i, n), i from 1 to n: do the i-th of n parts of the items, and write no output. For arrays of tasks
            which know nothing of each other, on any machines; a run without `part` finishes when they are over.
        shard: items a shard; None: as many as take some 20 s. No result depends on it.
        time_limit: seconds after which a worker of "processes" that still does its shard is ended; None: 600. Other
            engines take none.
        progress: callback, called from this thread with how many units are done, see `Job.unit`, and their total.

    Raises `JobError` for a folder that is in use, or holds another job, other things, or the job of other versions, and
    for a shard that fails each time; `OptionError`; `OSError` such as of a disk that is full: then all that was done is
    kept.
    """
    _check(job, threads, part, shard, progress)
    chosen, path = engine_of(engine, workers, time_limit, address), Path(folder).absolute()
    first, last = _range(job, part)
    if part is not None:
        path.mkdir(parents=True, exist_ok=True)
    with owned(path) if part is None else contextlib.nullcontext():
        digest = digest_of(begin(job, path))
        shards = Shards(path, digest)
        while not checksums.is_finished(path):
            if part is None:
                shards.forget_parts()
            gaps = shards.gaps(first, last)
            plan = Plan(gaps, units_per_item=job.units_per_item, workers=chosen.workers, size=shard)
            if not plan.is_empty:
                tell = _counter(job, job.count - sum(gap.length for gap in gaps), progress)
                chosen.run(ShardWork(job, path, digest, threads), plan, tell)
            if part is not None:
                break
            write_output(BlockWork(job, path, digest, threads), shards, chosen)
        else:
            shards.remove()
    return state_of(path, job)


def resume(folder: str | os.PathLike[str], **options: Any) -> JobState:
    """Go on with the job of a folder, with the options of `run`; a finished output that is damaged is made again.

    Raises as `run` does, and `JobError` for a folder without a job.
    """
    return run(renewed(folder), folder, **options)


def renewed(folder: str | os.PathLike[str]) -> Job:
    """The job of a folder, ready to go on: a finished output that is damaged counts as not finished any more.

    Raises as `run` does, and `JobError` for a folder without a job.
    """
    path = Path(folder).absolute()
    job = job_in(path)
    if checksums.is_finished(path) and checksums.changed(path):
        with owned(path):
            (path / checksums.SUMS).unlink(missing_ok=True)
    return job


def state_of(folder: str | os.PathLike[str], job: Job | None = None) -> JobState:
    """What became of the job of a folder; a job of the caller's own class is given too.

    Raises `JobError` for a folder without one.
    """
    path = Path(folder)
    manifest = read_manifest(path)
    job, finished = job or job_of(manifest), checksums.is_finished(path)
    left = 0 if finished else sum(gap.length for gap in Shards(path, digest_of(manifest)).gaps(0, job.count))
    return JobState(
        folder=path,
        kind=job.kind,
        unit=job.unit,
        total=job.count * job.units_per_item,
        done=(job.count - left) * job.units_per_item,
        finished=finished,
        owner=owner_of(path),
    )


def verify(folder: str | os.PathLike[str]) -> Verification:
    """Read all files of a job, finished or not, and compare their checksums.

    Raises `JobError` for a folder without a job, `OSError`.
    """
    path = Path(folder)
    manifest = read_manifest(path)
    if checksums.is_finished(path):
        return Verification(path, checksums.count_of(path), tuple(checksums.changed(path)))
    shards = Shards(path, digest_of(manifest))
    damaged = tuple(each.relative_to(path).as_posix() for each in shards.damaged())
    return Verification(path, len(shards.there()), damaged)


def _counter(job: Job, done: int, progress: Progress | None) -> Callable[[Shard], None]:
    """What counts the items of shards that are done, and says so."""
    unit = job.units_per_item
    if progress is not None:
        progress(done * unit, job.count * unit)

    def tell(shard: Shard) -> None:
        nonlocal done
        done += shard.length
        if progress is not None:
            progress(done * unit, job.count * unit)

    return tell


def _range(job: Job, part: tuple[int, int] | None) -> tuple[int, int]:
    """The items of a part, or all."""
    if part is None:
        return 0, job.count
    i, n = part
    return job.count * (i - 1) // n, job.count * i // n


def _check(job: Any, threads: Any, part: Any, shard: Any, progress: Any) -> None:
    """Raises `OptionError` for what `run` cannot take."""
    if not isinstance(job, Job):
        raise OptionError(f"job must be a job, such as ReachJob.of(robot), got {shown(job)}")
    if not is_count(threads, 1):
        raise OptionError(f"threads must be a positive whole number, got {shown(threads)}")
    if shard is not None and not is_count(shard, 1):
        raise OptionError(f"shard must be a positive whole number of items, got {shown(shard)}")
    if part is not None:
        fits = isinstance(part, tuple) and len(part) == 2 and all(is_count(each, 1) for each in part)
        if not fits or part[0] > part[1]:
            raise OptionError(f"part must be (i, n) with 1 <= i <= n, got {shown(part)}")
    check_callable(progress, "progress", OptionError)
