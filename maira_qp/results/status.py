"""How a call ended: the statuses, and the one rule that says which of them a solve ends with."""

from __future__ import annotations

from enum import IntEnum

import numpy as np


class NamedEnum(IntEnum):
    """Integers, for arrays, that print as their names; `f"{status:d}"` is the number."""

    def __str__(self) -> str:
        return self.name

    def __format__(self, spec: str) -> str:
        return format(int(self) if spec.endswith("d") else self.name, spec)


class Status(NamedEnum):
    """How a solve ended."""

    CONVERGED = 0
    """The pose is within its tolerances."""
    UNREACHABLE = 1
    """No configuration within the limits reaches the pose: proved."""
    NEAREST = 2
    """A local minimum of the pose error within the limits: no small motion comes nearer. Alias `LOCAL_MINIMUM`."""
    LOCAL_MINIMUM = 2
    BUDGET_SPENT = 3
    """Neither: the restarts, the iterations or the deadline ran out first. Alias `BUDGET_EXHAUSTED`."""
    BUDGET_EXHAUSTED = 3
    INVALID_TARGET = 4
    """The target of a batch holds NaN or inf: nothing was solved, and `q` and all numbers are NaN."""
    LIMITS_BROKEN = 5
    """No configuration was found that keeps the limits beside those of the joints: see `broken_limits`."""
    REJECTED = 6
    """The pose is reached, but `accept` rejected every configuration that was found to reach it: see `rejected`."""

    @property
    def meaning(self) -> str:
        """One sentence for a person."""
        return _MEANINGS[self]


_MEANINGS = {
    Status.CONVERGED: "the pose is reached within its tolerances",
    Status.UNREACHABLE: "no configuration within the limits reaches the pose (proved)",
    Status.NEAREST: "the pose was not reached; this is a nearest point (stationary within the limits)",
    Status.BUDGET_SPENT: "the budget was spent before the pose was reached or a nearest point found",
    Status.INVALID_TARGET: "the target holds NaN or inf: nothing was solved",
    Status.LIMITS_BROKEN: "no configuration within the further limits was found; this one breaks them",
    Status.REJECTED: "the pose is reached, but accept rejected every configuration that was found",
}


ORDER = (Status.CONVERGED, Status.LIMITS_BROKEN, Status.UNREACHABLE, Status.NEAREST)
"""The first of them that holds is the status of a solve; else `BUDGET_SPENT`."""


def status_of(*, reached: bool, breaks_limits: bool, proved: bool, stationary: bool) -> Status:
    """The status of a solve: of what was reached, is proved of the target, and is stationary where it ended."""
    for status, holds in zip(ORDER, (reached, breaks_limits, proved, stationary)):  # noqa: B905, it is timed
        if holds:
            return status
    return Status.BUDGET_SPENT


def statuses_of(
    *, reached: np.ndarray, breaks_limits: np.ndarray, proved: np.ndarray, stationary: np.ndarray
) -> np.ndarray:
    """`status_of` for N solves, from arrays (N,) of bool: (N,) of int."""
    return np.select([reached, breaks_limits, proved, stationary], [int(one) for one in ORDER], Status.BUDGET_SPENT)


class Reach(NamedEnum):
    """Whether a pose can be reached, for questions that are about nothing else."""

    REACHABLE = 0
    """A configuration within the limits reaches it: it was found."""
    UNREACHABLE = 1
    """None does: proved."""
    UNDECIDED = 2
    """Neither."""


def reach_of(status: np.ndarray) -> np.ndarray:
    """What statuses (...) of solves say of their poses: values of `Reach` (...), of int8."""
    kinds = np.full(max(Status) + 1, Reach.UNDECIDED, dtype=np.int8)
    kinds[Status.CONVERGED], kinds[Status.UNREACHABLE] = Reach.REACHABLE, Reach.UNREACHABLE
    return kinds[np.asarray(status)]


class StepStatus(NamedEnum):
    """What the arm is doing in a control tick: `Step.status`.

    A joint is at rest if its speed is at most 1e-6 of its limit (of 1 rad/s or 1 m/s where that is infinite).
    """

    ARRIVED = 0
    """Every task, of every level, is within `position_tolerance` and `orientation_tolerance` of `Options` after it"""
    MOVING = 1
    """Not arrived, and on the way: some joint is not at rest, or would not be but for its task's gain"""
    NEAREST = 2
    """At rest, where nothing near by is nearer, in the order of the levels: no level's QP asks for motion, so that what
    limits and the levels above leave free of its gradient is within `Options.stationarity_tolerance`, as a share of its
    errors where these are large, and it is at no saddle point"""
    STUCK = 3
    """At rest though the QPs ask for motion: a QP failed, or no share of the motion that they ask for was safe"""


class TrackerState(NamedEnum):
    """What a `Tracker` does with a target: `Command.state`."""

    FOLLOWING = 0
    """The tool is at the target within the tracker's `tolerance`, or no limit kept the tick from its whole way to it"""
    LIMITED = 1
    """The tool is farther from the target than that, and limits keep it there: `Command.reason` names them"""
    HOLDING = 2
    """No target is followed: the arm brakes, or stands; `Command.reason` says why"""
