"""Files of configurations and poses: of a recorded motion, of a path that was followed."""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Protocol

import numpy as np

from maira_qp.errors import OptionError
from maira_qp.io.atomic_write import replacing
from maira_qp.orientation import quaternion_from_matrix

SUFFIXES = (".csv", ".npz")
_POSE = ("x", "y", "z", "qw", "qx", "qy", "qz")


class Savable(Protocol):
    """Rows that a file can hold."""

    def __len__(self) -> int: ...

    def content(self, suffix: str) -> bytes:
        """The file. Raises `OptionError` for a suffix that is none of `SUFFIXES`."""
        ...


def content(
    suffix: str, columns: Mapping[str, np.ndarray], poses: np.ndarray, q: np.ndarray, joint_names: Sequence[str]
) -> bytes:
    """A file of N rows: `columns` (N,), poses (N, 4, 4) and configurations (N, n) [rad or m].

    CSV: the columns, `x, y, z, qw, qx, qy, qz` and `q_<joint>`, as `maira-qp solve --batch` and `mq.paths.from_csv`
    read poses. NPZ: the columns, `targets` (N, 4, 4), `q` (N, n) and `joint_names`. Raises `OptionError`.
    """
    if suffix == ".csv":
        return _csv(columns, poses, q, joint_names)
    if suffix == ".npz":
        file = io.BytesIO()
        arrays = {**columns, "targets": poses, "q": q, "joint_names": np.array(joint_names)}
        np.savez(file, allow_pickle=False, **arrays)
        return file.getvalue()
    raise OptionError(f"it is saved as {' or '.join(SUFFIXES)}, not {suffix!r}")


def _csv(columns: Mapping[str, np.ndarray], poses: np.ndarray, q: np.ndarray, joint_names: Sequence[str]) -> bytes:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow([*columns, *_POSE, *(f"q_{name}" for name in joint_names)])
    own = [column.tolist() for column in columns.values()]
    for *first, T, row in zip(*own, poses, q.tolist(), strict=True):
        writer.writerow([*first, *T[:3, 3].tolist(), *quaternion_from_matrix(T[:3, :3]).tolist(), *row])
    return text.getvalue().encode()


def save(what: Savable, name: str, directory: Path) -> Path:
    """Writes it into a new file of the directory; its name comes from a web page and is trusted with nothing.

    Raises `OptionError` for a name that is more than one, for what is there already, and for what has no rows.
    """
    if not len(what):
        raise OptionError("there is nothing to save yet")
    path = directory / plain_name(name)
    if path.exists() or path.is_symlink():
        raise OptionError(f"{path.name} is there already: choose another name")
    with replacing(path) as file:
        file.write(what.content(path.suffix))
    return path


def plain_name(name: str) -> str:
    """The name itself if it is one of a file that can be saved. Raises `OptionError`."""
    if not re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9_. -]{0,99}\.(csv|npz)", name):
        raise OptionError(
            f"{name[:120]!r} cannot be the file's name: letters, digits, _ . - and {' or '.join(SUFFIXES)} at the end"
        )
    return name
