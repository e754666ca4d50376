"""Where an arm does not follow a path, and why, in words."""

from __future__ import annotations

import numpy as np

from maira_qp.problem.problem import Problem
from maira_qp.results.path_solution import PathFailure, Rules
from maira_qp.results.solution import Solution
from maira_qp.results.status import Status
from maira_qp.robots.model.revolutions import TURN
from maira_qp.wording import Quantity, Wording

SINGULAR = 1e3
"""Condition number from which on a configuration is called singular."""
ROUNDING = 1e-9
"""By this share a step may be larger than is allowed."""
CLOSED = 1e-6
"""A loop whose ends are no further apart [rad or m] is closed."""


def missed(index: int, solution: Solution) -> PathFailure:
    """A pose that is not reached, by the solution that was found instead."""
    reason, proved = Wording(solution.status.meaning), solution.status == Status.UNREACHABLE
    if solution.status == Status.LIMITS_BROKEN:
        reason = Wording(reason, f": {', '.join(solution.broken_limits)}")
    elif not proved:
        off = Quantity(solution.position_error, "m", f"{1e3 * solution.position_error:.3g} mm")
        turned = Quantity(solution.orientation_error, "rad", f"{np.degrees(solution.orientation_error):.3g} deg")
        names = ", ".join(solution.active_limits)
        reason = Wording(reason, ", ", off, " and ", turned, " away", f"; it stands on {names}" if names else "")
    return PathFailure(index, reason, is_step=False, is_proved=proved)


def broken(problem: Problem, q: np.ndarray, index: int, rules: Rules) -> PathFailure:
    """A step of q (N, n) to the pose `index` that is too large, or changes branches."""
    robot, before = problem.robot, q[index - 1]
    steps = np.abs(q[index] - before)
    joint = int((steps / rules.step).argmax())
    name, unit = robot.joint_names[joint], "m" if robot.slides[joint] else "rad"
    if steps[joint] <= rules.step[joint] * (1.0 + ROUNDING):
        reason = f"no way was found to pose {index} along the path: the arm changes branches before it"
    elif rules.dt is not None and rules.step[joint] == robot.velocity_limit[joint] * rules.dt:
        least, most = (_si(value, f"{unit}/s") for value in (steps[joint] / rules.dt, robot.velocity_limit[joint]))
        reason = Wording(
            f"no way was found on which {name} moves by less than ",
            least,
            f" to pose {index}; its velocity limit is ",
            most,
        )
    else:
        least, most = (_si(value, unit) for value in (steps[joint], rules.step[joint]))
        reason = Wording(
            f"no way was found on which {name} moves by less than ", least, f" to pose {index}; ", most, " is allowed"
        )
    return PathFailure(index, Wording(reason, _circumstances(problem, before)), is_step=True, is_proved=False)


def _si(value: float, unit: str) -> Quantity:
    """A quantity in a sentence, by itself in metres or radians."""
    return Quantity(float(value), unit, f"{value:.3g} {unit}")


def _circumstances(problem: Problem, q: np.ndarray) -> str:
    """What may have to do with it: limits that q (n,) stands on, a singularity."""
    found, names = "", problem.active_limits(q)
    if names:
        found += f"; before it the arm stands on {', '.join(names)}"
    condition = problem.robot.condition_number(q)
    if condition > SINGULAR:
        found += f"; before it the arm is near a singularity (condition number {condition:.1e})"
    return found


def loop_gap(problem: Problem, q: np.ndarray) -> np.ndarray:
    """How far (n,) the end of a loop q (N, n) is from its beginning; a joint without limits may have made turns."""
    robot, gap = problem.robot, q[-1] - q[0]
    endless = ~robot.slides & ~np.isfinite(robot.upper) & ~np.isfinite(robot.lower)
    return gap - np.where(endless, TURN * np.round(gap / TURN), 0.0)


def open_end(problem: Problem, q: np.ndarray) -> PathFailure | None:
    """The end of a loop q (N, n) that does not meet its beginning; None: it does."""
    robot, gap = problem.robot, np.abs(loop_gap(problem, q))
    joint = int(gap.argmax())
    if gap[joint] <= CLOSED:
        return None
    name, away = robot.joint_names[joint], _si(gap[joint], "m" if robot.slides[joint] else "rad")
    reason = Wording(f"no way was found whose end meets its beginning: {name} ends ", away, " away")
    return PathFailure(len(q) - 1, reason, is_step=False, is_proved=False)
