"""Straight lines with slerp, and corners rounded by parabolas: line, polyline, rectangle, square, cube.

A blend begins a distance d before the corner c, at the pose a, and ends d behind it, at b. Between them runs the
quadratic Bézier curve of a, c and b by de Casteljau's construction, positions on lines and orientations by slerp:

    B(s) = between(between(a, c, s), between(c, b, s), s),  0 <= s <= 1.

Its position is a parabola inside the triangle (a, c, b), so no farther than d from c. At s = 0 it moves and turns
as the leg before the corner does, and at s = 1 as the leg behind it: the path is C1 in position and orientation
(linear segments with parabolic blends: Craig, "Introduction to robotics", section 7.3; Bézier curves of rotations:
Shoemake, "Animating rotation with quaternion curves", 1985, section 4).
"""

from __future__ import annotations

from typing import Any

import numpy as np

from maira_qp.errors import OptionError
from maira_qp.paths.arguments import checked_pose, checked_poses, finite, finite_positive, with_rotations
from maira_qp.paths.interpolation import angles, between, distances, interpolate
from maira_qp.paths.sampling import ROUNDING, STEP, TURN, along, checked_spacing, distinct, intervals, placed

EDGES_OF_CUBE = (0, 1, 3, 2, 0, 4, 5, 7, 6, 4, 5, 1, 3, 7, 6, 2)
"""Corners in order; bit k of a corner is its side in axis k. All edges, three of them twice, as on any walk."""


def line(start: Any, end: Any, *, step: float = STEP, turn: float = TURN, frame: Any = None) -> np.ndarray:
    """Make a straight line from pose to pose, the orientation by slerp: poses (N, 4, 4), evenly spaced.

    Args:
        start, end: the poses at its ends; from a pose to itself it is that pose.
        step, turn, frame: see `maira_qp.paths`.

    Raises `PoseError`, `OptionError`.
    """
    ends = np.array([checked_pose(start, "start"), checked_pose(end, "end")])
    return polyline(ends, step=step, turn=turn, frame=frame)


def polyline(
    poses: Any, *, blend: float = 0.0, step: float = STEP, turn: float = TURN, frame: Any = None
) -> np.ndarray:
    """Make straight lines through poses, with rounded corners: poses (M, 4, 4).

    Args:
        poses: (N, 4, 4), N >= 1; repeated ones count once.
        blend: how far before and behind each corner its parabola begins and ends [m]; 0: the path goes through every
            pose. Where the tool turns on the spot, the path goes through the pose.
        step, turn, frame: see `maira_qp.paths`.

    Each line and each blend is divided evenly. Raises `PoseError`, `OptionError` if two blends do not fit on a leg.
    """
    spacing = checked_spacing(step, turn)
    blend = finite(blend, "blend", "metres", least=0.0)
    path, costs = distinct(checked_poses(poses), spacing)
    if len(path) < 3 or blend == 0.0:
        return placed(interpolate(path, along(intervals(costs))), frame)
    return placed(_blended(path, costs, blend, spacing), frame)


def rectangle(
    center: Any,
    width: float,
    height: float,
    *,
    blend: float = 0.0,
    step: float = STEP,
    turn: float = TURN,
    frame: Any = None,
) -> np.ndarray:
    """Make a rectangle in the xy-plane of a pose, whose orientation the tool keeps: poses (N, 4, 4).

    Args:
        center: pose of its centre.
        width, height: sides along x and y [m], > 0.
        blend, step, turn, frame: as for `polyline`.

    It begins and ends in the middle of the side at -y and goes counterclockwise about z.
    Raises `PoseError`, `OptionError`.
    """
    T = checked_pose(center, "center")
    x, y = finite_positive(width, "width", "metres") / 2, finite_positive(height, "height", "metres") / 2
    corners = np.array([(0, -y, 0), (x, -y, 0), (x, y, 0), (-x, y, 0), (-x, -y, 0), (0, -y, 0)])
    return polyline(T @ with_rotations(corners, np.eye(3)), blend=blend, step=step, turn=turn, frame=frame)


def square(
    center: Any, side: float, *, blend: float = 0.0, step: float = STEP, turn: float = TURN, frame: Any = None
) -> np.ndarray:
    """Make a square in the xy-plane of a pose: poses (N, 4, 4), as those of `rectangle`.

    Args:
        center: pose of its centre.
        side: length of its sides [m], > 0.
        blend, step, turn, frame: as for `polyline`.

    Raises `PoseError`, `OptionError`.
    """
    side = finite_positive(side, "side", "metres")
    return rectangle(center, side, side, blend=blend, step=step, turn=turn, frame=frame)


def cube(
    center: Any,
    edge: float,
    *,
    tilt: float = 0.3,
    blend: float = 0.0,
    step: float = STEP,
    turn: float = TURN,
    frame: Any = None,
) -> np.ndarray:
    """Make moves along all edges of a cube, the orientation another at each corner: poses (N, 4, 4).

    Args:
        center: pose of its centre; the edges are along its axes.
        edge: their length [m], > 0.
        tilt: rotation of the tool at each corner about the diagonal through that corner, against `center` [rad].
        blend, step, turn, frame: as for `polyline`.

    Raises `PoseError`, `OptionError`.
    """
    from scipy.spatial.transform import Rotation  # not at the top: takes a while to load

    T = checked_pose(center, "center")
    sides = 2.0 * (np.array(EDGES_OF_CUBE)[:, None] >> np.arange(3) & 1) - 1.0
    R = Rotation.from_rotvec(finite(tilt, "tilt", "radians") / np.sqrt(3.0) * sides).as_matrix()
    corners = with_rotations(finite_positive(edge, "edge", "metres") / 2 * sides, R)
    return polyline(T @ corners, blend=blend, step=step, turn=turn, frame=frame)


def _blended(path: np.ndarray, costs: np.ndarray, blend: float, spacing: tuple[float, float]) -> np.ndarray:
    """The polyline through N >= 3 distinct poses with its corners rounded; `costs` (N - 1,) are those of the legs.

    Pieces are numbered along the path: leg i is piece 2 i, and the blend at pose i is piece 2 i - 1.
    """
    legs, turns = distances(path), angles(path)
    zones = np.zeros(len(path))
    zones[1:-1] = np.where((legs[:-1] > 0.0) & (legs[1:] > 0.0), blend, 0.0)
    _check_fit(legs, zones)
    whole = np.where(legs > 0.0, legs, 1.0)
    before, behind = zones[1:] / whole, zones[:-1] / whole  # of each leg, the parts that belong to blends
    straight = np.maximum(1.0 - before - behind, 0.0)

    pieces = np.empty(2 * len(legs) - 1)
    pieces[::2] = straight * costs
    angle = np.maximum(before[:-1] * turns[:-1], behind[1:] * turns[1:])
    fastest = angle * (1.0 + 1.0 / np.cos(angle / 4))  # of B(s): the Jacobi field between two turning orientations
    pieces[1::2] = np.maximum(2.0 * zones[1:-1] / spacing[0], fastest / spacing[1])
    at = along(intervals(pieces))

    piece = np.minimum(at.astype(np.int64), len(pieces) - 1)
    u, leg = at - piece, piece // 2
    on_leg = leg + behind[leg] + u * straight[leg]
    corner = np.minimum(leg + 1, len(legs) - 1)
    is_blend = piece % 2 == 1
    first = np.where(is_blend, corner - (1.0 - u) * before[corner - 1], on_leg)
    first[-1] = len(legs)
    T = interpolate(path, first)
    u, second = u[is_blend], (corner + u * behind[corner])[is_blend]
    T[is_blend] = between(T[is_blend], interpolate(path, second), u)
    return T


def _check_fit(legs: np.ndarray, zones: np.ndarray) -> None:
    """Raises `OptionError` where the blends of zones (N,) do not fit on the legs (N - 1,)."""
    needed = zones[:-1] + zones[1:]
    for i in np.flatnonzero(needed > legs * (1.0 + ROUNDING))[:1]:
        largest = legs[i] * zones.max() / needed[i]
        raise OptionError(
            f"a blend of {zones.max():g} m does not fit on leg {i}, {legs[i]:.6g} m long: at most {largest:.6g} m do"
        )
