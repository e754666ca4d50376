"""How an answer follows its target: dq/dtarget, by implicit differentiation of the conditions that make it optimal.

F are the joints that are free: no limit holds them. A limit holds its joint if its multiplier is above the tolerance to
which gradients vanish; at a multiplier of zero the answer moves differently to either side, and the derivative is the
one with the joint free. Along the target's twist t the conditions are kept to first order:

*Strict*: `grad objective + A^T y = 0` on F and `W e(q, t) = 0`, with `A = -d(W e)/dq`, `D = d(W e)/dt`, gives

    [ L  A^T ] [ dq ]     [ C ]
    [ A   0  ] [ dy ]  =  [ D ] dt        L = d2(objective - y W e)/dq2,   C = d2(y W e)/dq dt

solved in the null space of A: `dq = A^+ D dt + Z z` (Nocedal and Wright, "Numerical Optimization", 2006, section 16.2;
for sensitivities Fiacco, "Introduction to sensitivity and stability analysis in nonlinear programming", 1983).

*Weighted*, and the *nearest point* of a target out of reach: `H dq = -B dt` on F, with the exact derivatives H and B of
the gradient of `1/2 |W e|^2 + weight objective`, or of the error alone.

*The pose alone*: `A dq = D dt`, which leaves a redundant arm its self-motion. Of all motions that follow the target the
derivative is then the least, `A^+ D`, and likewise at a nearest point that a self-motion keeps. There are no
multipliers: a joint on a limit is held.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from maira_qp.errors import SensitivityError
from maira_qp.problem.objectives import Objective
from maira_qp.problem.problem import Problem
from maira_qp.problem.qp.costs import ExactTaskCost, LevelObjective, TaskCost, WeightedCost, multipliers
from maira_qp.problem.qp.hierarchy import largest_row
from maira_qp.problem.redundancy import Strict, Weighted, trades_off
from maira_qp.problem.targets import Poses
from maira_qp.problem.tasks.frame import FrameTask
from maira_qp.robots.model.configuration import Configuration
from maira_qp.solvers.reference.context import Context
from maira_qp.solvers.reference.multi_start import stationarity

ON_LIMIT = 1e-9
"""A joint as near to a limit [rad or m] stands on it; a row of another limit as near to its bound is active."""

SINGULAR = 1e-6
"""Singular values and curvatures below this share of the largest count as zero."""


def dq_dtarget(poses: Poses, at: Configuration, context: Context, reached: bool) -> np.ndarray:
    """Derivative (n, 6) of the answer at a configuration by the twist of its target. Raises `SensitivityError`."""
    problem = context.problem
    cost, wish = problem.costs(poses)
    _check(problem, wish, at, context)
    answer = _Answer(cost, tuple(task.target_key is not None for task in problem.tasks), at, context)
    if trades_off(wish) and (reached or _is_trade_off(cost, wish, at, context)):
        return answer.of_trade_off(wish)
    if not reached:
        return answer.of_nearest()
    return answer.of_objective(wish.objectives[0]) if isinstance(wish, Strict) else answer.of_pose()


def _is_trade_off(cost: TaskCost, wish: Weighted, at: Configuration, context: Context) -> bool:
    """The weighted sum is stationary, and not the error alone, as where the search did not reach the pose."""
    trade_off = WeightedCost(cost, wish.objective, wish.weight)
    return stationarity(trade_off, at, context) / min(1.0, wish.weight) < stationarity(cost, at, context)


def _check(problem: Problem, wish: Weighted | Strict | None, at: Configuration, context: Context) -> None:
    """Raises `SensitivityError` for problems whose derivative is not known."""
    if len(problem.target_keys) != 1:
        raise SensitivityError(
            f"the derivative is by one target from the call, and the tasks take {len(problem.target_keys)}"
        )
    if not all(isinstance(task, FrameTask) for task in problem.tasks):
        raise SensitivityError("the derivative is known for PoseTask, PositionTask and OrientationTask alone")
    objectives = wish.objectives if isinstance(wish, Strict) else ()
    if any(isinstance(each, LevelObjective) and each.tasks.tasks for each in objectives):
        raise SensitivityError("the derivative is not known for tasks at lower levels, only for objectives there")
    if (context.bounds(at).h <= ON_LIMIT).any():
        raise SensitivityError("the derivative is not known on further limits than those of the joints")


@dataclass(frozen=True)
class _Answer:
    """A configuration that answers, and what it depends on the target by."""

    cost: TaskCost
    takes_target: tuple[bool, ...]
    """Which of the tasks move with the target"""
    at: Configuration
    context: Context

    def of_trade_off(self, wish: Weighted) -> np.ndarray:
        """Where the weighted sum is least."""
        H = self._pose_hessian + wish.weight * wish.objective.hessian(self.at)
        gradient = self.cost.level(self.at).c + wish.weight * wish.objective.gradient(self.at)
        return self._of_minimum(H, gradient, min(1.0, wish.weight))

    def of_nearest(self) -> np.ndarray:
        """Where the error is least."""
        return self._of_minimum(self._pose_hessian, self.cost.level(self.at).c, 1.0)

    def of_pose(self) -> np.ndarray:
        """The least motion that keeps the pose reached."""
        free = self._movable & ~self._on_limit
        return self._embedded(free, self._following(free)[0])

    def of_objective(self, objective: Objective) -> np.ndarray:
        """Where an objective is least on the self-motion."""
        at, gradient = self.at, objective.gradient(self.at)
        inside = self._movable & ~self._on_limit
        self._following(inside)  # else the multipliers are not unique
        A = self.cost.rows(at)[0]
        y = multipliers(A, gradient, ~inside)
        free = self._free(gradient + A.T @ y, 1.0)
        X, Z = self._following(free)
        L = (objective.hessian(at) + self.cost.curvature(at, y))[np.ix_(free, free)]
        K = Z.T @ L @ Z
        curves = np.abs(np.linalg.eigvalsh(K))
        if curves.min(initial=np.inf) <= SINGULAR * np.abs(L).max():
            raise SensitivityError("the answer is singular: the first objective does not curve along the self-motion")
        return self._embedded(free, X - Z @ np.linalg.solve(K, Z.T @ (L @ X + self._target_curvature(y)[free])))

    def _of_minimum(self, H: np.ndarray, gradient: np.ndarray, scale: float) -> np.ndarray:
        """Of a cost with Hessian H (n, n) and gradient (n,), which vanishes to the tolerance times `scale`."""
        free = self._free(gradient, scale * max(1.0, float(np.linalg.norm(self.cost.rows(self.at)[1]))))
        B = self._target_hessian[free]
        curves, V = np.linalg.eigh(H[np.ix_(free, free)])
        kept = np.abs(curves) > SINGULAR * scale * np.abs(curves).max(initial=0.0)
        if np.abs(V[:, ~kept].T @ B).max(initial=0.0) > SINGULAR * np.abs(B).max(initial=0.0):
            raise SensitivityError("the answer is singular: the cost does not curve where the target pulls")
        return self._embedded(free, -(V[:, kept] / curves[kept]) @ (V[:, kept].T @ B))

    def _following(self, free: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The least motion (k, 6) of the k free joints that follows the target, and a basis Z of what it leaves open.

        Rows that an arm can never meet together, as of one with fewer than six joints, it follows as near as it can.
        A singular value whose square is below the error that is left, times how fast the rows turn, may be none at the
        solution itself (the theorem of Newton and Kantorovich; the rows turn about as fast as they are long).
        """
        A, error = self.cost.rows(self.at)
        U, s, Vt = np.linalg.svd(A[:, free])
        size = largest_row(A)
        rank = int((s > max(SINGULAR * size, np.sqrt(2 * size * np.linalg.norm(error)))).sum())
        if rank < self._generic_rank:
            reason = "limits hold joints that it needs" if (free < self._movable).any() else "the pose is singular"
            raise SensitivityError(f"the joints cannot follow the target in every direction: {reason}")
        return (Vt[:rank].T / s[:rank]) @ (U[:, :rank].T @ self._target_jacobian), Vt[rank:].T

    @cached_property
    def _generic_rank(self) -> int:
        """The rank of the tasks' rows where it is not singular: at a configuration that nothing distinguishes."""
        generic = self.context.robot.at(np.random.default_rng(0).normal(size=self.at.n))
        return _rank(self.cost.rows(generic)[0][:, self._movable])

    @property
    def _movable(self) -> np.ndarray:
        return self.context.robot.lower < self.context.robot.upper

    @property
    def _on_limit(self) -> np.ndarray:
        robot, q = self.context.robot, self.at.q
        return (q <= robot.lower + ON_LIMIT) | (q >= robot.upper - ON_LIMIT)

    def _free(self, gradient: np.ndarray, scale: float) -> np.ndarray:
        """The joints (n,) that no limit holds up against a gradient (n,) known to the tolerance times `scale`."""
        robot, q, known = self.context.robot, self.at.q, scale * self.context.options.stationarity_tolerance
        held = (q <= robot.lower + ON_LIMIT) & (gradient > known) | (q >= robot.upper - ON_LIMIT) & (gradient < -known)
        return self._movable & ~held

    def _embedded(self, free: np.ndarray, X: np.ndarray) -> np.ndarray:
        """Derivative (n, 6) of all joints from that of the free ones (k, 6)."""
        dq = np.zeros((self.at.n, 6))
        dq[free] = X
        return dq

    @property
    def _pose_hessian(self) -> np.ndarray:
        """Hessian (n, n) of `1/2 |W e|^2`."""
        return ExactTaskCost(self.cost).hessian(self.at)

    @property
    def _target_jacobian(self) -> np.ndarray:
        """D (m, 6)."""
        rows = [task.weights[:, None] * task.target_jacobian(self.at) for task in self._tasks]
        return np.vstack([D if takes else np.zeros_like(D) for D, takes in zip(rows, self.takes_target, strict=True)])

    @property
    def _target_hessian(self) -> np.ndarray:
        """B (n, 6)."""
        pairs = zip(self._tasks, self.takes_target, strict=True)
        return sum((task.target_hessian(self.at) for task, takes in pairs if takes), np.zeros((self.at.n, 6)))

    def _target_curvature(self, y: np.ndarray) -> np.ndarray:
        """C (n, 6) of multipliers y (m,)."""
        parts = np.split(y, np.cumsum([len(task.weights) for task in self._tasks])[:-1])
        triples = zip(self._tasks, parts, self.takes_target, strict=True)
        bends = (task.target_curvature(self.at, part) for task, part, takes in triples if takes)
        return sum(bends, np.zeros((self.at.n, 6)))

    @property
    def _tasks(self) -> tuple[FrameTask, ...]:
        return tuple(task for task in self.cost.tasks if isinstance(task, FrameTask))


def _rank(A: np.ndarray) -> int:
    """Rank of rows A (m, n)."""
    return int(np.linalg.matrix_rank(A, SINGULAR * largest_row(A)))
