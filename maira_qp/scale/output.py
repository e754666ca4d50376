"""The output of a job, written from its shards: block by block, so that one block of each worker is in memory."""

from __future__ import annotations

from maira_qp.scale import checksums
from maira_qp.scale.engines.engine import Engine
from maira_qp.scale.engines.here import Here
from maira_qp.scale.plan import Plan
from maira_qp.scale.shards import DamagedShard, Shard, Shards
from maira_qp.scale.work import BlockWork

LARGE = 64 * 2**20
"""From shards of so many bytes on, an output of several blocks is written by the workers of an engine that does it."""
PARTS, MOST_BLOCKS = 4, 32
"""Parts of the output for each worker, if none has more blocks than the latter: a part is not to take minutes."""


def write_output(work: BlockWork, shards: Shards, engine: Engine) -> None:
    """Write the output from the shards, and its checksums last: these are there if no shard was damaged, which is
    removed then, to be done again.

    Raises `OSError`, `JobError`.
    """
    job, folder = work.job, work.folder
    blocks = Shard(0, -(-job.count // job.block))
    if not engine.writes_output or blocks.length == 1 or shards.size() < LARGE:
        engine = Here()
    job.begin_output(folder)
    size = min(-(-blocks.length // (PARTS * engine.workers)), MOST_BLOCKS)
    plan = Plan([blocks], workers=engine.workers, size=size, parts="blocks of the output")
    try:
        engine.run(work, plan, lambda _: None)
    except DamagedShard as damage:
        damage.path.unlink(missing_ok=True)
        return
    job.end_output(folder)
    checksums.remove_parts(folder)
    checksums.write_sums(folder, engine.workers)
