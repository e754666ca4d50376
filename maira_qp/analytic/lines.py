"""Straight lines in space, such as the axes of joints, given by a point and a unit vector each."""

from __future__ import annotations

import numpy as np

MEETS_WITHIN = 1e-9
"""Axes that pass a point at most this far away, in lengths of the arm, meet there."""
PARALLEL_WITHIN = 1e-6
"""Lines whose angle has a smaller sine count as parallel."""


def meeting(points: np.ndarray, axes: np.ndarray) -> tuple[np.ndarray, float]:
    """The point (3,) nearest to lines, in least squares, and its distance [m] from the farthest of them.

    points (k, 3) [m], unit axes (k, 3); of lines that are all parallel one of the points nearest to them.
    """
    projectors = np.eye(3) - axes[:, :, None] * axes[:, None, :]
    centre = np.linalg.lstsq(projectors.sum(0), np.einsum("kij,kj->i", projectors, points), rcond=None)[0]
    return centre, float(np.linalg.norm(np.cross(axes, centre - points), axis=1).max())


def foot(points: np.ndarray, axes: np.ndarray) -> float:
    """How far along the first of two lines [m] it comes nearest to the second; 0 where they are parallel.

    points (2, 3) [m], unit axes (2, 3).
    """
    apart, cosine = points[0] - points[1], axes[0] @ axes[1]
    if np.linalg.norm(np.cross(*axes)) < PARALLEL_WITHIN:
        return 0.0
    return float((cosine * (axes[1] @ apart) - axes[0] @ apart) / (1 - cosine**2))
