"""The self-motion of a redundant arm: joints move, the tool stands still. Walked numerically, where no closed form is.

From a configuration the walk goes along the null space of the tool's Jacobian, to both sides; each step is brought back
onto the pose by a solve, and is halved where the direction turns too much. Where the null space has more than one
dimension, it goes as straight on as the self-motion lets it: the last direction is projected onto the null space. It
ends at a joint limit, where it comes back to where it began, or at `LONGEST`. Between the points it found the curve is
the cubic that has their directions.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.interpolate import CubicHermiteSpline

from maira_qp.problem.options import Options
from maira_qp.robots.model.robot import Robot
from maira_qp.solvers.solver import Solver

POSE = 6
"""What a pose fixes."""
STEP, SHORTEST = 0.05, 1e-5
"""A step through joint space at most, and at least: then it ends [rad, or m]."""
TURN = 0.05
"""What the direction turns in a step at most [rad]."""
LONGEST = 4 * np.pi
"""Length of the way to either side [rad, or m]."""
EXACT = Options(position_tolerance=1e-10, orientation_tolerance=1e-10, max_restarts=0)
"""Of the solve that brings a step back onto the pose: there is one way back, and no other start is sought."""
SINGULAR = 1e-6
"""Singular values of the Jacobian below this share of the largest belong to the null space."""
ENDS = 1e-9
"""A limit nearer than this [rad, or m] ends the walk."""


@dataclass(frozen=True, eq=False)
class SelfMotion:
    """A curve of configurations with the tool at one pose, by the length of the way s through joint space."""

    robot: Robot
    s: np.ndarray
    """(k,) [rad, or m], increasing; 0 where the walk began"""
    q: np.ndarray
    """Configurations (k, n), within the limits exactly"""
    directions: np.ndarray
    """dq/ds (k, n), of length 1"""
    is_closed: bool
    """It ends where it begins"""

    @property
    def lower(self) -> float:
        """Where it begins."""
        return float(self.s[0])

    @property
    def upper(self) -> float:
        """Where it ends."""
        return float(self.s[-1])

    @cached_property
    def _spline(self) -> CubicHermiteSpline:
        return CubicHermiteSpline(self.s, self.q, self.directions)

    def at(self, s: np.ndarray) -> np.ndarray:
        """Configurations (..., n) at s (...,) from `lower` to `upper`."""
        return np.clip(self._spline(s), self.robot.lower, self.robot.upper)


def is_redundant(robot: Robot) -> bool:
    """More joints move than a pose fixes."""
    return bool(np.count_nonzero(robot.lower < robot.upper) > POSE)


def self_motion(robot: Robot, q: np.ndarray) -> SelfMotion | None:
    """The self-motion through q (n,); None where there is none, as between two limits.

    To the side to which the joint that is the freest there goes up, s goes up.
    """
    walk = _Walk(robot, q)
    forth, is_closed = walk.walked(walk.start)
    back = [] if is_closed else walk.walked(-walk.start)[0]
    points = [*((-s, at, -direction) for s, at, direction in reversed(back)), (0.0, q, walk.start), *forth]
    if len(points) == 1:
        return None
    s, configurations, directions = (np.array(each) for each in zip(*points, strict=True))
    return SelfMotion(robot, s, configurations, directions, is_closed)


class _Walk:
    """From q (n,) to either side."""

    def __init__(self, robot: Robot, q: np.ndarray) -> None:
        self._robot, self._q = robot, q
        self._solver, self._target = Solver(robot, options=EXACT), robot.forward(q)
        free = self._null_space(q)
        self.start = _unit(free @ free[np.argmax((free**2).sum(axis=1))])

    def walked(self, direction: np.ndarray) -> tuple[list[tuple[float, np.ndarray, np.ndarray]], bool]:
        """The points (s, q, direction) behind the first one, and whether they come back to it."""
        points: list[tuple[float, np.ndarray, np.ndarray]] = []
        s, q, first, length = 0.0, self._q, direction, STEP
        while s < LONGEST and length > SHORTEST and (room := self._room(q, direction)) > ENDS:
            if self._is_back(q, direction, first):
                return [*points, (s + float(np.linalg.norm(self._q - q)), self._q, first)], True
            length = min(length, room)
            found = self._next(q, direction, length)
            if found is None:
                length *= 0.5
                continue
            s, (q, direction) = s + float(np.linalg.norm(found[0] - q)), found
            points.append((s, q, direction))
            length = min(2 * length, STEP)
        return points, False

    def _next(self, q: np.ndarray, direction: np.ndarray, length: float) -> tuple[np.ndarray, np.ndarray] | None:
        """The configuration and the direction a step further; None where they would be too far from expected."""
        expected = q + length * direction
        found = self._solver.solve(self._target, q0=expected)
        free = self._null_space(found.q)
        ahead = _unit(free @ (free.T @ direction))
        is_near = np.linalg.norm(found.q - expected) <= TURN * length and ahead @ direction >= np.cos(TURN)
        return (found.q, ahead) if found.success and is_near else None

    def _room(self, q: np.ndarray, direction: np.ndarray) -> float:
        """How far it is to the first limit."""
        moves = np.abs(direction) > ENDS
        limit = np.where(direction > 0, self._robot.upper, self._robot.lower)
        return float(((limit - q)[moves] / direction[moves]).min())

    def _is_back(self, q: np.ndarray, direction: np.ndarray, first: np.ndarray) -> bool:
        """The beginning lies right ahead."""
        way = self._q - q
        ahead = float(way @ direction)
        is_ahead = SHORTEST < ahead <= 1.5 * STEP and np.linalg.norm(way - ahead * direction) <= TURN * ahead
        return bool(is_ahead and first @ direction >= np.cos(TURN))

    def _null_space(self, q: np.ndarray) -> np.ndarray:
        """Orthonormal directions (n, k) of the joints that move, in which the tool stands still."""
        moves = self._robot.lower < self._robot.upper
        _, values, rows = np.linalg.svd(self._robot.jacobian(q)[:, moves])
        rank = int((values > SINGULAR * values[0]).sum())
        free = np.zeros((self._robot.n, len(rows) - rank))
        free[moves] = rows[rank:].T
        return free


def _unit(vector: np.ndarray) -> np.ndarray:
    """Of length 1, or zero."""
    return vector / max(float(np.linalg.norm(vector)), np.finfo(float).tiny)
