"""Signals that end a command: what they raise arrives, even where Python drops it.

The handler of a signal runs wherever the main thread happens to be. In a function that C code called back, as weak
references and the compiler do, nobody can catch what it raises: Python reports it as ignored, and the command goes on.
So a signal raises again after a second, until what it raised is on its way out. Other C code raises an error of its own
instead: after a signal, an error counts as the signal.
"""

from __future__ import annotations

import contextlib
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from types import FrameType

AGAIN = 1.0
"""After this time [s] a signal raises once more."""


class Terminated(KeyboardInterrupt):
    """SIGTERM: it ends the process as Ctrl-C does, so that files that were begun are removed."""

    code = 128 + signal.SIGTERM


@contextlib.contextmanager
def interruptible() -> Iterator[None]:
    """Within, Ctrl-C raises `KeyboardInterrupt` and SIGTERM `Terminated`; in a thread that may not listen, as before.

    A SIGINT that is ignored, or that has a handler of somebody else, is left alone.
    """
    if threading.current_thread() is not threading.main_thread() or not hasattr(signal, "setitimer"):  # Windows
        yield
        return
    raised: type[KeyboardInterrupt] = Terminated
    was_heard = False

    def hear(number: int, _: FrameType | None) -> None:
        nonlocal raised, was_heard
        raised, was_heard = Terminated if number == signal.SIGTERM else KeyboardInterrupt, True
        signal.setitimer(signal.ITIMER_REAL, AGAIN)
        raise raised

    def remind(*_: object) -> None:
        signal.setitimer(signal.ITIMER_REAL, AGAIN)
        if not _is_on_its_way():
            raise raised

    handlers: dict[int, Callable[[int, FrameType | None], None]] = {signal.SIGTERM: hear, signal.SIGALRM: remind}
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        handlers[signal.SIGINT] = hear
    before = {number: signal.signal(number, handler) for number, handler in handlers.items()}
    try:
        yield
    except Exception as error:
        if was_heard:
            raise raised from error
        raise
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        for number, handler in before.items():
            signal.signal(number, handler)


def _is_on_its_way() -> bool:
    """Whether somebody up the stack is already cleaning up after an interrupt."""
    reason = sys.exc_info()[1]
    while reason is not None and not isinstance(reason, KeyboardInterrupt):
        reason = reason.__context__
    return reason is not None
