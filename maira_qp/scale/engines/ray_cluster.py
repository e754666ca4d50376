"""The engine of a Ray cluster: of this machine, or one that runs already. Ray schedules and retries."""

from __future__ import annotations

import importlib.util
from typing import Any

from maira_qp.errors import OptionError
from maira_qp.scale.engines.engine import Done, Engine, processors
from maira_qp.scale.plan import ATTEMPTS, Plan
from maira_qp.scale.shards import Shard
from maira_qp.scale.work import Work

AHEAD = 2
"""Shards that are handed over at a time, for each worker."""


class RayCluster(Engine):
    """Tasks of a Ray cluster, one processor each; a task whose worker dies is done again by Ray."""

    def __init__(self, workers: int | None = None, *, address: str = "") -> None:
        """At most so many at a time, None: one per processor, or all that a cluster has, which is at `address`.

        Raises `OptionError` where Ray is not installed.
        """
        if importlib.util.find_spec("ray") is None:
            raise OptionError("the engine 'ray' needs ray: pip install 'maira-qp[ray]'")
        self.workers = workers or processors()
        self._limit, self._address = workers, address

    def run(self, work: Work, plan: Plan, done: Done) -> None:
        """See `Engine.run`."""
        import ray  # pyright: ignore[reportMissingImports]

        here = {"num_cpus": self.workers, "include_dashboard": False}
        place: dict[str, Any] = {"address": self._address} if self._address else here
        began = not ray.is_initialized()
        if began:
            ray.init(**place, log_to_driver=False)
        try:
            self._run(ray, work, plan, done)
        finally:
            if began:
                ray.shutdown()

    def _run(self, ray: Any, work: Work, plan: Plan, done: Done) -> None:
        task, shared = ray.remote(num_cpus=1, max_retries=ATTEMPTS)(_do), ray.put(work)
        slots, tasks = self._limit or max(1, int(ray.cluster_resources().get("CPU", 1))), dict[Any, Shard]()
        while True:
            while len(tasks) < AHEAD * slots and (shard := plan.take()) is not None:
                tasks[task.remote(shared, shard)] = shard
            if not tasks:
                return
            (ready,), _ = ray.wait(list(tasks), num_returns=1)
            shard = tasks.pop(ready)
            try:
                plan.done(shard, ray.get(ready))
            except ray.exceptions.RayTaskError as reason:
                raise reason.cause or reason from None
            except ray.exceptions.WorkerCrashedError as reason:
                plan.failed(shard, str(reason))
            else:
                done(shard)


def _do(work: Work, shard: Shard) -> float:
    return work(shard)
