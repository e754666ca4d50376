"""How the arm gets on: toward the target, straight to a configuration, along its self-motion, a recording or a path.

A motion gives the next configuration, as far from the last as the speed limits allow in a tick; on a path, which can be
scrubbed, the arm is at one of the poses at any time.
"""

from __future__ import annotations

from abc import ABC, abstractmethod

import numpy as np

from maira_qp.apps.viewer.motion.elbow import Elbow
from maira_qp.apps.viewer.motion.recording import Recording
from maira_qp.apps.viewer.paths.followed import Followed, Station
from maira_qp.errors import OptionError, shown
from maira_qp.robots.model.robot import Robot

SWIVEL_SPEED = 1.5
"""[rad/s], before the speed limits of the joints"""
SLOWEST = 1e-3
"""[rad/s] The elbow goes on at this speed even where joints turn too fast, which is next to a singularity."""
UNLIMITED = np.pi
"""Speed of a joint that has no limit [rad/s, or m/s]"""


class Motion(ABC):
    """What the arm does, tick by tick."""

    @abstractmethod
    def next(self, q: np.ndarray, dt: float) -> np.ndarray:
        """The configuration (n,) dt [s] after q (n,)."""

    @property
    @abstractmethod
    def is_done(self) -> bool:
        """There is nothing left to do."""


class Go(Motion):
    """Straight through joint space to a configuration, all joints in the same time."""

    def __init__(self, robot: Robot, goal: np.ndarray) -> None:
        """goal (n,), moved into the limits."""
        self._robot, self.goal = robot, np.clip(goal, robot.lower, robot.upper)
        self._left = np.inf

    def next(self, q: np.ndarray, dt: float) -> np.ndarray:
        """At limit speed of the joint that has the longest way."""
        way = self.goal - q
        self._left = _ticks(self._robot, way, dt)
        return (
            self.goal.copy() if self._left <= 1 else np.clip(q + way / self._left, self._robot.lower, self._robot.upper)
        )

    @property
    def is_done(self) -> bool:
        """It is there."""
        return self._left <= 1


class Swivel(Motion):
    """The elbow moves along its curve, so that the tool stands still."""

    def __init__(self, robot: Robot, elbow: Elbow, end: float) -> None:
        """From where it is to another place on the curve [rad, or m]."""
        self._robot, self.elbow = robot, elbow
        self._end = min(max(end, elbow.curve.lower), elbow.curve.upper)

    def next(self, q: np.ndarray, dt: float) -> np.ndarray:
        """At swivel speed, halved until no joint is faster than it may be."""
        curve, psi = self.elbow
        way = min(max(self._end - psi, -SWIVEL_SPEED * dt), SWIVEL_SPEED * dt)
        while True:
            further = self._end if way == self._end - psi else psi + way
            ahead = curve.at(np.array(further))
            if _ticks(self._robot, ahead - q, dt) <= 1 or abs(way) < SLOWEST * dt:
                self.elbow = Elbow(curve, further)
                return ahead
            way *= 0.5

    @property
    def is_done(self) -> bool:
        """The place is reached."""
        return self.elbow.psi == self._end


class Replay(Motion):
    """To the first configuration of a recording, and then through it in its own time."""

    def __init__(self, robot: Robot, recording: Recording) -> None:
        """A recording that is not empty."""
        self._recording, self._start = recording, Go(robot, recording.at(0.0))
        self._time = 0.0

    def next(self, q: np.ndarray, dt: float) -> np.ndarray:
        """On the way to the start, or on the recording."""
        if not self._start.is_done:
            return self._start.next(q, dt)
        self._time += dt
        return self._recording.at(self._time)

    @property
    def is_done(self) -> bool:
        """It is at its end."""
        return self._time >= self._recording.duration and self._start.is_done


class Along(Motion):
    """At the poses of a path that was followed, one after the other or as they are asked for; it ends with another."""

    def __init__(self, robot: Robot, path: Followed) -> None:
        """At the first pose."""
        self._robot, self._path = robot, path
        self._index, self._rate, self._time = 0, 0.0, 0.0

    def next(self, q: np.ndarray, dt: float) -> np.ndarray:
        """Exactly that of the pose; while it plays, no faster than the speed limits allow from pose to pose."""
        rows, last = self._path.solution.q, len(self._path) - 1
        self._time += dt
        while self._rate and self._index < last:
            way = rows[self._index + 1] - rows[self._index]
            needed = max(1 / self._rate, _ticks(self._robot, way, 1.0))
            if self._time < needed:
                break
            self._time -= needed
            self._index += 1
        if self._index == last:
            self._rate = 0.0
        return rows[self._index].copy()

    @property
    def is_done(self) -> bool:
        """Never: the last pose is still one of the path."""
        return False

    @property
    def station(self) -> Station:
        """Where it is."""
        return Station(self._path, self._index, self._rate > 0)

    def stand_at(self, index: int) -> None:
        """At a pose, the nearest that there is."""
        self._index, self._rate = min(max(index, 0), len(self._path) - 1), 0.0

    def play(self, rate: float) -> None:
        """Onward by so many poses per second, from the beginning if it is at the end. Raises `OptionError`."""
        if not 0.0 < rate < np.inf:
            raise OptionError(f"the speed must be a positive number of poses per second, got {shown(rate)}")
        self._index = 0 if self._index == len(self._path) - 1 else self._index
        self._rate, self._time = rate, 0.0


def _ticks(robot: Robot, way: np.ndarray, dt: float) -> float:
    """In how many ticks of dt [s] a way (n,) can be gone within the speed limits."""
    speed = np.where(np.isfinite(robot.velocity_limit) & (robot.velocity_limit > 0), robot.velocity_limit, UNLIMITED)
    return float((np.abs(way) / (speed * dt)).max())
