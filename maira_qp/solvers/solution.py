"""What a solve returns: a configuration, and an honest word on it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from enum import IntEnum
from functools import cached_property
from typing import TYPE_CHECKING, Any, overload

import numpy as np

from maira_qp.errors import OptionError, SensitivityError
from maira_qp.robots.robot import Robot, condition_numbers
from maira_qp.solvers.priorities import Priorities
from maira_qp.solvers.sensitivity import dq_dtarget
from maira_qp.solvers.setting import Setting

if TYPE_CHECKING:
    from maira_qp.solvers.explanation import Explanation
    from maira_qp.solvers.proofs import Proof

ACTIVE_WITHIN = 1e-9
"""A limit nearer than this [rad or m] counts as active."""


class Status(IntEnum):
    """How a solve ended."""

    CONVERGED = 0
    """The pose is within its tolerances."""
    UNREACHABLE = 1
    """No configuration within the limits reaches the pose: proved."""
    NEAREST = 2
    """Not at the pose, but at a point that no small motion within the limits brings nearer to it."""
    BUDGET_SPENT = 3
    """Neither: the restarts, the iterations or the deadline ran out first."""

    @property
    def meaning(self) -> str:
        """One sentence for a person."""
        return _MEANINGS[self]


_MEANINGS = {
    Status.CONVERGED: "the pose is reached within its tolerances",
    Status.UNREACHABLE: "no configuration within the limits reaches the pose (proved)",
    Status.NEAREST: "the pose was not reached; this is a nearest point (stationary within the limits)",
    Status.BUDGET_SPENT: "the budget was spent before the pose was reached or a nearest point found",
}


class _OfRobot:
    """Values that are computed when they are first asked for. A pickle holds them in place of the robot."""

    def __getstate__(self) -> dict[str, Any]:
        own = {"condition_number": self.condition_number, "active_limits": self.active_limits}
        return {**self.__dict__, **own, "_setting": None, "_asked": None}

    condition_number: Any
    active_limits: Any


@dataclass(frozen=True, eq=False)
class Solution(_OfRobot):
    """The answer to one target. `q` is finite and inside the limits to the bit, whatever the status."""

    q: np.ndarray
    """Configuration (n,) [rad or m]"""
    success: bool
    """The pose error of `q` is within the tolerances."""
    status: Status
    position_error: float
    """|p_d - p| [m]"""
    orientation_error: float
    """Angle between the orientations [rad]"""
    iterations: int
    """Iterations (QPs solved) over all starts"""
    restarts: int
    """Starts after the first"""
    cost: float
    """Value of the redundancy's first objective at `q`; NaN without redundancy"""
    projected_gradient: float
    """Largest entry of the gradient that no constraint holds up, of what was minimised last: the redundancy's objective
    along the self-motion (Strict), the weighted sum (Weighted), the pose error (not reached); NaN where nothing was"""
    optimal: bool
    """What was minimised last is stationary: its projected gradient is within its tolerance; the pose alone: reached.
    False with success: the pose is reached, but the redundancy is not settled (at a singular pose it may never be)"""
    start_projected: bool
    """The given start `q0` was outside the limits and was moved onto them."""
    backend: str
    """Who solved the QPs"""
    _setting: Setting | None = field(repr=False)
    _asked: tuple[Priorities, Any] | None = field(repr=False)
    """The tasks and what they were called with"""

    @cached_property
    def condition_number(self) -> float:
        """Of the tool's Jacobian at `q`: largest by smallest singular value"""
        return self._setting.robot.condition_number(self.q)  # type: ignore[union-attr]

    @cached_property
    def active_limits(self) -> list[str]:
        """Limits that `q` stands on, such as "joint4 upper", and pairs at their margin, such as "link5 - table" """
        return active_limits(self._setting, self.q)  # type: ignore[arg-type]

    @cached_property
    def proof(self) -> Proof | None:
        """What proves that the target is out of reach: for `UNREACHABLE`, else None. A pickle has lost it."""
        if self.status is not Status.UNREACHABLE or self._asked is None:
            return None
        from maira_qp.solvers.proofs import Proofs  # heavy: Numba comes with it

        priorities, target = self._asked
        proofs = Proofs.of(priorities, self._setting.options)  # type: ignore[union-attr]
        return None if proofs is None else proofs.proof(priorities.targets(target))

    def explain(self) -> Explanation:
        """Why the solve ended as it did: what is left, which limits of the joints stand in the way, what each costs.

        `print(solution.explain())` says it in words. It solves the target again without those limits, which takes some
        ten milliseconds. Raises `OptionError` for a solution that was pickled.
        """
        from maira_qp.solvers.explanation import explain  # which knows this module

        if self._asked is None or self._setting is None:
            raise OptionError("a pickled solution no longer knows its robot: call explain() before it is pickled")
        priorities, target = self._asked
        return explain(priorities, priorities.targets(target), self, self._setting)

    def jacobian(self) -> np.ndarray:
        """How `q` follows its target: dq/dtarget (n, 6) [rad/m, rad/rad], the derivative of what the solve minimised.

        The columns are the target's twist as in `Robot.jacobian`: linear [m] before angular [rad], base axes, at the
        target, `p_d + dp` and `exp(dphi) R_d`. A joint that a limit holds has a zero row; one that would stand there
        without the limit too, where the derivative has two sides, counts as free. Where nothing chooses between
        configurations, as without a redundancy, q follows by the least motion. See `maira_qp.solvers.sensitivity`.

        Raises `SensitivityError` for what is not optimal or is singular, for tasks at several levels or of several
        targets, on limits that are not of the joints, and for a solution that was pickled.
        """
        if self._setting is None or self._asked is None:
            raise SensitivityError("a pickled solution no longer knows its robot: call jacobian() before it is pickled")
        if not self.optimal:
            raise SensitivityError(f"only an optimal answer has a derivative, and this {self.status.name} one is not")
        priorities, target = self._asked
        at = self._setting.robot.at(self.q)
        return dq_dtarget(priorities, priorities.targets(target), at, self._setting, self.success)

    def as_dict(self) -> dict[str, Any]:
        """All values by their names."""
        own = {name: getattr(self, name) for name in _VALUES}
        return {**own, "condition_number": self.condition_number, "active_limits": self.active_limits}


_VALUES = (
    "q",
    "success",
    "status",
    "position_error",
    "orientation_error",
    "iterations",
    "restarts",
    "cost",
    "projected_gradient",
    "optimal",
    "start_projected",
    "backend",
)


def solution_of(**values: Any) -> Solution:
    """A `Solution` with these values; a frozen class's own constructor would take as long as a few iterations."""
    solution = object.__new__(Solution)
    solution.__dict__.update(values)
    return solution


@dataclass(frozen=True, eq=False)
class BatchSolution(_OfRobot):
    """The answers to N targets: the fields of `Solution` with a leading axis N.

    `batch[i]` is a `Solution`, `batch[i:j]` a shorter batch.
    """

    q: np.ndarray
    """(N, n)"""
    success: np.ndarray
    """(N,) of bool"""
    status: np.ndarray
    """(N,) integer values of `Status`"""
    position_error: np.ndarray
    """(N,) [m]"""
    orientation_error: np.ndarray
    """(N,) [rad]"""
    iterations: np.ndarray
    """(N,)"""
    restarts: np.ndarray
    """(N,)"""
    cost: np.ndarray
    """(N,)"""
    projected_gradient: np.ndarray
    """(N,)"""
    optimal: np.ndarray
    """(N,) of bool"""
    start_projected: np.ndarray
    """(N,) of bool"""
    backend: str
    _setting: Setting | None = field(repr=False)
    _asked: tuple[Priorities, np.ndarray] | None = field(repr=False)
    """The tasks and the rows (N, K, 12) of targets that they were called with"""

    @cached_property
    def condition_number(self) -> np.ndarray:
        """(N,)"""
        robot: Robot = self._setting.robot  # type: ignore[union-attr]
        parts = [robot.jacobians(self.q[k : k + 4096]) for k in range(0, len(self), 4096)]
        return np.concatenate([np.empty(0), *map(condition_numbers, parts)])

    @cached_property
    def active_limits(self) -> list[list[str]]:
        """N lists"""
        setting: Setting = self._setting  # type: ignore[assignment]
        lower, upper = setting.robot.lower + ACTIVE_WITHIN, setting.robot.upper - ACTIVE_WITHIN
        on_a_limit = (self.q <= lower) | (self.q >= upper) | setting.is_bent
        names: list[list[str]] = [[] for _ in range(len(self))]
        for i in np.flatnonzero(on_a_limit.any(axis=1)):
            names[i] = active_limits(setting, self.q[i])
        return names

    @staticmethod
    def blank(setting: Setting, backend: str, count: int, asked: tuple[Priorities, np.ndarray]) -> BatchSolution:
        """So many answers yet to be written: budget spent, at no q yet."""
        return BatchSolution(
            q=np.empty((count, setting.robot.n)),
            success=np.zeros(count, dtype=bool),
            status=np.full(count, int(Status.BUDGET_SPENT)),
            position_error=np.full(count, np.nan),
            orientation_error=np.full(count, np.nan),
            iterations=np.zeros(count, dtype=np.int64),
            restarts=np.zeros(count, dtype=np.int64),
            cost=np.full(count, np.nan),
            projected_gradient=np.full(count, np.nan),
            optimal=np.zeros(count, dtype=bool),
            start_projected=np.zeros(count, dtype=bool),
            backend=backend,
            _setting=setting,
            _asked=asked,
        )

    def put(self, i: int, solution: Solution) -> None:
        """Make this the i-th answer."""
        for name in _VALUES:
            if name != "backend":
                getattr(self, name)[i] = getattr(solution, name)

    def put_found(self, part: slice, outcome: np.ndarray, after: np.ndarray, tolerance: float) -> None:
        """What the compiled engine, which wrote the q, found for a part: see `Compiled.solve_batch`."""
        reached, proved = outcome[:, 0] > 0, outcome[:, 0] < 0
        self.success[part] = self.optimal[part] = reached
        self.status[part] = np.where(reached, Status.CONVERGED, Status.BUDGET_SPENT)
        self.position_error[part], self.orientation_error[part] = outcome[:, 4], outcome[:, 5]
        self.iterations[part], self.restarts[part] = outcome[:, 2], outcome[:, 1]
        self.start_projected[part] = outcome[:, 6] > 0
        finished = np.flatnonzero(~np.isnan(after[:, 0]))
        if not len(finished):
            return
        at = part.start + finished
        reached, iterations, gradient, cost, position, orientation = after[finished].T
        optimal = gradient <= tolerance
        self.success[at], self.optimal[at] = reached > 0, optimal
        self.status[at] = np.where(
            reached > 0,
            Status.CONVERGED,
            np.where(proved[finished], Status.UNREACHABLE, np.where(optimal, Status.NEAREST, Status.BUDGET_SPENT)),
        )
        self.position_error[at], self.orientation_error[at] = position, orientation
        self.iterations[at] += iterations.astype(np.int64)
        self.cost[at], self.projected_gradient[at] = cost, gradient

    def __len__(self) -> int:
        return len(self.q)

    @overload
    def __getitem__(self, i: int) -> Solution: ...

    @overload
    def __getitem__(self, i: slice) -> BatchSolution: ...

    def __getitem__(self, i: int | slice) -> Solution | BatchSolution:
        """The i-th answer, or some of them (copies)."""
        if isinstance(i, slice):
            arrays = {name: getattr(self, name)[i].copy() for name in _VALUES if name != "backend"}
            asked = None if self._asked is None else (self._asked[0], self._asked[1][i])
            return BatchSolution(**arrays, backend=self.backend, _setting=self._setting, _asked=asked)
        if not -len(self) <= i < len(self):
            raise IndexError(f"target {i} of a batch of {len(self)}")
        values = {name: getattr(self, name)[i] for name in _VALUES if name not in ("q", "status", "backend")}
        return Solution(
            q=self.q[i].copy(),
            status=Status(int(self.status[i])),
            **{name: value.item() for name, value in values.items()},
            backend=self.backend,
            _setting=self._setting,
            _asked=None if self._asked is None else (self._asked[0], self._asked[0].of_row(self._asked[1][i])),
        )

    def __iter__(self) -> Iterator[Solution]:
        return (self[i] for i in range(len(self)))


@dataclass(frozen=True, eq=False)
class Step:
    """One control tick."""

    velocity: np.ndarray
    """Joint velocity (n,) [rad/s or m/s], within the velocity limits to the bit"""
    q: np.ndarray
    """Configuration (n,) after the tick"""
    position_error: float
    """|p_d - p| [m] after the tick"""
    orientation_error: float
    """Angle between the orientations [rad] after the tick"""
    backend: str
    """Which engine made it: "compiled", or the name of the QP backend in the general engine"""
    _setting: Setting | None = field(repr=False)

    @cached_property
    def active_limits(self) -> list[str]:
        """Limits that `q` stands on, such as "joint4 upper", and pairs at their margin, such as "link5 - table" """
        return active_limits(self._setting, self.q)  # type: ignore[arg-type]

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "active_limits": self.active_limits, "_setting": None}


def active_limits(setting: Setting, q: np.ndarray) -> list[str]:
    """Names of the limits that q (n,) stands on, those of the joints first."""
    robot, names = setting.robot, []
    for name, value, low, high in zip(robot.joint_names, q, robot.lower, robot.upper, strict=True):
        if value <= low + ACTIVE_WITHIN:
            names.append(f"{name} lower")
        if value >= high - ACTIVE_WITHIN:
            names.append(f"{name} upper")
    at = robot.at(q)
    return names + [name for limit in setting.limits for name in limit.active(at)]
