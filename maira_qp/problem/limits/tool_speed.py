"""The speed of the tool, of which no fixed rows of a tick know: `|J_v dq| <= linear dt`, `|J_w dq| <= angular dt`.

These are balls, not polyhedra. A tick that is too fast is cut off by the plane that touches the ball where its
direction leaves it, as often as it takes (the cutting planes of Kelley, 1960), and what is left is scaled.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from maira_qp.arrays import is_listing, is_number
from maira_qp.errors import OptionError, shown
from maira_qp.orientation import orientation_error
from maira_qp.problem.limits.joint import Tick
from maira_qp.problem.limits.placement import FrameLimit
from maira_qp.robots.model.configuration import Configuration


@dataclass(frozen=True, eq=False, kw_only=True)
class ToolSpeedLimit(FrameLimit):
    """In a control tick a point of the tool moves by at most `linear`, and its frame turns by at most `angular`.

    Both hold at the beginning of the tick, at its end, and on the average in between; up to what a joint limit, or a
    deceleration that is limited, forces upon the joints. By least squares the motion stays as near to what the tasks
    ask for as the speed allows; with `keep_direction` it is scaled. Where no time passes, as in `solve`, it limits
    nothing.
    """

    linear: float = math.inf
    """[m/s]; > 0. In a call, a value (linear, angular) by the limit's name takes their place."""
    angular: float = math.inf
    """[rad/s]; > 0"""

    def __post_init__(self) -> None:
        super().__post_init__()
        self._check(self.linear, self.angular)

    def _check(self, linear: object, angular: object) -> None:
        for name, value in (("linear", linear), ("angular", angular)):
            if not (is_number(value) and value > 0):  # type: ignore[operator]
                raise OptionError(f"{name} of a ToolSpeedLimit must be a positive number, got {shown(value)}")

    def with_value(self, value: Any) -> ToolSpeedLimit:
        """With other speeds (linear, angular). Raises `OptionError`."""
        if not is_listing(value) or len(value) != 2:
            raise OptionError(f"speeds of a ToolSpeedLimit are (linear, angular), got {shown(value)}")
        linear, angular = value
        self._check(linear, angular)
        return self._with(linear=linear, angular=angular)

    def pace(self, at: Configuration, dq: np.ndarray, tick: Tick) -> float:
        """The larger of the two speeds of a displacement, as a share of what is allowed."""
        if not dq.any():
            return 0.0
        there = at.moved(dq)
        before, after = self.placement(at), self.placement(there)
        twists = np.array([self._jacobian(each) @ dq for each in (at, there)])
        moved = np.linalg.norm(after.translation - before.translation)
        turned = np.linalg.norm(orientation_error(before.rotation, after.rotation))
        linear = max(float(moved), *np.linalg.norm(twists[:, :3], axis=1).tolist()) / self.linear
        angular = max(float(turned), *np.linalg.norm(twists[:, 3:], axis=1).tolist()) / self.angular
        return max(linear, angular) / tick.dt

    def tangents(self, at: Configuration, dq: np.ndarray, tick: Tick) -> tuple[np.ndarray, np.ndarray]:
        """For each speed that is too large, the row across its direction."""
        J = self._jacobian(at)
        rows, ends = [np.empty((0, at.n))], [np.empty(0)]
        for part, most in ((J[:3], self.linear * tick.dt), (J[3:], self.angular * tick.dt)):
            motion = part @ dq
            size = float(np.linalg.norm(motion))
            if size > most:
                rows.append((motion / size) @ part[None])
                ends.append(np.array([most]))
        return np.vstack(rows), np.concatenate(ends)

    def _jacobian(self, at: Configuration) -> np.ndarray:
        """Of the offset frame (6, n), base axes."""
        return self._of_frame(np.eye(6), at) @ at.jacobian(self.frame)
