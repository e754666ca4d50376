"""The joint axes of a chain, as lines in the base."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from maira_qp.robots.model.robot import Robot


def screws(robot: Robot, q: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray]:
    """A point (n, 3) [m] of each joint's axis and its direction (n, 3) at q (n,), zero if None; NaN where it slides."""
    model, data, n = robot.model, robot.model.createData(), robot.n
    pin.computeJointJacobians(model, data, np.zeros(n) if q is None else q)
    columns = [
        pin.getJointJacobian(model, data, i + 1, pin.LOCAL_WORLD_ALIGNED).reshape(6, n)[:, i].copy() for i in range(n)
    ]
    axes = np.array([column[3:] if np.abs(column[:3]).max() < 0.5 else np.full(3, np.nan) for column in columns])
    return np.array([data.oMi[i + 1].translation for i in range(n)]), axes / np.linalg.norm(axes, axis=1)[:, None]
