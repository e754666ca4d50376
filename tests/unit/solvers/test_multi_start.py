"""Exhaustive multi-start, on a function whose basins are known."""

import numpy as np

from maira_qp.solvers.enumeration.exhaustive_multi_start import MOST_STARTS, PATIENCE, multi_start, new_among


def apart(q, others):
    return np.abs(others - q).max(axis=-1, initial=0.0)


def run(arrivals, seed=0, first=()):
    rng = np.random.default_rng(seed)
    return multi_start(arrivals, lambda count: rng.random((count, 1)), apart, 0.01, np.reshape(first, (-1, 1)))


def test_it_finds_every_basin_and_counts_its_starts():
    """Ten basins, one of which leads nowhere."""
    seen = []

    def arrivals(starts):
        seen.extend(np.floor(10 * starts[:, 0]).tolist())
        ends = np.floor(10 * starts)
        return np.where(ends == 7, np.nan, ends)

    found = run(arrivals)
    assert sorted(found.q[:, 0]) == [0, 1, 2, 3, 4, 5, 6, 8, 9]
    assert found.starts == len(seen)
    last_new = max(seen.index(basin) for basin in found.q[:, 0])
    assert found.without_new == len(seen) - 1 - last_new
    assert found.without_new >= PATIENCE


def test_it_gives_up_where_nothing_leads_anywhere():
    found = run(lambda starts: np.full_like(starts, np.nan))
    assert found.q.shape == (0, 1)
    assert found.starts == found.without_new
    assert PATIENCE <= found.starts < 2 * PATIENCE


def test_it_ends_where_solutions_do_not():
    """Every start its own solution, up to the resolution."""
    found = run(lambda starts: 1e6 * starts)
    assert MOST_STARTS <= found.starts < MOST_STARTS + 100


def test_the_given_start_comes_first():
    assert run(lambda starts: starts.round(1), first=[0.7]).q[0, 0] == 0.7


def test_only_strangers_are_new():
    q = np.array([[0.0], [np.nan], [1.0], [1.001], [2.0]])
    assert new_among(q, np.array([[2.0]]), apart, 0.01) == [0, 2]
