"""Limits of sums of joint values in a URDF: elements `<sum_limit>` of its root, which other readers pass over.

    <sum_limit name="split" lower="0" upper="0.04">
      <term joint="left" coefficient="0.5"/><term joint="right" coefficient="0.5"/>
    </sum_limit>

A joint of type fixed counts as standing at its attribute `at`, 0 without one: where a joint stands that moved before.
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from xml.etree.ElementTree import Element, SubElement

from maira_qp.errors import RobotError, listed
from maira_qp.robots.model.joint_limits import SumLimit

TAG = "sum_limit"

Place = tuple[str | None, float, float]
"""A joint that moves, multiplier and offset: where another one stands. None: at the offset."""


@dataclass(frozen=True)
class Sum:
    """A limit of a sum, some joints of which move."""

    limit: SumLimit
    """Of all joints, those that do not move too"""
    still: Mapping[str, float]
    """Where the joints stand that do not move [rad, or m]"""

    @property
    def moving(self) -> SumLimit:
        """The limit of the joints that move."""
        return self.limit.placed(self.still)


def sum_element(limit: SumLimit, still: Mapping[str, float] | None = None) -> Element:
    """A limit of a sum as `<sum_limit>`, with places of the joints that are fixed."""
    ends = {"lower": limit.lower, "upper": limit.upper}
    numbers = {key: repr(float(end)) for key, end in ends.items() if math.isfinite(end)}
    element = Element(TAG, {"name": limit.name, **numbers})
    for joint, factor in limit.coefficients.items():
        at = {"at": repr(float(still[joint]))} if still and joint in still else {}
        SubElement(element, "term", {"joint": joint, "coefficient": repr(float(factor)), **at})
    return element


def sums_of(root: Element, place: Callable[[str, float], Place], known: Iterable[str]) -> tuple[Sum, ...]:
    """The limits of sums in which some joint moves.

    Args:
        root: of the URDF
        place: where a joint stands, of one that is fixed at a value that value
        known: names of the joints

    Raises `RobotError` where such a limit makes no sense.
    """
    known = list(known)

    def moves(joint: str) -> bool:
        with contextlib.suppress(RobotError):  # of a joint that does not matter
            return joint in known and place(joint, 0.0)[0] is not None
        return False

    concerned = (each for each in root.findall(TAG) if any(moves(term.get("joint", "")) for term in each))
    read = (_sum_of(element, place, known) for element in concerned)
    return tuple(each for each in read if not each.limit.coefficients.keys() <= each.still.keys())


def _sum_of(element: Element, place: Callable[[str, float], Place], known: list[str]) -> Sum:
    """A limit of a sum. Raises `RobotError`."""
    what = f"the {TAG} {element.get('name', '')!r}"
    factors, still, constant = dict[str, float](), dict[str, float](), 0.0
    for term in element.findall("term"):
        joint, factor = term.get("joint", ""), _number(term, "coefficient", what, "1")
        if joint not in known:
            raise RobotError(f"{what} is about {joint!r}, which is not a joint; {listed(known, joint)}")
        leader, multiplier, offset = place(joint, _number(term, "at", what, "0"))
        name, share = (joint, factor) if leader is None else (leader, factor * multiplier)
        factors[name] = factors.get(name, 0.0) + share
        if leader is None:
            still[joint] = offset
        else:
            constant += factor * offset
    lower, upper = _number(element, "lower", what, "-inf"), _number(element, "upper", what, "inf")
    if lower > upper:
        raise RobotError(f"{what} has inverted limits: lower {lower} > upper {upper}")
    factors = {joint: factor for joint, factor in factors.items() if factor}
    limit = SumLimit(element.get("name") or "sum", factors, lower - constant, upper - constant)
    return Sum(limit, {joint: value for joint, value in still.items() if joint in factors})


def place_fixed(root: Element, values: Mapping[str, float]) -> None:
    """Write where joints of a normalised URDF stand that have been fixed [rad, or m]."""
    for term in root.iterfind(f"{TAG}/term"):
        if term.attrib["joint"] in values:
            term.set("at", repr(float(values[term.attrib["joint"]])))


def _number(element: Element, key: str, what: str, default: str) -> float:
    """An attribute; only one with an infinite default may be infinite. Raises `RobotError`."""
    text = element.get(key, default)
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if math.isnan(value) or (math.isinf(value) and text != default):
        raise RobotError(f"{what}: {key}={text[:80]!r} is not a number")
    return value
