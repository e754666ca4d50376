"""The clock: contestants take turns over the same paths, another one first each time.

A path is one call, timed by the processor time of the process, which other processes on the machine do not lengthen.
"""

from __future__ import annotations

import gc
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from time import process_time

import numpy as np

from maira_qp.evaluation.contestant import Contestant
from paths.motions import Path


@dataclass(frozen=True)
class Run:
    """A contestant along one path."""

    seconds: float
    start: np.ndarray | None
    """The configuration (n,) that it was given for the first pose [rad]."""
    q: np.ndarray | None
    """Configurations (m, n) [rad]; None, or fewer than there are poses, where it gave up."""
    error: str = ""
    """What it raised, if anything."""


def race(
    paths: Sequence[Path],
    contestants: Sequence[Contestant],
    *,
    starts_given: bool,
    advance: Callable[[], object],
) -> list[list[Run]]:
    """For each contestant its run along each path, from the motion's own first configuration or from any.

    `advance` is called after each run.
    """
    runs: list[list[Run]] = [[] for _ in contestants]
    for number, path in enumerate(paths):
        start = path.start if starts_given else None
        for k in range(len(contestants)):
            index = (k + number) % len(contestants)
            runs[index].append(_run(contestants[index], path, start))
            advance()
    return runs


def _run(contestant: Contestant, path: Path, start: np.ndarray | None) -> Run:
    follow, targets, q, error = contestant.follow, contestant.native(path.poses), None, ""
    assert follow is not None
    gc.collect()
    gc.disable()  # as timeit does: a collection would strike whoever is at work
    began = process_time()
    try:
        q = follow(targets, start)
    except Exception as reason:  # a path that a peer cannot follow, in whatever type it says so
        error = f"{type(reason).__name__}: {reason}"
    finally:
        seconds = process_time() - began
        gc.enable()
    return Run(seconds, start, q, error)
