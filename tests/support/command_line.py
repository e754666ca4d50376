"""What the tests of the command line share."""

import io
import signal
import sys


def heed_interrupts() -> None:
    """In a process about to begin: Ctrl-C is heard, as from a terminal, even where tests run in the background."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


def misuse(answer):
    """A misuse: exit code 2, nothing on stdout, one line on stderr, which is returned."""
    code, out, err = answer
    assert code == 2
    assert out == ""
    assert err.count("\n") == 1
    assert err.startswith("maira-qp: error: ")
    return err


def pipe_in(monkeypatch, content: bytes) -> None:
    """Standard input holds this."""
    monkeypatch.setattr(sys, "stdin", io.TextIOWrapper(io.BytesIO(content)))
