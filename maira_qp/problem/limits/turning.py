"""How far a frame is turned: the tilt of one of its axes, and the turn about that axis, with exact derivatives.

A rotation Q is a turn about k and then a tilt of k the short way (swing and twist: Grassia, "Practical parameterization
of rotations using the exponential map", 1998, section 4). With a = Q k and `theta = atan2(|k x a|, k . a)` the tilt is
the rotation vector `theta (k x a) / |k x a|`, two numbers across k, and with the quaternion (w, v) of Q the turn is
`2 atan2(v . k, w)`. Both are functions f of a vector x (of a, of the quaternion) that do not change with its length. A
turn phi from here takes x to `x + X phi + 1/2 phi^T X2 phi`; where x is a direction

    df/dphi = a x f_x,     d2f/dphi2 = X^T f_xx X + sym(f_x a^T),    X = -[a]x

and where it is the quaternion, `X2 = -x/4`, whose product with f_x vanishes.
"""

from __future__ import annotations

import math

import numpy as np

from maira_qp.orientation import quaternion_from_matrix, skew

SMALL = 1e-2
"""Below this sine of the tilt its derivatives are series."""

TINY = 1e-9
"""A direction this near to one, or to its opposite, is at no side of it."""


def tilt(a: np.ndarray) -> np.ndarray:
    """The tilt (2,) [rad] about x and y that takes z to the unit vector a (3,); any, of half a turn."""
    x, y, _ = a.tolist()
    ratio, _, _ = _angle_by_sine(a)
    return np.array([-ratio * y, ratio * x])  # k x a = (-a_y, a_x)


def tilt_derivatives(a: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The derivatives (2, 3) and (2, 3, 3) of the tilt by a turn of a (3,)."""
    x, y, c = a.tolist()
    g, slope, bend = _angle_by_sine(a)
    across, z = np.array([x, y, 0.0]), np.array([0.0, 0.0, 1.0])
    gradient = slope * across - z
    hessian = bend * np.outer(across, across) + slope * np.diag([1.0, 1.0, 0.0])
    hessian += 2 * (np.outer(across, z) + np.outer(z, across)) + 2 * c * np.outer(z, z)
    first, second = np.empty((2, 3)), np.empty((2, 3, 3))
    for i, side in enumerate(np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0]])):
        size, sides = float(side @ a), np.outer(side, gradient)
        first[i], second[i] = by_turn(a, g * side + size * gradient, sides + sides.T + size * hessian)
    return first, second


def angle(a: np.ndarray, d: np.ndarray) -> float:
    """The angle [rad] of the unit vectors a and d (3,)."""
    return math.atan2(math.hypot(*(a - (a @ d) * d).tolist()), float(a @ d))


def angle_derivatives(a: np.ndarray, d: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The derivatives (3,) and (3, 3) of the angle by a turn of a; zero where a is d or its opposite."""
    along, across = float(a @ d), a - (a @ d) * d
    r = math.hypot(*across.tolist())
    if r < TINY:
        return np.zeros(3), np.zeros((3, 3))
    e = across / r
    gradient = along * e - r * d
    hessian = (
        -2 * along * r * (np.outer(e, e) - np.outer(d, d))
        + (r * r - along * along) * (np.outer(e, d) + np.outer(d, e))
        + along / r * (np.eye(3) - np.outer(e, e) - np.outer(d, d))
    )
    return by_turn(a, gradient, hessian)


def turn_about_z(Q: np.ndarray) -> float:
    """The turn of Q (3, 3) about z in (-pi, pi] [rad]."""
    w, _, _, z = quaternion_from_matrix(Q).tolist()
    return 2 * math.atan2(z, w)


def turn_derivatives(Q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The derivatives (3,) and (3, 3) of the turn of Q (3, 3) about z by phi. A tilt of half a turn has none: 0."""
    w, x, y, z = quaternion_from_matrix(Q)
    square = max(w * w + z * z, TINY**2)
    X = 0.5 * np.array([[-x, -y, -z], [w, z, -y], [-z, w, x], [y, -x, w]])
    gradient = 2.0 / square * np.array([-z, 0.0, 0.0, w])
    hessian = np.zeros((4, 4))
    hessian[0, 0], hessian[3, 3] = 4 * w * z / square**2, -4 * w * z / square**2
    hessian[0, 3] = hessian[3, 0] = 2 * (z * z - w * w) / square**2
    return gradient @ X, X.T @ hessian @ X


def by_turn(a: np.ndarray, gradient: np.ndarray, hessian: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Derivatives (3,) and (3, 3) by a turn of a (3,), from those by a (of a function that its length leaves)."""
    X = -skew(a)
    sides = np.outer(gradient, a)
    return X.T @ gradient, X.T @ hessian @ X + 0.5 * (sides + sides.T) - (gradient @ a) * np.eye(3)


def _angle_by_sine(a: np.ndarray) -> tuple[float, float, float]:
    """g = theta / r, r the length of the unit vector a (3,) across z; `dg/dr / r`, and `(d2g/dr2 - dg/dr / r) / r^2`.

    Near z by the series of the arc tangent.
    """
    x, y, c = a.tolist()
    r = math.hypot(x, y)
    if r < SMALL and c > 0:
        s = (r / c) ** 2
        g = (1 - s / 3 + s**2 / 5 - s**3 / 7) / c
        return g, (-2 / 3 + 4 * s / 5 - 6 * s**2 / 7) / c**3, (8 / 5 - 24 * s / 7) / c**5
    r = max(r, TINY)
    theta = math.atan2(r, c)
    slope = (c * r - theta) / r**3
    return theta / r, slope, -(2 * c + 3 * slope) / r**2
