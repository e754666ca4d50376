"""A robot's chain as the array that the kernels work on, read off `pin.Model`, so that there is one truth about it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin

from maira_qp.kernels.chain import LOWER, PRISMATIC, ROW, START_LOWER, START_UPPER, UPPER

if TYPE_CHECKING:
    from maira_qp.robots.robot import Robot


def chain_of(robot: Robot) -> np.ndarray:
    """The chain (n + 1, 17) of `maira_qp.kernels.chain`: each joint's frame turned so that it moves along z.

    The robot must be a chain, `Robot.is_chain`.
    """
    model, n = robot.model, robot.n
    data = model.createData()
    pin.computeJointJacobians(model, data, np.zeros(n))
    chain, turn = np.zeros((n + 1, ROW)), np.eye(3)
    for i in range(n):
        motion = pin.getJointJacobian(model, data, i + 1, pin.LOCAL).reshape(6, n)[:, i]
        prismatic = bool(np.abs(motion[:3]).max() > 0.5)
        placement, next_turn = model.jointPlacements[i + 1], _z_onto(motion[:3] if prismatic else motion[3:])
        chain[i, :9] = (turn.T @ placement.rotation @ next_turn).ravel()
        chain[i, 9:12] = turn.T @ placement.translation
        chain[i, PRISMATIC], chain[i, LOWER], chain[i, UPPER] = prismatic, robot.lower[i], robot.upper[i]
        chain[i, START_LOWER], chain[i, START_UPPER] = robot.drawn_range[0][i], robot.drawn_range[1][i]
        turn = next_turn
    tool = model.frames[robot.frame_id(None)].placement
    chain[n, :9], chain[n, 9:12] = (turn.T @ tool.rotation).ravel(), turn.T @ tool.translation
    return chain


def _z_onto(axis: np.ndarray) -> np.ndarray:
    """A rotation (3, 3) whose z axis is the unit vector `axis` (3,); the identity where that is z."""
    if axis[2] == 1.0:
        return np.eye(3)
    x = np.cross(np.eye(3)[np.abs(axis).argmin()], axis)
    x /= np.linalg.norm(x)
    return np.column_stack([x, np.cross(axis, x), axis])
