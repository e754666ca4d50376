"""What the tests of the command line share."""

import io
import os
import signal
import subprocess
import sys


def heed_interrupts() -> None:
    """In a process about to begin: Ctrl-C is heard, as from a terminal, even where tests run in the background."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


def run_without_reader(*arguments, is_buffered: bool = True) -> tuple[int, str]:
    """Exit code and stderr of the command line whose reader is gone before it begins."""
    reader, writer = os.pipe()
    os.close(reader)
    command = [sys.executable, "-m", "maira_qp", *arguments]
    env = {**os.environ, "PYTHONUNBUFFERED": "" if is_buffered else "1"}
    done = subprocess.run(command, stdout=writer, stderr=subprocess.PIPE, text=True, timeout=600, env=env, check=False)
    os.close(writer)
    return done.returncode, done.stderr


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
