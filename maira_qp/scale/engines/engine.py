"""What an engine is, and the choice of one by its name."""

from __future__ import annotations

import os
from abc import ABC, abstractmethod
from collections.abc import Callable
from importlib import import_module

from maira_qp.errors import OptionError, listed, shown
from maira_qp.scale.plan import Plan
from maira_qp.scale.shards import Shard
from maira_qp.scale.work import Work

ENGINES = {
    "processes": "maira_qp.scale.engines.processes:Processes",
    "here": "maira_qp.scale.engines.here:Here",
    "dask": "maira_qp.scale.engines.dask_cluster:DaskCluster",
    "ray": "maira_qp.scale.engines.ray_cluster:RayCluster",
}
"""Engines by their names, each a module and a class."""
Done = Callable[[Shard], object]
"""Takes each shard that is done."""


class Engine(ABC):
    """Does the shards of a plan, some at a time, each by one worker."""

    workers: int
    """How many at a time."""
    writes_output = False
    """Whether its workers write a large output together; else the client does alone."""

    @abstractmethod
    def run(self, work: Work, plan: Plan, done: Done) -> None:
        """Take parts of some work, such as shards, from the plan until it is empty, and do them.

        A worker that dies, or takes longer than it may, is replaced, and the plan is told that its shard failed.
        Raises what the job raises, `OSError`, and `JobError` where a shard fails each time.
        """


def engine_of(
    name: str | Engine, workers: int | None = None, time_limit: float | None = None, address: str = ""
) -> Engine:
    """An engine by its name, or the one that was given. Raises `OptionError`, also for what it does not take."""
    if time_limit is not None and name != "processes":
        raise OptionError("time_limit is for the engine 'processes' alone: leave it out")
    if address and name not in ("dask", "ray"):
        raise OptionError("address is for the engines 'dask' and 'ray': leave it out")
    if isinstance(name, Engine):
        return name
    if not isinstance(name, str) or name not in ENGINES:
        raise OptionError(f"no engine {shown(name)}; {listed(ENGINES, name)}")
    if workers is not None and (isinstance(workers, bool) or not isinstance(workers, int) or workers < 1):
        raise OptionError(f"workers must be a positive whole number, got {shown(workers)}")
    module, _, kind = ENGINES[name].partition(":")
    if name == "here":
        if workers not in (None, 1):
            raise OptionError("the engine 'here' is this process alone: leave out workers, or take 'processes'")
        return getattr(import_module(module), kind)()
    if name == "processes":
        limits = {} if time_limit is None else {"time_limit": time_limit}
        return getattr(import_module(module), kind)(workers, **limits)
    return getattr(import_module(module), kind)(workers, address=address)


def processors() -> int:
    """How many processors this process may use."""
    return len(os.sched_getaffinity(0))
