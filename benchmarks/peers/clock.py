"""The clock: contestants take turns over chunks of the same targets, in rounds; the fastest round of each counts.

Turns and rounds spread whatever else the machine does over all contestants alike. A contestant's call is timed alone,
with its conversion of the answer; its conversion of the target is not. A batch is one call over all targets a round,
and its time is shared equally among them.
"""

from __future__ import annotations

import gc
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from time import perf_counter

import numpy as np

from maira_qp.evaluation.contestant import Contestant

CHUNK = 50
"""Targets a turn."""


@dataclass(frozen=True)
class Run:
    """One contestant's round over N targets."""

    seconds: np.ndarray
    """Time (N,) of each target [s]."""
    q: np.ndarray
    """Answers (N, n) [rad], NaN where none is claimed."""
    individual: bool
    """Whether the times were taken target by target."""

    @property
    def claimed(self) -> np.ndarray:
        """Which targets (N,) it claims to have solved."""
        return np.asarray(~np.isnan(self.q).all(axis=1))


def warm_up(contestants: Sequence[Contestant], targets: np.ndarray, starts: np.ndarray) -> None:
    """Let every contestant solve targets (N, 4, 4) from starts (N, n), so that nothing is done for the first time."""
    for contestant in contestants:
        if contestant.solve_all is not None:
            contestant.solve_all(targets)
            continue
        assert contestant.solve is not None
        for target, start in zip(targets, starts, strict=True):
            for given in (None, start) if contestant.draws_starts else (start,):
                contestant.solve(contestant.native(target), given)
            if contestant.step is not None:
                contestant.step(start, contestant.native(target), 0.01)


def race(
    contestants: Sequence[Contestant],
    targets: np.ndarray,
    starts: np.ndarray,
    *,
    given_starts: bool,
    rounds: int,
    advance: Callable[[], object],
) -> list[Run]:
    """The fastest round of each contestant over targets (N, 4, 4).

    Starts (N, n) are for those who cannot draw theirs, or, with `given_starts`, for all. `advance` is called after each
    turn, `turns` times in all.
    """
    natives = [[] if c.solve is None else [c.native(T) for T in targets] for c in contestants]
    best: dict[int, Run] = {}
    for number in range(rounds):
        runs = [_empty(starts.shape, c.solve is not None) for c in contestants]
        for begin in range(0, len(targets), CHUNK):
            part = range(begin, min(begin + CHUNK, len(targets)))
            for k in _order(len(contestants), number + begin // CHUNK):
                contestant = contestants[k]
                if contestant.solve is not None:
                    free = contestant.draws_starts and not given_starts
                    _turn(contestant, natives[k], None if free else starts, part, runs[k])
                    advance()
        for contestant, run in zip(contestants, runs, strict=True):
            if contestant.solve_all is not None:
                _batch(contestant, targets, run)
                advance()
        for k, run in enumerate(runs):
            if k not in best or run.seconds.mean() < best[k].seconds.mean():
                best[k] = run
    return [best[k] for k in range(len(contestants))]


def turns(contestants: Sequence[Contestant], count: int, rounds: int) -> int:
    """How many turns a race over so many targets takes."""
    batches = sum(c.solve is None for c in contestants)
    return rounds * (batches + (len(contestants) - batches) * -(-count // CHUNK))


def ticks(
    contestants: Sequence[Contestant], targets: np.ndarray, q: np.ndarray, dt: float, rounds: int
) -> list[tuple[float, np.ndarray]]:
    """For each contestant with a step: the mean time of one [s] in its fastest round, and velocities (N, n) [rad/s].

    From configurations q (N, n) toward targets (N, 4, 4), in ticks of dt [s].
    """
    natives = [[c.native(T) for T in targets] for c in contestants]
    best: list[tuple[float, np.ndarray]] = [(np.inf, q)] * len(contestants)
    for number in range(rounds):
        for k in _order(len(contestants), number):
            step, v, seconds = contestants[k].step, np.full(q.shape, np.nan), np.empty(len(q))
            assert step is not None
            for i, target in enumerate(natives[k]):
                began = perf_counter()
                v[i] = step(q[i], target, dt)
                seconds[i] = perf_counter() - began
            if seconds.mean() < best[k][0]:
                best[k] = float(seconds.mean()), v
    return best


def _order(count: int, shift: int) -> list[int]:
    """Everybody once, a different one first each time."""
    return [(k + shift) % count for k in range(count)]


def _empty(shape: tuple[int, ...], individual: bool) -> Run:
    return Run(np.zeros(shape[0]), np.full(shape, np.nan), individual)


def _turn(contestant: Contestant, natives: list, starts: np.ndarray | None, part: range, run: Run) -> None:
    """One chunk; what it needs is looked up before the clock starts."""
    solve, seconds, answers = contestant.solve, run.seconds, run.q
    assert solve is not None
    with _no_garbage_collection():
        for i in part:
            target, start = natives[i], None if starts is None else starts[i]
            began = perf_counter()
            result = solve(target, start)
            seconds[i] = perf_counter() - began
            answer = contestant.answer(result)
            if answer.claimed:
                answers[i] = answer.q


def _batch(contestant: Contestant, targets: np.ndarray, run: Run) -> None:
    assert contestant.solve_all is not None
    with _no_garbage_collection():
        began = perf_counter()
        run.q[:] = contestant.solve_all(targets)
        run.seconds[:] = (perf_counter() - began) / len(targets)


@contextmanager
def _no_garbage_collection() -> Iterator[None]:
    """As timeit does: a collection would strike whoever is at work, for what all have left behind."""
    gc.disable()
    try:
        yield
    finally:
        gc.enable()
