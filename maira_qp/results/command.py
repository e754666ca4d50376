"""What a tracker answers to a tick: the joint values and speeds for the robot, and what is to be known of them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from maira_qp.display import Card, joint_entries
from maira_qp.results.answer import OfProblem, Origin, errors_in_words
from maira_qp.results.status import TrackerState
from maira_qp.wording import fixed


@dataclass(frozen=True, eq=False, repr=False)
class Command(OfProblem):
    """What the robot is to do until the next tick. Its arrays are read-only."""

    q: np.ndarray
    """Configuration (n,) [rad or m] at the end of the tick"""
    velocity: np.ndarray
    """Joint velocity (n,) [rad/s or m/s] in the tick"""
    state: TrackerState
    """Whether the target is followed"""
    reason: str
    """LIMITED: which limits keep the tool from the target; HOLDING: why no target is followed; else empty"""
    position_error: float
    """|p_d - p| [m] from the target at the end of the tick; NaN while nothing is followed"""
    orientation_error: float
    """Angle [rad] from the target at the end of the tick; NaN while nothing is followed"""
    target: np.ndarray | Mapping[str, np.ndarray] | None
    """The target that was followed, behind the clutch: (4, 4), or {frame: (4, 4)} of several; None: nothing was"""
    _origin: Origin | None = field(default=None, repr=False)

    def __getstate__(self) -> dict[str, Any]:
        own = {name: getattr(self, name) for name in ("joint_names", "q_units", "left_free")}
        return {**self.__dict__, **own, "_origin": None}

    def _card(self) -> Card:
        units = self.q_units
        numbers = [f"{fixed(value, 4)} {unit}" for value, unit in zip(self.q, units, strict=True)]
        speeds = [f"{fixed(value, 4, '+')} {unit}/s" for value, unit in zip(self.velocity, units, strict=True)]
        both = [f"{number} {speed}" for number, speed in zip(numbers, speeds, strict=True)]
        is_followed = self.state != TrackerState.HOLDING
        words = errors_in_words(self.position_error, self.orientation_error, self.left_free)
        errors = f": error {words}" if is_followed else ""
        return Card(
            title=f"Command, {self.state}{errors}",
            facts=(("reason", self.reason),),
            entries=joint_entries(self.joint_names, both),
            headings=("joint", "q", "velocity"),
            rows=list(zip(self.joint_names, numbers, speeds, strict=True)),
        )


def command_of(**values: Any) -> Command:
    """A `Command` with these values and read-only arrays, without the frozen class's own constructor, which is slow."""
    for array in (values["q"], values["velocity"]):
        array.setflags(write=False)
    target = values["target"]
    if target is not None:
        for array in target.values() if isinstance(target, dict) else (target,):
            array.setflags(write=False)
    command = object.__new__(Command)
    object.__setattr__(command, "__dict__", values)
    return command
