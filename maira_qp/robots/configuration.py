"""A robot at one configuration: the proof that the kinematics that are read belong to that q."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin

if TYPE_CHECKING:
    from maira_qp.robots.robot import Robot

_AXES = pin.LOCAL_WORLD_ALIGNED


class Configuration:
    """Kinematics of a robot at q (n,), computed when asked for and kept; made by `Robot.at`.

    Safe to share between threads. Every value belongs to this q however many other configurations of the robot are in
    use: they share one Pinocchio `Data` a thread, which remembers whose kinematics it holds.
    """

    __slots__ = ("_jacobians", "_placements", "q", "robot")

    def __init__(self, robot: Robot, q: np.ndarray) -> None:
        """`q` (n,) [rad, or m] is copied and not checked: this runs in every iteration of a solver."""
        self.robot = robot
        self.q = np.array(q, dtype=np.float64)
        self.q.flags.writeable = False
        self._placements: dict[int, pin.SE3] = {}
        self._jacobians: dict[int, np.ndarray] = {}

    def placement(self, frame: str | None = None) -> pin.SE3:
        """Pose of a frame (None: the tip) in the base, a fresh copy. Raises `FrameError`."""
        index = self.robot.frame_id(frame)
        placement = self._placements.get(index)
        if placement is None:
            robot, scratch = self.robot, self.robot.scratch
            if scratch.q is not self.q:
                scratch.q = None  # nobody's, until it is done
                pin.forwardKinematics(robot.model, scratch.data, self.q)
                scratch.q = self.q
            placement = self._placements[index] = pin.updateFramePlacement(robot.model, scratch.data, index)
        return placement.copy()

    def jacobian(self, frame: str | None = None) -> np.ndarray:
        """Jacobian (6, n) of a frame (None: the tip), linear rows first, base axes; read-only. Raises `FrameError`."""
        index = self.robot.frame_id(frame)
        J = self._jacobians.get(index)
        if J is None:
            robot = self.robot
            J = pin.computeFrameJacobian(robot.model, robot.scratch.data, self.q, index, _AXES).reshape(6, robot.n)
            J.flags.writeable = False
            self._jacobians[index] = J
        return J

    def kinematic_hessian_product(self, frame: str | None, weights: np.ndarray) -> np.ndarray:
        """Second derivative (n, n), symmetric, of the pose of a frame (None: the tip), weighted by `weights` (6,).

        `sum_k weights[k] d2 pose_k / dq2` with pose = [p; phi], phi the rotation vector of R(q + dq) R(q)^T at dq = 0 in
        base axes. With the columns [v_i; w_i] of the Jacobian, and joint i before joint j on the chain, its entry is
        `w_p . (w_i x v_j) + 1/2 w_phi . (w_i x w_j)`: what is behind joint i turns with it (Bruyninckx and De Schutter,
        "Symbolic differentiation of the velocity mapping", 1996). Raises `FrameError`.
        """
        if self.robot.has_mimic:
            return self._hessian_by_differences(frame, weights)
        J = self.jacobian(frame)
        v, w = J[:3], J[3:]
        (a, b, c), (d, e, f) = weights[:3].tolist(), (0.5 * weights[3:]).tolist()
        by_position = np.array([[0.0, -c, b], [c, 0.0, -a], [-b, a, 0.0]])
        by_rotation = np.array([[0.0, -f, e], [f, 0.0, -d], [-e, d, 0.0]])
        C = np.triu((by_position @ w).T @ v + (by_rotation @ w).T @ w)
        return C + np.triu(C, 1).T

    def _hessian_by_differences(self, frame: str | None, weights: np.ndarray, step: float = 1e-5) -> np.ndarray:
        """The same where joints are coupled and the order of columns says nothing; error about 1e-10."""
        C = np.empty((self.robot.n, self.robot.n))
        for i, dq in enumerate(step * np.eye(self.robot.n)):
            ahead, back = (self.robot.at(self.q + sign * dq).jacobian(frame) for sign in (1, -1))
            C[i] = weights @ (ahead - back) / (2 * step)
        return (C + C.T) / 2
