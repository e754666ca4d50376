"""A batch of targets as the stages of the compiled engine take it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np


class Batch(NamedTuple):
    """N targets, and where the search for each begins."""

    rows: np.ndarray
    """(N, 12) R by rows, then p"""
    starts: np.ndarray
    """(N, n) or (0, n): there are none"""
    streams: np.ndarray
    """(N,) of uint64: what is random about each"""
    shuffled: bool
    """Attempts begin in another order than that of the library"""

    def some(self, which: slice | np.ndarray) -> Batch:
        """Some of them."""
        starts = self.starts[which] if len(self.starts) else self.starts
        return Batch(self.rows[which], starts, self.streams[which], self.shuffled)

    @property
    def anywhere(self) -> Batch:
        """The same targets without starts."""
        return self._replace(starts=self.starts[:0])
