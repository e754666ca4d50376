"""The judge: forward kinematics by Pinocchio, of a model that it loads itself, and what follows about an answer.

No solver has a say in it, neither ours nor a peer: an answer is right if the tool is where it was wanted, and the
joints are inside the limits, whatever its solver claims.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

POSITION_TOLERANCE, ORIENTATION_TOLERANCE = 1e-6, 1e-6
"""What counts as reached [m], [rad]."""


@dataclass(frozen=True)
class Verdicts:
    """What is true of N answers; an answer that is not finite, or none at all (NaN), is infinitely wrong."""

    position_error: np.ndarray
    """Distances (N,) of the tool from its target [m]."""
    orientation_error: np.ndarray
    """Angles (N,) between the tool and its target [rad]."""
    limit_violation: np.ndarray
    """How far (N,) the worst joint is out of its limits [rad or m]; 0 when all are inside."""

    def solved(self, slack: float = 0.0) -> np.ndarray:
        """Which answers (N,) reach their targets to tolerance, no joint more than `slack` [rad or m] out."""
        reached = self.position_error <= POSITION_TOLERANCE
        return reached & (self.orientation_error <= ORIENTATION_TOLERANCE) & (self.limit_violation <= slack)


class Judge:
    """Forward kinematics and verdicts of the chain from the root of a URDF to a tip."""

    def __init__(self, urdf: str, tip: str, joint_names: Sequence[str]) -> None:
        """From URDF text, and the names of the n joints in the order of q; the other joints stand still at zero.

        Raises `ValueError` if Pinocchio has the joints in another order, or not as one number each.
        """
        full = pin.buildModelFromXML(urdf)
        others = [i for i in range(1, full.njoints) if full.names[i] not in joint_names]
        self.model = pin.buildReducedModel(full, others, pin.neutral(full))
        if list(self.model.names)[1:] != list(joint_names) or self.model.nq != len(joint_names):
            raise ValueError(f"the joints are {list(self.model.names)[1:]}, not {list(joint_names)}")
        if not self.model.existFrame(tip):
            raise ValueError(f"there is no frame {tip!r}")
        self._data = self.model.createData()
        self._tip = self.model.getFrameId(tip)
        self.lower, self.upper = self.model.lowerPositionLimit.copy(), self.model.upperPositionLimit.copy()
        self.speed = self.model.velocityLimit.copy()

    def forward(self, q: np.ndarray) -> np.ndarray:
        """Tool pose (4, 4) in the base at q (n,)."""
        pin.framesForwardKinematics(self.model, self._data, np.asarray(q, dtype=float))
        return self._data.oMf[self._tip].homogeneous

    def screws(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The chain as a product of exponentials: axes (n, 3), a point (n, 3) [m] on each, tool pose (4, 4), at 0."""
        zero = np.zeros(self.model.nq)
        home = self.forward(zero)
        axes = pin.computeJointJacobians(self.model, self._data, zero)[3:].T.copy()
        return axes, np.array([self._data.oMi[i].translation for i in range(1, self.model.njoints)]), home

    def reach(self) -> tuple[np.ndarray, float]:
        """A point (3,) in the base and a distance [m] from it that the tool cannot exceed, if all joints turn."""
        _, points, home = self.screws()
        stations = np.vstack([points, home[:3, 3]])
        return points[0], float(np.linalg.norm(np.diff(stations, axis=0), axis=1).sum())

    def limit_violations(self, q: np.ndarray) -> np.ndarray:
        """How far (N,) the worst joint of each configuration (N, n) is out of its limits [rad or m]; inf for NaN."""
        excess = np.maximum(self.lower - q, q - self.upper).max(axis=1)
        return np.where(np.isnan(excess), np.inf, np.maximum(excess, 0.0))

    def verdicts(self, q: np.ndarray, targets: np.ndarray) -> Verdicts:
        """What is true of answers (N, n) to targets (N, 4, 4)."""
        finite = np.asarray(np.isfinite(q).all(axis=1))
        T = np.full((len(q), 4, 4), np.nan)
        for i in np.flatnonzero(finite):
            T[i] = self.forward(q[i])
        position = np.linalg.norm(T[:, :3, 3] - targets[:, :3, 3], axis=1)
        chord = np.linalg.norm(T[:, :3, :3] - targets[:, :3, :3], axis=(1, 2))
        angle = 2.0 * np.arcsin(np.minimum(chord / np.sqrt(8.0), 1.0))  # |A - B| = 2 sqrt(2) sin(angle / 2)
        return Verdicts(np.where(finite, position, np.inf), np.where(finite, angle, np.inf), self.limit_violations(q))
