"""The engine that is this process itself: one shard after another, for small jobs and for a look at what is slow."""

from __future__ import annotations

from maira_qp.scale.engines.engine import Done, Engine
from maira_qp.scale.plan import Plan
from maira_qp.scale.work import Work


class Here(Engine):
    """Does all shards in this process."""

    workers = 1

    def run(self, work: Work, plan: Plan, done: Done) -> None:
        """See `Engine.run`; a shard that hangs is not noticed."""
        while (shard := plan.take()) is not None:
            plan.done(shard, work(shard))
            done(shard)
