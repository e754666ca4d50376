"""Mesh files and convex hulls."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterable
from pathlib import Path
from urllib.parse import unquote

import coal
import numpy as np

from maira_qp.errors import OptionError, shown

THICKNESS = 1e-6
"""What a flat mesh, and a shape of a URDF with a size of zero, is thickened by [m]: `coal` needs an inside."""


def find_mesh(filename: str | os.PathLike[str], directories: Iterable[str | os.PathLike[str]]) -> Path:
    """The file that a URDF or a caller names.

    `package://NAME/PATH` is sought as NAME/PATH in each directory, then as PATH, for a directory that is the package; a
    relative path in each directory, then where the process runs. Raises `FileNotFoundError` with the places.
    """
    text, folders = os.fspath(filename), [Path(folder) for folder in directories]
    if text.startswith("package://"):
        path = Path(text.removeprefix("package://"))
        places = [folder / path for folder in folders]
        places += [folder.joinpath(*path.parts[1:]) for folder in folders]
    elif text.startswith("file://"):
        places = [Path(unquote(text.removeprefix("file://")))]
    else:
        places = [folder / text for folder in folders] + [Path(text)]  # an absolute path stays what it is
    for place in places:
        with contextlib.suppress(OSError):  # a name that no file can have
            if place.is_file():
                return place
    sought = ", ".join(dict.fromkeys(map(str, places))) or "nowhere: no directories are given"
    raise FileNotFoundError(f"the mesh {shown(text)} is not found; looked for: {sought:.1000}")


def mesh_points(path: Path) -> np.ndarray:
    """The vertices (k, 3) of a mesh file, in its own unit. Raises `OptionError` if it cannot be read."""
    return _points(_loaded(path), path)


def mesh_triangles(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """The vertices (k, 3) of a mesh file, in its own unit, and its triangles (m, 3) of indices of vertices.

    Raises `OptionError` if it cannot be read.
    """
    mesh = _loaded(path)
    triangles = [(t[0], t[1], t[2]) for t in map(mesh.tri_indices, range(mesh.num_tris))]
    return _points(mesh, path), np.array(triangles, dtype=int).reshape(-1, 3)


def _loaded(path: Path) -> coal.BVHModelBase:
    try:
        return coal.MeshLoader(coal.BV_OBBRSS).load(str(path), np.ones(3))
    except (ValueError, RuntimeError) as reason:
        raise OptionError(f"the mesh {str(path)!r} cannot be read: {str(reason)[:300]}") from None


def _points(mesh: coal.BVHModelBase, path: Path) -> np.ndarray:
    points = np.array(mesh.vertices(), dtype=float).reshape(-1, 3)
    if not np.isfinite(points).all():
        raise OptionError(f"the mesh {str(path)!r} has vertices that are not finite")
    return points


def convex_hull(points: np.ndarray) -> np.ndarray:
    """Those of the points (k, 3) [m] that are corners of their convex hull; flat ones are given `THICKNESS`.

    Raises `OptionError` if there are none.
    """
    from scipy.spatial import ConvexHull, QhullError  # heavy, and only meshes need it

    if not len(points):
        raise OptionError("a mesh without vertices has no shape")
    middle = points.mean(axis=0)
    axes = np.linalg.eigh((points - middle).T @ (points - middle))[1].T
    for axis in axes[np.ptp((points - middle) @ axes.T, axis=0) < THICKNESS]:
        points = np.vstack([points - 0.5 * THICKNESS * axis, points + 0.5 * THICKNESS * axis])
    try:
        return points[ConvexHull(points).vertices]
    except QhullError as reason:
        raise OptionError(f"a mesh has no convex hull: {str(reason).strip().splitlines()[0]}") from None


def convex_solid(corners: np.ndarray) -> coal.CollisionGeometry:
    """The convex solid with these corners (k, 3) [m]."""
    from scipy.spatial import ConvexHull

    points, triangles = coal.StdVec_Vec3s(), coal.StdVec_Triangle()
    for corner in corners:
        points.append(corner)
    for triangle in ConvexHull(corners).simplices.tolist():
        triangles.append(coal.Triangle(*triangle))
    return coal.Convex(points, triangles)
