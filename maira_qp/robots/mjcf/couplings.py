"""Joints that equality constraints and tendons couple: followers of other joints, and limits of sums.

An equality of two joints with a polynomial of degree one, or of fixed tendons, is a linear equation `A dq = b` in
`dq = q - q0` with MuJoCo's reference configuration q0. Gauss-Jordan elimination solves all of them at once for the
joints that come last in the tree: what is left on the right of each are leaders that come before it, or nothing. A
polynomial of higher degree is a linear equation only where the equations leave its argument one value. The range of a
fixed tendon is a limit of a sum of joints, and so is that of a follower: of one leader it is one of that leader.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from maira_qp.errors import RobotError
from maira_qp.robots.mjcf.compiled import package

EPSILON = 1e-12
"""Entries of the equations, scaled to 1, below this are rounding."""
NARROWER = 1e-9
"""A range that becomes narrower by less [rad, or m] was rounded."""

Range = tuple[float, float]
"""Lower and upper end [rad, or m], infinite where there is none."""


class Coupling(NamedTuple):
    """`q = sum of multiplier * q_leader + offset` [rad, or m]."""

    leaders: dict[int, float]
    """Multipliers by the index of the joint; without leaders the joint stands still"""
    offset: float


class Couplings(NamedTuple):
    """What equality constraints and tendons say about joints."""

    followers: dict[int, Coupling]
    """By the index of the joint."""
    ranges: dict[int, Range]
    """Of all hinges and slides, as couplings leave them."""
    sums: dict[str, tuple[dict[int, float], Range]]
    """Coefficients and range of the sums of several joints that are limited, by the name of the tendon or follower."""
    curved: dict[str, set[int]]
    """What is to be said of polynomials that are no linear equations, and the joints that they determine."""
    notes: dict[str, set[int]]
    """What is to be said of other constraints, which are not kept, and of ranges, and the joints concerned."""


def couplings_of(model: Any, names: list[str], given: Mapping[int, Range]) -> Couplings:
    """The couplings of a compiled model whose joints have those names; `given` are ranges in place of the model's.

    Raises `RobotError` where equalities contradict each other.
    """
    kinds, notes = package().mjtEq, dict[str, set[int]]()
    equations = list[_Equation]()
    for index in map(int, np.flatnonzero(model.eq_active0)):
        kind = int(model.eq_type[index])
        name = f"equality {model.equality(index).name or f'number {index}'!r}"
        if kind in (kinds.mjEQ_JOINT, kinds.mjEQ_TENDON):
            equation = _equation(model, index, kind == kinds.mjEQ_TENDON, name)
            if equation is None:
                notes[f"{name} is of a tendon that is no sum of joints, and is not kept"] = _of_tendons(model, index)
            else:
                equations.append(equation)
        elif kind in (kinds.mjEQ_CONNECT, kinds.mjEQ_WELD):
            notes[f"{name} closes a loop, which stays open: the joints in it move on their own"] = _between(
                model, index
            )
    followers, left = _solved(equations, model, names)
    curved = dict[str, set[int]]()
    for each in left:
        words = f"{each.name} is a polynomial of degree {each.degree}, which is not supported"
        curved[words] = each.determined(followers)
        notes[f"{words}, and not kept"] = set(np.flatnonzero(each.argument).tolist()) - curved[words]
    own = {joint: _range(model, joint) for joint in range(model.njnt) if is_single(model, joint)} | dict(given)
    ranges, sums = dict(own), dict[str, tuple[dict[int, float], Range]]()
    for name, row, ends in _limited(model, followers, own, names, notes):
        free, still = _of_leaders(row, followers)
        ends = ends[0] - still, ends[1] - still
        if len(free) > 1:
            sums[name] = free, ends
        elif free and not _narrow(ranges, free, ends):
            notes[f"{name!r} leaves the joint that it depends on no room, and its range is not kept"] = set(free)
    for joint, (low, high) in ranges.items():
        if low > own[joint][0] + NARROWER or high < own[joint][1] - NARROWER:
            notes[f"joint {names[joint]!r} has the range [{low:g}, {high:g}] that followers and tendons leave it"] = {
                joint
            }
    return Couplings(followers, ranges, sums, curved, notes)


class _Equation(NamedTuple):
    """`row @ dq = curve(argument @ dq)`, the polynomial's coefficients from degree 0 on."""

    name: str
    row: np.ndarray
    curve: np.ndarray
    argument: np.ndarray

    @property
    def is_linear(self) -> bool:
        """Its polynomial has degree one, or nothing to be one of."""
        return not (self.curve[2:].any() and self.argument.any())

    @property
    def degree(self) -> int:
        """Of the polynomial."""
        return int(np.flatnonzero(self.curve).max(initial=0))

    def determined(self, followers: Mapping[int, Coupling]) -> set[int]:
        """The joints on the left side, and those that lead them."""
        joints = set(np.flatnonzero(self.row).tolist())
        return joints.union(*(followers[joint].leaders for joint in joints if joint in followers))

    def linear(self) -> tuple[np.ndarray, float]:
        """The row (njnt,) and the right side."""
        return self.row - self.curve[1] * self.argument, float(self.curve[0])

    def at(self, value: float) -> tuple[np.ndarray, float]:
        """The same where the argument has a value."""
        return self.row, float(np.polynomial.polynomial.polyval(value, self.curve))


def _equation(model: Any, index: int, of_tendons: bool, name: str) -> _Equation | None:
    """An equality of joints or of tendons; None: of a tendon that does not run over joints alone."""
    ends = [int(each) for each in (model.eq_obj1id[index], model.eq_obj2id[index]) if each >= 0]
    rows = [_length(model, each) if of_tendons else _one(model, each) for each in ends]
    if any(row is None for row in rows):
        return None
    argument = rows[1] if len(rows) > 1 else np.zeros(model.njnt)
    if not np.isfinite(model.eq_data[index, :5]).all():
        raise RobotError(f"{name} has coefficients that are not finite")
    return _Equation(name, rows[0], np.array(model.eq_data[index, :5]), argument)  # type: ignore[arg-type]


def _solved(equations: list[_Equation], model: Any, names: list[str]) -> tuple[dict[int, Coupling], list[_Equation]]:
    """Followers from the equations, and those that are left out: polynomials of what can move."""
    linear = [equation.linear() for equation in equations if equation.is_linear]
    curved = [equation for equation in equations if not equation.is_linear]
    single = [is_single(model, joint) for joint in range(model.njnt)]
    reference = np.where(single, model.qpos0[model.jnt_qposadr], 0.0)
    while True:
        A = np.array([row for row, _ in linear]).reshape(len(linear), model.njnt)
        followers = dict[int, Coupling]()
        for row, side, pivot in _eliminated(A, np.array([side for _, side in linear]), names):
            leaders = {int(k): -float(row[k]) for k in np.flatnonzero(row) if k != pivot}
            offset = reference[pivot] + side - sum(m * reference[k] for k, m in leaders.items())
            followers[pivot] = Coupling(leaders, float(offset) + 0.0)
        known = {joint: each.offset for joint, each in followers.items() if not each.leaders}
        settled = [each for each in curved if set(np.flatnonzero(each.argument).tolist()) <= set(known)]
        if not settled:
            return followers, curved
        for each in settled:
            value = sum(each.argument[k] * (known[k] - reference[k]) for k in map(int, np.flatnonzero(each.argument)))
            linear.append(each.at(float(value)))
        curved = [each for each in curved if each not in settled]


def _limited(
    model: Any,
    followers: Mapping[int, Coupling],
    ranges: Mapping[int, Range],
    names: list[str],
    notes: dict[str, set[int]],
) -> list[tuple[str, dict[int, float], Range]]:
    """Name, coefficients by joint and range of what is limited: tendons and followers. Others are noted."""
    found = [(names[joint], {joint: 1.0}, ranges[joint]) for joint in followers if math.isfinite(sum(ranges[joint]))]
    taken = {name for name, _, _ in found}
    for tendon in map(int, np.flatnonzero(model.tendon_limited)):
        name = model.tendon(tendon).name or f"tendon{tendon}"
        row = _length(model, tendon)
        if row is None:
            notes[f"tendon {name!r} is limited and no sum of joints, and its range is not kept"] = set(
                _moved_by(model, tendon)
            )
            continue
        while name in taken:
            name += "_"
        taken.add(name)
        low, high = map(float, model.tendon_range[tendon])
        found.append((name, {int(k): float(row[k]) for k in np.flatnonzero(row)}, (low, high)))
    return found


def _of_leaders(row: Mapping[int, float], followers: Mapping[int, Coupling]) -> tuple[dict[int, float], float]:
    """A sum of joints as one of those that follow none, and what is constant in it."""
    free, still = dict[int, float](), 0.0
    for joint, factor in row.items():
        coupling = followers.get(joint, Coupling({joint: 1.0}, 0.0))
        still += factor * coupling.offset
        for leader, multiplier in coupling.leaders.items():
            free[leader] = free.get(leader, 0.0) + factor * multiplier
    scale = max((abs(factor) for factor in row.values()), default=0.0)
    return {joint: factor for joint, factor in free.items() if abs(factor) > EPSILON * scale}, still


def _narrow(ranges: dict[int, Range], free: Mapping[int, float], ends: Range) -> bool:
    """Narrow the range of the only joint of a sum to what the sum's leaves it, if that is anything."""
    ((joint, factor),) = free.items()
    low, high = sorted(end / factor + 0.0 for end in ends)
    narrowed = max(low, ranges[joint][0]), min(high, ranges[joint][1])
    if narrowed[0] > narrowed[1]:
        return False
    ranges[joint] = narrowed
    return True


def _range(model: Any, joint: int) -> Range:
    """The range of a hinge or slide."""
    if not model.jnt_limited[joint]:
        return -math.inf, math.inf
    low, high = map(float, model.jnt_range[joint])
    return low, high


def _one(model: Any, joint: int) -> np.ndarray:
    row = np.zeros(model.njnt)
    row[joint] = 1.0
    return row


def _length(model: Any, tendon: int) -> np.ndarray | None:
    """How the length of a fixed tendon changes with its joints (njnt,); None for one that runs through space.

    Raises `RobotError` for numbers that are not finite.
    """
    row = np.zeros(model.njnt)
    for k in _wraps(model, tendon):
        if int(model.wrap_type[k]) != package().mjtWrap.mjWRAP_JOINT:
            return None
        row[model.wrap_objid[k]] += model.wrap_prm[k]
    if not np.isfinite(row).all():
        raise RobotError(f"tendon {model.tendon(tendon).name!r} has coefficients that are not finite")
    return row


def _wraps(model: Any, tendon: int) -> range:
    first = int(model.tendon_adr[tendon])
    return range(first, first + int(model.tendon_num[tendon]))


def _of_tendons(model: Any, index: int) -> set[int]:
    """The joints that move the tendons of an equality."""
    ends = (int(model.eq_obj1id[index]), int(model.eq_obj2id[index]))
    return {joint for end in ends if end >= 0 for joint in _moved_by(model, end)}


def _moved_by(model: Any, tendon: int) -> set[int]:
    """The joints that change the length of a tendon: those between the bodies that it touches."""
    wraps, above = package().mjtWrap, list[set[int]]()
    joints = set[int]()
    for k in _wraps(model, tendon):
        kind, each = int(model.wrap_type[k]), int(model.wrap_objid[k])
        if kind == wraps.mjWRAP_JOINT:
            joints.add(each)
        elif kind == wraps.mjWRAP_SITE:
            above.append(set(joints_above(model, int(model.site_bodyid[each]))))
        elif kind in (wraps.mjWRAP_SPHERE, wraps.mjWRAP_CYLINDER):
            above.append(set(joints_above(model, int(model.geom_bodyid[each]))))
    return joints | (set.union(*above) - set.intersection(*above) if above else set())


def _between(model: Any, index: int) -> set[int]:
    """The joints between two bodies that a constraint holds together, none if one of them is moved from outside."""
    ends = [int(model.eq_obj1id[index]), int(model.eq_obj2id[index])]
    if int(model.eq_objtype[index]) == package().mjtObj.mjOBJ_SITE:
        ends = [int(model.site_bodyid[end]) for end in ends]
    if any(model.body_mocapid[end] >= 0 for end in ends):
        return set()
    above = [set(joints_above(model, end)) for end in ends]
    return above[0] ^ above[1]


def is_single(model: Any, joint: int) -> bool:
    """Whether one number moves a joint: a hinge or a slide."""
    kinds = package().mjtJoint
    return int(model.jnt_type[joint]) in (kinds.mjJNT_HINGE, kinds.mjJNT_SLIDE)


def joints_above(model: Any, body: int) -> list[int]:
    """The joints that move a body, those of the body itself first."""
    found = list[int]()
    while body > 0:
        first = int(model.body_jntadr[body])
        found += range(first, first + int(model.body_jntnum[body])) if first >= 0 else ()
        body = int(model.body_parentid[body])
    return found


def _eliminated(A: np.ndarray, b: np.ndarray, names: list[str]) -> list[tuple[np.ndarray, float, int]]:
    """Reduced rows (njnt,) with 1 at their pivot, right sides and pivots, which are as late as they can be."""
    rows = np.column_stack([A, b])
    rows = rows / np.maximum(np.abs(A).max(axis=1, keepdims=True, initial=0.0), EPSILON)
    done = 0
    pivots = list[int]()
    for column in range(A.shape[1] - 1, -1, -1):
        if done == len(rows):
            break
        best = done + int(np.argmax(np.abs(rows[done:, column])))
        if abs(rows[best, column]) <= EPSILON:
            continue
        rows[[done, best]] = rows[[best, done]]
        rows[done] /= rows[done, column]
        others = np.arange(len(rows)) != done
        rows[others] -= np.outer(rows[others, column], rows[done])
        rows[np.abs(rows) <= EPSILON] = 0.0
        pivots.append(column)
        done += 1
    for row in rows[done:]:
        if abs(row[-1]) > 1e-9:
            touched = ", ".join(names[k] for k in np.flatnonzero(np.abs(A).max(axis=0, initial=0.0)))
            raise RobotError(f"the equality constraints contradict each other, of the joints {touched:.500}")
    return [(rows[k, :-1], float(rows[k, -1]), pivot) for k, pivot in enumerate(pivots)]
