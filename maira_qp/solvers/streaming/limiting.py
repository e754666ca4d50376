"""What kept a control tick from its target, in words.

A limit is active where the tick's displacement d of a joint is the largest that it allows: `|d| = v_max dt`,
`|d - v_0 dt| = a dt^2`, the position limit, or the way from which the joint can just stop before that (see
`problem.limits.joint`). Where no joint is at a limit, a tick with limited accelerations still goes no faster than all
joints can brake for the target. They move in proportion, so that the one with the longest time to stop, `|v| / a`, is
the one that the others wait for.

What a whole step leaves is of second order: for revolute joints at most `L s^2 / 2` of the position and `s^2 / 2` of
the orientation, with L the length of the arm and s the sum of the joints' displacements. More than that, without an
active limit, is out of reach, or nearly so, near a singular configuration.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from maira_qp.kernels.control.active_limits import (
    ACCELERATION,
    BRAKING_LOWER,
    BRAKING_UPPER,
    LOWER,
    SPEED,
    UPPER,
    active_limits,
)
from maira_qp.problem.limits.collision import CollisionLimit
from maira_qp.problem.limits.joint import KEPT, Tick
from maira_qp.problem.problem import ACTIVE_WITHIN, Problem
from maira_qp.problem.redundancy import trades_off
from maira_qp.results.status import StepStatus
from maira_qp.results.step import Step

TO_ROUNDING = 1.0 - 1e-6
"""A limit is active from this share of it on."""

NEARLY = 0.99
"""The same for a row of another limit, which is known to first order."""

WORDS = {
    LOWER: "lower limit",
    UPPER: "upper limit",
    SPEED: "speed limit",
    BRAKING_LOWER: "braking for the lower limit",
    BRAKING_UPPER: "braking for the upper limit",
    ACCELERATION: "acceleration limit",
}


@dataclass(frozen=True, eq=False)
class Limiting:
    """The limits that a problem's ticks can be at."""

    problem: Problem
    limits: np.ndarray
    """(n, 5), see `active_limits`"""
    gain: float
    """The least gain of the tasks of the first level"""

    @staticmethod
    def of(problem: Problem) -> Limiting:
        """The limits of a problem's robot."""
        robot = problem.robot
        levers = np.where(robot.slides, 1 / robot.length, 1.0)
        limits = robot.lower, robot.upper, robot.velocity_limit, robot.acceleration_limit, levers
        return Limiting(problem, np.stack(limits, axis=1), min(task.gain for task in problem.tasks))

    def reason(self, q: np.ndarray, velocity: np.ndarray, step: Step, dt: float, tolerance: tuple[float, float]) -> str:
        """Why a step of dt [s] from q (n,) at a velocity (n,) did not reach its target; empty: it went its whole way.

        `tolerance` [m; rad] is what is not reached.
        """
        kinds = np.empty(len(q), np.int64)
        ways = active_limits(self.limits, q, velocity, step.q, step.velocity, dt, ACTIVE_WITHIN, TO_ROUNDING, kinds)
        joints: dict[int, list[str]] = {}
        for kind, name in zip(kinds.tolist(), self.problem.robot.joint_names, strict=True):
            if kind:
                joints.setdefault(kind, []).append(name)
        found = [f"{WORDS[kind]} of {', '.join(names)}" for kind, names in joints.items()]
        if self.problem.additional_limits:
            found += self._of_further_limits(q, velocity, step, dt)
        if step.status == StepStatus.NEAREST:
            found.insert(0, self._at_rest(step))
        elif step.status == StepStatus.STUCK:
            found.append("no part of the way to the target is safe")
        elif self.gain < 1:
            found.append(f"a gain of {self.gain:g} of the task")
        elif not found:
            return self._on_the_way(ways, step, dt, tolerance)
        return "; ".join(found)

    def _of_further_limits(self, q: np.ndarray, velocity: np.ndarray, step: Step, dt: float) -> list[str]:
        """The limits beside those of the joints of which a row holds with equality, or nearly so."""
        found, at, way = [], self.problem.robot.at(q), step.velocity * dt
        for limit in self.problem.additional_limits:
            rows = limit.rows(at, Tick(dt, velocity))
            if rows is None or not (rows[0] @ way >= NEARLY * rows[1] - KEPT).any():
                continue
            nearest = limit.nearest(at) if isinstance(limit, CollisionLimit) else None
            pair = "" if nearest is None else f" ({nearest.first} - {nearest.second}: {1e3 * nearest.distance:.1f} mm)"
            found.append(f"{type(limit).__name__}{pair}")
        return found

    def _at_rest(self, step: Step) -> str:
        """Of an arm that stands where nothing near by is nearer."""
        off = _amount(step.position_error, step.orientation_error)
        if trades_off(self.problem.redundancy):
            return f"at rest {off} from the target: out of reach, or the weighted redundancy's share"
        return f"out of reach by {off}"

    def _on_the_way(self, ways: tuple[float, float, int], step: Step, dt: float, tolerance: tuple[float, float]) -> str:
        """Of an arm that moves with no joint at a limit; `ways` is what `active_limits` returns."""
        speed, longest, last = ways
        position, orientation = step.position_error - tolerance[0], step.orientation_error - tolerance[1]
        robot, way, braking = self.problem.robot, speed * dt, speed * longest
        if position <= 0.5 * robot.length * way**2 and orientation <= 0.5 * way**2:
            return ""
        if position <= robot.length * braking and orientation <= braking:  # twice the way to a stop
            return f"acceleration limit of {robot.joint_names[last]}, which has to brake for the target"
        off = _amount(step.position_error, step.orientation_error)
        others = "".join(f" or near a {type(limit).__name__}," for limit in self.problem.additional_limits)
        return f"out of reach,{others} or near a singular configuration: {off} from the target"


def _amount(position: float, orientation: float) -> str:
    """Errors [m] and [rad] for a person."""
    return f"{1e3 * position:.1f} mm and {math.degrees(orientation):.1f} degrees"
