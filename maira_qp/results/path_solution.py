"""The result of following a path: a configuration for each of its poses, and whether the arm can run through them."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from maira_qp.arrays import plain
from maira_qp.display import Card
from maira_qp.errors import OptionError
from maira_qp.results.answer import OfProblem, Origin
from maira_qp.results.trajectory import Trajectory


@dataclass(frozen=True, eq=False)
class Rules:
    """What counts as following a path."""

    step: np.ndarray
    """(n,) largest step of each joint from pose to pose [rad or m]"""
    reconfigurations: int
    """So many larger steps are allowed"""
    dt: float | None
    """Time from pose to pose [s]"""


OWN = (
    "q",
    "success",
    "position_error",
    "orientation_error",
    "allowed_step",
    "reconfigurations",
    "max_joint_step",
    "first_failure",
    "reason",
)


@dataclass(frozen=True, eq=False, repr=False)
class PathSolution(OfProblem):
    """Configurations along a path of N poses, inside the limits exactly. `bool(path)`: it is followed whole."""

    q: np.ndarray
    """(N, n) [rad or m]"""
    success: np.ndarray
    """(N,) of bool: the pose is within the tolerances, by a fresh forward kinematics"""
    position_error: np.ndarray
    """(N,) [m]"""
    orientation_error: np.ndarray
    """(N,) [rad]"""
    rules: Rules
    """What was allowed"""
    continuous: np.ndarray
    """(N - 1,) of bool: the step from a pose to the next leads along the path, not from branch to branch"""
    _reasons: dict[int, str] = field(repr=False)
    """Why poses are not reached, by index"""
    _origin: Origin | None = field(default=None, repr=False)

    def __bool__(self) -> bool:
        return self.first_failure is None

    def __len__(self) -> int:
        return len(self.q)

    @cached_property
    def breaks(self) -> np.ndarray:
        """Indices of the poses before which a joint makes too large a step, or the arm changes branches."""
        steps = np.abs(np.diff(self.q, axis=0))
        return np.flatnonzero((steps > self.allowed_step * (1.0 + 1e-9)).any(axis=1) | ~self.continuous) + 1

    @property
    def allowed_step(self) -> np.ndarray:
        """(n,) largest step of each joint from pose to pose that was allowed [rad or m]"""
        return self.rules.step

    @property
    def reconfigurations(self) -> int:
        """How many such steps there are."""
        return len(self.breaks)

    @cached_property
    def max_joint_step(self) -> float:
        """Largest step of any joint from pose to pose [rad or m]"""
        return float(np.abs(np.diff(self.q, axis=0)).max(initial=0.0))

    @cached_property
    def first_failure(self) -> int | None:
        """Index of the first pose that is not reached, or only by one reconfiguration more than is allowed; None: the
        path is followed whole"""
        missed, beyond = np.flatnonzero(~self.success), self.breaks[self.rules.reconfigurations :]
        failures = [*missed[:1].tolist(), *beyond[:1].tolist()]
        return min(failures) if failures else None

    @cached_property
    def reason(self) -> str:
        """Why the path cannot be followed further than to there; empty: it is followed whole"""
        k = self.first_failure
        if k is None:
            return ""
        if not self.success[k]:
            return self._reasons.get(k, "the pose is not reached")
        steps = np.abs(self.q[k] - self.q[k - 1])
        joint = int((steps / self.allowed_step).argmax())
        name, unit = self.joint_names[joint], self.q_units[joint]
        if steps[joint] <= self.allowed_step[joint]:
            return f"no way was found to pose {k} along the path: the arm changes branches before it"
        return (
            f"no way was found on which {name} moves by less than {steps[joint]:.3g} {unit} to pose {k}; "
            f"{self.allowed_step[joint]:.3g} {unit} is allowed"
        )

    def timed(
        self,
        velocity: Any = None,
        acceleration: Any = None,
        jerk: Any = None,
        *,
        dt: float = 0.01,
        tool_speed: float | None = None,
        longest_part: bool = False,
    ) -> Trajectory:
        """Compute when the path is where: from rest to rest along a smooth curve through `q`, as quick as limits allow.

        By toppra, time-optimal; with `jerk` by ruckig, one law for the whole path, which is slower. Limits are a number
        for all joints, one each (n,), or {joint name: value}; those of the robot are never loosened.

        Args:
            velocity: largest speeds [rad/s or m/s]; None: the robot's own.
            acceleration: largest accelerations [rad/s^2 or m/s^2]; None: the robot's own.
            jerk: largest jerks [rad/s^3 or m/s^3], a number or (n,); None: not limited.
            dt: from sample to sample [s]; the duration is a multiple of it.
            tool_speed: speed of the tool's origin [m/s], held wherever the joints' limits allow it, and never exceeded;
                None: as fast as the joints allow.
            longest_part: time the longest part of the path that is followed without a reconfiguration.

        Raises `OptionError` for limits out of range, or of which there are none, for a path that is not followed whole
        or has reconfigurations, unless `longest_part`; without toppra or ruckig (`maira-qp[time]`), and for a path that
        was pickled.
        """
        if self._origin is None:
            raise OptionError("a pickled path no longer knows its robot: call timed() before it is pickled")
        return self._origin.timed(
            self,
            velocity=velocity,
            acceleration=acceleration,
            jerk=jerk,
            dt=dt,
            tool_speed=tool_speed,
            longest_part=longest_part,
        )

    def as_dict(self) -> dict[str, Any]:
        """All values by their names, as `json.dumps` takes them."""
        return {"joint_names": list(self.joint_names), **{name: plain(getattr(self, name)) for name in OWN}}

    def __getstate__(self) -> dict[str, Any]:
        own = {"joint_names": self.joint_names, "q_units": self.q_units}
        return {**self.__dict__, **own, "_origin": None}

    def _card(self) -> Card:
        k = self.first_failure
        whole = f"{len(self)} poses, followed whole" if k is None else f"{len(self)} poses, followed up to pose {k}"
        largest = np.abs(np.diff(self.q, axis=0)).max(axis=0, initial=0.0)
        rows = [
            (name, f"{low:.4f} to {high:.4f} {unit}", f"{step:.4f} {unit}")
            for name, unit, low, high, step in zip(
                self.joint_names, self.q_units, self.q.min(axis=0), self.q.max(axis=0), largest, strict=True
            )
        ]
        return Card(
            title=f"Path: {whole}",
            facts=(
                ("reason", self.reason),
                ("reached", f"{int(self.success.sum())} of {len(self)}"),
                ("reconfigurations", str(self.reconfigurations)),
                ("largest step", f"{self.max_joint_step:.4g}"),
            ),
            entries=[f"{name} {span}" for name, span, _ in rows],
            headings=("joint", "range", "largest step"),
            rows=rows,
        )
