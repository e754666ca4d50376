"""The result of timing a path: configurations, speeds and accelerations at times, and how well the tool keeps to it."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from maira_qp.arrays import plain, real_array
from maira_qp.display import Card
from maira_qp.errors import OptionError
from maira_qp.results.answer import OfProblem, Origin


@dataclass(frozen=True, eq=False)
class MotionLimits:
    """What a motion keeps to."""

    lower: np.ndarray
    """(n,) [rad or m]"""
    upper: np.ndarray
    """(n,) [rad or m]"""
    velocity: np.ndarray
    """(n,) [rad/s or m/s]"""
    acceleration: np.ndarray
    """(n,) [rad/s^2 or m/s^2]"""
    jerk: np.ndarray | None
    """(n,) [rad/s^3 or m/s^3]; None: not limited"""
    tool_speed: float | None
    """Of the tool's origin [m/s]; None: not limited"""


@dataclass(frozen=True)
class Deviation:
    """The largest distance of the tool from a path, and where it is."""

    value: float
    """[m] or [rad]"""
    time: float
    """When it is there [s]"""
    pose: int
    """Index of the path's pose that comes before"""


OWN = (
    "times",
    "q",
    "velocity",
    "acceleration",
    "tool_speed",
    "first_pose",
    "pose_times",
    "duration",
    "position_deviation",
    "orientation_deviation",
)


@dataclass(frozen=True, eq=False, repr=False)
class Trajectory(OfProblem):
    """A timed path at M times, from rest to rest; its joints stay inside their limits exactly."""

    times: np.ndarray
    """(M,) multiples of `dt` from 0 [s]"""
    q: np.ndarray
    """(M, n) [rad or m]"""
    velocity: np.ndarray
    """(M, n) [rad/s or m/s]"""
    acceleration: np.ndarray
    """(M, n) [rad/s^2 or m/s^2]; where it jumps, as it may without a limit of the jerk, that of afterwards"""
    tool_speed: np.ndarray
    """(M,) speed of the tool's origin [m/s]"""
    first_pose: int
    """Index in the path of the pose that the trajectory begins at"""
    pose_times: np.ndarray
    """(P,) times at which the poses from there on are passed [s]"""
    position_deviation: Deviation
    """Of the tool from the straight lines between the path's poses [m], by a fresh forward kinematics. The poses are
    those of `PathSolution.q`, which are off the targets by its errors."""
    orientation_deviation: Deviation
    """Of the tool from the shortest rotations between the path's poses [rad]"""
    limits: MotionLimits
    """What was allowed"""
    _origin: Origin | None = field(default=None, repr=False)

    def __len__(self) -> int:
        return len(self.times)

    @property
    def duration(self) -> float:
        """[s]"""
        return float(self.times[-1])

    def at(self, t: Any) -> np.ndarray:
        """Configurations (n,) at a time `t` [s], or (K, n) at times (K,), by cubic polynomials between the samples.

        Raises `OptionError` for times that are not from 0 to `duration`.
        """
        scalar = np.ndim(t) == 0
        times = real_array(t, () if scalar else (None,), "t", OptionError)
        if ((times < 0.0) | (times > self.duration)).any():
            raise OptionError(f"t must be from 0 to {self.duration:.9g} s, got {times.min():.9g} to {times.max():.9g}")
        if len(self) == 1:
            return self.q[0].copy() if scalar else np.repeat(self.q, len(times), axis=0)
        from scipy.interpolate import CubicHermiteSpline  # takes a while to load

        q = CubicHermiteSpline(self.times, self.q, self.velocity)(times)
        return np.clip(q, self.limits.lower, self.limits.upper)

    def as_dict(self) -> dict[str, Any]:
        """All values by their names, as `json.dumps` takes them."""
        values = {name: getattr(self, name) for name in OWN}
        for name in ("position_deviation", "orientation_deviation"):
            values[name] = vars(values[name])
        return {"joint_names": list(self.joint_names), "q_units": list(self.q_units), **plain(values)}

    def __getstate__(self) -> dict[str, Any]:
        own = {"joint_names": self.joint_names, "q_units": self.q_units}
        return {**self.__dict__, **own, "_origin": None}

    def _card(self) -> Card:
        far, turned = self.position_deviation, self.orientation_deviation
        speed, change = np.abs(self.velocity).max(axis=0), np.abs(self.acceleration).max(axis=0)
        shares = [f"{100 * share:.0f} %" for share in speed / self.limits.velocity]
        rows = [
            (name, f"{v:.4g} {unit}/s", f"{a:.4g} {unit}/s²", share)
            for name, unit, v, a, share in zip(self.joint_names, self.q_units, speed, change, shares, strict=True)
        ]
        return Card(
            title=f"Trajectory of {len(self.pose_times)} poses in {self.duration:.4g} s, {len(self)} samples",
            facts=(
                ("tool off the path", f"{far.value:.2g} m at {far.time:.4g} s, after pose {far.pose}"),
                ("tool turned off it", f"{turned.value:.2g} rad at {turned.time:.4g} s, after pose {turned.pose}"),
                ("largest speed of the tool", f"{self.tool_speed.max():.4g} m/s"),
            ),
            entries=[f"{name} up to {v}" for name, v, *_ in rows],
            headings=("joint", "largest speed", "largest acceleration", "of the speed that is allowed"),
            rows=rows,
        )
