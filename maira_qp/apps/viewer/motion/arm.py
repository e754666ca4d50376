"""Where the joints are, and what moves them: a motion, or control ticks toward the target."""

from __future__ import annotations

import time
from typing import Any

import numpy as np

from maira_qp.apps.viewer.motion.motions import Motion
from maira_qp.robots.model.robot import Robot
from maira_qp.solvers.solver import Solver

AT_REST = 1e-4
"""An arm that moves less in a tick [rad, or m] stands still."""
SMOOTHING = 0.05
"""Share of the last tick in the time that is shown."""


class Arm:
    """The joints of a robot."""

    def __init__(self, robot: Robot, q: np.ndarray) -> None:
        """At rest at q (n,)."""
        self.robot, self.q = robot, q
        self.motion: Motion | None = None
        self.is_following = False
        """It moves toward the target wherever no motion moves it."""
        self.still = 0
        """Ticks for which it has stood still"""
        self.tick_seconds = 0.0
        """What control ticks take [s], smoothed"""
        self._velocity = np.zeros(robot.n)

    def follow(self) -> None:
        """It moves toward the target from now on."""
        self.halt()
        self.is_following = True

    def start(self, motion: Motion) -> None:
        """A motion moves it from now on."""
        self.halt()
        self.motion = motion

    def halt(self) -> None:
        """Nothing moves it."""
        self.motion, self.is_following = None, False
        self._velocity = np.zeros(self.robot.n)
        self.still = 0

    def put(self, q: np.ndarray) -> None:
        """It is at q (n,), moved into the limits, at once."""
        self.halt()
        self.q = self.robot.clip(q)

    def tick(self, dt: float, solver: Solver, asked: Any) -> Motion | None:
        """Moves it by dt [s], toward what is asked of the solver if no motion does; returns the motion that did."""
        before, motion = self.q, self.motion
        if motion is not None:
            self.q = np.clip(motion.next(self.q, dt), self.robot.lower, self.robot.upper)
            if motion.is_done:
                self.motion = None
        elif self.is_following:
            begin = time.perf_counter()
            step = solver.step(self.q, asked, dt, velocity=self._velocity)
            seconds = time.perf_counter() - begin
            self.tick_seconds += SMOOTHING * (seconds - self.tick_seconds) if self.tick_seconds else seconds
            self.q, self._velocity = step.q, step.velocity
        self.still = self.still + 1 if float(np.abs(self.q - before).max()) < AT_REST else 0
        return motion
