"""What stays the same through one solve: the robot, its limits, who solves the QPs, the options."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from maira_qp.errors import OptionError
from maira_qp.problem.backends import Backend
from maira_qp.problem.limits import AccelerationLimit, Bounds, Limit, PositionLimit, Tick, VelocityLimit, merge
from maira_qp.problem.qp import QP
from maira_qp.robots.configuration import Configuration
from maira_qp.robots.robot import Robot, drawn
from maira_qp.solvers.options import Options

ADMITTING = 10
"""Times that bent limits are linearised to bring a configuration into them."""


@dataclass(frozen=True)
class Setting:
    """The surroundings of a solve."""

    robot: Robot
    further: tuple[Limit, ...]
    """The limits beside those of the joints"""
    start_range: tuple[np.ndarray, np.ndarray]
    """What starts of a search are drawn from, (n,) and (n,) [rad or m]"""
    backend: Backend
    options: Options

    @cached_property
    def limits(self) -> tuple[Limit, ...]:
        """All limits, those of the joints first."""
        robot = self.robot
        return (
            AccelerationLimit(robot.acceleration_limit),
            PositionLimit(robot.lower, robot.upper, robot.acceleration_limit),
            VelocityLimit(robot.velocity_limit),
            *self.further,
        )

    def random_start(self, rng: np.random.Generator) -> np.ndarray:
        """A configuration (n,) to start from, uniform within the range."""
        return drawn(rng, *self.start_range)

    def bounds(self, at: Configuration, tick: Tick | None = None) -> Bounds:
        """All limits on a displacement from a configuration, in a tick if given."""
        return merge(self.limits, at, tick)

    @cached_property
    def is_bent(self) -> bool:
        """Some limits are known by their rows to first order only."""
        return bool(self._bent)

    @cached_property
    def _bent(self) -> tuple[Limit, ...]:
        return tuple(limit for limit in self.further if type(limit).violation is not Limit.violation)

    def violation(self, at: Configuration) -> float:
        """By how much a configuration breaks one of them; >= 0."""
        return max((limit.violation(at) for limit in self.limits), default=0.0)

    def violations(self, at: Configuration) -> np.ndarray:
        """By how much a configuration breaks each part of them (k,); >= 0."""
        return np.concatenate([limit.violations(at) for limit in self._bent])

    def rows_within(self, at: Configuration, allowed: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """G (m, n) and h (m,) that keep each part of them broken by at most what is `allowed` (k,), to first order."""
        G, h, start = [np.empty((0, at.n))], [np.empty(0)], 0
        for limit in self._bent:
            if (rows := limit.rows(at, None)) is not None:
                G.append(rows[0])
                h.append(rows[1] + allowed[start + limit.parts(at)])
            start += len(limit.violations(at))
        return np.vstack(G), np.concatenate(h)

    def breach(self, at: Configuration) -> float:
        """Half the sum of squares of what is broken of all limits with rows."""
        rows = [row for limit in self.limits if (row := limit.rows(at, None)) is not None]
        return 0.5 * sum(float((np.minimum(h, 0.0) ** 2).sum()) for _, h in rows)

    def keeps(self, trial: Configuration, at: Configuration) -> bool:
        """A trial breaks no bent limit more than a configuration did."""
        return not self.is_bent or self.violation(trial) <= self.violation(at)

    def moved(self, at: Configuration, dq: np.ndarray) -> Configuration:
        """The configuration after a displacement dq (n,), inside the joint limits to the bit."""
        return self.robot.at(self.robot.clip(at.q + dq))

    def admitted(self, q: np.ndarray) -> np.ndarray:
        """The configuration (n,) within all limits that is nearest to q (n,); of bent limits one that is near.

        Raises `OptionError` if limits that are straight leave none; where bent ones seem to, what comes nearest.
        """
        clipped = self.robot.clip(q)
        for _ in range(ADMITTING if self.is_bent else 1):
            at = self.robot.at(clipped)
            rows = [row for limit in self.limits if (row := limit.rows(at, None)) is not None]
            if not any((h < 0).any() for _, h in rows):
                break
            G, h = np.vstack([G for G, _ in rows]), np.concatenate([h for _, h in rows])
            lower, upper = self.robot.lower - clipped, self.robot.upper - clipped
            nearest = self.backend.solve(QP(np.eye(len(q)), clipped - q, lower, upper, G, h))
            if not nearest.found:
                if self.is_bent:
                    break
                raise OptionError(f"no configuration satisfies the limits together ({nearest.reason})")
            clipped = self.robot.clip(clipped + nearest.x)
        return clipped
