"""What came out for an arm: times and the judge's verdicts, and the figures that tables and picture show."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from maira_qp.evaluation.contestant import Contestant
from maira_qp.evaluation.judge import Judge
from peers.arms import Questions
from peers.clock import Run

TOLERANCES = 1e-6, 1e-6
"""What counts as reached [m], [rad]."""
JUMP = 0.5
"""A joint that moves by more than this [rad] toward a nearby target has jumped to another solution."""
TICK_SLACK = 1e-9
"""By how much a tick may exceed limits [rad, rad/s], ours as well: q + v dt is rounded."""


@dataclass(frozen=True)
class Row:
    """One contestant on N targets."""

    name: str
    settings: str
    seconds: np.ndarray
    """Times (N,) [s]."""
    individual: bool
    """Whether the times were taken target by target, so that they have a distribution."""
    solved: np.ndarray
    """Which targets (N,) it solved, says the judge."""
    false: np.ndarray
    """Which (N,) it claimed to have solved and did not."""
    jumped: np.ndarray
    """Which answers (N,) are far from their start."""

    @property
    def mean(self) -> float:
        """Mean time of a target [s]."""
        return float(self.seconds.mean())


@dataclass(frozen=True)
class Tick:
    """One contestant's control ticks."""

    name: str
    mean: float
    """Mean time [s]."""
    violations: float
    """Share of ticks whose velocity, or the position after them, is out of limits."""


@dataclass(frozen=True)
class Outcome:
    """All about one arm."""

    arm: str
    remarks: list[str]
    """Who is not there, and why."""
    anywhere: list[Row]
    nearby: list[Row]
    out_of_reach: list[Row]
    ticks: list[Tick]


def judged(contestants: Sequence[Contestant], runs: Sequence[Run], asked: Questions, judge: Judge) -> list[Row]:
    """Each contestant's run as the judge sees it."""
    return [_row(contestant, run, asked, judge) for contestant, run in zip(contestants, runs, strict=True)]


def _row(contestant: Contestant, run: Run, asked: Questions, judge: Judge) -> Row:
    solved = judge.verdict(run.q, asked.targets).within(*TOLERANCES, contestant.slack) & run.claimed
    return Row(
        contestant.name,
        contestant.settings,
        run.seconds,
        run.individual,
        solved,
        run.claimed & ~solved,
        np.nan_to_num(np.abs(run.q - asked.starts)).max(axis=1) > JUMP,
    )


def ticked(contestant: Contestant, mean: float, v: np.ndarray, q: np.ndarray, dt: float, judge: Judge) -> Tick:
    """A contestant's ticks of dt [s], velocities v (N, n) [rad/s] from q (N, n) [rad], as the judge sees them."""
    too_fast = judge.speed_excess(v) > TICK_SLACK
    out = judge.limit_violation(q + v * dt) > TICK_SLACK
    return Tick(contestant.name, mean, float((too_fast | out).mean()))
