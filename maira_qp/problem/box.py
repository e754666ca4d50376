"""Consistency limits: a box about a start, which holds for one call beside the limits of the joints."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from maira_qp.errors import ConfigurationError, OptionError, shown
from maira_qp.robots.model.joint_values import joint_values
from maira_qp.robots.model.robot import Robot

SCOPE = "within max_joint_change of q0"
"""What verdicts hold for where there is a box."""


def checked_change(value: Any, robot: Robot) -> np.ndarray:
    """The largest changes (n,) [rad or m], inf: any, from a number, one each, or {joint name: value}.

    Raises `OptionError`.
    """
    change = joint_values(robot.joint_names, value, "max_joint_change", np.full(robot.n, np.inf))
    if not (change >= 0.0).all():
        raise OptionError(f"max_joint_change must not be negative, got {shown(value)}")
    return change


@dataclass(frozen=True, eq=False)
class ChangeBox:
    """The configurations that are at most some changes away from a start, joint by joint, and within the limits."""

    robot: Robot
    """Without the box"""
    start: np.ndarray
    """(n,) [rad or m]"""
    change: np.ndarray
    """(n,) [rad or m], inf: any"""

    @property
    def boxed(self) -> Robot:
        """The robot with what the box leaves of its limits. Raises `ConfigurationError` where that is nothing."""
        with np.errstate(over="ignore"):
            lower, upper = self.start - self.change, self.start + self.change
        # |q - start| <= change as it is computed
        lower = np.where(self.start - lower > self.change, np.nextafter(lower, np.inf), lower)
        upper = np.where(upper - self.start > self.change, np.nextafter(upper, -np.inf), upper)
        robot = self.robot
        lower, upper = np.maximum(lower, robot.lower), np.minimum(upper, robot.upper)
        for i in np.flatnonzero(lower > upper):
            raise ConfigurationError(
                f"q0 of joint {robot.joint_names[i]!r}, {self.start[i]:.6g}, is farther outside its limits, "
                f"{robot.lower[i]:.6g} to {robot.upper[i]:.6g}, than max_joint_change={self.change[i]:.6g}"
            )
        return robot.limited(lower=lower, upper=upper)

    def holds_at_end(self, joint: int, end: str, robot: Robot) -> bool:
        """Whether the end of a joint's range in the box, "lower" or "upper", is no limit of the joint itself."""
        return bool(getattr(robot, end)[joint] != getattr(self.robot, end)[joint])
