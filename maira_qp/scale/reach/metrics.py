"""How good configurations are: manipulability, and the distance from the joint limits.

Everything is an operation on each number alone, in one order, so that a result does not depend on which configurations
are computed together.
"""

from __future__ import annotations

import numpy as np

from maira_qp.robots.model.robot import Robot


def manipulabilities(robot: Robot, q: np.ndarray) -> np.ndarray:
    """The product (N,) of the min(6, n) singular values of the Jacobians at q (N, n), see `Robot.manipulability`.

    It is the root of det(J J^T), or of det(J^T J) where n < 6, by Cholesky's decomposition; 0 where rounding makes it
    singular.
    """
    J = np.ascontiguousarray(np.moveaxis(robot.jacobians(q), 0, -1))
    rows = J if J.shape[0] <= J.shape[1] else J.swapaxes(0, 1)
    k = len(rows)
    A = [[_product(rows[i], rows[j]) for j in range(i + 1)] for i in range(k)]
    determinant = np.ones(len(q))
    with np.errstate(divide="ignore", invalid="ignore"):
        for i in range(k):
            pivot = A[i][i]
            determinant = determinant * pivot
            for a in range(i + 1, k):
                factor = A[a][i] / pivot
                for b in range(i + 1, a + 1):
                    A[a][b] = A[a][b] - factor * A[b][i]
    return np.sqrt(np.where(determinant > 0.0, determinant, 0.0))


def limit_distances(robot: Robot, q: np.ndarray) -> np.ndarray:
    """How far (N,) configurations q (N, n) are from their nearest joint limit, in half ranges: 0 at one, 1 midway.

    Joints without limits do not count.
    """
    distance = np.ones(len(q))
    for i in np.flatnonzero(np.isfinite(robot.upper - robot.lower) & (robot.upper > robot.lower)):
        nearest = np.minimum(q[:, i] - robot.lower[i], robot.upper[i] - q[:, i])
        distance = np.minimum(distance, nearest / (0.5 * (robot.upper[i] - robot.lower[i])))
    return distance


def _product(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Inner products (N,) of vectors (n, N), summed in order."""
    total = x[0] * y[0]
    for a, b in zip(x[1:], y[1:], strict=True):
        total = total + a * b
    return total
