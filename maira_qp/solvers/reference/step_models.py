"""The quadratic models of the levels of a control tick.

With A (m, n) the weighted rows of a level's tasks, r their weighted error, K the rows of what goes before it (the
levels above, and the limits that it is pressed against), and Z a basis of their null space in the joints that no limit
holds, r splits into what the steps Z z can take away and what they leave:

    r' = F^4 r,   F = nu (A Z Z^T A^T + nu I)^-1

F is the identity for what A cannot reach and vanishes for what it can; the change comes where singular values pass
sqrt(nu), the share `SINGULAR` of the size of A, and its fourth power makes it sharp. Z is that of the hierarchy: a
direction in which a row of K is as weak as 1e-8, as in arms whose right angles are rounded, is not left to the level,
and what only it could take away stays. Only what is left bends a model:

    H = A^T A - sum_k r'_k d2 e_k / dq2 + sum_k lambda'_k dK_k / dq,   K^T lambda' = A^T r'
    c = -A^T r (each task's part times its gain)

(e the weighted error.) Where the targets can be reached this is Gauss-Newton's model: the tool takes its share of the
error along a straight line, and a self-motion is not set adrift by the curvature of errors that are about to vanish.
Where they cannot, r' is r at rest and the model is Newton's, with the Hessian of the level's Lagrangian (Nocedal and
Wright, "Numerical Optimization", 2006, section 18.1): the arm comes to rest. The Levenberg-Marquardt damping is by r'
too, and vanishes with the gradient (as proposed by Fan and Yuan, "On the quadratic convergence of the
Levenberg-Marquardt method without nonsingularity assumption", 2005).

A level that cannot reach its targets has dry friction: along directions in which its cost hardly falls, as with joint
angles that a model gives with few digits, an arm would go on for ever.

The levels below must leave a level's rows as they are. Where it bends, its rows do not feel every displacement that
would cost it: those directions in the null space of its rows in which its Hessian has curvature are rows as well.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from maira_qp.problem.limits.joint import Bounds
from maira_qp.problem.options import Options
from maira_qp.problem.qp.costs import HESSIAN_RANK_THRESHOLD, LevelObjective, TaskCost
from maira_qp.problem.qp.hierarchy import Level, largest_row, null_space, subspace
from maira_qp.problem.tasks.task import Task
from maira_qp.robots.model.configuration import Configuration

SINGULAR = 1e-2
"""sqrt(nu) as a share of the size of A, the root of the sum of its squares."""

FILTER = 4
"""The power of F."""

DEPENDENT = 1e-5
"""sqrt(eps) as a share of the size of K."""

PASSES = 4
"""Times that the joints and limits which hold a level are guessed again from the multipliers."""

NEAR = 0.1
"""A limit farther away than this [rad or m], or than a tick reaches at full speed, holds nothing."""

BENDS = 1e-6
"""A share of the error below which what is left of it bends nothing."""

UNKNOWN = 1e-8
"""Entries of a direction in which a level bends that are smaller are rounding: an eigenvector is known to that of the
Hessian by the least curvature that counts, 1e-16 / 1e-6. Joints that have nothing to do with each other stay apart."""

NOTHING = 1e-6
"""What is left of a weighted error below this [rad] bends nothing either: a target that near is reached."""

SADDLE, FLAT = 1e-3, 1e-5
"""Shares of |r'| sqrt(max |H|): negative curvature beyond the first is left, curvature below the second is none."""

STATIONARY = 0.1
"""A level may stand at a saddle point if its gradient is below this share of |r'| sqrt(max |H|).

How directions bend in which a level above does, nothing tells: below such a level no curvature is known to be negative.
"""

FRICTION = 0.7
"""A share of `Options.stationarity_tolerance` times |r'| sqrt(max |H|): the gradient below which a level rests, a
little less than what counts as stationary."""

FAINT = 1e-5
"""The same share of |r| sqrt(max |H|) where the targets are reached within the tolerances."""

LEAST_DAMPING = 1e-7
"""Floor of the damping as a share of the largest entry of H: the shortest of the steps that do the same."""

STEEP = 1e-5
"""The damping falls with the gradient to this share of what it is far from rest."""

STANDING = 1e-8
"""A joint as near to a limit stands on it [rad or m]."""

RANK = 1e-10
"""Share of the longest row of a level below which one counts as none: those of angles that a model gives with ten
digits say nothing, and a tick along them costs the level that share."""

TINY = 1e-30


@dataclass(frozen=True)
class Reach:
    """What limits leave of a tick at a configuration."""

    locked: np.ndarray
    """(n,) joints that cannot move at all"""
    at_lower: np.ndarray
    """(n,) joints whose lower limit is near"""
    at_upper: np.ndarray
    """(n,) joints whose upper limit is near"""
    standing: np.ndarray
    """(n,) joints that stand on a limit"""
    G: np.ndarray
    """(k, n) rows of further limits that are near"""

    @staticmethod
    def of(bounds: Bounds, timeless: Bounds, step: np.ndarray) -> Reach:
        """From the bounds of a tick, those where no time passes, and the largest displacements (n,) of a tick."""
        reach = np.minimum(step, NEAR)
        near = is_near((bounds.G, bounds.h), step)
        locked = timeless.lower >= timeless.upper
        standing = (timeless.lower >= -STANDING) | (timeless.upper <= STANDING)
        return Reach(locked, timeless.lower >= -reach, timeless.upper <= reach, standing, bounds.G[near])


def is_near(rows: tuple[np.ndarray, np.ndarray], step: np.ndarray) -> np.ndarray:
    """Which (k,) of the limits `G dq <= h` are near, with displacements of a tick up to step (n,)."""
    G, h = rows
    return h <= np.abs(G) @ np.minimum(step, NEAR)


@dataclass(frozen=True)
class TickModel:
    """A level and what is known about it at a configuration."""

    level: Level
    multipliers: np.ndarray
    """(m,) of the rows of the levels above, that balance the level's gradient"""
    bent: int
    """How many of its rows are directions in which it bends, behind those of its tasks"""


def are_reached(tasks: Iterable[Task], at: Configuration, options: Options) -> bool:
    """Whether every target is reached within the tolerances."""
    residuals = [task.residual(at) for task in tasks]
    return all(p <= options.position_tolerance and o <= options.orientation_tolerance for p, o in residuals)


def tick_models(levels: Sequence[LevelObjective], at: Configuration, reach: Reach, options: Options) -> list[TickModel]:
    """The models of the levels in falling priority."""
    models: list[TickModel] = []
    K, is_bent = np.empty((0, at.n)), False
    for number, level in enumerate(levels):
        A, r = level.tasks.rows(at)
        g, W = level.gradient(at), level.objective_hessian(at)
        held, G = holding(K, g, reach)
        Z = left_to_level([G, *(model.level.rows for model in models)], held)
        left = remaining_error(A, r, Z, held, level, W, at)
        pressed, bending = (balance(np.vstack([G, K]), each, held) for each in (g, g + A.T @ (r - left)))
        free = float(np.linalg.norm(Z.T @ g))
        bends = bool(left @ left > max(BENDS**2 * (r @ r), NOTHING**2))
        C = _upright(W) if level.objectives and number == 0 else W
        C = C + _curvature_above(levels[:number], models, at, bending[len(G) :])
        C = C + _curvature(level.tasks, at, left) if bends else C
        H = A.T @ A + C
        largest, squared = float(np.abs(H).max()), float(left @ left)
        steep = float(np.sqrt(squared / (largest + TINY))) * free
        mu = options.damping * min(max(steep, STEEP * squared), squared, 1.0)
        mu += LEAST_DAMPING * largest + level.tasks.damping(at)
        size = float(np.sqrt(squared * largest))
        flat = HESSIAN_RANK_THRESHOLD * largest if level.objectives else FLAT * size
        bent = K[:0]
        if number + 1 < len(levels) and (bends or level.objectives):
            bent = bent_directions(np.vstack([K, A]), C, reach.locked, flat)
        rows = np.vstack([A, bent])
        saddle = SADDLE * size if steep <= STATIONARY * squared and not is_bent else np.inf
        model = Level(H, level.pull(at), rows, level.cost(at), float(r @ r), rank_threshold=RANK)
        still = FAINT * float(np.sqrt(r @ r * largest)) if are_reached(level.tasks.tasks, at, options) else 0.0
        rough = FRICTION * options.stationarity_tolerance * size
        model = replace(model, saddle=saddle if bends else None, still=max(still, rough if bends else 0.0))
        model = replace(model, leaning=held & reach.standing)
        models.append(TickModel(model.damped(mu), pressed[len(G) :], len(bent)))
        K, is_bent = np.vstack([K, rows]), is_bent or (bends and len(bent) > 0)
    return models


def _upright(W: np.ndarray) -> np.ndarray:
    """W (n, n) with its eigenvalues replaced by their sizes."""
    values, V = np.linalg.eigh(W)
    return (V * np.abs(values)) @ V.T


def holding(K: np.ndarray, g: np.ndarray, reach: Reach) -> tuple[np.ndarray, np.ndarray]:
    """The joints (n,) and the rows (k, n) of limits near by that hold up a level with the rows K above it.

    They are those that the descent of its cost, g (n,) its gradient, runs into.
    """
    held, pressed = reach.locked, np.ones(len(reach.G), bool)
    for _ in range(PASSES):
        rows = np.vstack([reach.G[pressed], K])
        multipliers = balance(rows, g, held)
        pull = -(g + rows.T @ multipliers)
        hold = reach.locked | (reach.at_lower & (pull < 0)) | (reach.at_upper & (pull > 0))
        press = pressed.copy()
        press[pressed] = multipliers[: int(pressed.sum())] > 0
        press[~pressed] = reach.G[~pressed] @ pull > 0
        if (hold == held).all() and (press == pressed).all():
            break
        held, pressed = hold, press
    return held, reach.G[pressed]


def balance(K: np.ndarray, g: np.ndarray, held: np.ndarray) -> np.ndarray:
    """Multipliers (m,) of the rows K (m, n) that balance a gradient (n,) on the joints that nothing holds."""
    K = np.where(held, 0.0, K)
    return -np.linalg.solve(K @ K.T + dependent(K) * np.eye(len(K)), K @ g)


def left_to_level(above: Sequence[np.ndarray], held: np.ndarray) -> np.ndarray:
    """A basis (n, k) of the null space of the rows of each level above, in the joints that are not `held` (n,)."""
    Z = np.eye(len(held))[:, ~held]
    for rows in above:
        Z = subspace(Z, rows, RANK)
    return Z


def remaining_error(
    A: np.ndarray,
    r: np.ndarray,
    Z: np.ndarray,
    held: np.ndarray,
    level: LevelObjective,
    W: np.ndarray,
    at: Configuration,
) -> np.ndarray:
    """What steps Z z leave of the error r (m,) of the rows A, Z (n, k) without the joints that are `held` (n,).

    Where objectives count beside the tasks, W their Hessian, it is what the step to the least sum leaves.
    """
    AZ, nu = A @ Z, max(SINGULAR**2 * float((A[:, ~held] ** 2).sum()), TINY)
    if len(A) and level.objectives:
        values, V = np.linalg.eigh(AZ.T @ AZ + Z.T @ W @ Z)
        lifted = np.abs(values) + nu * SINGULAR**3
        g = sum(each.weight * each.objective.gradient(at) for each in level.objectives)
        return r - AZ @ V @ (V.T @ (AZ.T @ r - Z.T @ g) / lifted)
    M = AZ @ AZ.T + nu * np.eye(len(A))
    for _ in range(FILTER):
        r = nu * np.linalg.solve(M, r)
    return r


def bent_directions(rows: np.ndarray, C: np.ndarray, locked: np.ndarray, flat: float) -> np.ndarray:
    """Directions (k, n) in the null space of the rows (m, n) in which the curvature C (n, n) is beyond `flat`."""
    Z = np.eye(len(C))[:, ~locked]
    Z = Z @ null_space(rows @ Z, DEPENDENT, size=largest_row(rows))
    values, V = np.linalg.eigh(Z.T @ C @ Z)
    bent = (Z @ V[:, np.abs(values) > flat]).T
    return np.where(np.abs(bent) > UNKNOWN, bent, 0.0)


def dependent(K: np.ndarray) -> float:
    """What is added to the diagonal of `K K^T`, K (m, n), whose rows may depend on each other."""
    return DEPENDENT**2 * float((K * K).sum()) + TINY


def _curvature(tasks: TaskCost, at: Configuration, left: np.ndarray) -> np.ndarray:
    """How the cost of the tasks bends (n, n) beside Gauss-Newton's part, where `left` (m,) stays of their error."""
    parts = _split(left, [len(task.weighted_error(at)) for task in tasks.tasks])
    pairs = zip(tasks.tasks, parts, strict=False)
    return sum((task.residual_curvature(at, part) for task, part in pairs), np.zeros((at.n, at.n)))


def _curvature_above(
    levels: Sequence[LevelObjective], models: Sequence[TickModel], at: Configuration, multipliers: np.ndarray
) -> np.ndarray:
    """How the rows of levels bend (n, n), times their multipliers (m,)."""
    C, start = np.zeros((at.n, at.n)), 0
    for level, model in zip(levels, models, strict=True):
        stop = start + len(model.level.rows)
        C += level.tasks.curvature(at, multipliers[start : stop - model.bent])
        start = stop
    return C


def _split(values: np.ndarray, sizes: Sequence[int]) -> list[np.ndarray]:
    return np.split(values, np.cumsum(sizes))
