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

from maira_qp.problem.limits.collision import CollisionLimit
from maira_qp.problem.limits.joint import KEPT, Tick
from maira_qp.problem.problem import ACTIVE_WITHIN, Problem
from maira_qp.problem.redundancy import Weighted
from maira_qp.results.status import StepStatus
from maira_qp.results.step import Step

TO_ROUNDING = 1.0 - 1e-6
"""A limit is active from this share of it on."""

NEARLY = 0.99
"""The same for a row of another limit, which is known to first order."""


@dataclass(frozen=True)
class Limiting:
    """The limits of a problem's joints as plain numbers, which for a few joints are faster than arrays."""

    problem: Problem
    joints: list[tuple[str, float, float, float, float]]
    """Name, lower and upper limit [rad or m], and largest speed and acceleration of each joint"""
    levers: list[float]
    """What a joint's displacement counts as an angle [rad/rad, or rad/m]"""
    gain: float
    """The least gain of the tasks of the first level"""

    @staticmethod
    def of(problem: Problem) -> Limiting:
        """The limits of a problem's robot."""
        robot = problem.robot
        limits = robot.lower, robot.upper, robot.velocity_limit, robot.acceleration_limit
        return Limiting(
            problem,
            list(zip(robot.joint_names, *(limit.tolist() for limit in limits), strict=True)),
            np.where(robot.slides, 1 / robot.length, 1.0).tolist(),
            min(task.gain for task in problem.tasks),
        )

    def reason(self, q: np.ndarray, velocity: np.ndarray, step: Step, dt: float, tolerance: tuple[float, float]) -> str:
        """Why a step of dt [s] from q (n,) at a velocity (n,) did not reach its target; empty: it went its whole way.

        `tolerance` [m; rad] is what is not reached.
        """
        v = step.velocity.tolist()
        found = self._of_joints(q.tolist(), velocity.tolist(), step.q.tolist(), v, dt)
        found += self._of_further_limits(q, velocity, step, dt)
        if step.status == StepStatus.NEAREST:
            found.insert(0, self._at_rest(step))
        elif step.status == StepStatus.STUCK:
            found.append("no part of the way to the target is safe")
        elif self.gain < 1:
            found.append(f"a gain of {self.gain:g} of the task")
        elif not found:
            found += self._on_the_way(v, step, dt, tolerance)
        return "; ".join(found)

    def _of_joints(self, q: list[float], v: list[float], q1: list[float], v1: list[float], dt: float) -> list[str]:
        """The active limits by kind, with the joints that are at them; from q (n,) and v (n,) to q1 and v1."""
        found: dict[str, list[str]] = {}
        for (name, lower, upper, fastest, a), x, before, after, speed in zip(self.joints, q, v, q1, v1, strict=True):
            room, end = (upper - x, "upper") if speed > 0 else (x - lower, "lower")
            if after <= lower + ACTIVE_WITHIN:
                kind = "lower limit"
            elif after >= upper - ACTIVE_WITHIN:
                kind = "upper limit"
            elif abs(speed) >= TO_ROUNDING * fastest:
                kind = "speed limit"
            elif speed and a < math.inf and abs(speed) * dt + 0.5 * speed * speed / a >= TO_ROUNDING * room:
                kind = f"braking for the {end} limit"  # what the tick and braking take is what there is
            elif abs(speed - before) >= TO_ROUNDING * a * dt:
                kind = "acceleration limit"
            else:
                continue
            found.setdefault(kind, []).append(name)
        return [f"{kind} of {', '.join(joints)}" for kind, joints in found.items()]

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
        if isinstance(self.problem.redundancy, Weighted):
            return f"at rest {off} from the target: out of reach, or the weighted redundancy's share"
        return f"out of reach by {off}"

    def _on_the_way(self, v: list[float], step: Step, dt: float, tolerance: tuple[float, float]) -> list[str]:
        """Of an arm that moves with no joint at a limit."""
        speeds = [abs(each) * lever for each, lever in zip(v, self.levers, strict=True)]
        position, orientation = step.position_error - tolerance[0], step.orientation_error - tolerance[1]
        length, way = self.problem.robot.length, sum(speeds) * dt
        if position <= 0.5 * length * way**2 and orientation <= 0.5 * way**2:
            return []
        stopping = [abs(each) / a for each, (*_, a) in zip(v, self.joints, strict=True)]
        longest = max(stopping)
        braking = sum(speeds) * longest  # twice what the joints still go while the slowest one stops
        if position <= length * braking and orientation <= braking:
            return [
                f"acceleration limit of {self.joints[stopping.index(longest)][0]}, which has to brake for the target"
            ]
        off = _amount(step.position_error, step.orientation_error)
        others = "".join(f" or near a {type(limit).__name__}," for limit in self.problem.additional_limits)
        return [f"out of reach,{others} or near a singular configuration: {off} from the target"]


def _amount(position: float, orientation: float) -> str:
    """Errors [m] and [rad] for a person."""
    return f"{1e3 * position:.1f} mm and {math.degrees(orientation):.1f} degrees"
