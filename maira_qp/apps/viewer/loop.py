"""What keeps a session going: a thread that ticks at 60 Hz, and two that do its jobs beside it.

Whoever wants something of the session leaves it in the mailbox, from any thread and without waiting; it is done before
the next tick. Of what is left under one key the latest counts, of what has no key all.
"""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from functools import partial

from maira_qp.apps.viewer.answers import Job
from maira_qp.apps.viewer.session import Session
from maira_qp.apps.viewer.view import View

log = logging.getLogger(__name__)

PERIOD = 1 / 60
"""Length of a tick [s]"""
LONGEST = 0.1
"""What a tick that comes late makes good of at most [s]."""


class Mailbox:
    """What is to be done, of each key the latest, in the order in which the keys came."""

    def __init__(self) -> None:
        self._actions: dict[object, Callable[[Session], None]] = {}
        self._lock = threading.Lock()

    def put(self, key: str, action: Callable[[Session], None]) -> None:
        """Instead of what was there under the key."""
        with self._lock:
            self._actions[key] = action

    def add(self, action: Callable[[Session], None]) -> None:
        """Beside all that is there."""
        with self._lock:
            self._actions[object()] = action

    def take(self) -> list[Callable[[Session], None]]:
        """All of it; the mailbox is empty then."""
        with self._lock:
            actions, self._actions = list(self._actions.values()), {}
        return actions


class Helper:
    """A thread that does one job at a time."""

    def __init__(self, name: str) -> None:
        self._executor = ThreadPoolExecutor(1, thread_name_prefix=name)
        self._running: tuple[Job, Future] | None = None

    def turn(self, next_job: Callable[[], Job | None]) -> None:
        """Writes back what is done, and takes the next job if it is free. Raises what the job raised."""
        if self._running is not None and self._running[1].done():
            (job, future), self._running = self._running, None
            job.write(future.result())
        if self._running is None:
            job = next_job()
            if job is not None:
                self._running = job, self._executor.submit(job.think)

    def close(self) -> None:
        """No more jobs; one that runs is not waited for."""
        self._executor.shutdown(wait=False, cancel_futures=True)


class Loop:
    """Ticks a session until it is stopped. What goes wrong in a tick is told, and it goes on."""

    def __init__(
        self, session: Session, show: Callable[[Session, View], None], failed: Callable[[Exception], None]
    ) -> None:
        """`show` is called after each tick, `failed` for what went wrong, both in the loop's thread."""
        self.session = session
        self.mailbox = Mailbox()
        self._show, self._failed = show, failed
        self._helpers = Helper("viewer-job"), Helper("viewer-long-job")
        self._ends = threading.Event()
        self._thread = threading.Thread(target=self._run, name="viewer-loop", daemon=True)

    def start(self) -> None:
        """Begin."""
        self._thread.start()

    def stop(self) -> None:
        """End, once the tick that runs is over."""
        self._ends.set()
        self._thread.join(timeout=5)
        for helper in self._helpers:
            helper.close()

    def _run(self) -> None:
        last = time.perf_counter()
        while not self._ends.is_set():
            now = time.perf_counter()
            for action in self.mailbox.take():
                self._guarded(partial(action, self.session))
            self._guarded(partial(self._turn, min(max(now - last, PERIOD), LONGEST)))
            last = now
            self._ends.wait(max(0.0, now + PERIOD - time.perf_counter()))

    def _turn(self, dt: float) -> None:
        session = self.session
        short, long = self._helpers
        short.turn(session.next_job)
        long.turn(session.next_long_job)
        self._show(session, session.tick(dt))

    def _guarded(self, action: Callable[[], None]) -> None:
        """Does it; an error is told."""
        try:
            action()
        except Exception as reason:
            log.debug("in the viewer's loop", exc_info=True)
            self._failed(reason)
