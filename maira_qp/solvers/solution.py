"""What a solve returns: a configuration, and an honest word on it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, fields
from enum import IntEnum

import numpy as np

from maira_qp.robots.robot import Robot, condition_numbers

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


@dataclass(frozen=True, eq=False)
class Solution:
    """The answer to one target. `q` is finite and inside the limits to the bit, whatever the status."""

    q: np.ndarray
    """Configuration (n,) [rad or m]"""
    success: bool
    """The pose error of `q`, computed afresh, is within the tolerances."""
    status: Status
    position_error: float
    """|p_d - p| [m]"""
    orientation_error: float
    """Angle between the orientations [rad]"""
    iterations: int
    """Iterations (QPs solved) over all starts"""
    restarts: int
    """Starts after the first"""
    condition_number: float
    """Of the tool's Jacobian at `q`: largest by smallest singular value"""
    active_limits: list[str]
    """Limits that `q` stands on, such as "joint4 upper" """
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


@dataclass(frozen=True, eq=False)
class BatchSolution:
    """The answers to N targets: the fields of `Solution` with a leading axis N; `batch[i]` is a `Solution`."""

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
    condition_number: np.ndarray
    """(N,)"""
    active_limits: list[list[str]]
    """N lists"""
    cost: np.ndarray
    """(N,)"""
    projected_gradient: np.ndarray
    """(N,)"""
    optimal: np.ndarray
    """(N,) of bool"""
    start_projected: np.ndarray
    """(N,) of bool"""
    backend: str

    @staticmethod
    def of(n: int, backend: str, solutions: list[Solution]) -> BatchSolution:
        """Stack solutions of a robot with n joints."""
        columns = {f.name: [getattr(s, f.name) for s in solutions] for f in fields(Solution)}
        types: dict[str, type] = dict.fromkeys(("success", "optimal", "start_projected"), bool)
        types |= dict.fromkeys(("status", "iterations", "restarts"), np.int64)
        arrays = {
            key: np.array(column, dtype=types.get(key, float))
            for key, column in columns.items()
            if key not in ("active_limits", "backend")
        }
        arrays["q"] = arrays["q"].reshape(-1, n)
        return BatchSolution(**arrays, active_limits=columns["active_limits"], backend=backend)

    @staticmethod
    def of_search(
        robot: Robot, q: np.ndarray, outcome: np.ndarray, J: np.ndarray, start_projected: np.ndarray
    ) -> BatchSolution:
        """From the compiled search: q (N, n), outcomes (N, 6), Jacobians (N, 6, n). What it did not reach is spent."""
        reached, nan = outcome[:, 0] > 0, np.full(len(q), np.nan)
        on_a_limit = (q <= robot.lower + ACTIVE_WITHIN) | (q >= robot.upper - ACTIVE_WITHIN)
        return BatchSolution(
            q=q,
            success=reached,
            status=np.where(reached, Status.CONVERGED, Status.BUDGET_SPENT).astype(np.int64),
            position_error=outcome[:, 4].copy(),
            orientation_error=outcome[:, 5].copy(),
            iterations=outcome[:, 2].astype(np.int64),
            restarts=outcome[:, 1].astype(np.int64),
            condition_number=condition_numbers(J),
            active_limits=[
                active_limits(robot, each) if on.any() else [] for each, on in zip(q, on_a_limit, strict=True)
            ],
            cost=nan,
            projected_gradient=nan.copy(),
            optimal=reached.copy(),
            start_projected=start_projected,
            backend="compiled",
        )

    def put(self, i: int, solution: Solution) -> None:
        """Make this the i-th answer."""
        for f in fields(Solution):
            if f.name != "backend":
                getattr(self, f.name)[i] = getattr(solution, f.name)

    def __len__(self) -> int:
        return len(self.q)

    def __getitem__(self, i: int) -> Solution:
        """The i-th answer (copies)."""
        if not -len(self) <= i < len(self):
            raise IndexError(f"target {i} of a batch of {len(self)}")
        return Solution(
            q=self.q[i].copy(),
            success=bool(self.success[i]),
            status=Status(int(self.status[i])),
            position_error=float(self.position_error[i]),
            orientation_error=float(self.orientation_error[i]),
            iterations=int(self.iterations[i]),
            restarts=int(self.restarts[i]),
            condition_number=float(self.condition_number[i]),
            active_limits=list(self.active_limits[i]),
            cost=float(self.cost[i]),
            projected_gradient=float(self.projected_gradient[i]),
            optimal=bool(self.optimal[i]),
            start_projected=bool(self.start_projected[i]),
            backend=self.backend,
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
    active_limits: list[str]
    """Position limits that `q` stands on"""


def active_limits(robot: Robot, q: np.ndarray) -> list[str]:
    """Names of the limits that q (n,) stands on, such as "joint4 upper"."""
    names = []
    for name, value, low, high in zip(robot.joint_names, q, robot.lower, robot.upper, strict=True):
        if value <= low + ACTIVE_WITHIN:
            names.append(f"{name} lower")
        if value >= high - ACTIVE_WITHIN:
            names.append(f"{name} upper")
    return names
