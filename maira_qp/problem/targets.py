"""Targets as the numbers that engines work with, and the random streams that belong to them."""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin

from maira_qp.arrays import is_listing, is_native, real_array
from maira_qp.errors import ConfigurationError, OptionError, PoseError, shown
from maira_qp.orientation import ORTHONORMAL_WITHIN, rigid, rounding_of

WORD = 2**64

MULTIPLIER = np.uint64(0x9E3779B97F4A7C15)
"""Odd, so that no pose of a target is lost when the poses are mixed: 2^64 over the golden ratio (Knuth, "The Art of
Computer Programming", volume 3, section 6.4)."""


def row_of(target: pin.SE3) -> np.ndarray:
    """A pose as (12,): R by rows, then p."""
    return np.concatenate([target.rotation.ravel(), target.translation])


def pose_of(row: np.ndarray) -> pin.SE3:
    """The pose of a row (12,)."""
    return pin.SE3(row[:9].reshape(3, 3).copy(), row[9:].copy())


def rows_of(T: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Poses (N, 4, 4) as rows (N, 12), their rotations made exact; one with NaN or inf becomes NaN.

    And how far each (N,) was from a rotation, see `rounding_of`.

    Raises `PoseError`, naming the first that is no rigid transformation.
    """
    from maira_qp.kernels.spatial.pose_validation import FINE, NOT_FINITE, pose_rows  # heavy: Numba comes with it

    rows, faults, deviations = np.empty((len(T), 12)), np.empty(len(T), dtype=np.int64), np.zeros(len(T))
    pose_rows(T, ORTHONORMAL_WITHIN, rows, faults)
    if (faults != FINE).any():
        for i in np.flatnonzero(faults > NOT_FINITE):
            rows[i] = row_of(pin.SE3(rigid(T[i], f"target {i}")))
            deviations[i] = rounding_of(T[i])
        rows[faults == NOT_FINITE] = np.nan
    return rows, deviations


def seed_words(seed: int) -> np.ndarray:
    """A seed as two words (2,). Raises `OptionError` if it does not fit."""
    if seed >= WORD**2:
        raise OptionError("a seed must be below 2^128")
    return np.array([seed % WORD, seed // WORD], dtype=np.uint64)


SEED_0 = seed_words(0)


def streams(rows: np.ndarray, words: np.ndarray) -> np.ndarray:
    """64 bits (N,) that begin the random stream of each of N targets (N, 12), or of K poses each (N, K, 12).

    They depend on the target and the seed's words (2,) alone.
    """
    from maira_qp.kernels.search.random_numbers import streams_of

    if rows.ndim == 3:
        mixed = np.zeros(len(rows), dtype=np.uint64)
        for k in range(rows.shape[1]):
            mixed = mixed * MULTIPLIER + streams(np.ascontiguousarray(rows[:, k]), words)
        return mixed
    result = np.empty(len(rows), dtype=np.uint64)
    streams_of(rows, words, result)
    return result


def poses_of_batch(targets: Any, name: str = "target") -> np.ndarray:
    """The targets of a batch as (N, 4, 4), checked; not a copy where none is needed. Raises `PoseError`."""
    if isinstance(targets, pin.SE3) or not is_listing(targets):
        raise PoseError(f"{name}s must be a sequence of poses, (N, 4, 4); for one target use solve")
    if not isinstance(targets, np.ndarray):
        targets = [each.homogeneous if isinstance(each, pin.SE3) else each for each in targets]
    if not len(targets):
        return np.empty((0, 4, 4))
    if is_native(targets, (len(targets), 4, 4)):
        return targets
    try:
        return real_array(targets, (None, 4, 4), f"{name}s", PoseError, finite=None)
    except PoseError:
        poses = [real_array(T, (4, 4), f"{name} {i}", PoseError, finite=None) for i, T in enumerate(targets)]
        return np.array(poses).reshape(-1, 4, 4)


def checked_seed(value: Any) -> np.ndarray:
    """A seed or a generator as two words (2,). Raises `OptionError`."""
    if isinstance(value, np.random.Generator):
        value = value.integers(2**63)
    if not isinstance(value, (int, np.integer)) or isinstance(value, bool) or value < 0:
        raise OptionError(f"a seed must be a non-negative integer (or, for rng, a Generator), got {shown(value)}")
    return seed_words(int(value))


def checked_starts(q0: Any, count: int, n: int) -> np.ndarray | None:
    """The starts (count, n) of a batch from one (n,) for all or one each; None: none. Raises `ConfigurationError`."""
    if q0 is None:
        return None
    if not is_listing(q0) or not any(is_listing(each) for each in q0):
        return np.tile(real_array(q0, (n,), "q0", ConfigurationError), (count, 1))
    return real_array(q0, (count, n), "q0", ConfigurationError)
