"""Arms of six revolute joints in closed form, by EAIK: the arm falls apart into subproblems that are known to have one.

Source: Ostermeier, Kuelz and Althoff, "Automatic geometric decomposition for analytical inverse kinematics", 2025. The
library is an extra; the geometry is ours: axes and points on them at q = 0, from Pinocchio's model.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from importlib import import_module
from typing import Any

import numpy as np

from maira_qp.analytic.joint_axes import screws
from maira_qp.robots.model.robot import Robot

JOINTS = 6


@dataclass(frozen=True, eq=False)
class Decomposition:
    """What EAIK knows of an arm."""

    _solver: Any

    @staticmethod
    @lru_cache(maxsize=16)
    def of(robot: Robot) -> Decomposition | None:
        """Of a robot; None where EAIK is not installed or knows no decomposition."""
        if robot.n != JOINTS or not robot.is_chain:
            return None
        points, axes = screws(robot)
        if np.isnan(axes).any():
            return None
        try:
            eaik = import_module("eaik.pybindings.EAIK")
        except ImportError:
            return None
        home = robot.forward(np.zeros(JOINTS))
        offsets = np.diff(np.vstack([np.zeros(3), points, home.translation]), axis=0)
        solver = eaik.Robot(axes.T, offsets.T, home.rotation, [], True)
        return Decomposition(solver) if solver.has_known_decomposition() else None

    def branches(self, T: np.ndarray) -> np.ndarray:
        """Configurations (k, 6) [rad] for a pose T (4, 4), limits aside; some may only come near it."""
        q = np.reshape(self._solver.calculate_IK(T).Q, (-1, JOINTS))
        return q[np.isfinite(q).all(axis=1)]
