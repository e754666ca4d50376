"""What a solver has to offer to take part in the race."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np


def _itself(target: np.ndarray) -> np.ndarray:
    return target


@dataclass(frozen=True)
class Contestant:
    """A solver of one target at a time. What it returns is an answer that it claims to be right, or None."""

    name: str
    settings: str
    """What it was told, for the table."""
    forward: Callable[[np.ndarray], np.ndarray]
    """Its own tool pose (4, 4) at q (n,)."""
    solve: Callable[..., np.ndarray | None]
    """From a target, in its own type, and a start (n,): joint angles (n,) [rad]."""
    native: Callable[[np.ndarray], Any] = _itself
    """A target (4, 4) in its own type. This is not timed."""
    draws_starts: bool = False
    """Whether it finds starts itself where it is given None; otherwise it is given a random one."""
    step: Callable[[np.ndarray, Any, float], np.ndarray] | None = None
    """Joint velocities (n,) [rad/s] for one tick of dt [s] from q (n,) toward a target; None: it has no such thing."""
    limits: tuple[Any, Any] | None = None
    """Lower and upper limits (n,) [rad] as it has read them; None: it was given the judge's, or does not tell."""
    slack: float = 1e-9
    """How far out of limits [rad] an answer of it may be and still count."""


@dataclass(frozen=True)
class BatchContestant:
    """A solver of all targets in one call."""

    name: str
    settings: str
    solve_all: Callable[[np.ndarray], np.ndarray]
    """From targets (N, 4, 4): answers (N, n) [rad], NaN where it does not claim to have one."""
    slack: float = 1e-9
    """As above."""
