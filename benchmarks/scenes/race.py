"""The clock: libraries take turns over a whole scene, in rounds, another one first each time; the best round counts.

A tick is timed from the target to the next configuration, the library's own update of it included.
"""

from __future__ import annotations

import gc
from collections.abc import Sequence
from dataclasses import dataclass
from time import perf_counter

import numpy as np

from scenes.players import Player
from scenes.problems import Scene

WARM_UP = 20
"""Ticks before the clock starts, from the scene's start, which then begins anew."""


@dataclass(frozen=True)
class Run:
    """A library's best round over a scene of N ticks."""

    seconds: np.ndarray
    """(N,) [s]"""
    q: np.ndarray
    """Configurations (N + 1, n) [rad], the start first."""
    failed: int
    """Ticks in which it raised an error; the arm stood still in them."""


def race(scene: Scene, players: Sequence[Player], rounds: int) -> list[Run]:
    """The best round of each player."""
    natives = [[player.native(scene, target) for target in scene.targets] for player in players]
    for player, targets in zip(players, natives, strict=True):
        _run(scene, player, targets[:WARM_UP])
    best: dict[int, Run] = {}
    for shift in range(rounds):
        for k in range(len(players)):
            index = (k + shift) % len(players)
            run = _run(scene, players[index], natives[index])
            if index not in best or run.seconds.mean() < best[index].seconds.mean():
                best[index] = run
    return [best[k] for k in range(len(players))]


def _run(scene: Scene, player: Player, targets: Sequence) -> Run:
    tick = player.build(scene)
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
