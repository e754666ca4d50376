"""Even steps: a line on a path is moved along its self-motions so that its steps and their changes are small.

A least-squares problem in the displacements along the self-motions, linear between two descents to the path. Large
steps count more and more in it, by weights that follow them (iteratively reweighted least squares: Lawson,
"Contributions to the theory of linear least maximum approximations", 1961). A posture may draw on the line as well.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import solveh_banded

from maira_qp.problem.objectives import Posture
from maira_qp.solvers.paths.continuity import is_continuous
from maira_qp.solvers.paths.descents import PathArrays

LARGE = 10.0
"""What a high power of a step, by the largest of the line, counts against its square."""
FARTHEST = 0.1
"""How far [rad or m] a configuration is moved at once, at most."""
HARDLY = 1.2
"""For a smoother line the largest step may grow by this factor, if that is allowed."""
SHARES = (1.0, 0.5, 0.25)
"""Of a displacement, one after the other until it makes the line more even."""
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


PULLS = (0.01, 0.1, 1.0, 10.0, 100.0)
"""What the cost of a posture counts against that of the steps, one after the other, in terms of the line's own two."""


@dataclass(frozen=True, eq=False)
class Pull:
    """The cost of a posture, half of the weighted squares of the distances to it."""

    q_ref: np.ndarray
    """(n,) [rad or m]"""
    weights: np.ndarray
    """(n, n)"""

    @staticmethod
    def of(posture: Posture, n: int) -> Pull:
        """On an arm of n joints, of which the posture may not know the last."""
        beside = n - len(posture.q_ref)
        weights = np.diag(posture.weights) if posture.is_diagonal else posture.weights
        return Pull(np.pad(posture.q_ref, (0, beside)), np.pad(weights, (0, beside)))

    def cost(self, q: np.ndarray) -> float:
        """Of a line (N, n)."""
        off = q - self.q_ref
        return 0.5 * float(np.sum(off @ self.weights * off))


EVEN, LOW = Manner(bending=3.0, power=8, times=8), Manner(bending=0.0, power=24, times=40)
"""A smooth line; and one whose largest step is small, where a smooth one has too large a step."""
DRAWN = Manner(bending=3.0, power=8, times=20)
"""A smooth line on which a posture draws."""


@dataclass(frozen=True, eq=False)
class Unevenness:
    """The cost of a line of N configurations."""

    scales: np.ndarray
    """(N - 1, n): one by how far each joint may move from pose to pose"""
    largest: float
    """The step by which others are large"""
    manner: Manner
    pull: Pull | None = None

    def __call__(self, q: np.ndarray) -> float:
        """Of a line (N, n)."""
        steps = self.scales * np.diff(q, axis=0)
        high = (np.abs(steps) / self.largest) ** (self.manner.power - 2)
        bends = self.manner.bending * np.sum(np.diff(steps, axis=0) ** 2)
        pull = 0.0 if self.pull is None else self.pull.cost(q)
        return float(np.sum(steps**2 * (1.0 + 2.0 / self.manner.power * LARGE * high)) + bends) + pull

    def step(self, q: np.ndarray, free: np.ndarray) -> np.ndarray:
        """Displacements (N, n) along directions (N, n, d) that make it smaller, a damped Gauss-Newton step."""
        count, _, d = free.shape
        blocks = [np.zeros((count - far, d, d)) for far in range(3)]
        slope = np.zeros((count, d))
        steps = self.scales * np.diff(q, axis=0)
        weights = 1.0 + LARGE * (np.abs(steps) / self.largest) ** (self.manner.power - 2)
        self._add((-self.scales, self.scales), steps, weights, free, blocks, slope)
        if self.manner.bending:
            before, after = self.scales[:-1], self.scales[1:]
            bends = np.diff(steps, axis=0)
            weights = np.full(bends.shape, self.manner.bending)
            self._add((before, -before - after, after), bends, weights, free, blocks, slope)
        if self.pull is not None:
            drawn = 0.5 * free.swapaxes(1, 2) @ self.pull.weights
            slope += (drawn @ (q - self.pull.q_ref)[:, :, None])[:, :, 0]
            blocks[0] += drawn @ free
        moved = np.einsum("knd,kd->kn", free, _solved(blocks, -slope))
        return moved * min(1.0, FARTHEST / max(np.abs(moved).max(), FARTHEST))

    @staticmethod
    def _add(
        factors: tuple[np.ndarray, ...],
        rows: np.ndarray,
        weights: np.ndarray,
        free: np.ndarray,
        blocks: list[np.ndarray],
        slope: np.ndarray,
    ) -> None:
        """Add the squares of rows (M, n) by weights (M, n) to the normal equations, in place.

        Row k is a sum of factors (M, n) times the configurations k, k + 1 and so on.
        """
        count = len(rows)
        for i, left in enumerate(factors):
            here = free[i : i + count]
            slope[i : i + count] += np.einsum("knd,kn->kd", here, left * weights * rows)
            for j in range(i, len(factors)):
                product = np.einsum("knd,kn,kne->kde", here, left * weights * factors[j], free[j : j + count])
                blocks[j - i][i : i + count] += product


def drawn_to(path: PathArrays, q: np.ndarray, fixed: tuple[bool, bool], posture: Posture) -> np.ndarray:
    """The line (N, n) nearer to a posture, as far as its largest step stays about as it is and it jumps nowhere."""
    largest, pull = path.largest_steps(q).max(initial=0.0), Pull.of(posture, path.n)
    own = pull.cost(q)
    if path.n <= path.rank or len(q) < 3 or not 0.0 < largest <= 1.0 or own == 0.0:
        return q
    share = Unevenness(1.0 / path.windows, largest, DRAWN)(q) / own
    for times in PULLS:
        heavier = replace(pull, weights=times * share * pull.weights)
        there = evened(path, q, fixed, DRAWN, heavier, min(1.0, HARDLY * largest))
        steps = np.arange(len(q) - 1)
        if there is q or not is_continuous(path, steps, there[:-1], there[1:]).all():
            break
        q = there
    return q


def evened(
    path: PathArrays,
    q: np.ndarray,
    fixed: tuple[bool, bool],
    manner: Manner,
    pull: Pull | None = None,
    allowed: float | None = None,
) -> np.ndarray:
    """The line (N, n), N >= 3, made even, by descents to the path after each step; its first and last may be fixed.

    A posture may pull. Its largest step may grow to what is allowed; None: hardly.
    """
    largest = path.largest_steps(q).max()
    if largest == 0.0:
        return q
    ends = [end for end, is_fixed in zip((0, -1), fixed, strict=True) if is_fixed]
    cost_of = Unevenness(1.0 / path.windows, largest, manner, pull)
    cost, allowed = cost_of(q), max(largest, min(1.0, HARDLY * largest)) if allowed is None else allowed
    for _ in range(manner.times):
        free = path.self_motions(q)
        free[ends] = 0.0
        step = cost_of.step(q, free)
        for share in SHARES:
            there, arrived = path.descend(np.arange(len(q)), q + share * step)
            there[ends] = q[ends]
            after = cost_of(there)
            if arrived.all() and after < cost and path.largest_steps(there).max() <= allowed:
                break
        else:
            break
        is_slow = after > (1.0 - SLOW) * cost
        q, cost = there, after
        if is_slow:
            break
    return q


def _solved(blocks: list[np.ndarray], right: np.ndarray) -> np.ndarray:
    """The damped solution (N, d) of equations of blocks (N - k, d, d), those on the diagonal and those k beside it."""
    count, d = right.shape
    width = len(blocks) * d - 1
    banded = np.zeros((width + 1, count, d))  # upper form: row `width` holds the diagonal
    for far, block in enumerate(blocks):
        for i, j in np.ndindex(d, d):
            if far or j >= i:
                banded[width - far * d + i - j, far:, j] = block[:, i, j]
    banded[width] += DAMPING * banded[width].max()
    return solveh_banded(banded.reshape(width + 1, -1), right.ravel()).reshape(count, d)
