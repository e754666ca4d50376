"""Who takes part in a benchmark: one record for this package's methods, the textbooks' and the peers."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np


@dataclass(frozen=True)
class Answer:
    """What a contestant says of one target."""

    q: np.ndarray
    """Configuration (n,); empty where it has none."""
    claimed: bool
    """Whether it says that the target is reached, to its own tolerance."""
    status: str = ""
    """Its own word for how it ended."""
    iterations: int = 0
    """Over all starts."""
    restarts: int = 0
    """Starts after the first."""


def itself(target: Any) -> Any:
    """The target as the benchmark has it."""
    return target


def claim(q: np.ndarray | None) -> Answer:
    """A configuration (n,) that is claimed to be right, or None for no answer."""
    return Answer(np.empty(0), False) if q is None else Answer(q, True)


@dataclass(frozen=True, kw_only=True)
class Contestant:
    """A solver with its settings, and how it is called in each kind of benchmark; None: it takes no part in that."""

    name: str
    """What it is called in tables."""
    settings: str = ""
    """What it was told, for the table: its QP backend, its tolerances."""
    native: Callable[[Any], Any] = itself
    """A target of the benchmark in its own type. This is not timed."""
    solve: Callable[..., Any] | None = None
    """From a target of its own type and a start (n,), or None where it draws its own, to a result."""
    answer: Callable[[Any], Answer] = claim
    """A result as an `Answer`. This is not timed."""
    solve_all: Callable[[np.ndarray], np.ndarray] | None = None
    """From targets (N, 4, 4) in one call: answers (N, n), NaN where it does not claim to have one."""
    step: Callable[[np.ndarray, Any, float], np.ndarray] | None = None
    """Joint velocities (n,) [rad/s] for one tick of dt [s] from q (n,) toward a target."""
    control: Callable[[], Callable[[Any], np.ndarray]] | None = None
    """Begins a control run; what it returns takes a tick's target to the next configuration (n,)."""
    follow: Callable[[Any, np.ndarray | None], np.ndarray | None] | None = None
    """From a path of N poses, of its own type, and the configuration (n,) at the first, or None where any will do, to
    configurations (N, n); None, or fewer rows, where it gives up."""
    forward: Callable[[np.ndarray], np.ndarray] | None = None
    """Its own tool pose (4, 4) at q (n,), by which it must mean the robot that the judge means."""
    limits: tuple[Any, Any] | None = None
    """Lower and upper limits (n,) [rad] as it has read them; None: it was given the judge's, or does not tell."""
    draws_starts: bool = False
    """Whether it finds starts itself where it is given None; otherwise it is given a random one."""
    slack: float = 1e-9
    """How far out of limits [rad] an answer of it may be and still count."""
    lines: int = 0
    """Lines of code that a user writes for a control run with it."""
    pairs: Callable[[], int] | None = None
    """How many pairs of shapes it looks at in a control run."""
