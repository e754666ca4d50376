"""Work that is shared out among threads: all of it, once; what goes wrong stops the rest."""

import threading
import time

import pytest

from maira_qp.solvers.shares import in_shares


@pytest.mark.parametrize("threads", [None, 1, 2, 5])
@pytest.mark.parametrize(("count", "share"), [(0, 4), (1, 4), (4, 4), (103, 4)])
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


def test_progress_is_told_while_threads_are_at_work():
    told = []

    def work(part, halted):
        while len(told) <= part.start // 4:  # ends only if the other thread tells of what was done so far
            time.sleep(0.001)

    in_shares(work, 12, 4, 2, lambda done, count: told.append((done, count, threading.get_ident())))
    assert told == sorted(told)
    assert told[-1] == (12, 12, threading.get_ident())


@pytest.mark.parametrize("threads", [1, 3])
def test_what_goes_wrong_is_raised_and_stops_the_others(threads):
    begun = []

    def work(part, halted):
        begun.append(part.start)
        if part.start == 2:
            raise ValueError("the third")
        if threads > 1:
            assert halted.wait(60)

    with pytest.raises(ValueError, match="the third"):
        in_shares(
            lambda part, halted: None if part.start < 2 and threads == 1 else work(part, halted), 1000, 1, threads
        )
    assert len(begun) <= threads


def test_an_interrupt_stops_threads_at_work():
    ended = []

    def work(part, halted):
        ended.append(halted.wait(60))

    def progress(done, count):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        in_shares(work, 1000, 1, 3, progress)
    assert ended == [True] * 3
