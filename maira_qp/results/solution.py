"""What a solve returns: a configuration, and an honest word on it."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from enum import IntEnum
from functools import cached_property
from typing import TYPE_CHECKING, Any, overload

import numpy as np

from maira_qp.arrays import plain
from maira_qp.display import Card, Shown, joint_entries
from maira_qp.errors import MairaError, OptionError, SensitivityError
from maira_qp.orientation import rounding_of
from maira_qp.problem.levels import Priorities
from maira_qp.robots.model.robot import Robot, condition_numbers
from maira_qp.robots.unit_hints import degrees_hint, millimetres_hint, millimetres_hint_of_many
from maira_qp.solvers.analysis.sensitivity import dq_dtarget
from maira_qp.solvers.reference.context import Setting

if TYPE_CHECKING:
    from maira_qp.solvers.analysis.explanation import Explanation
    from maira_qp.solvers.certificates import Proof

ACTIVE_WITHIN = 1e-9
"""A limit nearer than this [rad or m] counts as active."""

SHOWN = 10
"""Answers of a batch that a notebook shows."""


class NamedEnum(IntEnum):
    """Integers, for arrays, that print as their names; `f"{status:d}"` is the number."""

    def __str__(self) -> str:
        return self.name

    def __format__(self, spec: str) -> str:
        return format(int(self) if spec.endswith("d") else self.name, spec)


class Status(NamedEnum):
    """How a solve ended."""

    CONVERGED = 0
    """The pose is within its tolerances."""
    UNREACHABLE = 1
    """No configuration within the limits reaches the pose: proved."""
    NEAREST = 2
    """Not at the pose, but at a point that no small motion within the limits brings nearer to it."""
    BUDGET_SPENT = 3
    """Neither: the restarts, the iterations or the deadline ran out first."""
    INVALID_TARGET = 4
    """The target of a batch holds NaN or inf: nothing was solved, and `q` and all numbers are NaN."""
    LIMITS_BROKEN = 5
    """No configuration was found that keeps the limits beside those of the joints: see `broken_limits`."""

    @property
    def meaning(self) -> str:
        """One sentence for a person."""
        return _MEANINGS[self]


_MEANINGS = {
    Status.CONVERGED: "the pose is reached within its tolerances",
    Status.UNREACHABLE: "no configuration within the limits reaches the pose (proved)",
    Status.NEAREST: "the pose was not reached; this is a nearest point (stationary within the limits)",
    Status.BUDGET_SPENT: "the budget was spent before the pose was reached or a nearest point found",
    Status.INVALID_TARGET: "the target holds NaN or inf: nothing was solved",
    Status.LIMITS_BROKEN: "no configuration within the further limits was found; this one breaks them",
}


class _OfSetting(Shown):
    """What is known of the joints. A pickle holds it in place of the robot."""

    _setting: Setting | None

    @cached_property
    def joint_names(self) -> tuple[str, ...]:
        """Names of the n joints, in the order of `q`"""
        return self._setting.robot.joint_names  # type: ignore[union-attr]

    @cached_property
    def q_units(self) -> tuple[str, ...]:
        """Units of the n joints: "rad", or "m" where one slides"""
        return tuple("m" if slides else "rad" for slides in self._setting.robot.slides)  # type: ignore[union-attr]


class _OfRobot(_OfSetting):
    """Values that are computed when they are first asked for. A pickle holds them in place of the robot."""

    condition_number: Any
    active_limits: Any
    broken_limits: Any
    max_joint_change: Any

    def __getstate__(self) -> dict[str, Any]:
        own = {name: getattr(self, name) for name in _OF_ROBOT}
        return {**self.__dict__, **own, "_setting": None, "_asked": None}

    def as_dict(self) -> dict[str, Any]:
        """All values by their names, as `json.dumps` takes them: lists in place of arrays, the name of a status, and
        None for a number that is not finite, such as the cost without redundancy."""
        return {name: plain(getattr(self, name)) for name in (*_VALUES, *_OF_ROBOT)}


_OF_ROBOT = ("joint_names", "q_units", "condition_number", "active_limits", "broken_limits", "max_joint_change")


@dataclass(frozen=True, eq=False, repr=False)
class Solution(_OfRobot):
    """The answer to one target. `q` is finite and inside the limits exactly, unless the status is INVALID_TARGET.

    `bool(solution)` is `solution.success`.
    """

    q: np.ndarray
    """Configuration (n,) [rad or m]"""
    success: bool
    """The pose error of `q` is within the tolerances."""
    status: Status
    position_error: float
    """|p_d - p| [m]"""
    orientation_error: float
    """Angle between the orientations [rad]"""
    iterations: int
    """Iterations (QPs solved) over all starts"""
    restarts: int
    """Starts after the first"""
    cost: float
    """Value of the redundancy's first objective at `q`; NaN without redundancy"""
    projected_gradient: float
    """Largest entry of the gradient that no constraint holds up, of what was minimised last: the redundancy's objective
    along the self-motion (Strict), the weighted sum (Weighted), the pose error (not reached); NaN where nothing was"""
    optimal: bool
    """What was minimised last is stationary: its projected gradient is within its tolerance; the pose alone: reached.
    False with success: the pose is reached, but the redundancy is not settled (at a singular pose it may never be)"""
    start_projected: bool
    """The given start `q0` was outside the limits and was moved onto them."""
    target_deviation: float
    """Largest entry of |R R^T - I| of a target given as an array, where it is above 1e-5, else 0: up to 2e-3 the
    nearest rotation was taken, as is meant by three or four decimals"""
    left_q0: bool
    """The answer left the neighbourhood of `q0`: a descent from there ends elsewhere, and this answer is better
    by more than the tolerances. False without `q0`"""
    backend: str
    """Who solved the QPs"""
    _start: np.ndarray | None = field(repr=False)
    """The start `q0` (n,) that was given"""
    _setting: Setting | None = field(repr=False)
    _asked: tuple[Priorities, Any] | None = field(repr=False)
    """The tasks and what they were called with"""

    def __bool__(self) -> bool:
        return self.success

    def _card(self) -> Card:
        numbers = [f"{value:.4f} {unit}" for value, unit in zip(self.q, self.q_units, strict=True)]
        return Card(
            title=f"Solution: {self.status.name}, {self.status.meaning}",
            facts=(
                ("error", f"{self.position_error:.3g} m, {self.orientation_error:.3g} rad"),
                ("effort", f"{self.iterations} iterations, {self.restarts} restarts, {self.backend}"),
                ("condition number", f"{self.condition_number:.4g}"),
                ("cost", f"{self.cost:.6g}{'' if self.optimal else ', not optimal'}" if np.isfinite(self.cost) else ""),
                ("active limits", ", ".join(self.active_limits)),
                ("broken limits", ", ".join(f"{name} by {x:.3g}" for name, x in self.broken_limits.items())),
                ("hint", " ".join(self.hints)),
            ),
            entries=joint_entries(self.joint_names, numbers),
            headings=("joint", "q", "limit"),
            rows=[
                (name, number, ", ".join(_ends_of(name, self.active_limits)))
                for name, number in zip(self.joint_names, numbers, strict=True)
            ],
        )

    @cached_property
    def max_joint_change(self) -> float:
        """How far the joint that moved most is from `q0`, max_i |q_i - q0_i| [rad or m]; NaN without `q0`"""
        return math.nan if self._start is None else float(np.abs(self.q - self._start).max())

    @cached_property
    def condition_number(self) -> float:
        """Of the tool's Jacobian at `q`: largest by smallest singular value"""
        if self.status is Status.INVALID_TARGET:
            return np.nan
        return self._setting.robot.condition_number(self.q)  # type: ignore[union-attr]

    @cached_property
    def active_limits(self) -> list[str]:
        """Limits that `q` stands on, such as "joint4 upper", and pairs at their margin, such as "link5 - table" """
        if self.status is Status.INVALID_TARGET:
            return []
        return active_limits(self._setting, self.q)  # type: ignore[arg-type]

    @cached_property
    def broken_limits(self) -> dict[str, float]:
        """What `q` breaks of the limits beside those of the joints, such as "link5 - table", and by how much.

        In the unit of the limit, for pairs of bodies what is missing of the margin [m]. Empty but for `LIMITS_BROKEN`.
        """
        if self.status is Status.INVALID_TARGET:
            return {}
        return broken_limits(self._setting, self.q)  # type: ignore[arg-type]

    @cached_property
    def proof(self) -> Proof | None:
        """What proves that the target is out of reach: for `UNREACHABLE`, else None. A pickle has lost it."""
        if self.status is not Status.UNREACHABLE or self._asked is None:
            return None
        from maira_qp.solvers.certificates import Proofs  # heavy: Numba comes with it

        priorities, target = self._asked
        proofs = Proofs.of(priorities, self._setting.options)  # type: ignore[union-attr]
        return None if proofs is None else proofs.proof(priorities.targets(target))

    @property
    def hints(self) -> tuple[str, ...]:
        """What looks like millimetres or degrees where metres and radians are asked for, a sentence each. Nothing was
        converted. A pickle has lost them."""
        if self._asked is None or self._setting is None or self.status is Status.INVALID_TARGET:
            return ()
        (priorities, asked), robot = self._asked, self._setting.robot
        targets = {} if self.success else priorities.targets(asked)
        far = [millimetres_hint(target.translation, robot) for target in targets.values()]
        moved = self._start if self.start_projected else None
        start = "" if moved is None else degrees_hint(moved, robot, "the start")
        return tuple(hint for hint in (*dict.fromkeys(far), start) if hint)

    def explain(self) -> Explanation:
        """Why the solve ended as it did: what is left, which limits of the joints stand in the way, what each costs.

        `print(solution.explain())` says it in words. It solves the target again without those limits, which takes some
        ten milliseconds. Raises `OptionError` for a solution that was pickled, `PoseError` for an invalid target.
        """
        from maira_qp.solvers.analysis.explanation import explain  # which knows this module

        if self._asked is None or self._setting is None:
            raise OptionError("a pickled solution no longer knows its robot: call explain() before it is pickled")
        priorities, target = self._asked
        return explain(priorities, priorities.targets(target), self, self._setting)

    def jacobian(self) -> np.ndarray:
        """How `q` follows its target: dq/dtarget (n, 6) [rad/m, rad/rad], the derivative of what the solve minimised.

        The columns are the target's twist as in `Robot.jacobian`: linear [m] before angular [rad], base axes, at the
        target, `p_d + dp` and `exp(dphi) R_d`. A joint that a limit holds has a zero row; one that would stand there
        without the limit too, where the derivative has two sides, counts as free. Where nothing chooses between
        configurations, as without a redundancy, q follows by the least motion. See `solvers.analysis.sensitivity`.

        Raises `SensitivityError` for what is not optimal or is singular, for tasks at several levels or of several
        targets, on limits that are not of the joints, and for a solution that was pickled.
        """
        if self._setting is None or self._asked is None:
            raise SensitivityError("a pickled solution no longer knows its robot: call jacobian() before it is pickled")
        if not self.optimal:
            raise SensitivityError(f"only an optimal answer has a derivative, and this {self.status.name} one is not")
        priorities, target = self._asked
        at = self._setting.robot.at(self.q)
        return dq_dtarget(priorities, priorities.targets(target), at, self._setting, self.success)


_VALUES = (
    "q",
    "success",
    "status",
    "position_error",
    "orientation_error",
    "iterations",
    "restarts",
    "cost",
    "projected_gradient",
    "optimal",
    "start_projected",
    "target_deviation",
    "left_q0",
    "backend",
)


def solution_of(**values: Any) -> Solution:
    """A `Solution` with these values; a frozen class's own constructor would take as long as a few iterations."""
    solution = object.__new__(Solution)
    solution.__dict__.update(values)
    return solution


def with_deviation(solution: Solution, target: Any) -> Solution:
    """The solution with the `target_deviation` of what it was asked for: a pose, or {frame: pose}."""
    poses = target.values() if isinstance(target, Mapping) else () if target is None else (target,)
    deviation = max((rounding_of(getattr(pose, "homogeneous", pose)) for pose in poses), default=0.0)
    return solution if deviation == 0 else replace(solution, target_deviation=deviation)


@dataclass(frozen=True, eq=False, repr=False)
class BatchSolution(_OfRobot):
    """The answers to N targets: the fields of `Solution` with a leading axis N.

    `batch[i]` is a `Solution`; `batch[i:j]`, `batch[[i, j]]` and `batch[mask]`, such as `batch[~batch.success]`, are
    shorter batches. As of an array, there is no truth of a batch: `batch.success.all()`, `batch.success.any()`.
    """

    q: np.ndarray
    """(N, n)"""
    success: np.ndarray
    """(N,) of bool"""
    status: np.ndarray
    """(N,) integer values of `Status`"""
    position_error: np.ndarray
    """(N,) [m]"""
    orientation_error: np.ndarray
    """(N,) [rad]"""
    iterations: np.ndarray
    """(N,)"""
    restarts: np.ndarray
    """(N,)"""
    cost: np.ndarray
    """(N,)"""
    projected_gradient: np.ndarray
    """(N,)"""
    optimal: np.ndarray
    """(N,) of bool"""
    start_projected: np.ndarray
    """(N,) of bool"""
    target_deviation: np.ndarray
    """(N,)"""
    left_q0: np.ndarray
    """(N,) of bool"""
    backend: str
    _starts: np.ndarray | None = field(repr=False)
    """(N, n)"""
    _setting: Setting | None = field(repr=False)
    _asked: tuple[Priorities, np.ndarray] | None = field(repr=False)
    """The tasks and the rows (N, K, 12) of targets that they were called with"""

    @cached_property
    def max_joint_change(self) -> np.ndarray:
        """(N,)"""
        return np.full(len(self), np.nan) if self._starts is None else np.abs(self.q - self._starts).max(axis=1)

    @cached_property
    def condition_number(self) -> np.ndarray:
        """(N,)"""
        robot: Robot = self._setting.robot  # type: ignore[union-attr]
        valid = self.status != Status.INVALID_TARGET
        q, numbers = self.q[valid], np.full(len(self), np.nan)
        parts = [robot.jacobians(q[k : k + 4096]) for k in range(0, len(q), 4096)]
        numbers[valid] = np.concatenate([np.empty(0), *map(condition_numbers, parts)])
        return numbers

    @cached_property
    def active_limits(self) -> list[list[str]]:
        """N lists"""
        setting: Setting = self._setting  # type: ignore[assignment]
        lower, upper = setting.robot.lower + ACTIVE_WITHIN, setting.robot.upper - ACTIVE_WITHIN
        on_a_limit = (self.q <= lower) | (self.q >= upper) | setting.is_bent
        names: list[list[str]] = [[] for _ in range(len(self))]
        for i in np.flatnonzero(on_a_limit.any(axis=1) & (self.status != Status.INVALID_TARGET)):
            names[i] = active_limits(setting, self.q[i])
        return names

    @cached_property
    def broken_limits(self) -> list[dict[str, float]]:
        """N mappings"""
        setting: Setting = self._setting  # type: ignore[assignment]
        return [broken_limits(setting, q) for q in self.q] if setting.further else [{} for _ in self.q]

    @staticmethod
    def blank(
        setting: Setting, backend: str, starts: np.ndarray | None, asked: tuple[Priorities, np.ndarray]
    ) -> BatchSolution:
        """Answers yet to be written to what was asked, from starts (N, n) or None: budget spent, at no q yet."""
        count = len(asked[1])
        return BatchSolution(
            q=np.empty((count, setting.robot.n)),
            success=np.zeros(count, dtype=bool),
            status=np.full(count, int(Status.BUDGET_SPENT)),
            position_error=np.full(count, np.nan),
            orientation_error=np.full(count, np.nan),
            iterations=np.zeros(count, dtype=np.int64),
            restarts=np.zeros(count, dtype=np.int64),
            cost=np.full(count, np.nan),
            projected_gradient=np.full(count, np.nan),
            optimal=np.zeros(count, dtype=bool),
            start_projected=np.zeros(count, dtype=bool),
            target_deviation=np.zeros(count),
            left_q0=np.zeros(count, dtype=bool),
            backend=backend,
            _starts=starts,
            _setting=setting,
            _asked=asked,
        )

    def put(self, i: int, solution: Solution) -> None:
        """Make this the i-th answer."""
        for name in _VALUES:
            if name not in ("backend", "target_deviation"):
                getattr(self, name)[i] = getattr(solution, name)

    def refuse(self, invalid: np.ndarray) -> None:
        """Say of some targets, (N,) of bool, that they hold NaN or inf: numbers are NaN, counts 0."""
        self.status[invalid] = Status.INVALID_TARGET
        for numbers in (self.q, self.position_error, self.orientation_error, self.cost, self.projected_gradient):
            numbers[invalid] = np.nan
        for counts in (self.success, self.optimal, self.start_projected, self.iterations, self.restarts):
            counts[invalid] = 0

    def put_found(self, part: slice, outcome: np.ndarray, after: np.ndarray, tolerance: float) -> None:
        """What the compiled engine, which wrote the q, found for a part: see `Compiled.solve_batch`."""
        reached, proved = outcome[:, 0] > 0, outcome[:, 0] < 0
        self.success[part] = self.optimal[part] = reached
        self.status[part] = np.where(reached, Status.CONVERGED, Status.BUDGET_SPENT)
        self.position_error[part], self.orientation_error[part] = outcome[:, 4], outcome[:, 5]
        self.iterations[part], self.restarts[part] = outcome[:, 2], outcome[:, 1]
        self.start_projected[part], self.left_q0[part] = outcome[:, 6] > 0, outcome[:, 8] > 0
        finished = np.flatnonzero(~np.isnan(after[:, 0]))
        if not len(finished):
            return
        at = part.start + finished
        reached, iterations, gradient, cost, position, orientation = after[finished].T
        optimal = gradient <= tolerance
        self.success[at], self.optimal[at] = reached > 0, optimal
        self.status[at] = np.where(
            reached > 0,
            Status.CONVERGED,
            np.where(proved[finished], Status.UNREACHABLE, np.where(optimal, Status.NEAREST, Status.BUDGET_SPENT)),
        )
        self.position_error[at], self.orientation_error[at] = position, orientation
        self.iterations[at] += iterations.astype(np.int64)
        self.cost[at], self.projected_gradient[at] = cost, gradient

    def __len__(self) -> int:
        return len(self.q)

    def __bool__(self) -> bool:
        raise MairaError(
            f"a batch of {len(self)} answers is neither true nor false: "
            "batch.success.all() or batch.success.any(); len(batch) is how many there are"
        )

    def _card(self) -> Card:
        counts = Counter(Status(value).name for value in self.status.tolist())
        plural = "" if len(self) == 1 else "s"
        reach = [f"{100 * self.success.mean():.4g} % reached"] if len(self) else []
        return Card(
            title=f"BatchSolution: {', '.join([f'{len(self)} target{plural}', *reach])}",
            facts=(
                ("status", ", ".join(f"{count} {name}" for name, count in counts.most_common())),
                ("position error [m]", _spread(self.position_error)),
                ("orientation error [rad]", _spread(self.orientation_error)),
                ("iterations", _spread(self.iterations)),
                ("solved by", self.backend),
                ("joints", ", ".join(self.joint_names)),
                ("hint", self._hint),
            ),
            headings=("", "status", "position error [m]", "orientation error [rad]", *self.joint_names),
            rows=[(str(i), *_row(one)) for i, one in enumerate(self[:SHOWN])],
        )

    @property
    def _hint(self) -> str:
        """Whether a target that is not reached looks like millimetres."""
        if self._asked is None or self._setting is None or self.success.all():
            return ""
        p = self._asked[1][~self.success, :, 9:].reshape(-1, 3)
        return millimetres_hint_of_many(p, self._setting.robot)

    @overload
    def __getitem__(self, i: int | np.integer) -> Solution: ...

    @overload
    def __getitem__(self, i: slice | Sequence[int] | np.ndarray) -> BatchSolution: ...

    def __getitem__(self, i: int | np.integer | slice | Sequence[int] | np.ndarray) -> Solution | BatchSolution:
        """The i-th answer, or some of them (copies): by a slice, numbers, or a mask (N,). Raises `IndexError`."""
        if not isinstance(i, slice):
            i = _checked_index(i, len(self))
        if not isinstance(i, int):
            arrays = {name: getattr(self, name)[i].copy() for name in _VALUES if name != "backend"}
            asked = None if self._asked is None else (self._asked[0], self._asked[1][i])
            starts = None if self._starts is None else self._starts[i]
            return BatchSolution(**arrays, backend=self.backend, _starts=starts, _setting=self._setting, _asked=asked)
        values = {name: getattr(self, name)[i] for name in _VALUES if name not in ("q", "status", "backend")}
        return Solution(
            q=self.q[i].copy(),
            status=Status(int(self.status[i])),
            **{name: value.item() for name, value in values.items()},
            backend=self.backend,
            _start=None if self._starts is None else self._starts[i],
            _setting=self._setting,
            _asked=None if self._asked is None else (self._asked[0], self._asked[0].of_row(self._asked[1][i])),
        )

    def __iter__(self) -> Iterator[Solution]:
        return (self[i] for i in range(len(self)))


class StepStatus(NamedEnum):
    """What the arm is doing in a control tick: `Step.status`.

    A joint is at rest if its speed is at most 1e-6 of its limit (of 1 rad/s or 1 m/s where that is infinite).
    """

    ARRIVED = 0
    """Every task, of every level, is within `position_tolerance` and `orientation_tolerance` of `Options` after it"""
    MOVING = 1
    """Not arrived, and on the way: some joint is not at rest, or gains and damping let a gradient fall slowly"""
    NEAREST = 2
    """At rest, where nothing near by is nearer, in the order of the levels: no task's gradient that limits and levels
    above leave free is larger than `Options.stationarity_tolerance`, and no level is at a saddle point"""
    STUCK = 3
    """At rest though the QPs ask for motion: a QP failed, or no share of the motion that they ask for was safe"""


@dataclass(frozen=True, eq=False, repr=False)
class Step(_OfSetting):
    """One control tick."""

    velocity: np.ndarray
    """Joint velocity (n,) [rad/s or m/s], within the velocity limits exactly"""
    q: np.ndarray
    """Configuration (n,) after the tick"""
    position_error: float
    """|p_d - p| [m] after the tick"""
    orientation_error: float
    """Angle between the orientations [rad] after the tick"""
    status: StepStatus
    """What the arm is doing"""
    backend: str
    """Which engine made it: "compiled", or the name of the QP backend in the general engine"""
    _setting: Setting | None = field(repr=False)

    @cached_property
    def active_limits(self) -> list[str]:
        """Limits that `q` stands on, such as "joint4 upper", and pairs at their margin, such as "link5 - table" """
        return active_limits(self._setting, self.q)  # type: ignore[arg-type]

    def __getstate__(self) -> dict[str, Any]:
        own = {"joint_names": self.joint_names, "q_units": self.q_units, "active_limits": self.active_limits}
        return {**self.__dict__, **own, "_setting": None}

    def _card(self) -> Card:
        units = self.q_units
        numbers = [f"{value:.4f} {unit}" for value, unit in zip(self.q, units, strict=True)]
        speeds = [f"{value:+.4f} {unit}/s" for value, unit in zip(self.velocity, units, strict=True)]
        both = [f"{number} {speed}" for number, speed in zip(numbers, speeds, strict=True)]
        return Card(
            title=f"Step: {self.position_error:.3g} m and {self.orientation_error:.3g} rad off, by {self.backend}",
            facts=(("active limits", ", ".join(self.active_limits)),),
            entries=joint_entries(self.joint_names, both),
            headings=("joint", "q", "velocity", "limit"),
            rows=[
                (name, number, speed, ", ".join(_ends_of(name, self.active_limits)))
                for name, number, speed in zip(self.joint_names, numbers, speeds, strict=True)
            ],
        )


def _checked_index(i: Any, count: int) -> int | np.ndarray:
    """A number, or numbers (k,), of a batch of so many. Raises `IndexError`."""
    try:
        index = np.asarray(None if isinstance(i, tuple) else i)
    except ValueError:  # lists of different lengths
        index = np.asarray(None)
    if index.ndim == 1 and not len(index):
        return np.empty(0, dtype=np.int64)
    if index.dtype == bool and index.ndim == 1:
        if len(index) != count:
            raise IndexError(f"a mask of a batch of {count} has {count} entries, not {len(index)}")
        return np.flatnonzero(index)
    if index.dtype.kind not in "iu" or index.ndim > 1:
        raise IndexError(f"a batch is indexed by a number, a slice, a list of numbers or a mask, not by {i!r:.80}")
    outside = np.atleast_1d(index)[np.atleast_1d((index < -count) | (index >= count))]
    if len(outside):
        raise IndexError(f"there is no target {outside[0]} in a batch of {count}")
    return index if index.ndim else int(index)


def _ends_of(joint: str, limits: list[str]) -> list[str]:
    """Which ends of its range a joint stands at: "lower", "upper"."""
    return [name.rsplit(" ", 1)[1] for name in limits if name.rsplit(" ", 1)[0] == joint]


def _row(one: Solution) -> tuple[str, ...]:
    """An answer in a table of a batch."""
    errors = f"{one.position_error:.3g}", f"{one.orientation_error:.3g}"
    return one.status.name, *errors, *(f"{value:.4f}" for value in one.q)


def _spread(values: np.ndarray) -> str:
    """The median and the largest of numbers (N,), those aside that are not known."""
    known = values[np.isfinite(values)]
    return f"median {np.median(known):.3g}, largest {known.max():.3g}" if len(known) else ""


def broken_limits(setting: Setting, q: np.ndarray) -> dict[str, float]:
    """What q (n,) breaks of the limits beside those of the joints, the worst first; nothing where q is NaN."""
    broken = setting.broken_limits(setting.robot.at(q)) if np.isfinite(q).all() else {}
    return dict(sorted(broken.items(), key=lambda item: -item[1]))


def active_limits(setting: Setting, q: np.ndarray) -> list[str]:
    """Names of the limits that q (n,) stands on, those of the joints first."""
    robot, names = setting.robot, []
    for name, value, low, high in zip(robot.joint_names, q, robot.lower, robot.upper, strict=True):
        if value <= low + ACTIVE_WITHIN:
            names.append(f"{name} lower")
        if value >= high - ACTIVE_WITHIN:
            names.append(f"{name} upper")
    at = robot.at(q)
    return names + [name for limit in setting.limits for name in limit.active(at)]
