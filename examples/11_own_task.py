"""A task and a limit of one's own: the tool rides on a sphere, and the elbow stays below a ceiling.

A task is an error and the Jacobian by which it falls; a limit is rows `G dq <= h`. Both are frozen dataclasses.
"""

from dataclasses import dataclass

import numpy as np
from rich import print

import maira_qp as mq


@dataclass(frozen=True, kw_only=True)
class SphereTask(mq.Task):
    """The tool is to be at a distance from a point, in whatever direction (one row)."""

    centre: tuple[float, float, float]
    """[m]"""
    radius: float
    """[m]"""

    def error(self, at):
        """What is missing of the radius (1,) [m]."""
        return np.array([self.radius - np.linalg.norm(at.placement().translation - self.centre)])

    def jacobian(self, at):
        """How the distance grows (1, n) [m/rad]: the part of the tool's motion that leads away from the centre."""
        away = at.placement().translation - self.centre
        return (away / np.linalg.norm(away)) @ at.jacobian()[None, :3]


@dataclass(frozen=True)
class Ceiling(mq.Limit):
    """A frame stays below a height [m]."""

    frame: str
    height: float

    def rows(self, at, tick):
        """One row: the frame rises by no more than what is left."""
        return at.jacobian(self.frame)[2:3], np.array([self.height]) - at.placement(self.frame).translation[2]

    def violation(self, at):
        """By how much it is too high [m], since the rows hold to first order only."""
        return max(0.0, at.placement(self.frame).translation[2] - self.height)


robot, centre = mq.Robot.maira(), (0.6, 0.0, 0.6)
task = SphereTask(centre=centre, radius=0.3)
wish = mq.PositionTask(target=mq.pose([0.6, 0.5, 1.2]), priority=2)  # outside: the nearest point of the sphere is meant
for title, limits in (("no ceiling", []), ("elbow below 0.9 m", [Ceiling("link4", 0.9)])):
    s = mq.Solver(robot, task=task, tasks=[wish], limits=limits).solve()
    tool, elbow = robot.forward(s.q).translation, robot.forward(s.q, "link4").translation
    print(f"{title}: {s.status.name}, radius {np.linalg.norm(tool - centre):.9f} m,", end=" ")
    print(f"wish off by {np.linalg.norm(tool - [0.6, 0.5, 1.2]):.4f} m, elbow at {elbow[2]:.4f} m")
