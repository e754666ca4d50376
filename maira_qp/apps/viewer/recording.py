"""A motion over time, to be played again and saved."""

from __future__ import annotations

import csv
import io
import re
from pathlib import Path

import numpy as np

from maira_qp.errors import OptionError
from maira_qp.io.atomic_write import replacing
from maira_qp.orientation import quaternion_from_matrix
from maira_qp.robots.model.robot import Robot

LONGEST = 36_000
"""Most rows of a recording: ten minutes at 60 Hz."""
_POSE = ("x", "y", "z", "qw", "qx", "qy", "qz")
SUFFIXES = (".csv", ".npz")


class Recording:
    """Configurations of a robot and their times, from 0 on."""

    def __init__(self, robot: Robot) -> None:
        """An empty one."""
        self.robot = robot
        self._times: list[float] = []
        self._rows: list[np.ndarray] = []

    def __len__(self) -> int:
        return len(self._times)

    @property
    def is_full(self) -> bool:
        """No more is taken."""
        return len(self) >= LONGEST

    @property
    def duration(self) -> float:
        """[s]"""
        return self._times[-1] if self._times else 0.0

    @property
    def times(self) -> np.ndarray:
        """(N,) [s]"""
        return np.array(self._times)

    @property
    def q(self) -> np.ndarray:
        """(N, n) [rad or m]"""
        return np.array(self._rows[: len(self)]).reshape(-1, self.robot.n)

    def add(self, q: np.ndarray, dt: float) -> None:
        """One more configuration (n,), dt [s] after the last; nothing once it is full."""
        if not self.is_full:
            self._rows.append(q.copy())
            self._times.append(self.duration + dt if self._times else 0.0)  # last: it is counted by its times

    def at(self, time: float) -> np.ndarray:
        """The configuration (n,) at a time [s], between two rows on the straight line; the ends go on for ever."""
        after = min(int(np.searchsorted(self._times, time)), len(self) - 1)
        before = max(after - 1, 0)
        span = self._times[after] - self._times[before]
        share = min(max((time - self._times[before]) / span, 0.0), 1.0) if span > 0 else 1.0
        return (1 - share) * self._rows[before] + share * self._rows[after]

    def content(self, suffix: str) -> bytes:
        """A file of it. CSV: `time, x, y, z, qw, qx, qy, qz` and `q_<joint>`, as `maira-qp solve --batch` reads poses.

        NPZ: `time` (N,), `targets` (N, 4, 4), `q` (N, n) and `joint_names`. Raises `OptionError` for another suffix.
        """
        if suffix not in SUFFIXES:
            raise OptionError(f"a recording is saved as {' or '.join(SUFFIXES)}, not {suffix!r}")
        return self._csv() if suffix == ".csv" else self._npz()

    def _csv(self) -> bytes:
        times, q, poses = self._columns()
        text = io.StringIO()
        writer = csv.writer(text, lineterminator="\n")
        writer.writerow(["time", *_POSE, *(f"q_{name}" for name in self.robot.joint_names)])
        for time, T, row in zip(times.tolist(), poses, q.tolist(), strict=True):
            writer.writerow([time, *T[:3, 3].tolist(), *quaternion_from_matrix(T[:3, :3]).tolist(), *row])
        return text.getvalue().encode()

    def _npz(self) -> bytes:
        times, q, poses = self._columns()
        file = io.BytesIO()
        np.savez(file, time=times, targets=poses, q=q, joint_names=np.array(self.robot.joint_names))
        return file.getvalue()

    def _columns(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Times (N,), configurations (N, n) and poses of the tool (N, 4, 4), while another thread may add more."""
        times = self.times
        q = self.q[: len(times)]
        return times, q, np.array([self.robot.forward(row).homogeneous for row in q]).reshape(-1, 4, 4)


def save(recording: Recording, name: str, directory: Path) -> Path:
    """Writes a recording into a new file of the directory; its name comes from a web page and is trusted with nothing.

    Raises `OptionError` for a name that is more than one, for what is there already, and for an empty recording.
    """
    if not len(recording):
        raise OptionError("nothing is recorded yet")
    path = directory / plain_name(name)
    if path.exists() or path.is_symlink():
        raise OptionError(f"{path.name} is there already: choose another name")
    with replacing(path) as file:
        file.write(recording.content(path.suffix))
    return path


def plain_name(name: str) -> str:
    """The name itself if it is one of a file that a recording can be. Raises `OptionError`."""
    if not re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9_. -]{0,99}\.(csv|npz)", name):
        raise OptionError(
            f"{name[:120]!r} cannot be the file's name: letters, digits, _ . - and {' or '.join(SUFFIXES)} at the end"
        )
    return name
