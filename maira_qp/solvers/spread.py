"""Points that fill a cube evenly."""

from __future__ import annotations

import numpy as np


def spread(count: int, n: int) -> np.ndarray:
    """Points (count, n) that fill the unit cube evenly.

    Point k is the fractional part of k a, a the powers of the root of x^(n + 1) = x + 1 (Roberts, "The unreasonable
    effectiveness of quasirandom sequences", 2018).
    """
    root = 2.0
    for _ in range(60):
        root = (1 + root) ** (1 / (n + 1))
    return (0.5 + np.outer(np.arange(count), root ** -np.arange(1.0, n + 1))) % 1
