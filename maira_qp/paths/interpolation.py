"""Poses between poses: positions on a straight line, orientations by slerp.

Slerp turns about one axis at an even rate, the short way round: `R(u) = A exp(u log(A^T B))` (Shoemake, "Animating
rotation with quaternion curves", 1985, section 3.3). Half a turn is as short either way, and one of both is taken.
"""

from __future__ import annotations

import numpy as np


def interpolate(poses: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Poses (M, 4, 4) on the polyline through poses (N, 4, 4), at places (M,) from 0 to N - 1: pose i is at i."""
    if len(poses) == 1:
        return np.repeat(poses, len(at), axis=0)
    leg = np.minimum(at.astype(np.int64), len(poses) - 2)
    return _on_legs(poses[:-1], poses[1:], leg, at - leg)


def between(A: np.ndarray, B: np.ndarray, u: np.ndarray) -> np.ndarray:
    """Poses (M, 4, 4) between A and B (M, 4, 4): A at u = 0, B at u = 1, u (M,)."""
    return _on_legs(A, B, np.arange(len(A)), u)


def distances(poses: np.ndarray) -> np.ndarray:
    """From each of the poses (N, 4, 4) to the next, (N - 1,) [m]."""
    return np.linalg.norm(np.diff(poses[:, :3, 3], axis=0), axis=1)


def angles(poses: np.ndarray) -> np.ndarray:
    """Of the rotation from each of the poses (N, 4, 4) to the next, (N - 1,) [rad].

    From the chord, `|B - A|_F = sqrt(8) sin(angle / 2)`: exact where the angle is small.
    """
    chord = np.linalg.norm(np.diff(poses[:, :3, :3], axis=0), axis=(1, 2)) / np.sqrt(8.0)
    return 2.0 * np.arcsin(np.minimum(chord, 1.0))


def _on_legs(A: np.ndarray, B: np.ndarray, leg: np.ndarray, u: np.ndarray) -> np.ndarray:
    """Poses (M, 4, 4) on legs (M,), of which leg i leads from A[i] to B[i] (N, 4, 4), at u (M,) of each."""
    from scipy.spatial.transform import Rotation  # not at the top: takes a while to load

    T, u = A[leg], u[:, None]
    T[:, :3, 3] = (1.0 - u) * T[:, :3, 3] + u * B[leg, :3, 3]
    turns = (A[:, :3, :3] != B[:, :3, :3]).any(axis=(1, 2))
    if turns.any():
        way = np.zeros((len(A), 3))
        relative = A[turns, :3, :3].swapaxes(1, 2) @ B[turns, :3, :3]
        way[turns] = Rotation.from_matrix(relative).as_rotvec()
        turning = np.flatnonzero(turns[leg])
        part = Rotation.from_rotvec(u[turning] * way[leg[turning]]).as_matrix()
        T[turning, :3, :3] = T[turning, :3, :3] @ part
    return T
