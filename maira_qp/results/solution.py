"""The result of a solve: a configuration, its verdict, and what both rest on."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from maira_qp.display import Card, joint_entries
from maira_qp.errors import OptionError, SensitivityError
from maira_qp.results.answer import Answer, Origin, errors_in_words
from maira_qp.results.status import Status
from maira_qp.robots.unit_hints import degrees_hint, millimetres_hint
from maira_qp.wording import figures, fixed

if TYPE_CHECKING:
    from maira_qp.results.certificate import Proof
    from maira_qp.results.explanation import Explanation


@dataclass(frozen=True, eq=False, repr=False)
class Solution(Answer):
    """The answer to one target. `q` is finite and inside the limits exactly, unless the status is INVALID_TARGET.

    `bool(solution)` is `solution.success`.
    """

    q: np.ndarray
    """Configuration (n,) [rad or m]"""
    success: bool
    """The pose error of `q` is within the tolerances, by a fresh forward kinematics."""
    status: Status
    position_error: float
    """|p_d - p| [m]; 0 where the tasks leave the position free, see `left_free`"""
    orientation_error: float
    """Angle between the orientations [rad]; 0 where the tasks leave the orientation free, see `left_free`"""
    iterations: int
    """Iterations (QPs solved), summed over all starts"""
    restarts: int
    """Number of starts after the first"""
    cost: float
    """Value of the redundancy's first objective at `q`; NaN without redundancy"""
    projected_gradient: float
    """Largest entry of the gradient that no constraint holds up, of what was minimised last: the redundancy's objective
    along the self-motion (Strict), the weighted sum (Weighted), the pose error (not reached); NaN where nothing was"""
    optimal: bool
    """What was minimised last is stationary: its projected gradient is within its tolerance; the pose alone: reached.
    False with success: the pose is reached, but the redundancy is not settled (at a singular pose it may never be)"""
    start_projected: bool
    """The given start `q0` was outside the limits and was clipped to them."""
    target_deviation: float
    """Largest entry of |R R^T - I| of a target given as an array, where it is above 1e-5, else 0: up to 2e-3 the
    nearest rotation was taken, as is meant by three or four decimals"""
    left_q0: bool
    """The answer left the neighbourhood of `q0`: a descent from there ends elsewhere, and this answer is better
    by more than the tolerances. False without `q0`"""
    backend: str
    """Engine: "compiled", or the name of the QP backend of the reference engine"""
    _start: np.ndarray | None = field(repr=False)
    """The start `q0` (n,) that was given"""
    _target: np.ndarray = field(repr=False)
    """The poses (K, 12) that were asked for, see `Targets`"""
    _origin: Origin | None = field(default=None, repr=False)
    rejected: int = 0
    """How many configurations the test `accept` rejected"""

    def __bool__(self) -> bool:
        return self.success

    def _card(self) -> Card:
        numbers = [f"{fixed(value, 4)} {unit}" for value, unit in zip(self.q, self.q_units, strict=True)]
        return Card(
            title=f"Solution: {self.status.name}, {self.status.meaning}{f', {self.scope}' if self.scope else ''}",
            facts=(
                ("error", errors_in_words(self.position_error, self.orientation_error, self.left_free)),
                ("effort", f"{self.iterations} iterations, {self.restarts} restarts, {self.backend}"),
                ("condition number", f"{self.condition_number:.4g}"),
                ("cost", f"{self.cost:.6g}{'' if self.optimal else ', not optimal'}" if np.isfinite(self.cost) else ""),
                ("rejected by accept", str(self.rejected) if self.rejected else ""),
                ("active limits", ", ".join(self.active_limits)),
                ("broken limits", ", ".join(f"{name} by {figures(x)}" for name, x in self.broken_limits.items())),
                ("hint", " ".join(self.hints)),
            ),
            entries=joint_entries(self.joint_names, numbers),
            headings=("joint", "q", "limit"),
            rows=[
                (name, number, ", ".join(ends_of(name, self.active_limits)))
                for name, number in zip(self.joint_names, numbers, strict=True)
            ],
        )

    @property
    def q0(self) -> np.ndarray | None:
        """The start (n,) [rad or m], of several the one that the answer is from; None: there was none"""
        return None if self._start is None else self._start.copy()

    @cached_property
    def max_joint_change(self) -> float:
        """Largest joint displacement from `q0`, max_i |q_i - q0_i| [rad or m]; NaN without `q0`"""
        return math.nan if self._start is None else float(np.abs(self.q - self._start).max())

    @cached_property
    def condition_number(self) -> float:
        """Condition number of the tool's Jacobian at `q`: largest by smallest singular value"""
        if self.status is Status.INVALID_TARGET:
            return np.nan
        return self._problem.robot.condition_number(self.q)

    @cached_property
    def active_limits(self) -> list[str]:
        """Limits that `q` stands on, such as "joint4 upper" or "LinearLimit row 1", and pairs at their margin, such as
        "link5 - table" """
        if self.status is Status.INVALID_TARGET:
            return []
        return self._problem.active_limits(self.q)

    @cached_property
    def broken_limits(self) -> dict[str, float]:
        """What `q` breaks of the limits beside those of the joints, such as "link5 - table", and by how much.

        In the unit of the limit, for pairs of bodies what is missing of the margin [m]. Empty but for `LIMITS_BROKEN`.
        """
        if self.status is Status.INVALID_TARGET:
            return {}
        return self._problem.limit_violations(self._problem.robot.at(self.q))

    @cached_property
    def proof(self) -> Proof | None:
        """Certificate that the target is out of reach, for `UNREACHABLE`; else None. Not pickled."""
        if self.status is not Status.UNREACHABLE or self._origin is None:
            return None
        return self._origin.proof(self)

    @property
    def hints(self) -> tuple[str, ...]:
        """What looks like millimetres or degrees where metres and radians are asked for, a sentence each. Nothing was
        converted. A pickle has lost them."""
        if self._origin is None or self.status is Status.INVALID_TARGET:
            return ()
        robot = self._problem.robot
        far = [] if self.success else [millimetres_hint(row[9:], robot) for row in self._target]
        moved = self._start if self.start_projected else None
        start = "" if moved is None else degrees_hint(moved, robot, "the start")
        return tuple(hint for hint in (*dict.fromkeys(far), start) if hint)

    def explain(self) -> Explanation:
        """Diagnose the solve: the remaining error, the joint limits that stand in the way, and what each costs.

        `print(solution.explain())` puts it in words. The target is solved again without those limits, which takes some
        ten milliseconds. Raises `OptionError` for a solution that was pickled, `PoseError` for an invalid target.
        """
        if self._origin is None:
            raise OptionError("a pickled solution no longer knows its robot: call explain() before it is pickled")
        return self._origin.explain(self)

    def jacobian(self) -> np.ndarray:
        """Compute dq/dtarget (n, 6) [rad/m, rad/rad], the derivative of the answer by its target.

        The columns are the target's twist as in `Robot.jacobian`: linear [m] before angular [rad], base axes, at the
        target, `p_d + dp` and `exp(dphi) R_d`. A joint that a limit holds has a zero row; one that would stand there
        without the limit too, where the derivative has two sides, counts as free. Where nothing chooses between
        configurations, as without a redundancy, q follows by the least motion, and so it is counted with a weight that
        fades, although there the way to the pose moves too. See `solvers.analysis.sensitivity`.

        Raises `SensitivityError` for what is not optimal or is singular, for tasks at several levels or of several
        targets, on limits that are not of the joints, and for a solution that was pickled.
        """
        if self._origin is None:
            raise SensitivityError("a pickled solution no longer knows its robot: call jacobian() before it is pickled")
        if not self.optimal:
            raise SensitivityError(f"only an optimal answer has a derivative, and this {self.status.name} one is not")
        return self._origin.jacobian(self)


def solution_of(**values: Any) -> Solution:
    """A `Solution` with these values; a frozen class's own constructor would take as long as a few iterations."""
    solution = object.__new__(Solution)
    object.__setattr__(solution, "__dict__", values)
    return solution


def ends_of(joint: str, limits: list[str]) -> list[str]:
    """Which ends of its range a joint stands at: "lower", "upper"."""
    return [name.rsplit(" ", 1)[1] for name in limits if name.rsplit(" ", 1)[0] == joint]
