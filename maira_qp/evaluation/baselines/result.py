"""What every reference method returns."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class BaselineResult:
    """Where a reference method stopped. Angles in rad, prismatic joints in m."""

    q: np.ndarray
    """The last configuration (n,)."""
    converged: bool
    """Whether the method's own error met its tolerance at q; if not, q is only the last of its approximations."""
    iterations: int
    """Steps taken, K."""
    error: float
    """Norm of the method's own error at q [m, or m and rad together]."""
    history: np.ndarray
    """Every configuration from the start to q, (K + 1, n)."""
