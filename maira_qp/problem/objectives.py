"""Objectives for the redundancy: what the arm should prefer among all configurations that reach the target.

Each is a cost to be made small, with its gradient and Hessian in joint space. The criteria that the literature climbs
(Siciliano et al., "Robotics", 2009, section 3.5.1) stand here with their sign turned.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from maira_qp.arrays import is_listing, is_number, real_array
from maira_qp.errors import OptionError, shown
from maira_qp.robots.model.configuration import Configuration
from maira_qp.robots.model.robot import Robot


class Objective(ABC):
    """A cost over configurations. Angles in rad, lengths in m."""

    @abstractmethod
    def of(self, robot: Robot) -> Objective:
        """The objective with everything that depends on the robot filled in and checked. Raises `OptionError`."""

    @abstractmethod
    def cost(self, at: Configuration) -> float:
        """The value to be made small."""

    @abstractmethod
    def gradient(self, at: Configuration) -> np.ndarray:
        """Gradient (n,) of the cost."""

    @abstractmethod
    def hessian(self, at: Configuration) -> np.ndarray:
        """Hessian (n, n) of the cost, symmetric, of any definiteness."""


def check_objective(objective: object) -> None:
    """Raises `OptionError` for what is no objective."""
    if not isinstance(objective, Objective):
        raise OptionError(
            f"not an objective: {shown(objective)}; "
            "valid: Posture(), LimitDistance(), Manipulability(), ObstacleDistance(...)"
        )


@dataclass(frozen=True)
class Posture(Objective):
    """Stay near a reference: `1/2 sum_i w_i (q_i - q_ref_i)^2`."""

    q_ref: Any = None
    """Reference configuration (n,) [rad or m]; None: the middle of the limits (0 for a continuous joint)."""
    weights: Any = None
    """Weights (n,), >= 0, or one for all; None: 1."""

    def of(self, robot: Robot) -> Posture:
        """With the reference and weights as arrays of the robot's size."""
        q_ref = robot.middle if self.q_ref is None else self.q_ref
        w = 1.0 if self.weights is None else self.weights
        shape = () if is_number(w) else (robot.n,)
        w = np.array(np.broadcast_to(real_array(w, shape, "weights of Posture", OptionError), robot.n))
        if (w < 0).any():
            raise OptionError(f"weights of Posture must not be negative, got {w.tolist()}")
        return Posture(real_array(q_ref, (robot.n,), "q_ref of Posture", OptionError), w)

    def cost(self, at: Configuration) -> float:
        """Weighted squared distance, halved."""
        d = at.displacement(self.q_ref)
        return float(0.5 * d @ (self.weights * d))

    def gradient(self, at: Configuration) -> np.ndarray:
        """Gradient (n,) [rad]."""
        return self.weights * at.displacement(self.q_ref)

    def hessian(self, at: Configuration) -> np.ndarray:
        """The weights on the diagonal (n, n)."""
        return np.diag(self.weights)


@dataclass(frozen=True)
class LimitDistance(Objective):
    """Stay away from the joint limits: `1/(2n) sum_i ((q_i - mid_i) / range_i)^2` (Liegeois, 1977).

    Continuous and locked joints do not count.
    """

    _posture: Posture | None = None

    def of(self, robot: Robot) -> LimitDistance:
        """With the robot's middle and ranges: it is a posture, weighted by the ranges."""
        extent = robot.upper - robot.lower
        counts = np.isfinite(extent) & (extent > 0)
        weights = np.where(counts, 1.0 / (robot.n * np.where(counts, extent, 1.0) ** 2), 0.0)
        return LimitDistance(Posture(robot.middle, weights).of(robot))

    @property
    def as_posture(self) -> Posture:
        """The posture that it is, once made for a robot."""
        assert self._posture is not None
        return self._posture

    def cost(self, at: Configuration) -> float:
        """Half of the mean squared distance from the middle, in ranges (no unit)."""
        return self.as_posture.cost(at)

    def gradient(self, at: Configuration) -> np.ndarray:
        """Gradient (n,) [1/rad or 1/m]."""
        return self.as_posture.gradient(at)

    def hessian(self, at: Configuration) -> np.ndarray:
        """Diagonal (n, n)."""
        return self.as_posture.hessian(at)


@dataclass(frozen=True)
class Manipulability(Objective):
    """Stay away from singularities: `-sqrt(det(J J^T))` (Yoshikawa, 1985); with n < 6 `-sqrt(det(J^T J))`."""

    frame: str | None = None
    """The frame whose Jacobian counts; None: the tip."""

    def of(self, robot: Robot) -> Manipulability:
        """With the frame's name checked."""
        robot.frame_id(self.frame)
        return self

    def cost(self, at: Configuration) -> float:
        """Minus the product of the Jacobian's singular values."""
        return -float(np.prod(np.linalg.svd(at.jacobian(self.frame), compute_uv=False)))

    def gradient(self, at: Configuration) -> np.ndarray:
        """`-sum_k (product of the other singular values) u_k^T dJ/dq_i v_k` (n,), finite at singularities too."""
        U, s, Vt = np.linalg.svd(at.jacobian(self.frame), full_matrices=False)
        others = np.array([np.prod(np.delete(s, k)) for k in range(len(s))])
        return -np.einsum("iab,ab->i", at.jacobian_derivative(self.frame), (U * others) @ Vt)

    def hessian(self, at: Configuration) -> np.ndarray:
        """By central differences of the gradient (n, n)."""
        return finite_difference_hessian(self, at)


@dataclass(frozen=True)
class ObstacleDistance(Objective):
    """Stay away from a point: minus the distance of the nearest of the arm's frames, smoothed where two are as near.

    The smooth minimum is `-1/k log sum_i exp(-k d_i)`, below the true one by at most log(number of frames) / k.
    """

    obstacle: Any
    """The point (3,) in the base [m]."""
    frames: tuple[str, ...] | None = None
    """Links whose origins count; None: the one behind each moving joint, and the tip."""
    sharpness: float = 50.0
    """k [1/m]; > 0."""

    def of(self, robot: Robot) -> ObstacleDistance:
        """With the point as an array and the frames' names checked."""
        point = real_array(self.obstacle, (3,), "obstacle of ObstacleDistance", OptionError)
        if not (is_number(self.sharpness) and 0 < self.sharpness < math.inf):
            raise OptionError(
                f"sharpness of ObstacleDistance must be a positive number [1/m], got {shown(self.sharpness)}"
            )
        if self.frames is not None and not is_listing(self.frames):
            raise OptionError(f"frames of ObstacleDistance must be a list of links, got {shown(self.frames)}")
        frames = (*robot.moved_links, robot.tip) if self.frames is None else tuple(self.frames)
        if not frames:
            raise OptionError("frames of ObstacleDistance is an empty list")
        for frame in frames:
            robot.frame_id(frame)
        return replace(self, obstacle=point, frames=frames)

    def _distances(self, at: Configuration) -> tuple[np.ndarray, np.ndarray]:
        """Offsets (k, 3) [m] of the frames from the obstacle and their norms (k,)."""
        offsets = np.array([at.placement(frame).translation - self.obstacle for frame in self.frames or ()])
        return offsets, np.linalg.norm(offsets, axis=1)

    def distance(self, at: Configuration) -> float:
        """The true distance of the nearest frame [m]."""
        return float(self._distances(at)[1].min())

    def cost(self, at: Configuration) -> float:
        """Minus the smooth distance [m]."""
        d = self._distances(at)[1]
        return float(np.log(np.exp(-self.sharpness * (d - d.min())).sum()) / self.sharpness - d.min())

    def gradient(self, at: Configuration) -> np.ndarray:
        """Gradient (n,) [m/rad]."""
        offsets, d = self._distances(at)
        share = np.exp(-self.sharpness * (d - d.min()))
        away = offsets / np.maximum(d, 1e-12)[:, None] * (share / share.sum())[:, None]
        jacobians = np.array([at.jacobian(frame)[:3] for frame in self.frames or ()])
        return -np.einsum("kij,ki->j", jacobians, away)

    def hessian(self, at: Configuration) -> np.ndarray:
        """By central differences of the gradient (n, n)."""
        return finite_difference_hessian(self, at)


def finite_difference_hessian(objective: Objective, at: Configuration, step: float = 1e-5) -> np.ndarray:
    """Hessian (n, n) of an objective by central differences of its gradient, made symmetric; error about step^2."""
    nudges = step * np.eye(at.n)
    H = np.array([objective.gradient(at.moved(dq)) - objective.gradient(at.moved(-dq)) for dq in nudges]) / (2 * step)
    return 0.5 * (H + H.T)
