"""A motion over time, to be played again and saved."""

from __future__ import annotations

import numpy as np

from maira_qp.apps.viewer.saving import content
from maira_qp.robots.model.robot import Robot

LONGEST = 36_000
"""Most rows of a recording: ten minutes at 60 Hz."""


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
        """A file of it, see `saving.content`, with the column `time` [s]. Raises `OptionError`."""
        times, q, poses = self._columns()
        return content(suffix, {"time": times}, poses, q, self.robot.joint_names)

    def _columns(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Times (N,), configurations (N, n) and poses of the tool (N, 4, 4), while another thread may add more."""
        times = self.times
        q = self.q[: len(times)]
        return times, q, np.array([self.robot.forward(row).homogeneous for row in q]).reshape(-1, 4, 4)
