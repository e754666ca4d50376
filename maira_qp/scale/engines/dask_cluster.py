"""The engine of a Dask cluster: of this machine, or one whose scheduler runs already. Dask schedules and retries."""

from __future__ import annotations

import importlib.util
from concurrent.futures import CancelledError
from typing import Any

from maira_qp.errors import JobError, OptionError
from maira_qp.scale.engines.engine import Done, Engine, processors
from maira_qp.scale.plan import Plan
from maira_qp.scale.shards import Shard
from maira_qp.scale.work import Work

AHEAD = 2
"""Shards that are handed over at a time, for each worker: one to do and one to go on with."""
TIMEOUT = 30.0
"""How long a scheduler may take to answer the first time [s]."""


class DaskCluster(Engine):
    """Workers of a Dask cluster; a worker that dies is Dask's to replace, and its shard is done again."""

    def __init__(self, workers: int | None = None, *, address: str = "") -> None:
        """At most so many at a time, None: one per processor, or all of a cluster, whose scheduler is at `address`.

        Raises `OptionError` where Dask is not installed.
        """
        if importlib.util.find_spec("distributed") is None:
            raise OptionError("the engine 'dask' needs dask and distributed: pip install 'maira-qp[scale]'")
        self.workers = workers or processors()
        self._limit, self._address = workers, address

    def run(self, work: Work, plan: Plan, done: Done) -> None:
        """See `Engine.run`. Raises `JobError` where the scheduler is not reached, or is lost."""
        from distributed import Client

        place: dict[str, Any] = {"address": self._address} if self._address else self._own()
        try:
            with Client(**place, set_as_default=False, timeout=TIMEOUT) as client, client.as_current():
                self._run(client, work, plan, done)
        except CancelledError as reason:
            raise JobError(f"the scheduler of Dask was lost: {' '.join(str(reason).split())[:300]}") from None
        except OSError as reason:
            if reason.errno is not None and not isinstance(reason, TimeoutError):
                raise  # of a file
            raise JobError(f"the scheduler of Dask is not reached, or was lost: {reason}") from None

    def _own(self) -> dict[str, Any]:
        return {"n_workers": self.workers, "threads_per_worker": 1, "processes": True, "dashboard_address": ":0"}

    def _run(self, client: Any, work: Work, plan: Plan, done: Done) -> None:
        from distributed import KilledWorker, wait

        tasks: dict[Any, Shard] = {}
        slots = self._limit or max(1, sum(client.nthreads().values()))
        while True:
            while len(tasks) < AHEAD * slots and (shard := plan.take()) is not None:
                tasks[client.submit(work, shard, pure=False)] = shard
            if not tasks:
                return
            for task in wait(list(tasks), return_when="FIRST_COMPLETED").done:
                shard = tasks.pop(task)
                try:
                    plan.done(shard, task.result())
                except KilledWorker as reason:
                    plan.failed(shard, f"Dask's workers died of it: {reason}")
                else:
                    done(shard)
