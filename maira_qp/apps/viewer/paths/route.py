"""The poses that the arm is to run through, and how they are made from what a person gives."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Literal

import numpy as np

from maira_qp.errors import OptionError, shown
from maira_qp.orientation import pose_error
from maira_qp.paths import circle, length, polyline
from maira_qp.problem.pose import as_pose

MOST_POSES = 20_000
"""Of a path: where none of them is reached, this takes half a minute."""
MOST_CORNERS = 200
LEAST_SPACING = 1e-3
"""[m]"""
SAME = 1e-9
"""Poses no further apart than this [m and rad] are one."""

Kind = Literal["corners", "circle", "file"]


@dataclass(frozen=True, eq=False)
class Route:
    """What a person gives, and the poses that are made of it; empty to begin with."""

    kind: Kind = "corners"
    given: np.ndarray = field(default_factory=lambda: np.empty((0, 4, 4)))
    """(M, 4, 4) corners, the pose of the circle's centre, or all poses of a file"""
    spacing: float = 0.005
    """Largest distance between neighbours on lines and circles [m], at least `LEAST_SPACING`"""
    is_closed: bool = False
    """It ends at the pose where it begins, by a straight line if it has to"""
    radius: float = 0.0
    """Of the circle [m]"""
    file: str = ""
    """Name of the file"""

    def __len__(self) -> int:
        return len(self.poses)

    @cached_property
    def poses(self) -> np.ndarray:
        """The path (N, 4, 4), N = 0 if nothing is given. Raises `OptionError` if it is too long."""
        if not len(self.given) or self.kind == "file":
            poses = self.given
        elif self.kind == "circle":
            poses = circle(self.given[0], self.radius, step=self.spacing)
        else:
            _check_count(length(self.given) / self.spacing)
            poses = polyline(self.given, step=self.spacing)
        if self.is_closed and len(poses) and not _is_same(poses[-1], poses[0]):
            poses = np.concatenate([poses, polyline(poses[[-1, 0]], step=self.spacing)[1:]])
        _check_count(len(poses))
        return poses

    def with_corner(self, T: np.ndarray) -> Route:
        """A straight line more, to a pose (4, 4); what was no path of corners is replaced. Raises `OptionError`."""
        known = self.given if self.kind == "corners" else self.given[:0]
        if len(known) >= MOST_CORNERS:
            raise OptionError(f"a path in the viewer has at most {MOST_CORNERS} corners: load a file")
        return self._with("corners", np.concatenate([known, T[None]]))

    def without_last(self) -> Route:
        """The last corner is taken back, if there is one."""
        return replace(self, given=self.given[:-1]) if self.kind == "corners" else self

    def cleared(self) -> Route:
        """Nothing is given."""
        return self._with("corners", self.given[:0])

    def with_circle(self, center: np.ndarray, radius: float, largest: float) -> Route:
        """A circle in the xy-plane of a pose (4, 4) instead. Raises `OptionError` unless 0 < radius <= largest [m]."""
        if not 0.0 < radius <= largest:
            raise OptionError(f"the radius must be positive and at most {largest:.3g} m, got {shown(radius)}")
        return replace(self._with("circle", as_pose(center).homogeneous[None]), radius=radius)

    def with_file(self, name: str, poses: np.ndarray) -> Route:
        """The poses (N, 4, 4) of a file instead."""
        return replace(self._with("file", poses), file=name)

    def spaced(self, spacing: float) -> Route:
        """With other distances [m]. Raises `OptionError`."""
        if not LEAST_SPACING <= spacing < np.inf:
            raise OptionError(f"the spacing must be at least {1e3 * LEAST_SPACING:g} mm, got {1e3 * spacing:g} mm")
        return replace(self, spacing=spacing)

    def closed(self, wanted: bool) -> Route:
        """Whether it ends where it begins."""
        return replace(self, is_closed=wanted)

    def _with(self, kind: Kind, given: np.ndarray) -> Route:
        return Route(kind, given, self.spacing, self.is_closed)


def _is_same(first: np.ndarray, second: np.ndarray) -> bool:
    return bool(np.abs(pose_error(as_pose(first), as_pose(second))).max() < SAME)


def _check_count(count: float) -> None:
    if count > MOST_POSES:
        raise OptionError(
            f"the path has {count:.0f} poses, and the viewer follows at most {MOST_POSES}: choose a larger spacing"
        )
