"""What happens when the reader of the output goes away, as in `maira-qp solve ... | head -1`."""

from __future__ import annotations

import contextlib
import os
import sys
from collections.abc import Iterator


def drop_output() -> None:
    """What is still to be written has no reader; without this the interpreter would complain as it ends."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def replace_closed_streams() -> None:
    """A process may be started without stdout or stderr (`>&-`), which Python makes None: then nobody reads them."""
    for name in ("stdout", "stderr"):
        if getattr(sys, name) is None:
            setattr(sys, name, open(os.devnull, "w", encoding="utf-8"))  # noqa: SIM115, it stays open to the end


@contextlib.contextmanager
def reader_may_leave() -> Iterator[None]:
    """Around output behind which there is an exit code: it is the verdict, whether somebody reads to the end or not."""
    try:
        yield
        sys.stdout.flush()
    except BrokenPipeError:
        drop_output()
