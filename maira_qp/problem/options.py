"""Tolerances and budgets of a solve, in one frozen class; the command line is made from the same class."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields

from maira_qp.arrays import LARGEST_COUNT, is_count, is_number
from maira_qp.errors import OptionError, shown

MOST_STARTS = 1_000_000
"""Each costs some bytes of memory."""


@dataclass(frozen=True, kw_only=True)
class Options:
    """When a pose counts as reached, how long to try, and how far to trust a step."""

    position_tolerance: float = 1e-6
    """Solved only if |p_d - p| <= position_tolerance [m]; > 0."""
    orientation_tolerance: float = 1e-6
    """Solved only if the angle between the orientations <= orientation_tolerance [rad]; > 0."""
    stationarity_tolerance: float = 1e-6
    """Optimal only if no entry of the projected gradient is larger; > 0 [of the cost, per rad or m].

    A level of a control tick that cannot reach its targets rests where its gradient is below 0.7 times that, as a share
    of what is left of its errors."""
    max_iterations: int = 200
    """Iterations of one start, accepted or not; >= 1."""
    max_restarts: int = 300
    """Further starts after the first; >= 0."""
    max_settling: int = 200
    """Steps toward the optimum of the redundancy, or of an unreached pose, once no start is left to try; >= 0."""
    start_candidates: int = 8
    """A random start is the best of so many configurations by their pose error; >= 1."""
    deadline: float | None = None
    """Return the best so far after this time [s]; None: no limit; > 0."""
    level_position_tolerance: float = 1e-5
    """A control tick's lower levels add at most this much to |p_d - p| of any task above them; > 0 [m]."""
    level_orientation_tolerance: float = 1e-5
    """The same for the angle between orientations, and for errors of other kinds; > 0 [rad]."""
    damping: float = 0.1
    """Levenberg-Marquardt damping mu = damping |W e|^2, before its adaptation; > 0."""
    stall_steps: int = 3
    """A start is given up after so many accepted steps in a row that improve too little; >= 1."""
    stall_ratio: float = 0.05
    """Too little is an improvement of the cost by less than this share; between 0 and 1."""

    def __post_init__(self) -> None:
        for f in fields(self):
            value = getattr(self, f.name)
            if f.name == "deadline" and value is None:
                continue
            whole = f.name.startswith("max_") or f.name in ("start_candidates", "stall_steps")
            least = 0 if f.name in ("max_restarts", "max_settling") else 1
            largest = MOST_STARTS if f.name in ("max_restarts", "start_candidates") else LARGEST_COUNT
            if whole and not is_count(value, least, largest):
                told = f"must be a whole number >= {least} and at most {largest}"
                raise OptionError(f"{f.name} {told}, got {shown(value)}")
            if not whole and not (is_number(value) and 0 < value < math.inf):
                raise OptionError(f"{f.name} must be a positive number, got {shown(value)}")
            object.__setattr__(self, f.name, int(value) if whole else float(value))
        if not self.stall_ratio < 1:
            raise OptionError(f"stall_ratio must be below 1, got {shown(self.stall_ratio)}")
