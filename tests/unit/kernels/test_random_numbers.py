"""The random numbers of a target: splitmix64, begun by the target and the seed alone."""

import numpy as np
from support.compiled_problems import arm, reachable_rows
from support.seeds import WORD, splitmix

from maira_qp.kernels.search.random_numbers import next_random, state_of, stream_of, streams_of


def stream(row: np.ndarray, *seed: int) -> int:
    return int(stream_of(row, np.array(seed, dtype=np.uint64)))


def test_the_generator_gives_the_published_numbers():
    """The first five of splitmix64 from 1234567."""
    state, found = np.uint64(1234567), []
    for _ in range(5):
        bits, state = next_random(np.uint64(state))
        found.append(int(bits))
    assert found == [
        6457827717110365317,
        3203168211198807973,
        9817491932198370423,
        4593380528125082431,
        16408922859458223821,
    ]


def test_the_generator_is_its_twin_at_any_state(rng):
    for state in [0, 1, 2**63 - 1, 2**63, WORD - 1, *map(int, rng.integers(0, WORD - 1, 500, dtype=np.uint64))]:
        assert tuple(map(int, next_random(np.uint64(state)))) == splitmix(state)


def test_a_stream_depends_on_each_number_of_the_target_and_on_both_words_of_the_seed(rng):
    """On the last bit of each."""
    row = reachable_rows(arm("maira"), rng, 1)[0]
    others = [stream(row, 3, 4)]
    for i in range(12):
        changed = row.copy()
        changed[i] = np.nextafter(changed[i], 9)
        others.append(stream(changed, 3, 4))
        others.append(stream(np.roll(row, i + 1), 3, 4) if i < 11 else stream(row[::-1].copy(), 3, 4))
    others += [stream(row, *seed) for seed in [(2, 4), (3, 5), (4, 3), (0, 0), (2**63, 4), (3, 2**63), (WORD - 1, 4)]]
    assert len(set(others)) == len(others)
    assert stream(row, 3, 4) == others[0]


def test_streams_of_many_targets_and_seeds_all_differ_and_half_of_their_bits_are_set(rng):
    rows = reachable_rows(arm("maira"), rng, 200)
    found = np.array([stream(row, seed, 0) for row in rows for seed in range(10)], dtype=np.uint64)
    assert len(np.unique(found)) == 2000
    bits = (found[:, None] >> np.arange(64, dtype=np.uint64)) & np.uint64(1)
    # each of 64 bits over 2,000 streams within 5 standard errors of one half
    assert np.abs(bits.mean(axis=0) - 0.5).max() < 5 * 0.5 / np.sqrt(2000)


def test_minus_zero_is_zero():
    row = np.array([1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.5, 0.0, 0.0])
    for i in np.flatnonzero(row == 0.0):
        minus = row.copy()
        minus[i] = -0.0
        assert stream(minus, 1, 2) == stream(row, 1, 2)
    assert stream(np.where(row == 0.0, 5e-324, row), 1, 2) != stream(row, 1, 2)


def test_streams_of_many_targets_at_once_are_those_of_each(rng):
    rows, seed = reachable_rows(arm("panda"), rng, 20), np.array([7, 8], dtype=np.uint64)
    found = np.zeros(20, dtype=np.uint64)
    streams_of(rows, seed, found)
    assert found.tolist() == [stream(row, 7, 8) for row in rows]


def test_every_attempt_has_random_numbers_of_its_own(rng):
    streams = [0, 1, 2, *map(int, rng.integers(0, WORD - 1, 50, dtype=np.uint64))]
    states = {int(state_of(np.uint64(each), attempt)) for each in streams for attempt in range(100)}
    assert len(states) == 100 * len(streams)
    assert int(state_of(np.uint64(5), 9)) == splitmix(splitmix(5)[0] ^ 9)[0]
