"""Obstacles around a robot, and how far the arm is from each."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from maira_qp.problem.collision import CollisionLimit
from maira_qp.robots.collision.shapes import Shape

MARGIN = 0.02
"""What is kept between the arm and an obstacle [m]."""


class Clearance(NamedTuple):
    """The point of the arm that is nearest to an obstacle."""

    obstacle: str
    link: str
    distance: float
    """[m], negative by the depth where they overlap"""
    points: np.ndarray
    """(2, 3) [m], of the link and of the obstacle, in the base"""


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
