"""The clock: libraries take turns over a whole scene, in rounds, another one first each time.

All rounds of a library are the same ticks, so the fastest of each tick counts: what else the machine does strikes
ticks, not libraries. A tick is timed from the target to the next configuration, the library's own update included.
"""

from __future__ import annotations

import gc
from collections.abc import Sequence
from dataclasses import dataclass, replace
from time import perf_counter

import numpy as np

from maira_qp.evaluation.contestant import Contestant
from scenes.problems import Scene

WARM_UP = 20
"""Ticks before the clock starts, from the scene's start, which then begins anew."""


@dataclass(frozen=True)
class Run:
    """A library's rounds over a scene of N ticks."""

    seconds: np.ndarray
    """Time (N,) of each tick, the shortest of all rounds [s]."""
    q: np.ndarray
    """Configurations (N + 1, n) [rad], the start first."""
    failed: int
    """Ticks in which it raised an error; the arm stood still in them."""

    @property
    def travel(self) -> float:
        """How far all joints went together [rad]: a joint that runs to and fro goes far."""
        return float(np.abs(np.diff(self.q, axis=0)).sum())


def race(scene: Scene, contestants: Sequence[Contestant], rounds: int) -> list[Run]:
    """What each contestant did, and in what time."""
    natives = [[each.native(target) for target in scene.targets] for each in contestants]
    for each, targets in zip(contestants, natives, strict=True):
        _run(scene, each, targets[:WARM_UP])
    runs: dict[int, Run] = {}
    for shift in range(rounds):
        for k in range(len(contestants)):
            index = (k + shift) % len(contestants)
            run = _run(scene, contestants[index], natives[index])
            if index in runs:
                run = replace(run, seconds=np.minimum(run.seconds, runs[index].seconds))
            runs[index] = run
    return [runs[k] for k in range(len(contestants))]


def _run(scene: Scene, contestant: Contestant, targets: Sequence) -> Run:
    assert contestant.control is not None
    tick = contestant.control()
    seconds, q, failed = np.zeros(len(targets)), [scene.start], 0
    gc.collect()
    gc.disable()  # as timeit does: a collection would strike whoever is at work
    try:
        for k, target in enumerate(targets):
            began = perf_counter()
            try:
                ahead = tick(target)
            except Exception:  # a QP without a solution, in whatever type its library says so
                ahead, failed = q[-1], failed + 1
            seconds[k] = perf_counter() - began
            q.append(np.array(ahead))
    finally:
        gc.enable()
    return Run(seconds, np.array(q), failed)
