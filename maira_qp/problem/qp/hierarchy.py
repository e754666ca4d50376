"""A strict hierarchy of quadratic levels under common limits.

Level 1 solves its box QP. Level k then moves only where it does not change the levels above: with Z an orthonormal
basis of the null space of all rows above, it minimises its own cost over

    { dq + Z z  :  lower <= dq + Z z <= upper,  G (dq + Z z) <= h }

from the dq of the level above. A level's inequalities are met as well as they can be, and what was reached of them
is a limit for the levels below. z = 0 is always feasible, so no level can fail, and J Z = 0 holds to rounding whether a
limit is active or not: level k cannot change the residual of a level above it. (Projecting level k into the null space
*inside* one QP has no such property: an active limit couples the two.) One redundant degree of freedom makes z a number
and its QP a clamp. The lexicographic problem is that of Kanoun, Lamiraux and Wieber, "Kinematic control of redundant
manipulators: generalizing the task-priority framework to inequality tasks", 2011; the null-space form that of Escande,
Mansard and Wieber, "Hierarchical quadratic programming", 2014, section 3.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from maira_qp.problem.limits.joint import FEASIBILITY, Bounds
from maira_qp.problem.qp.backends import Backend
from maira_qp.problem.qp.qp import QP

RANK_THRESHOLD = 1e-11
"""Singular values below this share of the largest count as zero: what moves along such a direction changes the residual
above by no more than that share."""

NO_PART = 1e-10
"""A joint that counts less than this in a direction [rad or m] takes no part in it, and must not feel its limit there:
robots whose angles are given with eleven digits, half turns among them, move joints by as much that should stand."""


@dataclass(frozen=True)
class Level:
    """A convex quadratic model `cost + c^T dq + 1/2 dq^T H dq` of one priority level at a configuration."""

    H: np.ndarray
    """(n, n), symmetric; where it is indefinite the level uses its positive part on the subspace that is left to it"""
    c: np.ndarray
    """(n,), the gradient"""
    rows: np.ndarray
    """(m, n), what the levels below must leave as it is: they move in its null space"""
    cost: float = 0.0
    squared_error: float = 0.0
    """|W e|^2 of the tasks in it"""
    rank_threshold: float = RANK_THRESHOLD
    """Share of the largest singular value of `rows` below which one counts as zero"""
    wishes: tuple[np.ndarray, np.ndarray] | None = None
    """G (k, n) and h (k,) of `G dq <= h`, kept as well as the levels above allow: the level adds `1/2 |s|^2` for the
    least s >= 0 with `G dq <= h + s`, and the levels below keep what it reached"""

    saddle: float | None = None
    """Curvature below minus this is left by a step of `ESCAPE` at least; None: no step has a least size"""
    still: float = 0.0
    """Dry friction: what a step costs per rad or m of it"""

    leaning: np.ndarray | None = None
    """(n,) joints that it presses against the limit that they stand on: its Hessian is made positive without them, or
    those that can move would go as slowly as the way bends for these"""

    def damped(self, mu: float) -> Level:
        """The same with `1/2 mu |dq|^2` added (Levenberg-Marquardt)."""
        return replace(self, H=self.H + mu * np.eye(len(self.c)))


@dataclass(frozen=True)
class Subproblem:
    """One level's QP in the coordinates z of the subspace left to it: `dq = start + Z z`."""

    qp: QP
    start: np.ndarray
    Z: np.ndarray
    """(n, k), with a zero column for each wish, whose slack is a variable too"""


def build_first(level: Level, bounds: Bounds) -> Subproblem:
    """Level 1: a QP with a box, in the joints that can move at all (a locked one leaves the QP)."""
    free = bounds.lower < bounds.upper
    start = np.where(free, 0.0, bounds.lower)
    Z = np.eye(len(free))[:, free]
    H, c, h = level.H, level.c, bounds.h
    if not free.all():
        c, h = (c + H @ start)[free], h - bounds.G @ start
        H = H[np.ix_(free, free)]
    if level.leaning is not None:
        leaning = (level.leaning & (bounds.lower <= 0.0) & (bounds.upper >= 0.0))[free]
        H = _apart(H, len(H) - int(leaning.sum()), np.argsort(leaning, kind="stable"))
    if level.saddle is not None:
        H, c = descending(H, c, Z, level.saddle)
    qp = QP(H, c, bounds.lower[free], bounds.upper[free], bounds.G[:, free], h)
    return _with_slack(Subproblem(qp, start, Z), level)


def build_next(level: Level, bounds: Bounds, start: np.ndarray, Z: np.ndarray) -> Subproblem:
    """A lower level: a QP in the few z, from the `start` (n,) of the level above, with every limit as a row."""
    moving = Z.shape[1]
    if level.leaning is not None and level.leaning.any():
        N = null_space(Z[level.leaning], NO_PART, size=1.0)
        Z, moving = np.hstack([Z @ N, Z @ null_space(N.T)]), N.shape[1]
        Z[np.abs(Z) < NO_PART] = 0.0
    H, c = _apart(Z.T @ level.H @ Z, moving), Z.T @ (level.c + level.H @ start)
    H, c = (convexified(H), c) if level.saddle is None else descending(H, c, Z, level.saddle)
    rows = np.vstack([Z, -Z, bounds.G @ Z])
    room = _room(bounds, start)
    felt = np.isfinite(room) & (rows != 0).any(axis=1)
    free = np.full(Z.shape[1], np.inf)
    return _with_slack(Subproblem(QP(H, c, -free, free, rows[felt], room[felt]), start, Z), level)


def _apart(H: np.ndarray, moving: int, order: np.ndarray | None = None) -> np.ndarray:
    """H (k, k) without what couples the first `moving` coordinates, in an order (k,), to the others."""
    if moving == len(H):
        return H
    others = np.arange(moving, len(H)) if order is None else order[moving:]
    alone = H.copy()
    alone[others], alone[:, others] = 0.0, 0.0
    alone[others, others] = np.linalg.norm(H)
    return alone


def _with_slack(problem: Subproblem, level: Level) -> Subproblem:
    """The problem with a variable s_i >= 0 more for each wish of the level, `G dq - s <= h`, and `1/2 |s|^2`."""
    if level.wishes is None:
        return problem
    (G, h), qp, Z = level.wishes, problem.qp, problem.Z
    n, k = len(G), Z.shape[1]
    H = np.zeros((k + n, k + n))
    H[:k, :k], H[k:, k:] = qp.H, np.eye(n)
    rows = np.zeros((len(qp.h) + n, k + n))
    rows[: len(qp.h), :k], rows[len(qp.h) :, :k], rows[len(qp.h) :, k:] = qp.G, G @ Z, -np.eye(n)
    widened = QP(
        H,
        np.concatenate([qp.c, np.zeros(n)]),
        np.concatenate([qp.lower, np.zeros(n)]),
        np.concatenate([qp.upper, np.full(n, np.inf)]),
        rows,
        np.concatenate([qp.h, h - G @ problem.start]),
    )
    return Subproblem(widened, problem.start, np.hstack([Z, np.zeros((len(Z), n))]))


def solve_hierarchy(levels: Sequence[Level], bounds: Bounds, backend: Backend) -> np.ndarray | None:
    """Displacement dq (n,) of the whole hierarchy, within the bounds; None if the backend could not solve level 1.

    dq is inside the box exactly. A level below the first that its backend cannot solve is left out.
    """
    displacements, _ = solve_each_level(levels, bounds, backend)
    return displacements[-1] if displacements else None


def solve_each_level(
    levels: Sequence[Level], bounds: Bounds, backend: Backend, end: float | None = None
) -> tuple[list[np.ndarray], bool]:
    """The displacements (n,) of level 1 alone, of levels 1 and 2, and so on, and whether all levels could be solved.

    There are none if level 1 could not be; a lower level that could not be is left out. They end early where nothing is
    left for the next level to move, or `time.monotonic()` passes `end` [s].
    """
    first = build_first(levels[0], bounds)
    solution = backend.solve(first.qp)
    if not solution.found:
        return [], False
    stands = not bounds.rest.any() and bool((bounds.h >= 0).all())
    z = _with_friction(first, solution.x, levels[0], lambda qp: backend.solve(qp).x) if stands else solution.x
    dq, Z = _shortened(first, z, bounds), first.Z[:, : int((bounds.lower < bounds.upper).sum())]
    displacements, solved = [np.clip(dq, bounds.lower, bounds.upper)], True
    for above, level in pairwise(levels):
        bounds = _with_wishes_kept(bounds, above, dq)
        Z = subspace(Z, above.rows, above.rank_threshold)
        if Z.shape[1] == 0 or (end is not None and time.monotonic() >= end):
            break
        below = build_next(level, bounds, dq, Z)
        z, found = _solve_in_null_space(below.qp, backend)
        z, solved = _with_friction(below, z, level, lambda qp: _solve_in_null_space(qp, backend)[0]), solved and found
        dq = _shortened(below, z, bounds)
        displacements.append(np.clip(dq, bounds.lower, bounds.upper))
    return displacements, solved


def _with_wishes_kept(bounds: Bounds, level: Level, dq: np.ndarray) -> Bounds:
    """The bounds and, as limits, what the displacement dq (n,) of a level reached of its wishes."""
    if level.wishes is None:
        return bounds
    G, h = level.wishes
    return replace(bounds, G=np.vstack([bounds.G, G]), h=np.concatenate([bounds.h, np.maximum(h, G @ dq)]))


def projected_gradient(gradient: np.ndarray, above: Sequence[Level], bounds: Bounds, backend: Backend) -> float:
    """Largest entry of the gradient (n,) that the limits and the levels above leave free: zero at a stationary point.

    It is the steepest descent step of the gradient, scaled down, to the nearest point that they allow (Nocedal and
    Wright, section 12.3). The scale makes a limit hold up its part of the gradient only where q stands on it, to about
    1e-9.
    """
    scale, n = 1e-3, len(gradient)
    if not above and len(bounds.h) == 0:
        return float(np.abs(np.clip(-scale * gradient, bounds.lower, bounds.upper)).max()) / scale
    Z = np.eye(n)[:, bounds.lower < bounds.upper]
    for level in above:
        Z = subspace(Z, level.rows, level.rank_threshold)
    if Z.shape[1] == 0:
        return 0.0
    problem = build_next(Level(np.eye(n), scale * gradient, np.eye(n)), bounds, np.zeros(n), Z)
    dq = _shortened(problem, _solve_in_null_space(problem.qp, backend)[0], bounds)
    return float(np.abs(dq).max()) / scale


def subspace(Z: np.ndarray, rows: np.ndarray, threshold: float) -> np.ndarray:
    """The part (n, k') of the subspace with basis Z (n, k) that the rows (m, n) do not feel."""
    Z = Z @ null_space(rows @ Z, threshold, size=largest_row(rows))
    Z[np.abs(Z) < NO_PART] = 0.0
    return Z


def null_space(A: np.ndarray, threshold: float = RANK_THRESHOLD, size: float = 0.0) -> np.ndarray:
    """Orthonormal basis (n, k) of the null space of A (m, n).

    Singular values count as zero below a share `threshold` of the largest, or of `size` where that is larger: rows of
    that size that say nothing new leave rounding behind, and no rank.
    """
    m, n = A.shape
    if m == 0 or n == 0:
        return np.eye(n)
    _, s, Vt = np.linalg.svd(A)
    return Vt[int((s > threshold * max(s[0], size)).sum()) :].T if s[0] > 0 else np.eye(n)


def largest_row(A: np.ndarray) -> float:
    """Length of the longest row of A (m, n)."""
    return float(np.sqrt(np.einsum("ij,ij->i", A, A).max(initial=0.0)))


def convexified(H: np.ndarray) -> np.ndarray:
    """H with its eigenvalues replaced by their sizes, and those near zero lifted: a descent direction from any H."""
    if len(H) == 1:
        return np.maximum(np.abs(H), 1e-12)
    values, V = np.linalg.eigh(H)
    sizes = np.abs(values)
    return (V * np.maximum(sizes, max(1e-9 * sizes.max(initial=0.0), 1e-12))) @ V.T


ESCAPE = 1e-3
"""The least step along a direction of negative curvature [rad or m]."""


def descending(H: np.ndarray, c: np.ndarray, Z: np.ndarray, saddle: float) -> tuple[np.ndarray, np.ndarray]:
    """H (k, k) with its eigenvalues replaced by their sizes, c (k,) with a pull out of saddle points.

    Along an eigenvector v of an eigenvalue below -saddle the step of the model is `ESCAPE` at least: where the gradient
    does not tell a side, that on which the largest entry of Z v (n,) is positive.
    """
    values, V = np.linalg.eigh(H)
    for value, v in zip(values, V.T, strict=True):
        if value < -saddle:
            way, least = Z @ v, ESCAPE * -value
            slope = float(c @ v)
            side = way[np.abs(way).argmax()] if abs(slope) < 1e-9 * least else -slope
            if abs(slope) < least:
                c = c - (slope + math.copysign(least, side)) * v
    return convexified(H), c


def _solve_in_null_space(qp: QP, backend: Backend) -> tuple[np.ndarray, bool]:
    """z (k,) of a lower level, and whether it was found: a clamp where k = 1, else by the backend.

    Where limits meet in a corner backends may find no point to their tolerance, though z = 0 is one: there it is by the
    active-set method of the compiled engine, which starts from it.
    """
    if len(qp.c) > 1:
        solution = backend.solve(qp)
        return (solution.x, True) if solution.found else _from_zero(qp)
    g = qp.G[:, 0]
    room = qp.h / np.where(g == 0, 1.0, g)
    low = np.max(room[g < 0], initial=-np.inf)
    high = np.min(room[g > 0], initial=np.inf)
    return np.clip(-qp.c / qp.H[0], low, high), True


def _from_zero(qp: QP) -> tuple[np.ndarray, bool]:
    """The same of a QP of which z = 0 keeps all rows, by `kernels.qp.null_space_qp`."""
    from maira_qp.kernels.qp.null_space_qp import ROW_QP, solve_row_qp  # heavy: Numba comes with it

    (m, k), z = qp.G.shape, np.zeros(len(qp.c))
    n = max(m, k)
    rows, upper = np.zeros((n, k)), np.full(n, np.inf)
    rows[:m], upper[:m] = qp.G, qp.h
    work = [np.empty(count, kind) for count, kind in zip(ROW_QP.sizes(n), (float, np.int64), strict=True)]
    found = qp.is_well_posed() and solve_row_qp(qp.H, qp.c, k, rows, -np.full(n, np.inf), upper, *work, z, np.zeros(n))
    return (z, True) if found else (np.zeros(k), False)


RUBS = 20
"""Times that the damping of a step is found again from its length."""

RUBS_LITTLE = 1e-3
"""Friction that takes away less than this share of what a step gains is left out."""

SETTLED = 1e-9
"""The damping is found when `mu |dq|` is `still` but for this share."""

STICKS = 0.9
"""A step of which friction takes away more than this share is not taken."""

JUMP = 30.0
"""By what the damping grows where friction is more than the gradient along the longest part of a step."""


def _with_friction(problem: Subproblem, z: np.ndarray, level: Level, solve: Callable[[QP], np.ndarray]) -> np.ndarray:
    """The step z (k,) with the cost `Level.still |dq|` beside the level's own, as by dry friction.

    It is that of a damping mu with `mu |dq| = still`: where the gradient is no larger than `still` the arm stands, flat
    directions are left before steep ones, and what is worth its way is done nearly as before. mu is found by secants of
    1/|dq|, which is nearly linear in it (as trust-region steps are: Nocedal and Wright, section 4.3).
    """
    still, damping, last, slowness = level.still, 0.0, 0.0, 0.0
    if still == 0.0 or level.wishes is not None:
        return z
    for rub in range(RUBS):
        fall, length = _fall(problem, z, level)
        if (
            length == 0.0
            or (not rub and still * length <= RUBS_LITTLE * fall)
            or (rub and abs(damping * length - still) <= SETTLED * still)
        ):
            break
        slope = (1.0 / length - slowness) / (damping - last) if rub else 0.0
        last, slowness = damping, 1.0 / length
        damping = _next_damping(damping, slowness, slope, still)
        if damping == last:
            break
        z = solve(replace(problem.qp, H=problem.qp.H + damping * np.eye(len(z))))
    fall, length = _fall(problem, z, level)
    return z if still * length <= STICKS * fall else 0.0 * z


def _next_damping(damping: float, slowness: float, slope: float, still: float) -> float:
    """Where the line through a slowness 1/|dq| at a damping meets `damping / still`."""
    if slope * still >= 1.0:
        return JUMP * damping
    return max((slowness - slope * damping) / (1.0 / still - slope), 0.0)


def _fall(problem: Subproblem, z: np.ndarray, level: Level) -> tuple[float, float]:
    """By how much the level's cost falls by a step z (k,) within the limits, negative curvature and all; its length."""
    step, g = problem.Z @ z, level.c + level.H @ problem.start
    return -float(step @ (g + 0.5 * (level.H @ step))), float(np.linalg.norm(step))


OVERSTEPPED = 1e-10
"""What a step may overstep the box [rad or m], as far as backends are exact: it is clipped, and the levels above lose
no more than that times their rows."""


def _shortened(problem: Subproblem, z: np.ndarray, bounds: Bounds) -> np.ndarray:
    """dq (n,) of the longest step along z, at most z itself, that oversteps no limit but for rounding.

    z = 0 is feasible, so however inaccurate the backend is the step is feasible; and since it is shortened as a whole
    and not clipped, it stays in the null space of the levels above.
    """
    step, start = problem.Z @ z, problem.start
    move = np.concatenate([step, -step, bounds.G @ step])
    room = _room(bounds, start) + np.r_[np.full(2 * len(start), OVERSTEPPED), np.full(len(bounds.h), FEASIBILITY)]
    over = move > room
    return start + np.min(room[over] / move[over], initial=1.0) * step


def _room(bounds: Bounds, dq: np.ndarray) -> np.ndarray:
    """What dq (n,) leaves of the upper bounds, the lower bounds and the rows, in this order (2n + m,)."""
    room = np.concatenate([bounds.upper - dq, dq - bounds.lower, bounds.h - bounds.G @ dq])
    return np.maximum(room, 0.0)
