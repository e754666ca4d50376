"""Even steps: a line on a path is moved along its self-motions so that its steps and their changes are small.

A least-squares problem in the displacements along the self-motions, linear between two descents to the path. Large
steps count more and more in it, by weights that follow them (iteratively reweighted least squares: Lawson,
"Contributions to the theory of linear least maximum approximations", 1961).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import spsolve

from maira_qp.solvers.paths.descents import PathArrays

LARGE = 10.0
"""What a high power of a step, by the largest of the line, counts against its square."""
FARTHEST = 0.1
"""How far [rad or m] a configuration is moved at once, at most."""
HARDLY = 1.2
"""For a smoother line the largest step may grow by this factor, if that is allowed."""
DAMPING, SLOW = 1e-6, 1e-3
"""By the largest entry of the normal matrix; a smaller fall of the cost ends it."""


@dataclass(frozen=True)
class Manner:
    """What is made small."""

    bending: float
    """What the square of a change of steps counts against the square of a step"""
    power: int
    """To which power large steps count, beside their squares"""
    times: int
    """How often the line is moved, at most"""


EVEN, LOW = Manner(bending=3.0, power=8, times=8), Manner(bending=0.0, power=24, times=40)
"""A smooth line; and one whose largest step is small, where a smooth one has too large a step."""


@dataclass(frozen=True, eq=False)
class Unevenness:
    """The cost of a line of N configurations."""

    steps_of: sparse.sparray
    """((N - 1) n, N n): steps, by what is allowed"""
    bends_of: sparse.sparray
    """((N - 2) n, N n): their changes, by the root of what these count"""
    largest: float
    """The step by which others are large"""
    power: int

    @staticmethod
    def of(path: PathArrays, largest: float, manner: Manner) -> Unevenness:
        """On a path."""
        count, joints = len(path), sparse.eye_array(path.n)
        steps_of = sparse.diags_array(1.0 / path.windows.ravel()) @ sparse.kron(_differences(count), joints)
        bends_of = np.sqrt(manner.bending) * sparse.kron(_differences(count - 1), joints) @ steps_of
        return Unevenness(steps_of, bends_of, largest, manner.power)

    def __call__(self, q: np.ndarray) -> float:
        """Of a line (N, n)."""
        steps, bends = self.steps_of @ q.ravel(), self.bends_of @ q.ravel()
        high = (np.abs(steps) / self.largest) ** (self.power - 2)
        return float(np.sum(steps**2 * (1.0 + 2.0 / self.power * LARGE * high)) + np.sum(bends**2))

    def step(self, q: np.ndarray, free: np.ndarray) -> np.ndarray:
        """Displacements (N, n) along directions (N, n, d) that make it smaller, a damped Gauss-Newton step."""
        along = sparse.block_diag(list(free), format="csr")
        steps, bends = self.steps_of @ q.ravel(), self.bends_of @ q.ravel()
        weights = np.sqrt(1.0 + LARGE * (np.abs(steps) / self.largest) ** (self.power - 2))
        rows = sparse.vstack([sparse.diags_array(weights) @ self.steps_of, self.bends_of]) @ along
        normal = rows.T @ rows
        normal += DAMPING * normal.diagonal().max() * sparse.eye_array(normal.shape[0])
        moved = along @ spsolve(normal.tocsc(), -rows.T @ np.concatenate([weights * steps, bends]))
        return moved.reshape(q.shape) * min(1.0, FARTHEST / max(np.abs(moved).max(), FARTHEST))


def evened(path: PathArrays, q: np.ndarray, fixed: tuple[bool, bool], manner: Manner) -> np.ndarray:
    """The line (N, n), N >= 3, made even, by descents to the path after each step; its first and last may be fixed."""
    largest = path.largest_steps(q).max()
    if largest == 0.0:
        return q
    ends = [end for end, is_fixed in zip((0, -1), fixed, strict=True) if is_fixed]
    cost_of, allowed = Unevenness.of(path, largest, manner), max(largest, min(1.0, HARDLY * largest))
    cost = cost_of(q)
    for _ in range(manner.times):
        free = np.linalg.svd(path.jacobians(q), full_matrices=True)[2][:, path.rank :, :].swapaxes(1, 2)
        free[ends] = 0.0
        there, arrived = path.descend(np.arange(len(q)), q + cost_of.step(q, free))
        there[ends] = q[ends]
        after = cost_of(there)
        if not arrived.all() or not after < cost or path.largest_steps(there).max() > allowed:
            break
        is_slow = after > (1.0 - SLOW) * cost
        q, cost = there, after
        if is_slow:
            break
    return q


def _differences(count: int) -> sparse.sparray:
    """D (count - 1, count): D x are the differences of neighbours."""
    return sparse.eye_array(count - 1, count, k=1) - sparse.eye_array(count - 1, count)
