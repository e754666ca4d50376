"""Limits: what a displacement dq may be at a configuration q. Boxes stay boxes; coupled limits are rows `G dq <= h`."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from maira_qp.arrays import real_array
from maira_qp.errors import OptionError


@dataclass(frozen=True)
class Bounds:
    """All limits on a displacement dq (n,) together: `lower <= dq <= upper` and `G dq <= h`."""

    lower: np.ndarray
    """(n,) [rad or m]"""
    upper: np.ndarray
    """(n,) [rad or m]"""
    G: np.ndarray
    """(m, n), m = 0 where the limits are a box alone"""
    h: np.ndarray
    """(m,)"""

    @property
    def held(self) -> np.ndarray:
        """Which joints (n,) stand on a limit, or beyond it."""
        return (self.lower >= 0) | (self.upper <= 0)

    def within(self, radius: float) -> Bounds:
        """The same, and every entry of dq at most `radius` > 0 in size (a trust region)."""
        return Bounds(np.clip(self.lower, -radius, 0), np.clip(self.upper, 0, radius), self.G, self.h)


class Limit(ABC):
    """One kind of limit of a robot with n joints."""

    @abstractmethod
    def box(self, q: np.ndarray, dt: float | None) -> tuple[np.ndarray, np.ndarray] | None:
        """Lower and upper bound (n,) on dq from q (n,) in a tick of dt [s] (None: no time passes), or None."""

    @abstractmethod
    def rows(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray] | None:
        """G (m, n) and h (m,) of `G dq <= h` at q (n,), h negative where q breaks the limit; or None."""


@dataclass(frozen=True)
class PositionLimit(Limit):
    """`lower <= q + dq <= upper`, (n,) each [rad or m]."""

    lower: np.ndarray
    upper: np.ndarray

    def box(self, q: np.ndarray, dt: float | None) -> tuple[np.ndarray, np.ndarray]:
        """The distance to either limit."""
        return self.lower - q, self.upper - q

    def rows(self, q: np.ndarray) -> None:
        """None."""


@dataclass(frozen=True)
class VelocityLimit(Limit):
    """`|dq| <= velocity dt`, velocity (n,) [rad/s or m/s]; no limit where no time passes."""

    velocity: np.ndarray

    def box(self, q: np.ndarray, dt: float | None) -> tuple[np.ndarray, np.ndarray] | None:
        """The distance that a tick allows."""
        if dt is None:
            return None
        reach = self.velocity * dt
        return -reach, reach

    def rows(self, q: np.ndarray) -> None:
        """None."""


@dataclass(frozen=True)
class LinearLimit(Limit):
    """`A q <= b`, A (m, n), b (m,): coupled joints, as in a parallelogram arm whose q2 + q3 is limited."""

    A: Any
    b: Any

    def __post_init__(self) -> None:
        A = real_array(self.A, (None, None), "A of a LinearLimit", OptionError)
        b = real_array(self.b, (A.shape[0],), "b of a LinearLimit", OptionError)
        object.__setattr__(self, "A", A)
        object.__setattr__(self, "b", b)

    def box(self, q: np.ndarray, dt: float | None) -> None:
        """None."""

    def rows(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """What is left of b, negative where a row is broken."""
        return self.A, self.b - self.A @ q


def merge(limits: Sequence[Limit], q: np.ndarray, dt: float | None = None) -> Bounds:
    """The limits at q (n,) as one `Bounds`, which always admits some dq.

    Each box is clipped into the ones that come later in the list, so the merged box is never empty: with position
    before velocity, a joint outside its limits comes back at its limit speed. A row already broken may not be broken
    further.
    """
    n = len(q)
    lower, upper = np.full(n, -np.inf), np.full(n, np.inf)
    G, h = [np.empty((0, n))], [np.empty(0)]
    for limit in limits:
        if (box := limit.box(q, dt)) is not None:
            lower, upper = np.clip(lower, *box), np.clip(upper, *box)
        if (rows := limit.rows(q)) is not None:
            G.append(rows[0])
            h.append(np.maximum(rows[1], 0.0))
    return Bounds(lower, upper, np.vstack(G), np.concatenate(h))
