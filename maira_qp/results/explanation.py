"""Why a solve ended as it did, as data, and in words."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from maira_qp.arrays import plain
from maira_qp.display import Card, Shown
from maira_qp.results.status import Status
from maira_qp.wording import Quantity, Wording, figures, joined

if TYPE_CHECKING:
    from maira_qp.results.certificate import Proof

MOSTLY = 0.9
"""Share of a direction along an axis, from which on the axis stands for it."""

NEGLIGIBLE = 1e-9
"""Errors below this [m or rad] are not worth a word."""


@dataclass(frozen=True)
class ActiveLimit:
    """A limit that a joint stands on, and what it costs."""

    name: str
    """Such as "joint4 upper" """
    multiplier: float
    """What the minimised cost would fall by [per rad or m]; 0 where the limit holds nothing up"""
    position: float
    """What releasing it alone takes off the position error [m]"""
    orientation: float
    """And off the orientation error [rad]"""
    further: float | None
    """How far beyond the limit [rad or m] the joint reaches the target, if that limit alone gives way; else None"""
    unit: str
    """Of `further`: "rad" or "m" """


@dataclass(frozen=True)
class ActivePair:
    """Two bodies that a `CollisionLimit` holds apart, and what it costs."""

    name: str
    """Such as "link5 - ball" """
    distance: float
    """[m]"""
    multiplier: float
    """What the minimised cost would fall by [per m] if they could be nearer; 0 where they are in nobody's way"""


@dataclass(frozen=True)
class ActiveRow:
    """A limit beside those of the joints and `CollisionLimit`, or a row of it, that the answer stands on."""

    name: str
    """Such as "ConeLimit", "BoxLimit x upper", "LinearLimit row 1" """
    multiplier: float
    """What the minimised cost would fall by [per `unit`] if the limit were wider; 0 where it holds nothing up"""
    unit: str
    """Of the limit: "rad" or "m"; "" where it is the limit's own"""


@dataclass(frozen=True)
class BrokenLimit:
    """A limit beside those of the joints that no configuration was found to keep."""

    name: str
    """Such as "link5 - table" """
    amount: float
    """By how much the answer breaks it"""
    unit: str
    """Of `amount`: "m" for a pair of bodies, whose margin is meant; "" where it is the limit's own"""


@dataclass(frozen=True, eq=False, repr=False)
class Explanation(Shown):
    """Why a solve ended as it did; `str()` says it in words."""

    status: Status
    position_error: float
    """What is left [m]"""
    orientation_error: float
    """[rad]"""
    limits: tuple[ActiveLimit, ...]
    """The joint limits that the answer stands on, the most costly first"""
    pairs: tuple[ActivePair, ...]
    """The pairs of bodies as near as their margin allows, the most costly first"""
    blocked: np.ndarray
    """What the limits that cost something keep of the way to the target together (6,): position [m] and rotation [rad]
    in the axes of the tool; zero where the task is none of a pose"""
    is_reached_without: bool
    """Without these limits the target would be reached"""
    is_unreachable_without: bool
    """It is proved that without these limits the target would not be reached either"""
    starts_without: int
    """From so many starts the target was looked for without these limits"""
    is_reached_within: bool
    """On the way the target was found to be within the limits: the solve had missed it"""
    proof: Proof | None
    """What proves `UNREACHABLE`"""
    is_compromise: bool
    """`Weighted` holds the tool off a pose that can be reached"""
    scope: str = ""
    """What all of this holds for, see `Solution.scope`"""
    hints: tuple[str, ...] = ()
    """What looks like another unit than metres and radians, a sentence each"""
    broken: tuple[BrokenLimit, ...] = ()
    """What the answer breaks, the worst first: for `LIMITS_BROKEN`"""
    position_alone: float | None = None
    """What is left of the position error where the orientation is free [m]; None: that was not asked"""
    is_stretched: bool = False
    """Without regard to the orientation, the arm ends straight on its way to the target, which is farther away"""
    rows: tuple[ActiveRow, ...] = ()
    """The other limits that the answer stands on, the most costly first. What is said of a target without these limits
    is without the whole of a limit of which a row costs something."""

    def as_dict(self) -> dict[str, Any]:
        """As plain values that `json.dumps` takes, the words with them; None for numbers that are not known."""
        values = {
            "text": str(self),
            "status": self.status,
            "position_error": self.position_error,
            "orientation_error": self.orientation_error,
            "limits": [asdict(limit) for limit in self.limits],
            "pairs": [asdict(pair) for pair in self.pairs],
            "rows": [asdict(row) for row in self.rows],
            "broken": [asdict(limit) for limit in self.broken],
            "blocked": self.blocked,
            "is_reached_without": self.is_reached_without,
            "is_unreachable_without": self.is_unreachable_without,
            "starts_without": self.starts_without,
            "is_reached_within": self.is_reached_within,
            "is_compromise": self.is_compromise,
            "position_alone": self.position_alone,
            "is_stretched": self.is_stretched,
            "scope": self.scope,
            "hints": self.hints,
            "proof": None if self.proof is None else self.proof.words,
        }
        return plain(values)

    @property
    def blocking(self) -> tuple[str, ...]:
        """Names of the limits, pairs and rows that cost something."""
        return tuple(one.name for one in (*self.limits, *self.pairs, *self.rows) if one.multiplier > 0)

    @property
    def words(self) -> Wording:
        """For people, as `str()`."""
        return joined(" ", _sentences(self))

    def __str__(self) -> str:
        return str(self.words)

    def _card(self) -> Card:
        return Card(
            title=f"Explanation: {self.status.name}",
            words=str(self),
            headings=("limit", "multiplier", "its release gains [m]", "[rad]", "reached with it so much further"),
            rows=[
                (
                    limit.name,
                    figures(limit.multiplier),
                    figures(limit.position),
                    figures(limit.orientation),
                    "" if limit.further is None else f"{limit.further:.3g} {limit.unit}",
                )
                for limit in self.limits
            ]
            + [(one.name, figures(one.multiplier), "", "", "") for one in (*self.pairs, *self.rows)],
        )


def _sentences(why: Explanation) -> Iterator[str]:
    """The explanation in words, and what may be behind it."""
    yield from _reasons(why)
    yield from why.hints


def _reasons(why: Explanation) -> Iterator[str]:
    if why.scope:
        yield f"All of this is {why.scope}, whose box counts as limits."
    if why.status is Status.REJECTED:
        yield "The target is reached, but accept rejected every configuration that was found to reach it."
        return
    if why.status is Status.LIMITS_BROKEN:
        broken = joined(" and ", [Wording(one.name, " by ", _amount(one.amount, one.unit)) for one in why.broken])
        found = "No configuration was found that keeps the limits beside those of the joints: this one breaks "
        yield Wording(found, broken, ".")
        yield Wording("It is ", _off(why), " away from the target.")
        return
    if why.status is Status.CONVERGED:
        yield "The target is reached."
    elif why.is_compromise:
        yield Wording("The target can be reached, but the weight of the posture holds the tool ", _off(why), " off it.")
    elif why.status is Status.UNREACHABLE:
        proof = "" if why.proof is None else Wording(": ", why.proof.words)
        yield Wording("The target is proved to be out of reach", proof, "; the answer is ", _off(why), " away.")
    elif why.status is Status.NEAREST:
        yield Wording("The answer is ", _off(why), " away from the target, and nothing near it is closer.")
    else:
        spent = " away from the target; the budget was spent before a nearest point was found."
        yield Wording("The answer is ", _off(why), spent)
    if why.status is Status.CONVERGED or why.is_compromise:
        standing = (*why.limits, *why.rows)
        free = [limit.name for limit in standing if not limit.multiplier > 0]
        if free:
            yield f"It stands on {' and '.join(free)}."
        for limit in standing:
            if limit.multiplier > 0:
                unit = limit.unit or "unit of its own"
                yield f"It stands on {limit.name}, which costs {figures(limit.multiplier)} per {unit}."
        for pair in why.pairs:
            cost = f", which costs {figures(pair.multiplier)} per m" if pair.multiplier > 0 else ""
            yield Wording(_apart(pair), cost, ".")
        return
    if why.position_alone is not None:
        short = Wording(_amount(why.position_alone, "m"), " short of it.")
        if why.is_stretched:
            yield Wording("The arm is stretched out toward the target: in any orientation the tool ends ", short)
        elif why.position_alone > 0:
            yield Wording("In any orientation the tool ends ", short)
        else:
            yield "In another orientation the tool reaches the position."
    if why.is_reached_within:
        yield "From another start the target is reached within the limits."
    if not why.blocking:
        yield f"No {'' if why.pairs or why.rows else 'joint '}limit holds it back."
        return
    names = " and ".join(why.blocking)
    if np.linalg.norm(why.blocked) > 0:
        yield Wording(f"{names} {'block' if len(why.blocking) > 1 else 'blocks'} ", _way(why.blocked), ".")
    else:
        yield f"{names} {'stand' if len(why.blocking) > 1 else 'stands'} in the way."
    for pair in why.pairs:
        if pair.multiplier > 0:
            yield Wording(_apart(pair), ".")
    alone = [limit for limit in why.limits if limit.further is not None]
    if alone:
        least = min(alone, key=lambda limit: limit.further or 0.0)
        joint, end = least.name.rsplit(" ", 1)
        further = _amount(least.further or 0.0, least.unit)
        yield Wording(f"With {joint} ", further, f" beyond its {end} limit the target would be reached.")
    elif why.is_reached_without:
        yield "Without these limits the target would be reached."
    elif why.is_unreachable_without:
        yield "It is proved that without these limits it would not be reached either."
    else:
        starts = "one start" if why.starts_without == 1 else f"any of {why.starts_without} starts"
        yield f"Without these limits it was not reached either, from {starts}."


def _apart(pair: ActivePair) -> Wording:
    """How far two bodies are apart."""
    if pair.distance < 0:
        return Wording(pair.name, " overlap by ", _amount(-pair.distance, "m"))
    return Wording(pair.name, " are ", _amount(pair.distance, "m"), " apart")


def _off(why: Explanation) -> str:
    """The errors that are left, as far as they are errors."""
    parts = [
        _amount(value, unit)
        for value, unit in ((why.position_error, "m"), (why.orientation_error, "rad"))
        if value > NEGLIGIBLE
    ]
    return joined(" and ", parts) or "nearly nothing"


def _way(displacement: np.ndarray) -> str:
    """A displacement (6,) in the axes of the tool."""
    parts = []
    for vector, unit, word in ((displacement[:3], "m", "along"), (displacement[3:], "rad", "about")):
        size = float(np.linalg.norm(vector))
        if size > NEGLIGIBLE:
            axis = int(np.abs(vector).argmax())
            share = vector / size
            name = f"tool {'-' if share[axis] < 0 else ''}{'xyz'[axis]}"
            if abs(share[axis]) < MOSTLY:
                name = f"({', '.join(f'{x + 0.0:.2f}' for x in share.round(2))}) of the tool"
            parts.append(Wording(_amount(size, unit), f" {word} {name}"))
    return joined(" and ", parts) or "nearly nothing"


def _amount(value: float, unit: str) -> Quantity | str:
    """A length or an angle in the unit that people use, or a number of no known unit."""
    if not unit:
        return f"{value:.3g}"
    if unit == "rad":
        return Quantity(value, unit, f"{math.degrees(value):.3g} degrees")
    long = f"{value:,.0f} m" if value >= 1000 else f"{value:.3g} m"
    return Quantity(value, unit, long if value >= 1 else f"{1e3 * value:.3g} mm")
