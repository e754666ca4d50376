"""Directions of self-motions, against SciPy's null space."""

import numpy as np
import pytest
from scipy.linalg import null_space

from maira_qp.kernels.paths.self_motions import self_motions


@pytest.mark.parametrize(("m", "n"), [(6, 7), (3, 7), (6, 8), (5, 6)])
def test_they_span_the_null_space(m, n):
    jacobians = np.random.default_rng(m + n).normal(size=(20, m, n))
    directions = np.empty((20, n, n - m))
    self_motions(jacobians, directions)
    for J, Z in zip(jacobians, directions, strict=True):
        N = null_space(J)
        np.testing.assert_allclose(Z @ Z.T, N @ N.T, atol=1e-10)
        np.testing.assert_allclose(Z.T @ Z, np.eye(n - m), atol=1e-12)


@pytest.mark.parametrize("rank", range(6))
def test_of_a_singular_jacobian_they_are_some_of_its_null_space(rank):
    rng = np.random.default_rng(rank)
    J = rng.normal(size=(6, rank)) @ rng.normal(size=(rank, 7))
    Z = np.empty((1, 7, 1))
    self_motions(J[None], Z)
    np.testing.assert_allclose(J @ Z[0], 0.0, atol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(Z), 1.0, rtol=1e-12)
