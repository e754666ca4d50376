"""Curves in a plane and about an axis: arc, circle, spiral."""

from __future__ import annotations

from typing import Any

import numpy as np

from maira_qp.errors import OptionError, PoseError
from maira_qp.paths.arguments import checked_pose, finite, finite_positive, flag, with_rotations
from maira_qp.paths.interpolation import angles, interpolate
from maira_qp.paths.sampling import STEP, TURN, along, checked_spacing, intervals, placed

STRAIGHT = 1e-9
"""Sine of the angle between two chords below which no circle is told from a line."""
CELLS = 1024
"""Parts of a spiral, equal in angle, within each of which its poses are evenly spaced."""


def arc(start: Any, via: Any, end: Any, *, step: float = STEP, turn: float = TURN, frame: Any = None) -> np.ndarray:
    """Make the arc of a circle from a pose through another to a third: poses (N, 4, 4), `via` among them.

    The orientation goes by slerp from `start` to `via` and from there to `end`, evenly with the angle of the arc.
    `step`, `turn`, `frame`: see `maira_qp.paths`. Raises `PoseError` if no one circle runs through the three
    positions, `OptionError`.
    """
    spacing = checked_spacing(step, turn)
    poses = np.array([checked_pose(start, "start"), checked_pose(via, "via"), checked_pose(end, "end")])
    p = poses[:, :3, 3]
    to_via, to_end, onward = p[1] - p[0], p[2] - p[0], p[2] - p[1]
    a, b, c = map(np.linalg.norm, (to_via, to_end, onward))
    if not min(a, b, c) > 0.0:
        raise PoseError("start, via and end must be three positions; for a whole circle: circle(center, radius)")
    to_via, to_end, onward = to_via / a, to_end / b, onward / c
    normal = np.cross(to_via, to_end)
    if not min(np.linalg.norm(normal), np.linalg.norm(np.cross(to_via, onward))) > STRAIGHT:
        raise PoseError("start, via and end lie on a line, through which no circle runs; use line or polyline")
    normal /= np.linalg.norm(normal)
    at_start, at_end = _angle(to_via, to_end), _angle(to_end, onward)
    # an arc is twice the angle that it is seen under from another point of its circle (Euclid, Elements, III.20)
    swept = 2.0 * np.array([at_end, at_start])
    diameter = a / np.sin(at_end)
    tangent = np.cos(at_end) * to_via - np.sin(at_end) * np.cross(normal, to_via)
    inward = np.cross(normal, tangent)

    step, turn = spacing
    at = along(intervals(np.max([diameter / 2 * swept / step, swept / turn, angles(poses) / turn], axis=0)))
    path = interpolate(poses, at)
    half = np.interp(at, [0.0, 1.0, 2.0], np.concatenate([[0.0], np.cumsum(swept)])) / 2
    inner = (at != 0.0) & (at != 1.0) & (at != 2.0)
    chord = diameter * np.sin(half)[:, None]
    on_circle = p[0] + chord * (np.cos(half)[:, None] * tangent + np.sin(half)[:, None] * inward)
    path[inner, :3, 3] = on_circle[inner]
    return placed(path, frame)


def circle(
    center: Any,
    radius: float,
    *,
    turns: float = 1.0,
    start_angle: float = 0.0,
    tangent: bool = False,
    step: float = STEP,
    turn: float = TURN,
    frame: Any = None,
) -> np.ndarray:
    """Make a circle in the xy-plane of a pose: poses (N, 4, 4), evenly spaced.

    Args:
        center: pose of its centre.
        radius: [m], > 0.
        turns: how often it runs round, counterclockwise about z, clockwise if negative; parts of a turn are allowed.
        start_angle: where it begins, from x toward y [rad].
        tangent: the tool turns with the circle, its x-axis along the motion; else it keeps the orientation of `center`.
        step, turn, frame: see `maira_qp.paths`.

    Raises `PoseError`, `OptionError`.
    """
    radius = finite_positive(radius, "radius", "metres")
    return spiral(
        center,
        radius,
        radius,
        turns=turns,
        start_angle=start_angle,
        tangent=tangent,
        step=step,
        turn=turn,
        frame=frame,
    )


def spiral(
    center: Any,
    start_radius: float,
    end_radius: float,
    *,
    turns: float = 1.0,
    pitch: float = 0.0,
    start_angle: float = 0.0,
    tangent: bool = False,
    step: float = STEP,
    turn: float = TURN,
    frame: Any = None,
) -> np.ndarray:
    """Make a spiral about the z-axis of a pose: poses (N, 4, 4), evenly spaced where `step` decides.

    Archimedean, the radius and the height change evenly with the angle: with equal radii it is a helix, without
    pitch it lies in the xy-plane.

    Args:
        center: pose of its centre, at the height of its beginning.
        start_radius, end_radius: [m], >= 0, not both 0.
        turns: whole or part turns, counterclockwise about z, clockwise if negative; not 0.
        pitch: rise along z in a turn [m].
        start_angle: where it begins, from x toward y [rad].
        tangent: the tool turns with the angle, its x-axis at right angles to the radius, in the direction of motion;
            else it keeps the orientation of `center`.
        step, turn, frame: see `maira_qp.paths`.

    Raises `PoseError`, `OptionError`.
    """
    T = checked_pose(center, "center")
    first = finite(start_radius, "start_radius", "metres", least=0.0)
    last = finite(end_radius, "end_radius", "metres", least=0.0)
    turns = finite(turns, "turns", "turns")
    if turns == 0.0 or first == last == 0.0:
        raise OptionError("turns must not be 0, nor both radii: it would be no curve")
    rise, begin = finite(pitch, "pitch", "metres") * abs(turns), finite(start_angle, "start_angle", "radians")
    tangent = flag(tangent, "tangent")
    step, turn = checked_spacing(step, turn)

    swept = 2.0 * np.pi * turns
    # a cell is as long as at its greater radius, so that no two neighbours are farther apart than they may be
    nodes = np.linspace(0.0, 1.0, CELLS + 1)
    radii = first + (last - first) * nodes
    speeds = np.linalg.norm(np.broadcast_arrays(swept * np.maximum(radii[:-1], radii[1:]), last - first, rise), axis=0)
    reached = np.concatenate([[0.0], np.cumsum(np.maximum(speeds / step, abs(swept) / turn) / CELLS)])
    count = int(intervals(reached[-1:])[0])
    u = np.interp(np.linspace(0.0, reached[-1], count + 1), reached, nodes)

    angle, radius = begin + swept * u, (1.0 - u) * first + u * last
    cos, sin = np.cos(angle), np.sin(angle)
    R = np.broadcast_to(np.eye(3), (len(u), 3, 3)).copy()
    if tangent:
        ahead = np.sign(turns)
        R[:, 0, 0], R[:, 1, 0] = -ahead * sin, ahead * cos
        R[:, 0, 1], R[:, 1, 1] = -ahead * cos, -ahead * sin
    return placed(T @ with_rotations(np.stack([radius * cos, radius * sin, rise * u], axis=1), R), frame)


def _angle(a: np.ndarray, b: np.ndarray) -> float:
    """Between two unit vectors (3,) [rad], exact at both ends of the range."""
    return float(np.arctan2(np.linalg.norm(np.cross(a, b)), a @ b))
