"""A worker of `processes.py`: a process that does shards which come by a pipe, until the pipe ends.

It begins as `python -c` with one line, so that no module of the caller's is run a second time. When the pipe ends, the
client is no more, and the worker ends at once, in the middle of its shard.
"""

from __future__ import annotations

import os
import pickle
import queue
import signal
import sys
import threading
import traceback
from multiprocessing.connection import Connection
from typing import Any

from maira_qp.scale.shards import Shard

STARTED, DONE, FAILED = "started", "done", "failed"


def serve(descriptor: int) -> None:
    """Take the work, then shards, from the pipe; answer each with how long it took [s], or with what went wrong."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the client ends its workers
    os.dup2(2, 1)  # nothing that a library prints gets into the client's output
    channel, inbox = Connection(descriptor), queue.SimpleQueue[Any]()
    threading.Thread(target=_listen, args=(channel, inbox), daemon=True).start()
    work = pickle.loads(inbox.get())
    channel.send((STARTED, None))
    while True:
        shard: Shard = inbox.get()
        try:
            channel.send((DONE, work(shard)))
        except Exception as reason:
            channel.send((FAILED, (_portable(reason), traceback.format_exc())))


def _listen(channel: Connection, inbox: queue.SimpleQueue[Any]) -> None:
    try:
        while True:
            inbox.put(channel.recv())
    except (EOFError, OSError):
        os._exit(0)


def _portable(reason: Exception) -> Exception | None:
    """An exception that can be sent; None if it cannot."""
    try:
        return pickle.loads(pickle.dumps(reason))
    except Exception:
        return None


if __name__ == "__main__":
    serve(int(sys.argv[1]))
