"""The errors that the reference methods drive to zero, each with its Jacobian, and when they count as zero."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from maira_qp.orientation import orientation_error
from maira_qp.robots.dh.table import DHTable

Residual = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]
"""q (n,) to the error e (m,) and the Jacobian J (m, n) of the motion that reduces it: e changes by -J dq."""


def position_residual(table: DHTable, point: np.ndarray) -> Residual:
    """x_d - f(q) (3,) [m] and the linear Jacobian (3, n)."""

    def residual(q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        htms = table.compute_htms(q)
        return point - htms[-1, :3, 3], table.jacobian_of(htms)[:3]

    return residual


def pose_residual(
    table: DHTable, target: np.ndarray, orientation: Callable[[np.ndarray, np.ndarray], np.ndarray] = orientation_error
) -> Residual:
    """[p_d - p; orientation(R, R_d)] (6,) [m; rad] and the geometric Jacobian (6, n)."""

    def residual(q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        htms = table.compute_htms(q)
        T = htms[-1]
        e = np.concatenate([target[:3, 3] - T[:3, 3], orientation(T[:3, :3], target[:3, :3])])
        return e, table.jacobian_of(htms)

    return residual


def sine_orientation_error(R: np.ndarray, R_d: np.ndarray) -> np.ndarray:
    """`1/2 sum_k R(:, k) x R_d(:, k)` (3,): axis times sin(angle) of the rotation from R to R_d (3, 3), base axes.

    It vanishes at half a turn as well as at none. Source: Luh, Walker and Paul, "Resolved-acceleration control", 1980.
    """
    return 0.5 * np.cross(R.T, R_d.T).sum(axis=0)


def within(position_tolerance: float, orientation_tolerance: float) -> Callable[[np.ndarray], bool]:
    """Whether |e[:3]| < position_tolerance [m] and |e[3:]| < orientation_tolerance [rad]."""

    def met(e: np.ndarray) -> bool:
        return bool(np.linalg.norm(e[:3]) < position_tolerance and np.linalg.norm(e[3:]) < orientation_tolerance)

    return met
