"""Which columns make a pose: found by their names, or told what is missing.

A pose is `x, y, z` [m] with `qw, qx, qy, qz` (scalar first) or with `roll, pitch, yaw`, or, where positions will do,
alone; or the rows of its 4x4 matrix,
`m00` to `m23` and, if they like, `m30` to `m33`. A start is `q0_<joint>` for every joint. All further columns are the
caller's own.
"""

from __future__ import annotations

import difflib
import itertools
from collections.abc import Sequence
from dataclasses import dataclass

from maira_qp.errors import PoseError, listed

POSITION = ("x", "y", "z")
MATRIX = tuple(f"m{row}{column}" for row in range(3) for column in range(4))
LAST_ROW = ("m30", "m31", "m32", "m33")
ORIENTATIONS: dict[str, tuple[str, ...]] = {
    "quaternion": ("qw", "qx", "qy", "qz"),
    "rpy": ("roll", "pitch", "yaw"),
    "matrix": (*MATRIX, *LAST_ROW),
}
START = "q0_"
VALID = "a pose is x, y, z with qw, qx, qy, qz or with roll, pitch, yaw; or m00, m01, ... m23, its matrix by rows"


@dataclass(frozen=True)
class Layout:
    """Where a pose is in the columns of a file."""

    form: str
    """quaternion, rpy, matrix or position"""
    pose: tuple[str, ...]
    """The columns of the pose, x, y, z first, or the matrix by rows."""
    start: tuple[str, ...]
    """The columns of the start, in the order of the joints; none: the file holds no starts."""

    @property
    def names(self) -> tuple[str, ...]:
        """All columns that hold numbers."""
        return (*self.pose, *self.start)


def layout(names: Sequence[str], joint_names: Sequence[str] | None, *, position_only: bool = False) -> Layout:
    """The layout that the names of the columns say; without names of joints there is no start.

    With `position_only` a position without an orientation will do, if no column is like that of an orientation.

    Raises `PoseError`, naming what is missing and what is valid.
    """
    twice = [name for i, name in enumerate(names) if name in names[:i]]
    if twice:
        raise PoseError(f"more than one column is named {twice[0]!r}")
    found = {form: [name for name in own if name in names] for form, own in ORIENTATIONS.items()}
    forms = [form for form, own in found.items() if own]
    if len(forms) > 1:
        raise PoseError(f"one orientation is enough: there are both {found[forms[0]][0]!r} and {found[forms[1]][0]!r}")
    every = list(itertools.chain(*ORIENTATIONS.values()))
    if not forms and position_only and all(name in names for name in POSITION) and not _misspelt(every, names):
        return Layout("position", POSITION, () if joint_names is None else _start(names, joint_names))
    if not forms:
        raise PoseError(f"no column of an orientation{_hint(every, names)}; {VALID}")
    form = forms[0]
    if form == "matrix" and any(name in names for name in POSITION):
        raise PoseError(f"one position is enough: there are both 'x', 'y' or 'z' and {found[form][0]!r}")
    if form == "matrix":
        pose = ORIENTATIONS[form] if any(name in names for name in LAST_ROW) else MATRIX
    else:
        pose = (*POSITION, *ORIENTATIONS[form])
    _complete(pose, names, VALID)
    return Layout(form, pose, () if joint_names is None else _start(names, joint_names))


def _start(names: Sequence[str], joint_names: Sequence[str]) -> tuple[str, ...]:
    start = tuple(START + joint for joint in joint_names)
    given = [name for name in names if name.startswith(START)]
    for name in given:
        if name not in start:
            raise PoseError(f"column {name!r} names no joint; {listed(start, name)}")
    if not given:
        return ()
    _complete(start, names, f"a start is {', '.join(start)}")
    return start


def _complete(wanted: Sequence[str], names: Sequence[str], valid: str) -> None:
    missing = [name for name in wanted if name not in names]
    if missing:
        columns = "column" if len(missing) == 1 else "columns"
        raise PoseError(f"no {columns} {', '.join(map(repr, missing))}{_hint(missing, names)}; {valid}")


def _hint(missing: Sequence[str], names: Sequence[str]) -> str:
    """What to say of a misspelt name among the columns, or what columns there are."""
    return _misspelt(missing, names) or f" among {', '.join(repr(name[:60]) for name in names[:40])}"


def _misspelt(missing: Sequence[str], names: Sequence[str]) -> str:
    """What to say of a name among the columns that is like something that is missing; empty: there is none."""
    known = {*POSITION, *itertools.chain(*ORIENTATIONS.values())}
    written = {name.lower(): name for name in names if name not in known and not name.startswith(START)}
    for wanted in missing:
        close = difflib.get_close_matches(wanted, written, n=1)
        if close:
            return f"; there is {written[close[0]]!r}: did you mean {wanted!r}?"
    return ""
