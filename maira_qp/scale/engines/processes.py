"""The engine of processes on this machine. A worker that dies or hangs is replaced, and its shard is done again."""

from __future__ import annotations

import contextlib
import os
import pickle
import subprocess
import sys
import time
from collections.abc import Mapping
from multiprocessing import Pipe
from multiprocessing.connection import Connection, wait

from maira_qp.errors import JobError, MairaError, OptionError
from maira_qp.scale.engines.engine import Done, Engine, processors
from maira_qp.scale.engines.worker import DONE, FAILED
from maira_qp.scale.plan import ATTEMPTS, Plan
from maira_qp.scale.shards import Shard
from maira_qp.scale.work import Work

PROGRAM = "import sys; sys.path[:] = {path!r}; from maira_qp.scale.engines import worker; worker.serve({descriptor})"
LIBRARIES = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")
"""Variables that say how many threads libraries begin: as many as a worker is to have."""
ENDING = 5.0
"""How long a worker that has closed its pipe may take to end [s]."""


class Processes(Engine):
    """Workers that are processes of this machine."""

    writes_output = True

    def __init__(self, workers: int | None = None, *, time_limit: float = 600.0) -> None:
        """So many workers, None: one per processor; a shard may take `time_limit` [s], > 0. Raises `OptionError`."""
        if not time_limit > 0:
            raise OptionError(f"time_limit must be positive, got {time_limit}")
        self.workers = processors() if workers is None else workers
        self.time_limit = time_limit

    def run(self, work: Work, plan: Plan, done: Done) -> None:
        """See `Engine.run`."""
        program, busy = pickle.dumps(work), dict[Connection, _Worker]()
        self._lost = 0
        try:
            while True:
                while len(busy) < self.workers and not plan.is_empty:
                    worker = _Worker(program, work.threads)
                    busy[worker.channel] = worker
                if not busy:
                    return
                ready = wait(list(busy), self._time_left(busy))
                for channel in ready:
                    worker = busy[channel]  # type: ignore[index]
                    if not self._heard(worker, plan, done):
                        del busy[worker.channel]
                        worker.end()
                self._end_late(busy, plan)
        finally:
            for worker in busy.values():
                worker.end()

    def _heard(self, worker: _Worker, plan: Plan, done: Done) -> bool:
        """Take what a worker says; whether it has another shard to do now."""
        try:
            kind, value = worker.channel.recv()
        except (EOFError, OSError):
            code = worker.ended()
            if worker.shard is not None:
                plan.failed(worker.shard, f"the worker ended with exit code {code}")
            else:
                self._lost += 1
            if self._lost >= ATTEMPTS:
                raise JobError(f"{self._lost} workers ended before they began, with exit code {code}") from None
            return False
        if kind == FAILED:
            assert worker.shard is not None
            raise _what(value, worker.shard, plan.parts)
        if kind == DONE:
            assert worker.shard is not None
            plan.done(worker.shard, value)
            done(worker.shard)
        return worker.give(plan.take())

    def _time_left(self, busy: Mapping[Connection, _Worker]) -> float | None:
        begun = [worker.begun for worker in busy.values() if worker.shard is not None]
        return max(0.0, min(begun) + self.time_limit - time.monotonic()) if begun else None

    def _end_late(self, busy: dict[Connection, _Worker], plan: Plan) -> None:
        for worker in [each for each in busy.values() if each.shard is not None]:
            if time.monotonic() - worker.begun >= self.time_limit and not worker.channel.poll():
                del busy[worker.channel]
                worker.end()
                assert worker.shard is not None
                plan.failed(worker.shard, f"it took longer than the {self.time_limit:g} s of the time limit")


class _Worker:
    """A process, the pipe to it, and the shard that it does."""

    def __init__(self, program: bytes, threads: int) -> None:
        self.channel, theirs = Pipe()
        code = PROGRAM.format(path=sys.path, descriptor=theirs.fileno())
        environment = os.environ | {name: str(threads) for name in LIBRARIES}
        with theirs:
            self._process = subprocess.Popen(
                [sys.executable, "-c", code],
                pass_fds=[theirs.fileno()],
                stdin=subprocess.DEVNULL,
                env=environment,
                start_new_session=True,  # Ctrl-C in a terminal is for the client
            )
        with contextlib.suppress(OSError):
            self.channel.send(program)
        self.shard: Shard | None = None
        self.begun = 0.0

    def give(self, shard: Shard | None) -> bool:
        """Let it do a shard; whether there is one."""
        self.shard, self.begun = shard, time.monotonic()
        if shard is not None:
            with contextlib.suppress(OSError):  # it is no more, which is seen when it is listened to
                self.channel.send(shard)
        return shard is not None

    def ended(self) -> int:
        """Its exit code, once it has closed the pipe."""
        with contextlib.suppress(subprocess.TimeoutExpired):
            return self._process.wait(ENDING)
        self.end()
        return self._process.returncode

    def end(self) -> None:
        """End it, whatever it does."""
        self.channel.close()
        self._process.kill()
        self._process.wait()


def _what(value: tuple[Exception | None, str], shard: Shard, parts: str) -> Exception:
    """What a worker says went wrong, to be raised: the job's own errors and those of files as they are."""
    reason, trace = value
    if isinstance(reason, (MairaError, OSError)):
        return reason
    return JobError(f"the {parts} {shard.first} to {shard.last - 1} failed:\n{trace}")
