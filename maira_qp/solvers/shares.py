"""A long list shared out among threads, for work that spends its time where Python's lock is released."""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import FIRST_EXCEPTION, Future, ThreadPoolExecutor, wait
from threading import Event, Lock

Progress = Callable[[int, int], object]
"""Takes how many are done, and how many there are."""

NEVER = Event()
"""For work that nobody interrupts."""

ROUNDS, LEAST = 4, 64
"""A short list is cut into shares so small that every thread has so many, but not smaller than the least."""

TELLING = 0.1
"""Seconds between two calls of `progress` where threads do the work."""


def in_shares(
    work: Callable[[slice, Event], object],
    count: int,
    share: int,
    threads: int | None = None,
    progress: Progress | None = None,
) -> None:
    """Call `work` for slices that make up range(count), each at most a share long, on threads (None: one a processor).

    Ctrl-C, or an exception in one of them, sets the event that `work` is given: it should return soon then. No share is
    begun any more, and the exception is raised. `progress` is called by this thread.
    """
    threads = threads or os.cpu_count() or 1
    share = min(share, max(LEAST, -(-count // (ROUNDS * threads))))
    threads = min(threads, -(-count // share))
    firsts, lock, halted, done = iter(range(0, count, share)), Lock(), Event(), 0

    def take() -> None:
        nonlocal done
        while not halted.is_set():
            with lock:
                first = next(firsts, count)
            if first >= count:
                return
            part = slice(first, min(first + share, count))
            work(part, halted)
            with lock:
                done += part.stop - part.start
            if threads <= 1 and progress is not None:
                progress(done, count)

    if threads <= 1:
        return take()
    pool = ThreadPoolExecutor(threads)
    try:
        left: set[Future[None]] = {pool.submit(take) for _ in range(threads)}
        while left:
            ended, left = wait(left, None if progress is None else TELLING, FIRST_EXCEPTION)
            for each in ended:
                each.result()
            if progress is not None:
                progress(done, count)
    finally:
        halted.set()
        pool.shutdown()
