"""A target as the numbers that engines work with, and the random stream that belongs to it."""

from __future__ import annotations

import hashlib

import numpy as np
import pinocchio as pin


def row_of(target: pin.SE3) -> np.ndarray:
    """A pose as (12,): R by rows, then p."""
    return np.concatenate([target.rotation.ravel(), target.translation])


def stream_of(row: np.ndarray, seed: int) -> int:
    """64 bits that begin the random stream of a target (12,) under a seed: of these two alone."""
    content = np.ascontiguousarray(row, dtype="<f8").tobytes() + str(int(seed)).encode()
    return int.from_bytes(hashlib.blake2b(content, digest_size=8).digest(), "little")
