"""The swivel angle of an arm with an elbow: where the elbow stands on its circle about the line shoulder-wrist.

The plane of shoulder s, elbow e and wrist w is turned against the reference plane, which holds s, w and the direction
of reference, by the angle psi about the unit vector along w - s (Shimizu et al., "Analytical inverse kinematic
computation for 7-DOF redundant manipulators with joint limits", 2008, section III). Tolani, Goswami and Badler (2000)
call it the swivel angle.
"""

from __future__ import annotations

import math
from copy import copy
from dataclasses import dataclass
from typing import Any

import numpy as np

from maira_qp.arrays import real_array
from maira_qp.errors import OptionError
from maira_qp.orientation import skew
from maira_qp.problem.pose import unit_vector
from maira_qp.problem.tasks.task import Task, checked_weights
from maira_qp.robots.model.configuration import Configuration
from maira_qp.robots.model.robot import Robot

SMALL = 1e-9
"""A triangle lower than this [m] has no plane, and no swivel angle."""


@dataclass(frozen=True, kw_only=True)
class SwivelTask(Task):
    """The elbow's swivel angle is to be `angle` (one row). On a stretched arm, which has none, the error is zero."""

    shoulder: str
    """Link whose origin is the shoulder's centre."""
    elbow: str
    """Link whose origin is the elbow's centre."""
    wrist: str
    """Link whose origin is the wrist's centre."""
    angle: float
    """[rad]"""
    reference: tuple[float, float, float] = (0.0, 0.0, 1.0)
    """Direction (3,) in the base that the angle counts from: 0 where the elbow stands on its side."""
    weight: float = 1.0
    """What an error of 1 rad counts; > 0."""
    priority: int = 2

    def __post_init__(self) -> None:
        super().__post_init__()
        checked_weights(self.weight, "weight", 1)
        real_array(self.angle, (), "angle of SwivelTask", OptionError)
        object.__setattr__(self, "reference", tuple(unit_vector(self.reference, "reference").tolist()))

    def of(self, robot: Robot) -> SwivelTask:
        """With the frames' names checked. Raises `FrameError`."""
        for frame in (self.shoulder, self.elbow, self.wrist):
            robot.frame_id(frame)
        return self

    def with_value(self, value: Any) -> SwivelTask:
        """The same task with another angle [rad]. Raises `OptionError`."""
        task = copy(self)
        object.__setattr__(task, "angle", float(real_array(value, (), f"angle of {self.key!r}", OptionError)))
        return task

    @property
    def weights(self) -> float:
        """That of the row."""
        return float(self.weight)

    def swivel(self, at: Configuration) -> float | None:
        """The swivel angle [rad] in (-pi, pi]; None where there is none."""
        elbow, side, up, _ = self._plane(at)
        if math.hypot(elbow @ side, elbow @ up) < SMALL:
            return None
        return math.atan2(elbow @ side, elbow @ up)

    def error(self, at: Configuration) -> np.ndarray:
        """The turn (1,) [rad] that is missing, the short way round."""
        angle = self.swivel(at)
        return np.array([0.0 if angle is None else math.remainder(self.angle - angle, math.tau)])

    def change(self, at: Configuration, before: Configuration, after: Configuration) -> np.ndarray:
        """What a motion changes of the error (1,) [rad], the short way round."""
        return np.array([math.remainder(float(super().change(at, before, after)[0]), math.tau)])

    def jacobian(self, at: Configuration) -> np.ndarray:
        """Derivative (1, n) of the swivel angle."""
        elbow, side, up, length = self._plane(at)
        Js, Je, Jw = (at.jacobian(frame)[:3] for frame in (self.shoulder, self.elbow, self.wrist))
        x, y = float(elbow @ up), float(elbow @ side)
        if math.hypot(x, y) < SMALL:
            return np.zeros((1, at.n))
        # psi = atan2(y, x), both in a frame that turns with the line shoulder-wrist
        across = (x * side - y * up) / (x * x + y * y)
        along = skew(up) @ side
        reference = np.array(self.reference)
        lift = float(reference @ up)
        slope = float(elbow @ along) * across  # the line turns under the elbow
        turn = float(reference @ along) / lift * side if lift > SMALL else np.zeros(3)  # and takes the plane with it
        return (across @ (Je - Js) - (slope - turn) @ (Jw - Js) / length)[None]

    def _plane(self, at: Configuration) -> tuple[np.ndarray, np.ndarray, np.ndarray, float]:
        """The elbow from the shoulder (3,) [m], the axes of the circle's plane (3,) each, and the length s-w [m]."""
        s, e, w = (at.placement(frame).translation for frame in (self.shoulder, self.elbow, self.wrist))
        line = w - s
        length = max(float(np.linalg.norm(line)), SMALL)
        along = line / length
        up = np.array(self.reference) - (along @ self.reference) * along
        norm = float(np.linalg.norm(up))
        if norm < SMALL:  # the line runs along the reference: any direction across will do
            up = skew(along)[:, np.abs(along).argmin()]
            norm = float(np.linalg.norm(up))
        up = up / norm
        return e - s, skew(along) @ up, up, length
