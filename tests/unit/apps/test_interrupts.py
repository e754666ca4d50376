"""Signals end a command wherever they find it, and leave nothing behind."""

import contextlib
import ctypes
import os
import signal
import sys
import threading
import time
from xml.etree import ElementTree

import pytest

from maira_qp.apps.interrupts import AGAIN, Terminated, interruptible

SIGNALS = [(signal.SIGINT, KeyboardInterrupt), (signal.SIGTERM, Terminated)]


@pytest.fixture(autouse=True)
def reported_as_ignored(monkeypatch):
    """What Python says of an exception that nobody can catch."""
    said = []
    monkeypatch.setattr(sys, "unraisablehook", said.append)
    return said


@pytest.fixture(autouse=True)
def heeded_interrupts():
    """Ctrl-C is heard, even where tests run in the background."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


def wait() -> None:
    """Works until it is interrupted; not for ever."""
    end = time.monotonic() + 60 * AGAIN
    while time.monotonic() < end:
        time.sleep(0.01)


def send(sign: int) -> None:
    """A command that gets a signal."""
    with interruptible():
        os.kill(os.getpid(), sign)
        wait()


def send_in_a_callback(sign: int) -> None:
    """The signal's handler runs in a function that C code calls."""
    with interruptible():
        ctypes.CFUNCTYPE(None)(lambda: os.kill(os.getpid(), sign))()
        wait()


def send_in_a_generator(sign: int) -> None:
    """The signal's handler runs in a generator, of which C code says only that it is none of its sequences."""

    def numbers():
        os.kill(os.getpid(), sign)
        wait()
        yield 1

    with interruptible():
        ElementTree.Element("robot").extend(numbers())


@pytest.mark.parametrize(("sign", "kind"), SIGNALS)
@pytest.mark.parametrize("command", [send, send_in_a_callback, send_in_a_generator])
def test_a_signal_ends_a_command_wherever_it_comes(command, sign, kind):
    with pytest.raises(KeyboardInterrupt) as raised:
        command(sign)
    assert raised.type is kind


def test_a_callback_drops_what_a_signal_raises(reported_as_ignored):
    with pytest.raises(Terminated):
        send_in_a_callback(signal.SIGTERM)
    assert [ignored.exc_type for ignored in reported_as_ignored] == [Terminated]


def test_a_signal_raises_once():
    with contextlib.suppress(Terminated):
        send(signal.SIGTERM)
    time.sleep(1.5 * AGAIN)


def test_errors_without_a_signal_are_what_they_are():
    with pytest.raises(ValueError, match="mine"), interruptible():
        raise ValueError("mine")


def test_who_cleans_up_is_not_interrupted_again():
    cleaned = False
    with contextlib.suppress(Terminated), interruptible():
        try:
            os.kill(os.getpid(), signal.SIGTERM)
            wait()
        finally:
            time.sleep(2.5 * AGAIN)
            cleaned = True
    assert cleaned


def test_what_listened_before_listens_again():
    of_signals = {sign: signal.getsignal(sign) for sign in (signal.SIGINT, signal.SIGTERM, signal.SIGALRM)}
    with interruptible():
        assert signal.getsignal(signal.SIGTERM) is not of_signals[signal.SIGTERM]
    assert {sign: signal.getsignal(sign) for sign in of_signals} == of_signals
    assert signal.getitimer(signal.ITIMER_REAL) == (0.0, 0.0)


def test_an_ignored_ctrl_c_stays_ignored():
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        with interruptible():
            assert signal.getsignal(signal.SIGINT) is signal.SIG_IGN
    finally:
        signal.signal(signal.SIGINT, before)


def test_a_thread_that_may_not_listen_goes_on():
    done = []

    def work() -> None:
        with interruptible():
            done.append(True)

    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    assert done
