"""All that there is to see after a tick."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from maira_qp.apps.viewer.answers import Ghosts, Verdict
from maira_qp.apps.viewer.elbow import Elbow
from maira_qp.apps.viewer.surroundings import Clearance
from maira_qp.robots.robot import Robot
from maira_qp.solvers.solution import ACTIVE_WITHIN


@dataclass(frozen=True, eq=False)
class View:
    """All that there is to see after a tick."""

    q: np.ndarray
    """(n,)"""
    tool: pin.SE3
    target: pin.SE3
    position_error: float
    """[m]"""
    orientation_error: float
    """[rad]"""
    condition_number: float
    at_limit: list[str]
    """Joints at a limit, such as "joint4 upper" """
    clearances: list[Clearance]
    tick_seconds: float
    """What control ticks take [s]"""
    verdict: Verdict | None
    """On the target as it is, if it is known yet"""
    ghosts: Ghosts | None
    elbow: Elbow | None
    notice: str
    """Why distances are not known or obstacles not avoided, if so"""


def limits_at(robot: Robot, q: np.ndarray) -> list[str]:
    """The limits that q (n,) stands on, such as "joint4 upper"."""
    sides = (q <= robot.lower + ACTIVE_WITHIN, "lower"), (q >= robot.upper - ACTIVE_WITHIN, "upper")
    return [f"{name} {side}" for i, name in enumerate(robot.joint_names) for mask, side in sides if mask[i]]
