"""The viewer's loop: a mailbox, helpers beside it, and nothing that ends it but its end."""

import threading
import time

import pytest

from maira_qp.apps.viewer.answers import Job
from maira_qp.apps.viewer.loop import Helper, Loop, Mailbox
from maira_qp.apps.viewer.session import Session


def until(condition, seconds: float = 20.0) -> bool:
    """Waits until something is true; whether it came true."""
    end = time.monotonic() + seconds
    while not condition():
        if time.monotonic() > end:
            return False
        time.sleep(0.01)
    return True


def test_the_latest_of_each_key_counts_in_the_order_in_which_the_keys_came():
    mailbox, done = Mailbox(), []
    for key, value in (("target", 1), ("joint", 2), ("target", 3)):
        mailbox.put(key, lambda _, value=value: done.append(value))
    for action in mailbox.take():
        action(None)
    assert done == [3, 2]
    assert mailbox.take() == []


def test_of_what_has_no_key_all_counts_in_the_order_in_which_it_came():
    mailbox, done = Mailbox(), []
    for value in range(3):
        mailbox.add(lambda _, value=value: done.append(value))
        mailbox.put("key", lambda _: done.append("latest"))
    for action in mailbox.take():
        action(None)
    assert done == [0, "latest", 1, 2]


def test_a_helper_does_one_job_at_a_time_and_writes_in_the_thread_that_asks():
    helper, gate, threads = Helper("helper"), threading.Event(), []
    jobs = [Job(lambda: gate.wait(20) and threading.get_ident(), threads.append) for _ in range(2)]
    asked = []

    def next_job():
        asked.append(1)
        return jobs.pop() if jobs else None

    helper.turn(next_job)
    helper.turn(next_job)
    assert (len(asked), threads) == (1, [])
    gate.set()
    assert until(lambda: helper.turn(next_job) or len(threads) == 2)
    assert threading.get_ident() not in threads
    helper.close()


def test_what_a_job_raises_is_raised_and_the_next_one_is_done():
    helper, written = Helper("helper"), []
    jobs = [Job(lambda: 1, written.append), Job(lambda: 1 / 0, written.append)]

    def turn():
        helper.turn(lambda: jobs.pop() if jobs else None)
        return bool(written)

    turn()
    with pytest.raises(ZeroDivisionError):
        until(turn)
    assert until(turn)
    helper.close()


def test_the_loop_outlives_what_goes_wrong_in_it(maira):
    shown, failures = [], []
    loop = Loop(Session(maira), lambda session, view: shown.append(view), failures.append)
    loop.start()
    assert until(lambda: shown)
    loop.mailbox.put("wrong", lambda session: 1 / 0)
    assert until(lambda: failures)
    count = len(shown)
    assert until(lambda: len(shown) > count + 3)
    assert [type(reason) for reason in failures] == [ZeroDivisionError]
    loop.stop()
    count = len(shown)
    time.sleep(0.1)
    assert len(shown) == count
