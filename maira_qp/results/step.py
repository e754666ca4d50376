"""The result of a control step."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from maira_qp.display import Card, joint_entries
from maira_qp.results.answer import OfProblem, Origin, errors_in_words
from maira_qp.results.solution import ends_of
from maira_qp.results.status import StepStatus
from maira_qp.wording import fixed


@dataclass(frozen=True, eq=False, repr=False)
class Step(OfProblem):
    """The result of one control step."""

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
    """Which engine made it: "compiled", or the name of the QP backend in the reference engine"""
    _origin: Origin | None = field(default=None, repr=False)

    @cached_property
    def active_limits(self) -> list[str]:
        """Limits that `q` stands on, such as "joint4 upper", and pairs at their margin, such as "link5 - table" """
        return self._problem.active_limits(self.q)

    def __getstate__(self) -> dict[str, Any]:
        own = {name: getattr(self, name) for name in ("joint_names", "q_units", "left_free", "active_limits")}
        return {**self.__dict__, **own, "_origin": None}

    def _card(self) -> Card:
        units = self.q_units
        numbers = [f"{fixed(value, 4)} {unit}" for value, unit in zip(self.q, units, strict=True)]
        speeds = [f"{fixed(value, 4, '+')} {unit}/s" for value, unit in zip(self.velocity, units, strict=True)]
        errors = errors_in_words(self.position_error, self.orientation_error, self.left_free)
        both = [f"{number} {speed}" for number, speed in zip(numbers, speeds, strict=True)]
        return Card(
            title=f"Step, {self.status}: error {errors}, by {self.backend}",
            facts=(("active limits", ", ".join(self.active_limits)),),
            entries=joint_entries(self.joint_names, both),
            headings=("joint", "q", "velocity", "limit"),
            rows=[
                (name, number, speed, ", ".join(ends_of(name, self.active_limits)))
                for name, number, speed in zip(self.joint_names, numbers, speeds, strict=True)
            ],
        )


def step_of(**values: Any) -> Step:
    """A `Step` with these values; a frozen class's own constructor would take as long as a tenth of a tick."""
    step = object.__new__(Step)
    object.__setattr__(step, "__dict__", values)
    return step
