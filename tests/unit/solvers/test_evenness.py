"""The step of a line towards an even one, against dense least squares."""

import numpy as np
import pytest

from maira_qp.solvers.paths.evenness import DAMPING, EVEN, FARTHEST, LARGE, LOW, Unevenness


def expected(cost: Unevenness, q: np.ndarray, free: np.ndarray) -> np.ndarray:
    """The same by dense matrices, row by row."""
    count, n, d = free.shape
    along = np.zeros((count * n, count * d))
    for k in range(count):
        along[k * n : (k + 1) * n, k * d : (k + 1) * d] = free[k]
    differences = np.kron(np.eye(count - 1, count, k=1) - np.eye(count - 1, count), np.eye(n))
    steps_of = cost.scales.ravel()[:, None] * differences
    bends_of = np.kron(np.eye(count - 2, count - 1, k=1) - np.eye(count - 2, count - 1), np.eye(n)) @ steps_of
    steps = steps_of @ q.ravel()
    weights = np.sqrt(1.0 + LARGE * (np.abs(steps) / cost.largest) ** (cost.manner.power - 2))
    rows = np.vstack([weights[:, None] * steps_of, np.sqrt(cost.manner.bending) * bends_of])
    normal = along.T @ rows.T @ rows @ along
    normal += DAMPING * normal.diagonal().max() * np.eye(len(normal))
    moved = (along @ np.linalg.solve(normal, -along.T @ rows.T @ rows @ q.ravel())).reshape(q.shape)
    return moved * min(1.0, FARTHEST / np.abs(moved).max())


@pytest.mark.parametrize("manner", [EVEN, LOW])
@pytest.mark.parametrize(("count", "d"), [(3, 1), (12, 1), (9, 2), (7, 3)])
def test_the_step_is_that_of_dense_least_squares(count, d, manner):
    rng = np.random.default_rng(count)
    q, free = np.cumsum(rng.normal(scale=0.05, size=(count, 5)), axis=0), rng.normal(size=(count, 5, d))
    free[0] = 0.0  # its end stays
    scales = rng.uniform(1.0, 4.0, size=(count - 1, 5))
    cost = Unevenness(scales, np.abs(scales * np.diff(q, axis=0)).max(), manner)
    step = cost.step(q, free)
    np.testing.assert_allclose(step, expected(cost, q, free), rtol=1e-6, atol=1e-9)
    assert cost(q + 0.01 * step) < cost(q)
    np.testing.assert_array_equal(step[0], 0.0)
