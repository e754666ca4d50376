"""The result of a batch of solves: the fields of `Solution` as arrays."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, overload

import numpy as np

from maira_qp.display import Card
from maira_qp.errors import MairaError
from maira_qp.problem.problem import ACTIVE_WITHIN
from maira_qp.problem.targets import Targets
from maira_qp.results.answer import ERRORS, VALUES, Answer, Origin
from maira_qp.results.solution import Solution
from maira_qp.results.status import Status
from maira_qp.robots.model.robot import condition_numbers
from maira_qp.robots.unit_hints import millimetres_hint_of_many
from maira_qp.wording import fixed

SHOWN = 10
"""Answers of a batch that a notebook shows."""


@dataclass(frozen=True, eq=False, repr=False)
class BatchSolution(Answer):
    """The answers to N targets: the fields of `Solution` with a leading axis N.

    `batch[i]` is a `Solution`; `batch[i:j]`, `batch[[i, j]]` and `batch[mask]`, such as `batch[~batch.success]`, are
    shorter batches. As of an array, there is no truth of a batch: `batch.success.all()`, `batch.success.any()`.
    """

    q: np.ndarray
    """(N, n)"""
    success: np.ndarray
    """(N,) of bool"""
    status: np.ndarray
    """(N,) integer values of `Status`; `status_names` has their names"""
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
    rejected: np.ndarray
    """(N,)"""
    backend: str
    _starts: np.ndarray | None = field(repr=False)
    """(N, n)"""
    _targets: np.ndarray = field(repr=False)
    """The poses (N, K, 12) that were asked for, see `Targets`"""
    _origin: Origin | None = field(repr=False)
    _origins: Sequence[Origin] | None = field(default=None, repr=False)
    """(N,) where the calls differed in more than poses, each with its own; None: all have the same"""

    def __getstate__(self) -> dict[str, Any]:
        return {**super().__getstate__(), "_origins": None}

    @property
    def status_names(self) -> np.ndarray:
        """(N,) of text: `status` by the names of `Status`, such as "CONVERGED" """
        names = np.array([Status(value).name for value in range(max(Status) + 1)])
        return names[self.status]

    @cached_property
    def max_joint_change(self) -> np.ndarray:
        """(N,)"""
        return np.full(len(self), np.nan) if self._starts is None else np.abs(self.q - self._starts).max(axis=1)

    @cached_property
    def condition_number(self) -> np.ndarray:
        """(N,)"""
        robot = self._problem.robot
        valid = self.status != Status.INVALID_TARGET
        q, numbers = self.q[valid], np.full(len(self), np.nan)
        parts = [robot.jacobians(q[k : k + 4096]) for k in range(0, len(q), 4096)]
        numbers[valid] = np.concatenate([np.empty(0), *map(condition_numbers, parts)])
        return numbers

    @cached_property
    def active_limits(self) -> list[list[str]]:
        """N lists"""
        if self.scope:
            return [one.active_limits for one in self]
        robot = self._problem.robot
        lower, upper = robot.lower + ACTIVE_WITHIN, robot.upper - ACTIVE_WITHIN
        on_a_limit = (self.q <= lower) | (self.q >= upper) | bool(self._problem.additional_limits)
        names: list[list[str]] = [[] for _ in range(len(self))]
        for i in np.flatnonzero(on_a_limit.any(axis=1) & (self.status != Status.INVALID_TARGET)):
            names[i] = self._problem.active_limits(self.q[i]) if self._origins is None else self[int(i)].active_limits
        return names

    @cached_property
    def broken_limits(self) -> list[dict[str, float]]:
        """N mappings"""
        if not self._problem.additional_limits:
            return [{} for _ in self.q]
        return [self[i].broken_limits for i in range(len(self))]

    @staticmethod
    def blank(
        origin: Origin,
        backend: str,
        starts: np.ndarray | None,
        targets: Targets,
        origins: Sequence[Origin] | None = None,
    ) -> BatchSolution:
        """Answers yet to be written to targets, from starts (N, n) or None: budget spent, at no q yet."""
        count = len(targets)
        return BatchSolution(
            q=np.empty((count, origin.problem.robot.n)),
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
            target_deviation=targets.deviations,
            left_q0=np.zeros(count, dtype=bool),
            rejected=np.zeros(count, dtype=np.int64),
            backend=backend,
            _starts=starts,
            _targets=targets.rows,
            _origin=origin,
            _origins=origins,
        )

    def put(self, i: int, solution: Solution) -> None:
        """Make this the i-th answer."""
        for name in VALUES:
            if name not in ("backend", "target_deviation"):
                getattr(self, name)[i] = getattr(solution, name)

    def refuse(self, invalid: np.ndarray) -> None:
        """Say of some targets, (N,) of bool, that they hold NaN or inf: numbers are NaN, counts 0."""
        self.status[invalid] = Status.INVALID_TARGET
        for numbers in (self.q, self.position_error, self.orientation_error, self.cost, self.projected_gradient):
            numbers[invalid] = np.nan
        for counts in (self.success, self.optimal, self.start_projected, self.iterations, self.restarts):
            counts[invalid] = 0

    def put_some(self, some: np.ndarray, answers: BatchSolution) -> None:
        """Make these the answers with numbers (k,)."""
        for name in VALUES:
            if name not in ("backend", "target_deviation"):
                getattr(self, name)[some] = getattr(answers, name)

    def put_arrays(self, arrays: Mapping[str, np.ndarray]) -> None:
        """Write these fields of all answers."""
        for name, values in arrays.items():
            getattr(self, name)[:] = values

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
                ("verdicts hold", self.scope),
                ("position error [m]", self._spread_of("position")),
                ("orientation error [rad]", self._spread_of("orientation")),
                ("iterations", _spread(self.iterations)),
                ("solved by", self.backend),
                ("joints", ", ".join(self.joint_names)),
                ("hint", self._hint),
            ),
            headings=("", "status", "position error [m]", "orientation error [rad]", *self.joint_names),
            rows=[(str(i), *_row(one)) for i, one in enumerate(self[:SHOWN])],
            further_rows=max(len(self) - SHOWN, 0),
        )

    def _spread_of(self, part: str) -> str:
        """That of the errors of position or orientation."""
        return "free" if part in self.left_free else _spread(getattr(self, ERRORS[part]))

    @property
    def _hint(self) -> str:
        """Whether a target that is not reached looks like millimetres."""
        if self._origin is None or self.success.all():
            return ""
        return millimetres_hint_of_many(self._targets[~self.success, :, 9:].reshape(-1, 3), self._problem.robot)

    @overload
    def __getitem__(self, i: int | np.integer) -> Solution: ...

    @overload
    def __getitem__(self, i: slice | Sequence[int] | np.ndarray) -> BatchSolution: ...

    def __getitem__(self, i: int | np.integer | slice | Sequence[int] | np.ndarray) -> Solution | BatchSolution:
        """The i-th answer, or some of them (copies): by a slice, numbers, or a mask (N,). Raises `IndexError`."""
        if not isinstance(i, slice):
            i = _checked_index(i, len(self))
        if not isinstance(i, int):
            arrays = {name: getattr(self, name)[i].copy() for name in VALUES if name != "backend"}
            starts, targets = None if self._starts is None else self._starts[i], self._targets[i]
            origins = None if self._origins is None else [self._origins[k] for k in np.arange(len(self))[i]]
            return BatchSolution(
                **arrays,
                backend=self.backend,
                _starts=starts,
                _targets=targets,
                _origin=self._origin,
                _origins=origins,
            )
        values = {name: getattr(self, name)[i] for name in VALUES if name not in ("q", "status", "backend")}
        start = None if self._starts is None else self._starts[i]
        origin = self._origin if self._origins is None else self._origins[i]
        return Solution(
            q=self.q[i].copy(),
            status=Status(int(self.status[i])),
            **{name: value.item() for name, value in values.items()},
            backend=self.backend,
            _start=start,
            _target=self._targets[i],
            _origin=None if origin is None else origin.near(start),
        )

    def __iter__(self) -> Iterator[Solution]:
        return (self[i] for i in range(len(self)))


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


def _row(one: Solution) -> tuple[str, ...]:
    """An answer in a table of a batch."""
    errors = ("free" if part in one.left_free else f"{getattr(one, name):.3g}" for part, name in ERRORS.items())
    return one.status.name, *errors, *(fixed(value, 4) for value in one.q)


def _spread(values: np.ndarray) -> str:
    """The median and the largest of numbers (N,), those aside that are not known."""
    known = values[np.isfinite(values)]
    return f"median {np.median(known):.3g}, largest {known.max():.3g}" if len(known) else ""
