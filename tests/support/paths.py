"""Random poses, and paths measured by Pinocchio's logarithms."""

from __future__ import annotations

import itertools

import numpy as np
import pinocchio as pin


def random_pose(rng: np.random.Generator, spread: float = 1.0) -> pin.SE3:
    """Any orientation; position normally distributed [m]."""
    quaternion = pin.Quaternion(rng.normal(size=4)).normalized()
    return pin.SE3(quaternion.toRotationMatrix(), spread * rng.normal(size=3))


def random_poses(rng: np.random.Generator, count: int, spread: float = 1.0) -> np.ndarray:
    """(count, 4, 4)"""
    return np.array([random_pose(rng, spread).homogeneous for _ in range(count)])


def distances(path: np.ndarray) -> np.ndarray:
    """From each pose (N, 4, 4) to the next [m]."""
    return np.sqrt(((path[1:, :3, 3] - path[:-1, :3, 3]) ** 2).sum(axis=1))


def rotation_angles(path: np.ndarray) -> np.ndarray:
    """Of the rotation from each pose (N, 4, 4) to the next [rad]."""
    return np.array([np.linalg.norm(pin.log3(A.T @ B)) for A, B in itertools.pairwise(path[:, :3, :3])])
