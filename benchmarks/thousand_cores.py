"""The constants behind a map on a thousand cores: work per pose, bytes, the end of a run, and what a shard costs.

    python benchmarks/thousand_cores.py

Processor time, so that other work on the machine matters less. `docs/guide/reach_maps.md` says what follows from it.
"""

from __future__ import annotations

import importlib.util
import resource
import tempfile
from collections.abc import Callable
from pathlib import Path

import maira_qp as mq


def seconds_of(work: Callable[[], object]) -> float:
    """Processor time of this process for some work."""
    before = resource.getrusage(resource.RUSAGE_SELF)
    work()
    after = resource.getrusage(resource.RUSAGE_SELF)
    return after.ru_utime - before.ru_utime + after.ru_stime - before.ru_stime


def size_of(folder: Path) -> int:
    """Bytes of all files."""
    return sum(path.stat().st_size for path in folder.rglob("*") if path.is_file())


def measure_poses(name: str, cell: float, directions: int) -> None:
    """What a pose costs: its verdict and figures, its bytes in a shard and in the map, and its share of the end."""
    job = mq.scale.ReachJob.of(mq.Robot.load(name), cell=cell, directions=directions)
    job.compute(0, 1, 1)  # what is made once
    poses = job.count * job.units_per_item
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place, "map")
        work = seconds_of(lambda: mq.scale.run(job, folder, engine="here", part=(1, 1)))
        shards = size_of(folder)
        end = seconds_of(lambda: mq.scale.run(job, folder, engine="here"))
        print(
            f"{name}, {poses} poses: {1e6 * work / poses:.2f} us and {shards / poses:.2f} bytes in shards per pose; "
            f"at the end {1e6 * end / poses:.3f} us and {size_of(folder) / poses:.2f} bytes of the map",
            flush=True,
        )


def measure_shards(engine: str, count: int = 1000) -> None:
    """What a shard costs the client, and the scheduler where it is in the same process."""
    job = mq.scale.ReachJob.of(mq.Robot.maira(), cell=0.25, directions=20)
    length = job.count // count
    with tempfile.TemporaryDirectory() as place:
        how = {"engine": engine, "workers": 1, "shard": length, "part": (1, 1)}
        used = seconds_of(lambda: mq.scale.run(job, Path(place, "map"), **how))
        print(f"{engine}: {1e3 * used * length / job.count:.2f} ms of client and scheduler per shard", flush=True)


def main() -> None:
    """Measure all of it."""
    measure_poses("maira", 0.1, 200)
    measure_poses("panda", 0.1, 50)
    measure_shards("processes")
    if importlib.util.find_spec("distributed") is not None:
        measure_shards("dask")


if __name__ == "__main__":
    main()
