"""Objectives that a redundant arm can climb in its null space, each with its gradient, on the plain DH chain.

All are functions w(q) to be made large: the manipulability, the distance from the joint limits, and the distance
of the arm from an obstacle. The gradients are exact, not differences. Source: Siciliano et al., "Robotics:
Modelling, Planning and Control", 2009, section 3.5.1.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from maira_qp.arrays import real_array
from maira_qp.errors import ConfigurationError, OptionError
from maira_qp.evaluation.baselines.joints import pull_to_middle
from maira_qp.robots.dh.table import DHTable

SINGULAR = 1e-9
"""A Jacobian whose singular values span more than this ratio has manipulability 0 and, here, no gradient."""


def manipulability(table: DHTable, q: Any) -> float:
    """w = sqrt(det(J J^T)) at q (n,): the product of the six singular values of J, 0 with fewer than six joints."""
    sigma = np.linalg.svd(table.jacobian(q), compute_uv=False)
    return float(np.prod(sigma)) if table.n >= 6 else 0.0


def manipulability_gradient(table: DHTable, q: Any) -> np.ndarray:
    """Gradient (n,) of `manipulability`: w tr(J^+ dJ/dq_i) each; zero where J is singular and w has a kink."""
    J = table.jacobian(q)
    if table.n < 6:
        return np.zeros(table.n)
    U, sigma, Vt = np.linalg.svd(J, full_matrices=False)
    if sigma[-1] <= SINGULAR * sigma[0]:
        return np.zeros(table.n)
    J_pinv = Vt.T @ (U / sigma).T
    return np.prod(sigma) * np.einsum("jr,irj->i", J_pinv, _jacobian_derivative(J))


def _jacobian_derivative(J: np.ndarray) -> np.ndarray:
    """dJ/dq (n, 6, n), its first axis the joint i that moves, of a chain's Jacobian J (6, n).

    A joint i at or before j carries column j along: both of its halves turn with the angular velocity of i. A joint i
    beyond j moves only the tool, seen from joint j. Source: Hourtash, "The kinematic Hessian and higher
    derivatives", 2005.
    """
    v, w = J[:3].T, J[3:].T
    i, j = np.indices((len(v), len(v)))
    before = (i <= j)[..., None]
    linear = np.where(before, np.cross(w[i], v[j]), np.cross(w[j], v[i]))
    angular = np.where(before, np.cross(w[i], w[j]), 0.0)
    return np.concatenate([linear, angular], axis=-1).transpose(0, 2, 1)


def limit_distance(table: DHTable, q: Any) -> float:
    """w = -1/(2n) sum(((q_i - mid_i) / range_i)^2) at q (n,): 0 in the middle of all ranges, -1/8 with all at a limit.

    A joint without limits, or locked (lower = upper), adds nothing.
    """
    q = real_array(q, (table.n,), "q", ConfigurationError)
    return float(-np.mean((pull_to_middle(table, q) * _inverse_range(table)) ** 2) / 2)


def limit_distance_gradient(table: DHTable, q: Any) -> np.ndarray:
    """Gradient (n,) of `limit_distance`: -(q_i - mid_i) / (n range_i^2)."""
    q = real_array(q, (table.n,), "q", ConfigurationError)
    return -pull_to_middle(table, q) * _inverse_range(table) ** 2 / table.n


def _inverse_range(table: DHTable) -> np.ndarray:
    """1 / (upper - lower) (n,); 0 for a joint without limits or locked."""
    span = table.upper - table.lower
    return np.divide(1.0, span, out=np.zeros(table.n), where=span > 0)


def obstacle_distance(table: DHTable, q: Any, obstacle: Any) -> float:
    """w = min |p - obstacle| [m] over the points p of the arm: the straight lines between its frames' origins."""
    return float(np.linalg.norm(_nearest_point(table.compute_htms(q), _point(obstacle))[2]))


def obstacle_distance_gradient(table: DHTable, q: Any, obstacle: Any) -> np.ndarray:
    """Gradient (n,) of `obstacle_distance` [m/rad or m/m]; zero where the arm touches the obstacle.

    Where two points of the arm are equally near, that of the one nearer to the base.
    """
    htms = table.compute_htms(q)
    k, s, away = _nearest_point(htms, _point(obstacle))
    distance = np.linalg.norm(away)
    if distance == 0:
        return np.zeros(table.n)
    # the nearest point slides along the line as well, but that changes the distance by nothing to first order
    J = (1 - s) * _origin_jacobian(table, htms, k) + s * _origin_jacobian(table, htms, k + 1)
    return J.T @ (away / distance)


def _point(obstacle: Any) -> np.ndarray:
    return real_array(obstacle, (3,), "obstacle", OptionError)


def _nearest_point(htms: np.ndarray, obstacle: np.ndarray) -> tuple[int, float, np.ndarray]:
    """The arm's point p nearest to the obstacle o.

    Its line k (from origin k to k + 1), how far along it p is, in [0, 1], and p - o (3,) [m].
    """
    origins = htms[:, :3, 3]
    lines = np.diff(origins, axis=0)
    squares = (lines**2).sum(axis=1)
    along = ((obstacle - origins[:-1]) * lines).sum(axis=1)
    s = np.clip(np.divide(along, squares, out=np.zeros_like(along), where=squares > 0), 0.0, 1.0)
    away = origins[:-1] + s[:, None] * lines - obstacle
    k = int(np.argmin(np.linalg.norm(away, axis=1)))
    return k, float(s[k]), away[k]


def _origin_jacobian(table: DHTable, htms: np.ndarray, k: int) -> np.ndarray:
    """Linear Jacobian (3, n) of the origin of frame k: the chain cut there, whose later joints do not move it."""
    J = np.zeros((3, table.n))
    moving = [(i, link) for i, link in enumerate(table.links) if link.kind != "fixed"]
    for column, ((i, link), axis) in enumerate(zip(moving, table.axis_frames, strict=True)):
        if i < k:
            z = htms[axis, :3, 2]
            J[:, column] = z if link.kind == "prismatic" else np.cross(z, htms[k, :3, 3] - htms[axis, :3, 3])
    return J
