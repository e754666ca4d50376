"""Obstacles around a robot, and how far the arm is from each."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from maira_qp.problem.limits.collision import CollisionLimit
from maira_qp.robots.collision.shapes import Shape
from maira_qp.robots.model.robot import Robot

MARGIN = 0.02
"""What is kept between the arm and an obstacle [m]."""


SLACK = 1e-4
"""Nearer than the margin by at most this [m] is at the margin."""
STRIDE = 0.02
"""A way is looked at in steps of this [rad or m] of the joint that goes farthest."""


class Clearance(NamedTuple):
    """The point of the arm that is nearest to an obstacle."""

    obstacle: str
    link: str
    distance: float
    """[m], negative by the depth where they overlap"""
    points: np.ndarray
    """(2, 3) [m], of the link and of the obstacle, in the base"""


class Overlap(NamedTuple):
    """Two links that are in each other."""

    first: str
    second: str
    depth: float
    """[m]"""


def too_near(found: Sequence[Clearance]) -> list[Clearance]:
    """Those inside the margin, the nearest first."""
    return sorted((one for one in found if one.distance < MARGIN - SLACK), key=lambda one: one.distance)


def first_in_the_way(limit: CollisionLimit, q: np.ndarray, goal: np.ndarray) -> Clearance | None:
    """What the straight way in joint space from q (n,) to a goal (n,) comes too near to; None: nothing.

    An obstacle that is too near at q already may be so on the way, but not at the goal.
    """
    begin = {one.obstacle for one in too_near(clearances(limit, q))}
    for share in np.linspace(0, 1, 2 + int(np.abs(goal - q).max() / STRIDE))[1:]:
        near = too_near(clearances(limit, (1 - share) * q + share * goal))
        blocking = [one for one in near if share == 1 or one.obstacle not in begin]
        if blocking:
            return blocking[0]
    return None


def collision_limit(obstacles: Mapping[str, Shape], directories: Sequence[str]) -> CollisionLimit:
    """The arm against the obstacles, not against itself; its meshes are sought in `directories`."""
    return CollisionLimit(
        obstacles=tuple(obstacles.values()), margin=MARGIN, self_collision=False, meshes=directories, missing="ignore"
    )


def clearances(limit: CollisionLimit, q: np.ndarray) -> list[Clearance]:
    """Of each obstacle of a limit that is made for a robot at q (n,), in the order of the obstacles."""
    scene = limit.scene
    contacts = scene.contacts(q, np.inf)
    nearest: dict[str, Clearance] = {}
    for i, pair in enumerate(contacts.pairs):
        link, obstacle = (scene.parts[part].name for part in scene.pairs[pair])
        distance, point = float(contacts.distances[i]), contacts.points[i]
        if obstacle not in nearest or distance < nearest[obstacle].distance:
            points = np.array([point, point + distance * contacts.normals[i]])
            nearest[obstacle] = Clearance(obstacle, link, distance, points)
    return [nearest[obstacle.name] for obstacle in limit.obstacles if obstacle.name in nearest]


def self_collision_limit(robot: Robot, directories: Sequence[str]) -> CollisionLimit:
    """The robot against itself, links aside that are in each other nearly always. Raises `MairaError`."""
    return CollisionLimit(margin=0.0, allowed="sampled", meshes=directories, missing="ignore").of(robot)


def overlaps(limit: CollisionLimit, q: np.ndarray) -> list[Overlap]:
    """The links of a robot at q (n,) that are in each other, the deepest first."""
    scene = limit.scene
    contacts = scene.contacts(q, 0.0)
    deepest: dict[tuple[str, str], float] = {}
    for pair, distance in zip(contacts.pairs, contacts.distances, strict=True):
        if distance < -SLACK:
            names = tuple(scene.parts[part].name for part in scene.pairs[pair])
            deepest[names] = max(deepest.get(names, 0.0), -float(distance))  # type: ignore[index, arg-type]
    found = [Overlap(*names, depth) for names, depth in deepest.items()]
    return sorted(found, key=lambda one: -one.depth)
