"""Surfaces on which a quantity of a map has one value, by the marching cubes of scikit-image."""

from __future__ import annotations

import importlib.util
from typing import NamedTuple

import numpy as np

from maira_qp.arrays import is_number
from maira_qp.errors import OptionError, shown
from maira_qp.scale.reach.grid import Positions


class MapSurface(NamedTuple):
    """A closed surface of triangles."""

    vertices: np.ndarray
    """(V, 3) [m]"""
    faces: np.ndarray
    """(F, 3) indices of the vertices of each triangle, which go round it against the clock as seen from outside"""


def check_skimage() -> None:
    """Whether surfaces can be made. Raises `OptionError`."""
    if importlib.util.find_spec("skimage") is None:
        raise OptionError("surfaces need scikit-image: pip install 'maira-qp[surface]'")


def surface_at(values: np.ndarray, level: float, grid: Positions) -> MapSurface:
    """The surface between the cells whose values (X, Y, Z) are above a level and those below, NaN among the latter.

    Between the centres of two cells values are interpolated; at the edge of the grid the surface is closed. Raises
    `OptionError` for a level that no surface has, and without scikit-image.
    """
    check_skimage()
    from skimage.measure import marching_cubes  # pyright: ignore[reportMissingImports]

    known = values[np.isfinite(values)].astype(float)
    low, high = (float(known.min()), float(known.max())) if len(known) else (0.0, 0.0)
    floor = min(0.0, low)
    if not (is_number(level) and floor < level < high):
        raise OptionError(f"level must be between {floor:g} and {high:g}, the largest value, got {shown(level)}")
    padded = np.full([n + 2 for n in values.shape], floor)
    padded[1:-1, 1:-1, 1:-1] = np.where(np.isfinite(values), values, floor)
    vertices, faces, _, _ = marching_cubes(padded, level, spacing=(grid.cell,) * 3, gradient_direction="ascent")
    first = np.array([grid.axis(k)[0] - grid.cell for k in range(3)])
    return MapSurface(vertices + first, faces)
