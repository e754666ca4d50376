"""Solid shapes: the obstacles around a robot, and what the links of one are made of."""

from __future__ import annotations

import os
from abc import ABC, abstractmethod
from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar

import coal
import numpy as np
import pinocchio as pin

from maira_qp.arrays import is_listing, real_array
from maira_qp.errors import OptionError, shown
from maira_qp.orientation import rigid_or_point
from maira_qp.robots.collision.meshes import convex_hull, convex_solid, find_mesh, mesh_points


class Shape(ABC):
    """A convex solid. Its `pose` is that of its middle, in the base (an obstacle) or in its link; `name` its own."""

    pose: Any
    name: str
    has_own_pose: ClassVar[bool]
    """Of each: whether it was made with a pose."""

    def _check(self, **sizes: tuple[int, ...]) -> None:
        """The pose as a copy, the sizes of those array shapes as floats. Raises `OptionError`, `PoseError`."""
        kind = type(self).__name__
        if not isinstance(self.name, str):
            raise OptionError(f"name of a {kind} must be text, not {shown(self.name)}")
        object.__setattr__(self, "has_own_pose", self.pose is not None)
        T = np.eye(4) if self.pose is None else rigid_or_point(self.pose, f"pose of a {kind}")
        object.__setattr__(self, "pose", pin.SE3(T[:3, :3].copy(), T[:3, 3].copy()))
        for size, shape in sizes.items():
            value = real_array(getattr(self, size), shape, f"{size} of a {kind}", OptionError)
            if not (value > 0).all():
                raise OptionError(f"{size} of a {kind} must be positive [m], got {value.tolist()}")
            object.__setattr__(self, size, tuple(value.tolist()) if shape else float(value))

    @abstractmethod
    def solid(self) -> coal.CollisionGeometry:
        """The shape as an object of `coal`, its middle in the origin."""

    def loaded(self, directories: Iterable[str | os.PathLike[str]]) -> Shape:
        """The shape with nothing left in files. Raises `OptionError`, and `FileNotFoundError` for a missing mesh."""
        return self


@dataclass(frozen=True, eq=False)
class Sphere(Shape):
    """A ball."""

    radius: float
    """[m]; > 0"""
    pose: Any = None
    """Pose in the base, `pin.SE3` or (4, 4), or a point (3,) [m]; None: at the origin."""
    name: str = field(default="", kw_only=True)

    def __post_init__(self) -> None:
        self._check(radius=())

    def solid(self) -> coal.CollisionGeometry:
        """A sphere."""
        return coal.Sphere(self.radius)


@dataclass(frozen=True, eq=False)
class Ellipsoid(Shape):
    """All points with `(x / a)^2 + (y / b)^2 + (z / c)^2 <= 1` along the axes of its pose."""

    radii: Any
    """a, b and c (3,) [m]; > 0"""
    pose: Any = None
    """Pose of its middle in the base, `pin.SE3` or (4, 4); None: at the origin."""
    name: str = field(default="", kw_only=True)

    def __post_init__(self) -> None:
        self._check(radii=(3,))

    def solid(self) -> coal.CollisionGeometry:
        """An ellipsoid."""
        return coal.Ellipsoid(*self.radii)


@dataclass(frozen=True, eq=False)
class Box(Shape):
    """A box along the axes of its pose."""

    size: Any
    """Lengths of its edges (3,) [m]; > 0"""
    pose: Any = None
    """Pose of its middle in the base, `pin.SE3` or (4, 4), or a point (3,) [m]; None: at the origin."""
    name: str = field(default="", kw_only=True)

    def __post_init__(self) -> None:
        self._check(size=(3,))

    def solid(self) -> coal.CollisionGeometry:
        """A box."""
        return coal.Box(*self.size)


@dataclass(frozen=True, eq=False)
class Capsule(Shape):
    """All points within `radius` of a line of `length` along z, in the middle of its pose."""

    radius: float
    """[m]; > 0"""
    length: float
    """Of the line [m], the round ends not counted; > 0"""
    pose: Any = None
    """Pose of its middle in the base, `pin.SE3` or (4, 4), or a point (3,) [m]; None: at the origin."""
    name: str = field(default="", kw_only=True)

    def __post_init__(self) -> None:
        self._check(radius=(), length=())

    def solid(self) -> coal.CollisionGeometry:
        """A capsule."""
        return coal.Capsule(self.radius, self.length)


@dataclass(frozen=True, eq=False)
class Cylinder(Shape):
    """A cylinder along z, in the middle of its pose."""

    radius: float
    """[m]; > 0"""
    length: float
    """[m]; > 0"""
    pose: Any = None
    """Pose of its middle in the base, `pin.SE3` or (4, 4), or a point (3,) [m]; None: at the origin."""
    name: str = field(default="", kw_only=True)

    def __post_init__(self) -> None:
        self._check(radius=(), length=())

    def solid(self) -> coal.CollisionGeometry:
        """A cylinder."""
        return coal.Cylinder(self.radius, self.length)


@dataclass(frozen=True, eq=False)
class Mesh(Shape):
    """The convex hull of a mesh; what has hollows is given as several meshes, each of them convex.

    The hull has a depth where something is inside it, and a distance in a microsecond; a bag of triangles has neither.
    """

    source: Any
    """A file (STL, OBJ, DAE, ...), or vertices (k, 3) [m] and faces (m, 3), three indices of vertices each."""
    pose: Any = None
    """Pose of its origin in the base, `pin.SE3` or (4, 4), or a point (3,) [m]; None: at the origin."""
    scale: Any = 1.0
    """Factor of the vertices, one or (3,); not 0. Negative: mirrored."""
    name: str = field(default="", kw_only=True)
    _hull: np.ndarray | None = field(default=None, kw_only=True, repr=False)

    def __post_init__(self) -> None:
        self._check()
        shape = (3,) if is_listing(self.scale) else ()
        scale = np.broadcast_to(real_array(self.scale, shape, "scale of a Mesh", OptionError), (3,))
        if not scale.all():
            raise OptionError(f"scale of a Mesh must not be zero, got {scale.tolist()}")
        object.__setattr__(self, "scale", tuple(scale.tolist()))
        if not isinstance(self.source, (str, os.PathLike)):
            object.__setattr__(self, "source", _checked_mesh(self.source))

    def loaded(self, directories: Iterable[str | os.PathLike[str]]) -> Mesh:
        """With its hull, the file sought as `find_mesh` does."""
        if self._hull is not None:
            return self
        if isinstance(self.source, tuple):
            vertices, faces = self.source
            points = vertices[np.unique(faces)]
        else:
            points = mesh_points(find_mesh(self.source, directories))
        return replace(self, _hull=convex_hull(points * self.scale))

    def solid(self) -> coal.CollisionGeometry:
        """The hull, of a mesh that is loaded."""
        assert self._hull is not None
        return convex_solid(self._hull)


def _checked_mesh(source: Any) -> tuple[np.ndarray, np.ndarray]:
    """Vertices (k, 3) and faces (m, 3). Raises `OptionError`."""
    if not isinstance(source, (tuple, list)) or len(source) != 2:
        raise OptionError(f"a Mesh is made of a file, or of (vertices, faces), not of {shown(source)}")
    vertices = real_array(source[0], (None, 3), "vertices of a Mesh", OptionError)
    faces = real_array(source[1], (None, 3), "faces of a Mesh", OptionError)
    if not faces.size or not np.isin(faces, np.arange(len(vertices))).all():
        raise OptionError(
            f"faces of a Mesh must be indices of its {len(vertices)} vertices, three a face, at least one"
        )
    return vertices, faces.astype(int)
