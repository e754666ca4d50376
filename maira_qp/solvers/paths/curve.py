"""A path of configurations as a smooth curve, and how far the tool leaves the poses' own path on it.

The curve is the cubic spline through the configurations over the joints' distance. A joint whose spline might pass a
limit is interpolated monotonically between the poses in its place, which never does.

Source: Fritsch and Carlson, "Monotone piecewise cubic interpolation", 1980.
"""

from __future__ import annotations

import numpy as np
from scipy.interpolate import CubicHermiteSpline, CubicSpline, PchipInterpolator
from scipy.spatial.transform import Rotation

from maira_qp.robots.model.robot import Robot

REPEATED = 1e-3
"""A pose whose step is smaller than so many times the largest one is that before it, once more."""
BETWEEN = 8
"""So many places between two poses at which the tool is compared with their path; fewer on long paths."""
PLACES = 100_000
"""On a long path: so many places in all, and at least one between two poses."""


def distances(robot: Robot, q: np.ndarray) -> np.ndarray:
    """Distance (N,) from the first to each configuration (N, n) [rad]; of a sliding joint by the arm's length."""
    steps = np.diff(q, axis=0) / np.where(robot.slides, robot.length, 1.0)
    return np.concatenate([[0.0], np.linalg.norm(steps, axis=1).cumsum()])


def knots_of(gone: np.ndarray) -> np.ndarray:
    """Indices (K,) of the poses that are not repeated, the last pose among them; `gone` (N,) are the distances."""
    least = REPEATED * np.diff(gone).max(initial=0.0)
    kept = [0]
    for k, distance in enumerate(gone.tolist()):
        if distance - gone[kept[-1]] > least:
            kept.append(k)
    if len(kept) > 1:
        kept[-1] = len(gone) - 1
    return np.array(kept)


def curve_through(u: np.ndarray, q: np.ndarray, robot: Robot) -> CubicHermiteSpline:
    """The curve through configurations (K, n) at increasing places (K,), K > 1, inside the limits but for rounding."""
    slopes, third = CubicSpline(u, q)(u, 1), np.diff(u)[:, None] / 3.0
    inner = np.concatenate([q[:-1] + third * slopes[:-1], q[1:] - third * slopes[1:]])  # Bezier points: a convex hull
    beyond = ((inner < robot.lower) | (inner > robot.upper)).any(axis=0)
    if beyond.any():
        slopes[:, beyond] = PchipInterpolator(u, q[:, beyond])(u, 1)
    return CubicHermiteSpline(u, q, slopes)


def deviations(robot: Robot, curve: CubicHermiteSpline) -> tuple[tuple[float, float], tuple[float, float]]:
    """The largest distance [m] and angle [rad] of the tool from the path of the curve's knots, each with its place.

    That path goes from pose to pose on straight lines, about fixed axes; each place of the curve is compared with it
    between the same two knots, its position with the nearest point of the line, its orientation with the nearest one of
    the rotation.
    """
    u = curve.x
    count = int(np.clip(PLACES // len(u), 1, BETWEEN))
    shares = np.arange(1, count + 1) / (count + 1.0)
    places = (u[:-1] + shares[:, None] * np.diff(u)).ravel()  # those of one share after those of another
    begin = np.tile(np.arange(len(u) - 1), count)
    points, rotations = _poses(robot, curve(u))
    between, turned = _poses(robot, curve(places))
    lines = np.diff(points, axis=0)[begin]
    turns = (rotations[:-1].transpose(0, 2, 1) @ rotations[1:])[begin]
    gone, turned = between - points[begin], rotations[begin].transpose(0, 2, 1) @ turned
    vectors, rest = (Rotation.from_matrix(R).as_rotvec() for R in (turns, turned))
    off = np.linalg.norm(gone - _shares(gone, lines) * lines, axis=1)
    angle = (Rotation.from_rotvec(-_shares(rest, vectors) * vectors) * Rotation.from_matrix(turned)).magnitude()
    return (float(off.max()), float(places[off.argmax()])), (float(angle.max()), float(places[angle.argmax()]))


def _shares(gone: np.ndarray, way: np.ndarray) -> np.ndarray:
    """How far (N, 1) along ways (N, 3), from 0 to 1, the points are that are nearest to what was gone (N, 3)."""
    size = (way**2).sum(axis=1)
    share = np.divide((gone * way).sum(axis=1), size, out=np.zeros_like(size), where=size > 0.0)
    return np.clip(share, 0.0, 1.0)[:, None]


def _poses(robot: Robot, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Positions (N, 3) [m] and rotations (N, 3, 3) of the tool at configurations (N, n)."""
    poses = [robot.at(each).placement(None) for each in q]
    return np.array([T.translation for T in poses]), np.array([T.rotation for T in poses])
