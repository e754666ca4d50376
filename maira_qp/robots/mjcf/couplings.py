"""Joints that equality constraints couple: the linear ones, brought to `q = multiplier * q_leader + offset`.

An equality of two joints with a polynomial of degree one, or of fixed tendons, is a linear equation `A dq = b` in
`dq = q - q0` with MuJoCo's reference configuration q0. Gauss-Jordan elimination solves all of them at once for the
joints that come last in the tree: what is left on the right of each is a leader that comes before it, or nothing.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from maira_qp.errors import RobotError
from maira_qp.robots.mjcf.compiled import package

EPSILON = 1e-12
"""Entries of the equations, scaled to 1, below this are rounding."""


class Coupling(NamedTuple):
    """`q = multiplier * q_leader + offset`, without a leader `q = offset` [rad, or m]."""

    leader: int | None
    multiplier: float
    offset: float


class Couplings(NamedTuple):
    """What equality constraints say about joints."""

    followers: dict[int, Coupling]
    """By the index of the joint."""
    others: dict[str, set[int]]
    """Joints of the constraints that are not of that form, by what is to be said of these."""


def couplings_of(model: Any, names: list[str]) -> Couplings:
    """The couplings of a compiled model whose joints have those names. Raises `RobotError` where they contradict."""
    rows, sides, others = list[np.ndarray](), list[float](), dict[str, set[int]]()
    kinds = package().mjtEq
    for index in np.flatnonzero(model.eq_active0):
        kind = int(model.eq_type[index])
        name = model.equality(index).name or f"number {index}"
        if kind in (kinds.mjEQ_JOINT, kinds.mjEQ_TENDON):
            row, side, is_linear = _equation(model, int(index), kind == kinds.mjEQ_TENDON)
            if is_linear:
                rows.append(row)
                sides.append(side)
            else:
                others[f"equality {name!r} is no linear one of joints"] = set(np.flatnonzero(row).tolist())
        elif kind in (kinds.mjEQ_CONNECT, kinds.mjEQ_WELD):
            joints = _between(model, int(index))
            if joints:
                others[f"equality {name!r} closes a loop"] = joints
    followers = _solved(np.array(rows).reshape(len(rows), model.njnt), np.array(sides), model, names, others)
    return Couplings(followers, others)


def _equation(model: Any, index: int, of_tendons: bool) -> tuple[np.ndarray, float, bool]:
    """The row (njnt,) and right side of an equality in dq, and whether it is one: its polynomial has degree one."""
    first, second = model.eq_obj1id[index], model.eq_obj2id[index]
    constant, slope, *rest = model.eq_data[index, :5]
    sides = [_length(model, each) if of_tendons else _one(model, each) for each in (first, second) if each >= 0]
    is_linear = not np.any(rest if second >= 0 else [])
    row = sides[0][0] - (slope * sides[1][0] if second >= 0 else 0.0)
    return row, float(constant), bool(is_linear and all(known for _, known in sides))


def _one(model: Any, joint: int) -> tuple[np.ndarray, bool]:
    row = np.zeros(model.njnt)
    row[joint] = 1.0
    return row, True


def _length(model: Any, tendon: int) -> tuple[np.ndarray, bool]:
    """How the length of a tendon changes with its joints (njnt,), and whether it is a fixed one, of joints alone."""
    row = np.zeros(model.njnt)
    first = model.tendon_adr[tendon]
    wraps = range(first, first + model.tendon_num[tendon])
    if any(int(model.wrap_type[k]) != package().mjtWrap.mjWRAP_JOINT for k in wraps):
        return row, False
    for k in wraps:
        row[model.wrap_objid[k]] += model.wrap_prm[k]
    return row, True


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


def _solved(
    A: np.ndarray, b: np.ndarray, model: Any, names: list[str], others: dict[str, set[int]]
) -> dict[int, Coupling]:
    """Followers from the equations `A dq = b`; those with several leaders are added to `others`."""
    single = [is_single(model, joint) for joint in range(model.njnt)]
    reference = np.where(single, model.qpos0[model.jnt_qposadr], 0.0)
    followers = dict[int, Coupling]()
    for row, side, pivot in _eliminated(A, b, names):
        leaders = np.flatnonzero(row)
        leaders = leaders[leaders != pivot]
        if len(leaders) > 1:
            told = ", ".join(names[k] for k in np.flatnonzero(row))
            others[f"the equalities of the joints {told} leave none of them a single leader"] = set(
                np.flatnonzero(row).tolist()
            )
        elif len(leaders) == 1:
            multiplier = -float(row[leaders[0]])
            offset = reference[pivot] + side - multiplier * reference[leaders[0]]
            followers[pivot] = Coupling(int(leaders[0]), multiplier, float(offset) + 0.0)
        else:
            followers[pivot] = Coupling(None, 0.0, float(reference[pivot] + side))
    return followers


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
