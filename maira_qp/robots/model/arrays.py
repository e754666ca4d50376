"""A robot's joints as arrays that the kernels work on, read off `pin.Model`, so that there is one truth about it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin

from maira_qp.kernels.kinematics.kinematic_tree import ACCELERATION, BASE, ROW, VELOCITY
from maira_qp.kernels.kinematics.serial_chain import LOWER, PRISMATIC, START_LOWER, START_UPPER, UPPER

if TYPE_CHECKING:
    from maira_qp.robots.model.robot import Robot


@dataclass(frozen=True)
class KinematicTree:
    """The arrays of `kernels.kinematics.kinematic_tree`: each joint's frame is turned so that it moves along z."""

    robot: Robot
    joints: np.ndarray
    """(n, 19)"""
    parents: np.ndarray
    """(n,) of int64"""
    turns: np.ndarray
    """(n, 3, 3), from the frame of a joint here to that of Pinocchio"""

    @staticmethod
    def of(robot: Robot) -> KinematicTree:
        """Of a robot without mimic joints."""
        model, n = robot.model, robot.n
        data = model.createData()
        pin.computeJointJacobians(model, data, np.zeros(n))
        joints, parents, turns = np.zeros((n, ROW)), np.empty(n, np.int64), np.empty((n, 3, 3))
        for i in range(n):
            motion = pin.getJointJacobian(model, data, i + 1, pin.LOCAL).reshape(6, n)[:, i]
            prismatic = bool(np.abs(motion[:3]).max() > 0.5)
            turns[i] = _z_onto(motion[:3] if prismatic else motion[3:])
            parents[i] = model.parents[i + 1] - 1
            joints[i, :12] = _placed(turns, parents[i], model.jointPlacements[i + 1], turns[i])
            joints[i, PRISMATIC] = prismatic
        joints[:, LOWER], joints[:, UPPER] = robot.lower, robot.upper
        joints[:, START_LOWER], joints[:, START_UPPER] = robot.drawn_range
        joints[:, VELOCITY], joints[:, ACCELERATION] = robot.velocity_limit, robot.acceleration_limit
        return KinematicTree(robot, joints, parents, turns)

    def frame(self, name: str | None) -> tuple[int, np.ndarray]:
        """The joint that carries a frame (None: the tip), or `BASE`, and its placement (12,) behind it."""
        frame = self.robot.model.frames[self.robot.frame_id(name)]
        joint = frame.parentJoint - 1
        return joint, _placed(self.turns, joint, frame.placement, np.eye(3))


def _placed(turns: np.ndarray, joint: int, placement: pin.SE3, turn: np.ndarray) -> np.ndarray:
    """A placement behind a joint, or on the base, as (12,), R by rows and p; the frame that is placed is turned too."""
    back = np.eye(3) if joint == BASE else turns[joint].T
    return np.concatenate([(back @ placement.rotation @ turn).ravel(), back @ placement.translation])


def _z_onto(axis: np.ndarray) -> np.ndarray:
    """A rotation (3, 3) whose z axis is the unit vector `axis` (3,); the identity where that is z."""
    if axis[2] == 1.0:
        return np.eye(3)
    x = np.cross(np.eye(3)[np.abs(axis).argmin()], axis)
    x /= np.linalg.norm(x)
    return np.column_stack([x, np.cross(axis, x), axis])
