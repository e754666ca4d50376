"""What a list of all solutions for a pose holds, and what it claims."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import overload

import numpy as np

from maira_qp.robots.arcs import Arc
from maira_qp.robots.srs import Branch

SHOWN = 20
"""Solutions that a printed list shows."""


@dataclass(frozen=True, eq=False)
class ListedSolution:
    """One of all solutions for a pose."""

    q: np.ndarray
    """Configuration (n,) [rad or m], within the limits to the bit"""
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

    @property
    def branch(self) -> Branch | None:
        """The branches of elbow, shoulder and wrist; None: no S-R-S arm."""
        return None if self.arc is None else self.arc.branch


@dataclass(frozen=True, eq=False, repr=False)
class Solutions(Sequence[ListedSolution]):
    """All solutions for a pose that are known, the best first. What they are depends on the arm, see `method`."""

    items: tuple[ListedSolution, ...]
    method: str
    """"closed form (S-R-S)": the best of every arc. "closed form (EAIK)", or "numerical" where at most six joints move:
    isolated solutions. "numerical" where more do: distinct local optima of the objective along the self-motion"""
    is_complete: bool
    """Nothing is missing, by the geometry of the arm. Never said of a numerical list"""
    starts: int = 0
    """Descents that a numerical list is from"""
    starts_without_new: int = 0
    """Descents since the last one that led to a solution that was not in it yet"""

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

    def __repr__(self) -> str:
        told = f", {self.starts} starts, {self.starts_without_new} since the last new one" if self.starts else ""
        complete = "complete" if self.is_complete else "not proved complete"
        lines = [f"Solutions({len(self)}, {self.method}, {complete}{told})"]
        for i, one in enumerate(self.items[:SHOWN]):
            arc = "" if one.arc is None else f"  psi {one.arc.lower:6.3f} to {one.arc.upper:6.3f}"
            lines.append(f"{i:4d}  cost {one.cost:10.4g}  q " + " ".join(f"{x:7.3f}" for x in one.q) + arc)
        return "\n".join([*lines, *(["  ..."] if len(self) > SHOWN else [])])
