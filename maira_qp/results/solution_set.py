"""What a list of all solutions for a pose holds, and what it claims."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import overload

import numpy as np

from maira_qp.analytic.srs.arcs import Arc
from maira_qp.analytic.srs.geometry import Branch
from maira_qp.display import Card, Shown, joint_entries
from maira_qp.results.answer import errors_in_words
from maira_qp.wording import fixed

SHOWN, SHOWN_JOINTS = 12, 7
"""Solutions that a printed list shows, and joints of each."""


@dataclass(frozen=True, eq=False, repr=False)
class ListedSolution(Shown):
    """One of all solutions for a pose."""

    q: np.ndarray
    """Configuration (n,) [rad or m], within the limits exactly"""
    cost: float
    """Value of the objective that the list is ranked by"""
    position_error: float
    """|p_d - p| [m]"""
    orientation_error: float
    """Angle between the orientations [rad]"""
    arc: Arc | None = None
    """The arc of the swivel angle of which this is the best; None: no S-R-S arm"""
    psi: float | None = None
    """The swivel angle [rad]; None: no S-R-S arm"""
    joint_names: tuple[str, ...] = ()
    """Names of the n joints, in the order of `q`"""
    left_free: tuple[str, ...] = ()
    """What the tasks leave free, "position" or "orientation": its error says nothing, and is 0"""

    def _card(self) -> Card:
        numbers = [fixed(value, 4) for value in self.q]
        arc = "" if self.arc is None else f"psi {self.arc.in_words()}"
        if self.arc is not None and self.psi is not None and not self.arc.is_isolated:
            arc += f", here {fixed(self.psi, 4)}"
        return Card(
            title=f"ListedSolution: cost {self.cost:.6g}",
            facts=(
                ("error", errors_in_words(self.position_error, self.orientation_error, self.left_free)),
                ("arc", arc),
            ),
            entries=joint_entries(self.joint_names, numbers),
            headings=("joint", "q"),
            rows=list(zip(self.joint_names, numbers, strict=True)),
        )

    @property
    def branch(self) -> Branch | None:
        """The branches of elbow, shoulder and wrist; None: no S-R-S arm."""
        return None if self.arc is None else self.arc.branch


@dataclass(frozen=True, eq=False, repr=False)
class Solutions(Shown, Sequence[ListedSolution]):
    """All solutions for a pose that are known, the best first. What they are depends on the arm, see `method`."""

    items: tuple[ListedSolution, ...]
    method: str
    """"closed form (S-R-S)": the best of every arc. "closed form (EAIK)", or "numerical" where at most six joints move:
    isolated solutions. "numerical" where more do: distinct local optima of the objective along the self-motion"""
    is_complete: bool
    """Nothing is missing: by the geometry of an S-R-S arm; of a decomposed one all branches are regular and in balance,
    see `solvers.enumeration.all_solutions`, and descents found no other. Never said of a numerical list"""
    starts: int = 0
    """Random descents that a numerical list is from, or that a list of branches was checked with"""
    starts_without_new: int = 0
    """Descents since the last one that led to a solution that was not in it yet"""
    reason: str = ""
    """Why it is not said to be complete; empty where it is"""

    def __len__(self) -> int:
        return len(self.items)

    @overload
    def __getitem__(self, i: int) -> ListedSolution: ...

    @overload
    def __getitem__(self, i: slice) -> tuple[ListedSolution, ...]: ...

    def __getitem__(self, i: int | slice) -> ListedSolution | tuple[ListedSolution, ...]:
        return self.items[i]

    def __iter__(self) -> Iterator[ListedSolution]:
        return iter(self.items)

    def _card(self) -> Card:
        told = (
            f", {self.starts} starts, {self.starts_without_new} since the last new one"
            if self.method == "numerical"
            else ""
        )
        complete = "complete" if self.is_complete else "not proved complete"
        names = self.items[0].joint_names if self.items else ()
        more = len(self) - SHOWN
        arcs = bool(self.items) and self.items[0].arc is not None
        return Card(
            title=f"Solutions({len(self)}, {self.method}, {complete}{told})",
            facts=(("joints", ", ".join(names)),),
            lines=[
                *map(_line, range(SHOWN), self.items),
                *([f"  ... and {more} more"] if more > 0 else []),
                *([f"  {self.reason}"] if self.reason else []),
            ],
            headings=("", "cost", *names, *(["psi"] if arcs else [])),
            rows=[
                (
                    str(i),
                    f"{one.cost:.5g}",
                    *(fixed(x, 4) for x in one.q),
                    *([one.arc.in_words(3)] if one.arc is not None else []),
                )
                for i, one in enumerate(self)
            ],
        )


def _line(i: int, one: ListedSolution) -> str:
    """The i-th of a list, for a terminal."""
    joints = "".join(f"{fixed(x, 3):>8}" for x in one.q[:SHOWN_JOINTS])
    return f"{i:5d}  cost {one.cost:<9.4g}{joints}{' ...' if len(one.q) > SHOWN_JOINTS else ''}"
