"""Work that is shared out among threads: all of it, once; what goes wrong stops the rest."""

import threading
import time

import pytest

from maira_qp.solvers.compiled import thread_pool as shares
from maira_qp.solvers.compiled.thread_pool import in_shares


@pytest.fixture(autouse=True)
def threads_at_once(monkeypatch):
    """However little is left after the first share."""
    monkeypatch.setattr(shares, "WORTH", -1.0)


@pytest.mark.parametrize("threads", [None, 1, 2, 5])
@pytest.mark.parametrize(("count", "share"), [(0, 4), (1, 4), (4, 4), (8, 4), (103, 4)])
def test_every_entry_is_worked_on_once(threads, count, share):
    done, told = [0] * count, []

    def work(part, halted):
        assert part.stop - part.start <= share
        assert not halted.is_set()
        for i in range(part.start, part.stop):
            done[i] += 1

    in_shares(work, count, share, threads, lambda *so_far: told.append(so_far))
    assert done == [1] * count
    assert told == sorted(told)
    assert told[-1:] == ([(count, count)] if count else [])


@pytest.mark.parametrize(("worth", "expected"), [(-1.0, 3), (1e9, 1)])
def test_threads_begin_where_it_is_worth_it(monkeypatch, worth, expected):
    monkeypatch.setattr(shares, "WORTH", worth)
    idents, together = set(), threading.Barrier(2, timeout=60)

    def work(part, halted):
        idents.add(threading.get_ident())
        if 0 < part.start <= 2 and expected > 1:
            together.wait()

    in_shares(work, 9, 1, 2)
    assert len(idents) == expected


def test_progress_is_told_while_threads_are_at_work():
    told = []

    def work(part, halted):
        while len(told) < part.start // 4:  # ends only if the other thread tells of what was done so far
            time.sleep(0.001)

    in_shares(work, 16, 4, 2, lambda done, count: told.append((done, count, threading.get_ident())))
    assert told == sorted(told)
    assert told[-1] == (16, 16, threading.get_ident())


@pytest.mark.parametrize("threads", [1, 3])
def test_what_goes_wrong_is_raised_and_stops_the_others(threads):
    begun = []

    def work(part, halted):
        begun.append(part.start)
        if part.start == 3:
            raise ValueError("the fourth")
        if threads > 1 and part.start > 0:
            assert halted.wait(60)

    with pytest.raises(ValueError, match="the fourth"):
        in_shares(work, 1000, 1, threads)
    assert sorted(begun) == [0, 1, 2, 3]


def test_an_interrupt_stops_threads_at_work():
    ended = []

    def work(part, halted):
        if part.start > 0:
            ended.append(halted.wait(60))

    def progress(done, count):
        if len(threading.enumerate()) > before:
            raise KeyboardInterrupt

    before = len(threading.enumerate())
    with pytest.raises(KeyboardInterrupt):
        in_shares(work, 1000, 1, 3, progress)
    assert set(ended) == {True}
