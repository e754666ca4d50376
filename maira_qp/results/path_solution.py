"""The result of following a path: a configuration for each of its poses, and whether the arm can run through them."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from maira_qp.arrays import plain
from maira_qp.display import Card
from maira_qp.errors import OptionError
from maira_qp.results.answer import OfProblem, Origin, unknown_errors
from maira_qp.results.trajectory import Trajectory
from maira_qp.wording import fixed

if TYPE_CHECKING:
    from maira_qp.results.certificate import Proof
    from maira_qp.results.path_proof import PathProof


@dataclass(frozen=True, eq=False)
class Rules:
    """What counts as following a path."""

    step: np.ndarray
    """(n,) largest step of each joint from pose to pose [rad or m]"""
    reconfigurations: int
    """So many larger steps are allowed"""
    dt: float | None
    """Time from pose to pose [s]"""
    loop: bool
    """The path is closed: it is to end with the configuration that it begins with"""
    is_start_given: bool
    """The configuration at the first pose is given"""


@dataclass(frozen=True)
class PathFailure:
    """Where an arm does not follow a path."""

    index: int
    """The pose that is not reached, or before which the arm leaves the path; the last of a loop that is not closed"""
    reason: str
    """Why"""
    is_step: bool
    """The pose is reached, and the step to it is none along the path: a reconfiguration"""
    is_proved: bool
    """No configuration within the limits reaches the pose: proved, not only not found"""


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
    "parts",
)


@dataclass(frozen=True, eq=False, repr=False)
class PathSolution(OfProblem):
    """Configurations along a path of N poses, inside the limits exactly. `bool(path)`: it is followed whole."""

    q: np.ndarray
    """(N, n) [rad or m]"""
    success: np.ndarray
    """(N,) of bool: the pose is within the tolerances, by a fresh forward kinematics, and the limits are kept"""
    position_error: np.ndarray
    """(N,) [m]"""
    orientation_error: np.ndarray
    """(N,) [rad]"""
    rules: Rules
    """What was allowed"""
    failures: tuple[PathFailure, ...]
    """Where it is not followed, pose by pose in their order: poses that are not reached, and reconfigurations"""
    _targets: np.ndarray = field(repr=False)
    """(N, 12) R by rows, then p"""
    _origin: Origin | None = field(default=None, repr=False)

    def __bool__(self) -> bool:
        return self.first_failure is None

    def __len__(self) -> int:
        return len(self.q)

    @property
    def allowed_step(self) -> np.ndarray:
        """(n,) largest step of each joint from pose to pose that was allowed [rad or m]"""
        return self.rules.step

    @property
    def breaks(self) -> np.ndarray:
        """Indices of the poses before which a joint makes too large a step, or the arm changes branches."""
        return np.array([each.index for each in self.failures if each.is_step], dtype=np.int64)

    @property
    def reconfigurations(self) -> int:
        """How many such steps there are."""
        return len(self.breaks)

    @cached_property
    def max_joint_step(self) -> float:
        """Largest step of any joint from pose to pose [rad or m]"""
        return float(np.abs(np.diff(self.q, axis=0)).max(initial=0.0))

    @cached_property
    def parts(self) -> list[tuple[int, int]]:
        """First and past-the-last index of each part of the path that is followed without a break."""
        found, begin = [], 0
        for failure in self.failures:
            found.append((begin, failure.index))
            begin = failure.index if failure.is_step else failure.index + 1
        return [(first, last) for first, last in [*found, (begin, len(self))] if last > first]

    @cached_property
    def _failure(self) -> PathFailure | None:
        allowed = self.rules.reconfigurations
        for failure in self.failures:
            allowed -= failure.is_step
            if not failure.is_step or allowed < 0:
                return failure
        return None

    @property
    def first_failure(self) -> int | None:
        """Index of the first pose that is not reached, or only by one reconfiguration more than is allowed; None: the
        path is followed whole"""
        return None if self._failure is None else self._failure.index

    @property
    def reason(self) -> str:
        """Why the path cannot be followed further than to there; empty: it is followed whole"""
        return "" if self._failure is None else self._failure.reason

    @cached_property
    def proof(self) -> Proof | PathProof | None:
        """What proves that the path cannot be followed past `first_failure`, as data that other code can check.

        For a pose out of reach that of `Solution.proof`. For S-R-S arms with steps too large: that the poses up to
        some later one cannot be followed, see `PathProof`; it takes up to some seconds to look for. None: there is
        none, it was not found, or the path was pickled.
        """
        return None if self._failure is None or self._origin is None else self._origin.path_proof(self)

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
            jerk: largest jerks [rad/s^3 or m/s^3]; None, and for joints that are not named: not limited.
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
        own = {name: plain(getattr(self, name)) for name in OWN}
        return {"joint_names": list(self.joint_names), **own} | unknown_errors(self.left_free)

    def __getstate__(self) -> dict[str, Any]:
        own = {name: getattr(self, name) for name in ("joint_names", "q_units", "left_free")}
        return {**self.__dict__, **own, "_origin": None}

    def _card(self) -> Card:
        k = self.first_failure
        whole = f"{len(self)} poses, followed whole" if k is None else f"{len(self)} poses, followed up to pose {k}"
        largest = np.abs(np.diff(self.q, axis=0)).max(axis=0, initial=0.0)
        rows = [
            (name, f"{fixed(low, 4)} to {fixed(high, 4)} {unit}", f"{step:.4f} {unit}")
            for name, unit, low, high, step in zip(
                self.joint_names,
                self.q_units,
                self.q.min(axis=0, initial=np.inf),
                self.q.max(axis=0, initial=-np.inf),
                largest,
                strict=True,
            )
            if len(self)
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
