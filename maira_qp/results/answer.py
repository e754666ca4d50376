"""What all results share: the joints that they speak of, and what is computed when it is first asked for."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import Any, Protocol

import numpy as np

from maira_qp.arrays import plain
from maira_qp.display import Shown
from maira_qp.errors import OptionError
from maira_qp.problem.problem import Problem
from maira_qp.robots.model.robot import Robot


class Origin(Protocol):
    """Where a result comes from: it knows the problem, and answers what is asked of the result later."""

    @property
    def problem(self) -> Problem:
        """What was solved."""
        ...

    @property
    def scope(self) -> str:
        """What verdicts hold for, see `Answer.scope`."""
        ...

    def near(self, start: np.ndarray | None) -> Origin:
        """Where the answer from a start (n,) comes from."""
        ...

    def explain(self, solution: Any) -> Any:
        """See `Solution.explain`."""
        ...

    def jacobian(self, solution: Any) -> np.ndarray:
        """See `Solution.jacobian`."""
        ...

    def proof(self, solution: Any) -> Any:
        """See `Solution.proof`."""
        ...

    def path_proof(self, path: Any) -> Any:
        """See `PathSolution.proof`."""
        ...

    def timed(self, path: Any, **limits: Any) -> Any:
        """See `PathSolution.timed`."""
        ...


class OfProblem(Shown):
    """What is known of the joints. A pickle holds it in place of the robot."""

    q: np.ndarray
    _origin: Origin | None

    @property
    def joints(self) -> dict[str, Any]:
        """`q` by the names of the joints: {joint name: value} [rad or m], each an array (N,) where there are N"""
        values = self.q.tolist() if self.q.ndim == 1 else self.q.T
        return dict(zip(self.joint_names, values, strict=True))

    @cached_property
    def left_free(self) -> tuple[str, ...]:
        """What the tasks of the first level leave free: "position", "orientation"; its error is 0 and says nothing"""
        return () if self._origin is None else self._problem.left_free

    @property
    def _problem(self) -> Problem:
        return self._origin.problem  # type: ignore[union-attr]

    @property
    def robot(self) -> Robot:
        """The robot that was solved for. Raises `OptionError` for what was pickled: a pickle does not hold it."""
        if self._origin is None:
            raise OptionError("a pickled result no longer knows its robot")
        box = self._problem.box
        return self._problem.robot if box is None else box.robot

    @cached_property
    def joint_names(self) -> tuple[str, ...]:
        """Names of the n joints, in the order of `q`"""
        return self._problem.robot.joint_names

    @cached_property
    def q_units(self) -> tuple[str, ...]:
        """Units of the n joints: "rad", or "m" where one slides"""
        return tuple("m" if slides else "rad" for slides in self._problem.robot.slides)


class Answer(OfProblem):
    """Values that are computed when they are first asked for. A pickle holds them in place of the robot."""

    condition_number: Any
    active_limits: Any
    broken_limits: Any
    max_joint_change: Any

    @cached_property
    def scope(self) -> str:
        """What the verdict holds for: empty, or "within max_joint_change of q0" where that was asked for"""
        return "" if self._origin is None else self._origin.scope

    def __getstate__(self) -> dict[str, Any]:
        own = {name: getattr(self, name) for name in OF_ROBOT}
        return {**self.__dict__, **own, "_origin": None}

    def as_dict(self) -> dict[str, Any]:
        """All values by their names, as `json.dumps` takes them: lists in place of arrays, the name of a status, and
        None for a number that is not finite, such as the cost without redundancy, and for the error of what is free."""
        return {name: plain(getattr(self, name)) for name in (*VALUES, *OF_ROBOT)} | unknown_errors(self.left_free)


def unknown_errors(left_free: Sequence[str]) -> dict[str, None]:
    """None for the errors of what is left free."""
    return {ERRORS[name]: None for name in left_free}


def errors_in_words(position: float, orientation: float, left_free: Sequence[str]) -> str:
    """Errors [m] and [rad], such as "2e-09 m, orientation free"."""
    parts = {"position": f"{position:.3g} m", "orientation": f"{orientation:.3g} rad"}
    return ", ".join(f"{name} free" if name in left_free else part for name, part in parts.items())


OF_ROBOT = (
    "joint_names",
    "q_units",
    "left_free",
    "condition_number",
    "active_limits",
    "broken_limits",
    "max_joint_change",
    "scope",
)

ERRORS = {"position": "position_error", "orientation": "orientation_error"}
"""The fields that say nothing where that is left free"""

VALUES = (
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
    "rejected",
    "backend",
)
