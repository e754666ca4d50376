"""One finite-difference checker for everything that claims a gradient or a Hessian."""

from collections.abc import Callable

import numpy as np


def difference_gradient(f: Callable[[np.ndarray], float], q: np.ndarray, step: float = 1e-6) -> np.ndarray:
    """Gradient (n,) of a scalar function by central differences."""
    return np.array([f(q + dq) - f(q - dq) for dq in step * np.eye(len(q))]) / (2 * step)


def difference_jacobian(f: Callable[[np.ndarray], np.ndarray], q: np.ndarray, step: float = 1e-6) -> np.ndarray:
    """Jacobian (m, n) of a vector function by central differences."""
    return np.array([f(q + dq) - f(q - dq) for dq in step * np.eye(len(q))]).T / (2 * step)


def assert_close(found: np.ndarray, expected: np.ndarray, tolerance: float) -> None:
    """Largest difference, relative to the larger of 1 and the expected values."""
    assert np.abs(found - expected).max() <= tolerance * max(1.0, np.abs(expected).max())
