"""Targets as the numbers that engines work with, and the random streams that belong to them."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from maira_qp.errors import OptionError
from maira_qp.orientation import ORTHONORMAL_WITHIN, rigid

WORD = 2**64


def row_of(target: pin.SE3) -> np.ndarray:
    """A pose as (12,): R by rows, then p."""
    return np.concatenate([target.rotation.ravel(), target.translation])


def pose_of(row: np.ndarray) -> pin.SE3:
    """The pose of a row (12,)."""
    return pin.SE3(row[:9].reshape(3, 3).copy(), row[9:].copy())


def rows_of(T: np.ndarray) -> np.ndarray:
    """Poses (N, 4, 4) as rows (N, 12), their rotations made exact; one with NaN or inf becomes NaN.

    Raises `PoseError`, naming the first that is no rigid transformation.
    """
    from maira_qp.kernels.rigid import FINE, NOT_FINITE, pose_rows  # heavy: Numba comes with it

    rows, faults = np.empty((len(T), 12)), np.empty(len(T), dtype=np.int64)
    pose_rows(T, ORTHONORMAL_WITHIN, rows, faults)
    if (faults != FINE).any():
        for i in np.flatnonzero(faults > NOT_FINITE):
            rows[i] = row_of(pin.SE3(rigid(T[i], f"target {i}")))
        rows[faults == NOT_FINITE] = np.nan
    return rows


def seed_words(seed: int) -> np.ndarray:
    """A seed as two words (2,). Raises `OptionError` if it does not fit."""
    if seed >= WORD**2:
        raise OptionError(f"a seed must be below 2^128, got {seed:.3g}")
    return np.array([seed % WORD, seed // WORD], dtype=np.uint64)


SEED_0 = seed_words(0)


def streams(rows: np.ndarray, words: np.ndarray) -> np.ndarray:
    """64 bits (N,) for each of the targets (N, 12) that begin its random stream: of the target and the
    seed's words (2,) alone."""
    from maira_qp.kernels.random_numbers import streams_of

    result = np.empty(len(rows), dtype=np.uint64)
    streams_of(rows, words, result)
    return result
