"""Solid shapes as triangles, to be drawn. A vertex is shared only where the surface is smooth."""

from __future__ import annotations

import itertools
from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from maira_qp.robots.collision.shapes import Box, Capsule, Cylinder, Ellipsoid, Shape, Sphere

SIDES = 32
"""Of what is round, seen along its axis."""


class Triangles(NamedTuple):
    """A surface, seen from outside where the corners of a triangle run counterclockwise."""

    vertices: np.ndarray
    """(k, 3) [m]"""
    faces: np.ndarray
    """Indices (m, 3) of vertices"""

    def moved(self, T: np.ndarray) -> Triangles:
        """The same at a pose (4, 4)."""
        return Triangles(self.vertices @ T[:3, :3].T + T[:3, 3], self.faces)


def joined(parts: Iterable[Triangles]) -> Triangles:
    """Several surfaces, at least one, as one."""
    parts = list(parts)
    starts = np.cumsum([0, *(len(part.vertices) for part in parts[:-1])])
    faces = [part.faces + start for part, start in zip(parts, starts, strict=True)]
    return Triangles(np.concatenate([part.vertices for part in parts]), np.concatenate(faces))


def triangles(shape: Shape) -> Triangles:
    """The surface of a shape, but of a mesh, in the frame of the link or the base that its pose is in."""
    if isinstance(shape, Sphere):
        surface = turned(_arc(shape.radius, -90, 90, 0.0))
    elif isinstance(shape, Ellipsoid):
        ball = turned(_arc(1.0, -90, 90, 0.0))
        surface = Triangles(ball.vertices * shape.radii, ball.faces)
    elif isinstance(shape, Cylinder):
        r, h = shape.radius, 0.5 * shape.length
        surface = turned([(0, -h), (r, -h)], [(r, -h), (r, h)], [(r, h), (0, h)])
    elif isinstance(shape, Capsule):
        h = 0.5 * shape.length
        surface = turned(_arc(shape.radius, -90, 0, -h) + _arc(shape.radius, 0, 90, h))
    elif isinstance(shape, Box):
        surface = _cuboid(np.array(shape.size))
    else:
        raise TypeError(f"a {type(shape).__name__} has no surface of its own")
    return surface.moved(shape.pose.homogeneous)


def turned(*profiles: list[tuple[float, float]]) -> Triangles:
    """The surface that profiles sweep about z, each a curve of points (radius, height) with the outside on its right.

    Each is smooth, and meets the next in an edge.
    """
    return joined(_turned(np.array(profile, dtype=float)) for profile in profiles)


def _turned(profile: np.ndarray) -> Triangles:
    """The surface of one profile (k, 2)."""
    angles = np.linspace(0.0, 2 * np.pi, SIDES, endpoint=False)
    r, z = profile[:, :1], profile[:, 1:]
    vertices = np.stack([r * np.cos(angles), r * np.sin(angles), np.broadcast_to(z, (len(z), SIDES))], axis=-1)
    here = np.arange((len(profile) - 1) * SIDES).reshape(-1, SIDES)
    beside = np.roll(here, -1, axis=1)
    faces = [np.stack([here, beside, beside + SIDES], axis=-1), np.stack([here, beside + SIDES, here + SIDES], axis=-1)]
    return Triangles(vertices.reshape(-1, 3), np.concatenate(faces).reshape(-1, 3))


def _arc(radius: float, begin: float, end: float, height: float) -> list[tuple[float, float]]:
    """A profile: an arc about (0, height) from one latitude to another [deg]."""
    latitudes = np.radians(np.linspace(begin, end, 1 + SIDES * round(end - begin) // 360))
    return [(float(radius * np.cos(a)), float(height + radius * np.sin(a))) for a in latitudes]


def _cuboid(size: np.ndarray) -> Triangles:
    """A box with edges (3,) [m], its middle in the origin."""
    square = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)]) / 2
    sides = []
    for axis, side in itertools.product(range(3), (-0.5, 0.5)):
        corners = np.insert(square, axis, side, axis=1) * size
        is_outward = (side > 0) == (axis != 1)  # z and x, in this order, would be right-handed about y
        sides.append(Triangles(corners if is_outward else corners[::-1], np.array([(0, 1, 2), (0, 2, 3)])))
    return joined(sides)
