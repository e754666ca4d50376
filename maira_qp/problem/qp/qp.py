"""A quadratic program and its solution, which can certify itself.

    min 1/2 x^T H x + c^T x   subject to   lower <= x <= upper,  G x <= h

The Karush-Kuhn-Tucker conditions, with multipliers z >= 0 of the rows and z_box of the box (positive at an upper bound,
negative at a lower one): `H x + c + G^T z + z_box = 0`, feasibility, and a multiplier only where the limit is active
(Nocedal and Wright, "Numerical Optimization", 2006, section 16.4).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class QP:
    """The data of a QP in n variables with m rows. H (n, n) symmetric, c (n,), bounds (n,), G (m, n), h (m,)."""

    H: np.ndarray
    c: np.ndarray
    lower: np.ndarray
    upper: np.ndarray
    G: np.ndarray
    h: np.ndarray

    def is_well_posed(self) -> bool:
        """No NaN anywhere, finite H and c, and no empty interval. What is not may never reach a backend."""
        return bool(
            np.isfinite(self.H).all()
            and np.isfinite(self.c).all()
            and np.isfinite(self.G).all()
            and (self.lower <= self.upper).all()
            and not np.isnan(self.h).any()
        )

    def cost(self, x: np.ndarray) -> float:
        """Value of the objective at x (n,)."""
        return float(0.5 * x @ self.H @ x + self.c @ x)


@dataclass(frozen=True)
class QPSolution:
    """What a backend found for a QP; where that is nothing, x is zero clipped to the box, the residuals infinite."""

    qp: QP
    found: bool
    x: np.ndarray
    """(n,), inside the box exactly"""
    z: np.ndarray
    """(m,) multipliers of the rows"""
    z_box: np.ndarray
    """(n,) multipliers of the box"""
    reason: str = ""
    """Why nothing was found, in the backend's words"""

    def primal_residual(self) -> float:
        """By how much x breaks a constraint."""
        if not self.found:
            return np.inf
        qp, x = self.qp, self.x
        broken = np.concatenate([qp.lower - x, x - qp.upper, qp.G @ x - qp.h])
        return float(broken.max(initial=0))

    def dual_residual(self) -> float:
        """Largest entry of `H x + c + G^T z + z_box`."""
        if not self.found:
            return np.inf
        qp = self.qp
        return float(np.abs(qp.H @ self.x + qp.c + qp.G.T @ self.z + self.z_box).max(initial=0))

    def complementarity(self) -> float:
        """Largest product of a multiplier and its constraint's slack; a multiplier of the wrong sign counts whole."""
        if not self.found:
            return np.inf
        qp, x = self.qp, self.x
        up, down = np.maximum(self.z_box, 0), np.maximum(-self.z_box, 0)
        with np.errstate(invalid="ignore"):  # a zero multiplier of a bound at infinity
            products = np.concatenate([up * (qp.upper - x), down * (x - qp.lower), self.z * (qp.h - qp.G @ x)])
        products[np.concatenate([up, down, self.z]) == 0] = 0
        return float(max(np.abs(products).max(initial=0), np.max(-self.z, initial=0)))
