"""Where the arm rested, to go back to and forth."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from maira_qp.orientation import pose_error

SAME = 1e-6
"""Joints [rad, or m] and targets [m and rad] no further apart than this are the same."""
MOST = 200
"""Moments that are kept."""


class Moment(NamedTuple):
    """A configuration at rest, and its targets."""

    q: np.ndarray
    """(n,)"""
    targets: Mapping[str, pin.SE3]
    """{tip: T_base_tool}"""

    def is_like(self, other: Moment) -> bool:
        """Nothing that can be seen has moved."""
        errors = (pose_error(T, other.targets[tip]) for tip, T in self.targets.items())
        return bool(np.abs(self.q - other.q).max() < SAME and all(np.abs(error).max() < SAME for error in errors))


class History:
    """Moments in order, and which of them is now."""

    def __init__(self, first: Moment) -> None:
        """Begins with a moment."""
        self._moments, self._now = [first], 0

    def rest(self, moment: Moment) -> None:
        """The arm rests; what could be redone is forgotten if this is another moment."""
        if not moment.is_like(self._moments[self._now]):
            self._moments = [*self._moments[: self._now + 1], moment][-MOST:]
            self._now = len(self._moments) - 1

    def undo(self, moment: Moment) -> Moment | None:
        """The last moment that differs from this one; None: there is none."""
        index = self._now if not moment.is_like(self._moments[self._now]) else self._now - 1
        return self._go(index)

    def redo(self) -> Moment | None:
        """The moment after that of the last `undo`; None: there is none."""
        return self._go(self._now + 1)

    def _go(self, index: int) -> Moment | None:
        if not 0 <= index < len(self._moments):
            return None
        self._now = index
        return self._moments[index]
