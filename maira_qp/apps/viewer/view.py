"""All that there is to see after a tick."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

import numpy as np
import pinocchio as pin

from maira_qp.apps.viewer.answers import Ghosts, Verdict
from maira_qp.apps.viewer.drawing.surroundings import Clearance, Overlap
from maira_qp.apps.viewer.motion.elbow import Elbow
from maira_qp.apps.viewer.paths.followed import PathView
from maira_qp.apps.viewer.targets import Targets
from maira_qp.problem.problem import ACTIVE_WITHIN
from maira_qp.robots.model.robot import Robot


class Standing(Enum):
    """How an arm stands to its target, or to the pose of a path that it is shown at."""

    UNKNOWN = "..."
    """It is being found out."""
    REACHED = "REACHED"
    """The tool is at the target within the tolerances, and the arm is as clear as it is to be."""
    TOO_NEAR = "TOO NEAR"
    """It is to keep clear of the obstacles, and is inside the margin of one."""
    MOVING = "MOVING"
    """The target can be reached, and the arm is on its way."""
    HELD_UP = "HELD UP"
    """It stands still, though a better configuration is known."""
    ANSWERED = "ANSWERED"
    """The target cannot be reached from here as far as is known: the verdict says what is."""
    ON_PATH = "ON THE PATH"
    """It is at a pose of a path, and came there along the path."""
    OFF_PATH = "OFF THE PATH"
    """A pose of a path is not reached, or not along the path."""


@dataclass(frozen=True, eq=False)
class View:
    """All that there is to see after a tick."""

    q: np.ndarray
    """(n,)"""
    tools: Targets
    """Where the tips are"""
    targets: Targets
    """Where they are to be"""
    selected: str
    """The tip whose target is typed"""
    has_base_axes: bool
    """Targets are dragged along the axes of the base, not along their own"""
    position_error: float
    """The largest of all tips [m]"""
    orientation_error: float
    """The largest of all tips [rad]"""
    condition_number: float
    at_limit: list[str]
    """Joints at a limit, such as "joint4 upper" """
    clearances: list[Clearance]
    overlaps: list[Overlap]
    """Links that are in each other"""
    tick_seconds: float
    """What control ticks take [s]"""
    verdict: Verdict
    """On the last targets that were looked at"""
    standing: Standing
    """How the arm as it is drawn stands to its target"""
    too_near: list[Clearance]
    """Obstacles inside the margin of the arm as it is drawn, if it is to keep clear of them; the nearest first"""
    in_the_way: Clearance | None
    """What keeps the arm from a better configuration that is known, if something does"""
    ghosts: Ghosts | None
    elbow: Elbow | None
    path: PathView
    notice: str
    """Why distances are not known or obstacles not avoided, if so"""

    @property
    def tool(self) -> pin.SE3:
        """Where the selected tip is."""
        return self.tools[self.selected]

    @property
    def target(self) -> pin.SE3:
        """Where it is to be."""
        return self.targets[self.selected]


def limits_at(robot: Robot, q: np.ndarray) -> list[str]:
    """The limits that q (n,) stands on, such as "joint4 upper"."""
    sides = (q <= robot.lower + ACTIVE_WITHIN, "lower"), (q >= robot.upper - ACTIVE_WITHIN, "upper")
    return [f"{name} {side}" for i, name in enumerate(robot.joint_names) for mask, side in sides if mask[i]]
