"""One client at a time: who works on a folder holds a lock on a file in it, which says its process and its machine.

The lock is the kernel's (`flock`): it ends with the process, however that ends, so that no file is ever stale.
"""

from __future__ import annotations

import contextlib
import fcntl
import json
import os
import socket
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from maira_qp.errors import JobError

LOCK = "job.lock"
TRIES, PAUSE = 10, 0.02
"""How often a lock is asked for, and the time between [s]: who only looks holds it for a moment."""


@contextlib.contextmanager
def owned(folder: Path) -> Iterator[None]:
    """Own a folder, which is made if need be, while the block runs. Raises `JobError` if another does, `OSError`."""
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / LOCK
    descriptor = _locked(path)
    try:
        os.ftruncate(descriptor, 0)
        os.write(descriptor, json.dumps({"pid": os.getpid(), "host": socket.gethostname()}).encode())
        yield
    finally:
        with contextlib.suppress(OSError):
            path.unlink()
        os.close(descriptor)


def owner_of(folder: Path) -> dict[str, Any] | None:
    """The process that works on a folder, its `pid` and `host`; None if there is none."""
    path = folder / LOCK
    try:
        descriptor = os.open(path, os.O_RDONLY)
    except FileNotFoundError:
        return None
    try:
        fcntl.flock(descriptor, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return _owner(path)
    finally:
        os.close(descriptor)
    return None


def _locked(path: Path) -> int:
    """A descriptor of the file, locked. Raises `JobError`, `OSError`."""
    for _ in range(TRIES):
        descriptor = os.open(path, os.O_RDWR | os.O_CREAT, 0o666)
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            os.close(descriptor)
            time.sleep(PAUSE)
            continue
        except BaseException:
            os.close(descriptor)
            raise
        if _is_at(descriptor, path):  # else its owner removed it after it was opened here
            return descriptor
        os.close(descriptor)
    owner = _owner(path)
    raise JobError(f"{path.parent} is in use by process {owner['pid']} of the machine {owner['host']!r}")


def _is_at(descriptor: int, path: Path) -> bool:
    try:
        return os.path.samestat(os.fstat(descriptor), os.stat(path))
    except FileNotFoundError:
        return False


def _owner(path: Path) -> dict[str, Any]:
    try:
        owner = json.loads(path.read_text())
        return {"pid": owner["pid"], "host": owner["host"]}
    except (OSError, ValueError, KeyError, TypeError):  # just begun, or just ended
        return {"pid": "?", "host": "?"}
