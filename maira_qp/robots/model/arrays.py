"""A robot's joints as arrays that the kernels work on, read off `pin.Model`, so that there is one truth about it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from maira_qp.kernels.kinematics.kinematic_tree import BASE
from maira_qp.kernels.layout import Joint
from maira_qp.robots.model.kinematics import Kinematics


@dataclass(frozen=True)
class KinematicTree:
    """The arrays of `kernels.kinematics.kinematic_tree`: each joint's frame is turned so that it moves along z.

    A robot has one of them, `Robot.tree`, which is not to be written to.
    """

    kinematics: Kinematics
    joints: np.ndarray
    """(n, 19)"""
    parents: np.ndarray
    """(n,) of int64"""
    turns: np.ndarray
    """(n, 3, 3), from the frame of a joint here to that of Pinocchio"""

    @staticmethod
    def build(
        kinematics: Kinematics,
        limits: tuple[np.ndarray, np.ndarray],
        drawn_range: tuple[np.ndarray, np.ndarray],
        velocity: np.ndarray,
        acceleration: np.ndarray,
    ) -> KinematicTree:
        """The arrays of a model without mimic joints.

        Args:
            kinematics: the model and its frames
            limits: lower and upper (n,) [rad, or m]
            drawn_range: the ends (n,) of what random configurations are drawn from [rad, or m]
            velocity: largest speeds (n,) [rad/s, or m/s]
            acceleration: largest accelerations (n,) [rad/s^2, or m/s^2]
        """
        model, n = kinematics.model, kinematics.n
        data = model.createData()
        pin.computeJointJacobians(model, data, np.zeros(n))
        joints, parents, turns = np.zeros((n, Joint.TREE_WIDTH)), np.empty(n, np.int64), np.empty((n, 3, 3))
        for i in range(n):
            motion = pin.getJointJacobian(model, data, i + 1, pin.LOCAL).reshape(6, n)[:, i]
            prismatic = bool(np.abs(motion[:3]).max() > 0.5)
            turns[i] = _z_onto(motion[:3] if prismatic else motion[3:])
            parents[i] = model.parents[i + 1] - 1
            joints[i, :12] = _placed(turns, parents[i], model.jointPlacements[i + 1], turns[i])
            joints[i, Joint.PRISMATIC] = prismatic
        joints[:, Joint.LOWER], joints[:, Joint.UPPER] = limits
        joints[:, Joint.START_LOWER], joints[:, Joint.START_UPPER] = drawn_range
        joints[:, Joint.VELOCITY], joints[:, Joint.ACCELERATION] = velocity, acceleration
        return KinematicTree(kinematics, joints, parents, turns)

    @property
    def n(self) -> int:
        """Number of joints."""
        return len(self.parents)

    def frame(self, name: str | None, offset: pin.SE3 | None = None) -> tuple[int, np.ndarray]:
        """The joint that carries a frame (None: the tip), or `BASE`, and its placement (12,) behind it.

        Or that of an `offset` in the frame.
        """
        frame = self.kinematics.model.frames[self.kinematics.frame_id(name)]
        joint = frame.parentJoint - 1
        placement = frame.placement if offset is None else frame.placement * offset
        return joint, _placed(self.turns, joint, placement, np.eye(3))

    def chain(self) -> np.ndarray:
        """The chain (n + 1, 17) of `kernels.kinematics.serial_chain`, of a tree in which every joint moves the tip."""
        chain = np.zeros((self.n + 1, Joint.WIDTH))
        chain[:-1] = self.joints[:, : Joint.WIDTH]
        chain[-1, :12] = self.frame(None)[1]
        return chain


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
