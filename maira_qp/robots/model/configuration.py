"""A robot at one configuration: the proof that the kinematics that are read belong to that q."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pinocchio as pin

from maira_qp.robots.model.kinematics import Kinematics

_AXES = pin.LOCAL_WORLD_ALIGNED
_CROSS = np.array([[0, 0, 0, 0, 0, -1, 0, 1, 0], [0, 0, 1, 0, 0, 0, -1, 0, 0], [0, -1, 0, 1, 0, 0, 0, 0, 0]], float)
"""`(u @ _CROSS).reshape(3, 3) @ v` is u x v."""
_HALF_TURNS = np.array([1, 1, 1, 0.5, 0.5, 0.5])


@cache
def _before(n: int) -> np.ndarray:
    """Where (n, n) joint i is joint j or comes before it."""
    return np.triu(np.ones((n, n), dtype=bool))


class Configuration:
    """Kinematics of a robot at q (n,), computed when asked for and kept; made by `Robot.at`.

    Safe to share between threads. Every value belongs to this q however many other configurations of the robot are in
    use: they share one Pinocchio `Data` a thread, which remembers whose kinematics it holds.
    """

    __slots__ = ("_jacobians", "_kinematics", "_placements", "kept", "q")

    def __init__(self, kinematics: Kinematics, q: np.ndarray) -> None:
        """`q` (n,) [rad, or m] is copied and not checked: this runs in every iteration of a solver."""
        self._kinematics = kinematics
        self.q = np.array(q, dtype=np.float64)
        self.q.setflags(write=False)
        self._placements: dict[int, pin.SE3] = {}
        self._jacobians: dict[int, np.ndarray] = {}
        self.kept: dict[tuple[int, str], tuple[object, Any]] = {}
        """What others computed for this q, by the id of the object that it belongs to, which is kept alive with it."""

    @property
    def n(self) -> int:
        """Number of joints."""
        return self._kinematics.n

    def moved(self, dq: np.ndarray) -> Configuration:
        """The configuration that the displacement dq (n,) [rad, or m] leads to."""
        return Configuration(self._kinematics, self._kinematics.integrate(self.q, dq))

    def displacement(self, q0: np.ndarray) -> np.ndarray:
        """The displacement (n,) [rad, or m] that leads here from q0 (n,)."""
        return self._kinematics.difference(q0, self.q)

    def placement(self, frame: str | None = None, offset: pin.SE3 | None = None) -> pin.SE3:
        """Pose of a frame (None: the tip), or of an `offset` in it, in the base, a fresh copy. Raises `FrameError`."""
        index = self._kinematics.frame_id(frame)
        placement = self._placements.get(index)
        if placement is None:
            model, scratch = self._kinematics.model, self._kinematics.scratch
            if scratch.q is not self.q:
                scratch.q = None  # nobody's, until it is done
                pin.forwardKinematics(model, scratch.data, self.q)
                scratch.q = self.q
            placement = self._placements[index] = pin.updateFramePlacement(model, scratch.data, index)
        return placement.copy() if offset is None else placement * offset

    def jacobian(self, frame: str | None = None, offset: pin.SE3 | None = None) -> np.ndarray:
        """Jacobian (6, n) of a frame (None: the tip), or of an `offset` in it; read-only. Raises `FrameError`.

        Linear rows first, base axes.
        """
        index = self._kinematics.frame_id(frame)
        J = self._jacobians.get(index)
        if J is None:
            model, scratch = self._kinematics.model, self._kinematics.scratch
            J = pin.computeFrameJacobian(model, scratch.data, self.q, index, _AXES)
            if J.ndim == 1:  # of a robot with one joint
                J = J.reshape(6, 1)
            J.setflags(write=False)
            self._jacobians[index] = J
        if offset is None:
            return J
        moved, arm = J.copy(), self.placement(frame).rotation @ offset.translation
        moved[:3] -= (arm @ _CROSS).reshape(3, 3) @ J[3:]
        moved.setflags(write=False)
        return moved

    def jacobian_derivative(self, frame: str | None = None) -> np.ndarray:
        """Derivative (n, 6, n) of a frame's Jacobian (None: the tip): entry [i] is dJ/dq_i, base axes.

        With the columns [v_j; w_j]: joint i turns what is behind it, `dJ_j/dq_i = [w_i x v_j; w_i x w_j]` where i comes
        before j on the chain, and moves the tip for what is before it, `[w_j x v_i; 0]` (Bruyninckx and De Schutter,
        "Symbolic differentiation of the velocity mapping", 1996). In a tree the columns of joints that do not carry the
        frame are zero, and so are their terms, whatever their place in q. Raises `FrameError`.
        """
        n = self.n
        if self._kinematics.has_mimic:
            return self._derivative_by_differences(frame)
        J = self.jacobian(frame)
        crosses = (J[3:].T @ _CROSS).reshape(n, 3, 3) @ J.reshape(2, 1, 3, n)  # [v or w, i, :, j] = w_i x column j
        before = _before(n)[:, None]
        derivative = np.empty((n, 6, n))
        derivative[:, :3] = np.where(before, crosses[0], crosses[0].T)
        derivative[:, 3:] = np.where(before, crosses[1], 0.0)
        return derivative

    def _derivative_by_differences(
        self, frame: str | None, step: float = 1e-5, offset: pin.SE3 | None = None
    ) -> np.ndarray:
        """The same where mimic joints couple columns, and their order says nothing; error about 1e-10."""
        pairs = [(self.moved(dq), self.moved(-dq)) for dq in step * np.eye(self.n)]
        return np.array([ahead.jacobian(frame, offset) - back.jacobian(frame, offset) for ahead, back in pairs]) / (
            2 * step
        )

    def kinematic_hessian_product(
        self, frame: str | None, weights: np.ndarray, offset: pin.SE3 | None = None
    ) -> np.ndarray:
        """Second derivative (n, n), symmetric, of the pose of a frame (None: the tip), weighted by `weights` (6,).

        Or of an `offset` in the frame.

        `sum_k weights[k] d2 pose_k / dq2` with pose = [p; phi], phi the rotation vector of R(q + dq) R(q)^T at dq = 0
        in base axes. It is the symmetric part of the weighted `jacobian_derivative`: for i before j
        `w_p . (w_i x v_j) + 1/2 w_phi . (w_i x w_j)`, with the weights w_p and w_phi. Raises `FrameError`.
        """
        if self._kinematics.has_mimic:
            C = np.tensordot(weights, self._derivative_by_differences(frame, offset=offset), (0, 1))
            return 0.5 * (C + C.T)
        J = self.jacobian(frame, offset)
        across = ((weights * _HALF_TURNS).reshape(2, 3) @ _CROSS).reshape(6, 3).T
        C = J[3:].T @ (across @ J)  # w_i . (v_j x w_p + 1/2 w_j x w_phi)
        return np.where(_before(self.n), C, C.T)
