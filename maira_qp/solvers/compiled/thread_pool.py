"""A long list shared out among threads, for work that spends its time where Python's lock is released."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator
from concurrent.futures import FIRST_EXCEPTION, Future, ThreadPoolExecutor, wait
from threading import Event, Lock

import numpy as np

Progress = Callable[[int, int], object]
"""Takes how many are done, and how many there are."""

NEVER = Event()
"""For work that nobody interrupts."""

ATTEMPTS = 30_000
"""Attempts at targets that resist, at most, between two looks at whether the work is to stop."""

ROUNDS, LEAST = 4, 256
"""For several threads a short list is cut so that each has so many shares, none of them shorter than the least."""

WORTH = 0.01
"""Seconds of work left for which it is worth to start threads."""

TELLING = 0.1
"""Seconds between two calls of `progress` where threads do the work."""


def in_shares(
    work: Callable[[slice, Event], object],
    count: int,
    share: int,
    threads: int | None = None,
    progress: Progress | None = None,
) -> None:
    """Call `work` for slices that make up range(count), each at most a share long, on threads; None: one per processor.

    The first are done by this thread; others begin if it takes long. Ctrl-C, or an exception in one of them, sets the
    event that `work` is given: it should return soon then. No share is begun any more, and the exception is raised.
    `progress` is called by this thread.
    """
    threads = threads or os.cpu_count() or 1
    if threads > 1:
        share = min(share, max(LEAST, -(-count // (ROUNDS * threads))))
    firsts, lock, halted, done = iter(range(0, count, share)), Lock(), Event(), 0

    def take() -> bool:
        """Do one share; whether there was one."""
        nonlocal done
        with lock:
            first = next(firsts, count)
        if first >= count or halted.is_set():
            return False
        part = slice(first, min(first + share, count))
        work(part, halted)
        with lock:
            done += part.stop - part.start
        return True

    def take_all() -> None:
        while take():
            pass

    begin = time.perf_counter()
    while take():
        if progress is not None:
            progress(done, count)
        seconds_left = (time.perf_counter() - begin) * (count - done) / done
        if threads > 1 and count - done > share and seconds_left > WORTH:
            break
    threads = min(threads, -(-(count - done) // share))
    if not threads:
        return
    pool = ThreadPoolExecutor(threads)
    try:
        left: set[Future[None]] = {pool.submit(take_all) for _ in range(threads)}
        while left:
            ended, left = wait(left, None if progress is None else TELLING, FIRST_EXCEPTION)
            for each in ended:
                each.result()
            if progress is not None:
                progress(done, count)
    finally:
        halted.set()
        pool.shutdown()


def parts(some: np.ndarray, attempts: int, halted: Event) -> Iterator[np.ndarray]:
    """Some of the targets in parts of so many that their attempts, so many each, take no more than a moment."""
    most = max(1, ATTEMPTS // attempts)
    for first in range(0, len(some), most):
        if halted.is_set():
            return
        yield some[first : first + most]
