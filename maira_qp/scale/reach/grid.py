r"""The grids of a reachability map: cubic cells of positions, and orientations uniform over all rotations.

An orientation is a direction of the tool's z axis and a roll about it. Directions are those of the Fibonacci lattice on
the sphere (Gonzalez, "Measurement of areas on a sphere using Fibonacci and latitude-longitude lattices", 2010),

    z_k = 1 - (2 k + 1) / D,    azimuth_k = 2 pi k / golden ratio,

each of which stands for the same area. From the rotation that takes z to the direction the short way, D x K roll angles
are K equal steps of a turn, the first of which is spread by the golden ratio over the directions: a product of uniform
measures, which is the uniform measure of SO(3).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

GOLDEN = 0.5 * (1.0 + 5.0**0.5)
AROUND = 5
"""Directions that count as around another."""


@dataclass(frozen=True)
class Positions:
    """Cubic cells whose corners are whole multiples of their edge, so that maps of the same edge fit together."""

    cell: float
    """Edge [m]"""
    lower: tuple[int, int, int]
    """The lower corner, in cells"""
    shape: tuple[int, int, int]
    """How many cells along x, y and z"""

    @property
    def count(self) -> int:
        """How many cells."""
        return self.shape[0] * self.shape[1] * self.shape[2]

    def axis(self, k: int) -> np.ndarray:
        """The centres [m] along axis k, (shape[k],)."""
        return (np.arange(self.shape[k]) + self.lower[k] + 0.5) * self.cell

    def centres(self, first: int, last: int) -> np.ndarray:
        """The centres (last - first, 3) [m] of cells, counted with z fastest."""
        index = np.unravel_index(np.arange(first, last), self.shape)
        return np.column_stack([self.axis(k)[index[k]] for k in range(3)])

    def index(self, points: np.ndarray) -> np.ndarray:
        """The cells (N,) that hold points (N, 3) [m]; -1 for those outside, and NaN."""
        with np.errstate(invalid="ignore"):
            at = np.floor(points / self.cell) - self.lower
            inside = np.all((at >= 0) & (at < self.shape), axis=1)
        at = np.where(inside[:, None], at, 0).astype(np.int64)
        return np.where(inside, np.ravel_multi_index(tuple(at.T), self.shape), -1)

    def around(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The eight cells whose centres are around points (N, 3) [m], and their weights, both (8, N).

        The weights are those of trilinear interpolation between centres, beyond the outermost of the nearest point that
        is between some.
        """
        last = np.array(self.shape) - 1
        with np.errstate(over="ignore"):
            at = np.clip(np.nan_to_num(points) / self.cell - self.lower - 0.5, 0, last)
        low = at.astype(np.int64)
        ends, shares = (low, np.minimum(low + 1, last)), (1.0 - (at - low), at - low)
        corners = list(np.ndindex(2, 2, 2))
        cells = [np.ravel_multi_index([ends[c][:, k] for k, c in enumerate(corner)], self.shape) for corner in corners]
        weights = [np.prod([shares[c][:, k] for k, c in enumerate(corner)], axis=0) for corner in corners]
        return np.array(cells), np.array(weights)


@dataclass(frozen=True)
class Orientations:
    """Directions of the tool's z axis, and rolls about it."""

    directions: int
    rolls: int

    @property
    def count(self) -> int:
        """How many orientations."""
        return self.directions * self.rolls

    @cached_property
    def vectors(self) -> np.ndarray:
        """The directions (D, 3), unit vectors."""
        k = np.arange(self.directions)
        z, azimuth = 1.0 - (2.0 * k + 1.0) / self.directions, 2.0 * np.pi * ((k / GOLDEN) % 1.0)
        radius = np.sqrt(1.0 - z * z)
        return np.column_stack([radius * np.cos(azimuth), radius * np.sin(azimuth), z])

    @cached_property
    def angles(self) -> np.ndarray:
        """The roll angles (D, K) [rad]."""
        first = (np.arange(self.directions) * GOLDEN) % 1.0
        return 2.0 * np.pi * (np.arange(self.rolls) + first[:, None]) / self.rolls

    @cached_property
    def rotations(self) -> np.ndarray:
        """The rotations (D, K, 3, 3)."""
        s, c = np.sin(self.angles)[..., None], np.cos(self.angles)[..., None]
        x, y = (axis[:, None, :] for axis in _frames(self.vectors))
        z = np.broadcast_to(self.vectors[:, None, :], (self.directions, self.rolls, 3))
        return np.stack([c * x + s * y, c * y - s * x, z], axis=-1)

    def nearest(self, R: np.ndarray) -> np.ndarray:
        """Of rotations (N, 3, 3) the orientation (N,) with the nearest direction, and then the nearest roll."""
        R = _bounded(R)
        direction = np.asarray(self._tree.query(R[:, :, 2])[1])
        if self.rolls == 1:
            return direction
        steps = self._roll_steps(R, direction)
        return direction * self.rolls + np.rint(steps).astype(np.int64) % self.rolls

    def around(self, R: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The orientations around rotations (N, 3, 3), and their weights, both (M, N).

        The `AROUND` directions nearest to the z axis, by chords d_1 <= d_2 <= ... between unit vectors, weigh
        1 - (d_k / d_6)^2, which goes to zero where another takes the place of the last; and on each of them the two
        rolls next to that of the rotation weigh as in linear interpolation. Among so few directions or fewer it is the
        nearest orientation alone.
        """
        if self.directions <= AROUND:
            return self.nearest(R)[None], np.ones((1, len(R)))
        R = _bounded(R)
        chord, near = self._tree.query(R[:, :, 2], k=AROUND + 1)
        weights = 1.0 - (chord[:, :-1] / chord[:, -1:]).T ** 2
        weights /= np.maximum(weights.sum(axis=0), np.finfo(float).tiny)
        direction = near[:, :-1].T
        if self.rolls == 1:
            return direction, weights
        steps = np.array([self._roll_steps(R, each) for each in direction])
        low = np.floor(steps)
        rolls = np.stack([low, low + 1.0]).astype(np.int64) % self.rolls
        shares = np.stack([low + 1.0 - steps, steps - low])
        return (direction * self.rolls + rolls).reshape(-1, len(R)), (weights * shares).reshape(-1, len(R))

    def _roll_steps(self, R: np.ndarray, direction: np.ndarray) -> np.ndarray:
        """How many steps of a roll (N,) rotations (N, 3, 3) are beyond the first on directions (N,)."""
        vectors = self.vectors[direction]
        x, y = (axis[direction] for axis in self._axes)
        tool = R[:, :, 0] - (R[:, :, 0] * vectors).sum(axis=1)[:, None] * vectors
        angle = np.arctan2((tool * y).sum(axis=1), (tool * x).sum(axis=1))
        return (angle - self.angles[direction, 0]) * self.rolls / (2.0 * np.pi)

    @cached_property
    def _axes(self) -> tuple[np.ndarray, np.ndarray]:
        return _frames(self.vectors)

    @cached_property
    def _tree(self) -> Any:
        from scipy.spatial import KDTree  # not at the top: takes a while to load

        return KDTree(self.vectors)


def _bounded(R: np.ndarray) -> np.ndarray:
    """Rotations (N, 3, 3), and something finite where they are none."""
    return np.clip(np.nan_to_num(R), -1.0, 1.0)


def _frames(z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The x and y axes (D, 3) after the short rotation that takes z to each of unit vectors (D, 3), none of them -z."""
    a, b, c = z.T
    share = 1.0 / (1.0 + c)
    x = np.column_stack([1.0 - a * a * share, -a * b * share, -a])
    y = np.column_stack([-a * b * share, 1.0 - b * b * share, -b])
    return x, y
