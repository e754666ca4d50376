"""Poses at even times: straight moves with trapezoidal speed, or at times that are given.

A move takes w seconds at full speed, and its acceleration A is in units of full speed [1/s]. Its speed rises evenly to
the peak `v = min(1, sqrt(w A))` in `r = v / A` seconds, stays, and falls to 0 in as many: it takes `T = w / v + r`
seconds (Lynch and Park, "Modern robotics", 2017, section 9.2.2.2). T is lengthened to a whole number of dt, which keeps
the limits.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from maira_qp.arrays import real_array
from maira_qp.errors import OptionError
from maira_qp.paths.arguments import checked_poses, finite_positive, flag, positive
from maira_qp.paths.interpolation import angles, distances, interpolate
from maira_qp.paths.sampling import along, distinct, intervals, placed

SPEED = 0.25
"""Default of `speed` [m/s]."""
ANGULAR_SPEED = 1.0
"""Default of `angular_speed` [rad/s]."""


def waypoints(
    poses: Any,
    dt: float,
    *,
    times: Any = None,
    speed: float | None = None,
    angular_speed: float | None = None,
    acceleration: float | None = None,
    angular_acceleration: float | None = None,
    stop: bool = True,
    frame: Any = None,
) -> np.ndarray:
    """Sample moves through poses at times dt apart, on straight lines with slerp: poses (M, 4, 4).

    Args:
        poses: (N, 4, 4), N >= 1.
        dt: time from a pose to the next [s], > 0.
        times: when each pose is reached, (N,) [s], increasing; speeds and accelerations must be left out. The last
            pose is held until a whole number of dt is over.
        speed, angular_speed: largest ones [m/s], [rad/s], > 0; None: 0.25 m/s and 1 rad/s.
        acceleration, angular_acceleration: largest ones [m/s^2], [rad/s^2], > 0; None: full speed at once.
        stop: come to rest at every pose, and reach each exactly; else only at the ends. A corner is then taken at
            speed, and accelerations are those along the path: round it by `polyline(..., blend=...)` before.
        frame: see `maira_qp.paths`.

    Raises `PoseError`, `OptionError`.
    """
    path = checked_poses(poses)
    dt = finite_positive(dt, "dt", "seconds")
    limits = {
        "speed": speed,
        "angular_speed": angular_speed,
        "acceleration": acceleration,
        "angular_acceleration": angular_acceleration,
    }
    stop = flag(stop, "stop")
    if times is not None:
        given = [name for name, value in limits.items() if value is not None]
        if given:
            raise OptionError(f"either times or {', '.join(given)}: times say how fast each move is")
        return placed(interpolate(path, _at_times(times, len(path), dt)), frame)

    full = (
        finite_positive(SPEED if speed is None else speed, "speed", "m/s"),
        finite_positive(ANGULAR_SPEED if angular_speed is None else angular_speed, "angular_speed", "rad/s"),
    )
    rates = (
        math.inf if acceleration is None else positive(acceleration, "acceleration", "m/s^2"),
        math.inf if angular_acceleration is None else positive(angular_acceleration, "angular_acceleration", "rad/s^2"),
    )
    path, durations = distinct(path, full)
    if len(path) == 1:
        return placed(path, frame)
    with np.errstate(divide="ignore"):
        growth = durations * np.minimum(rates[0] / distances(path), rates[1] / angles(path))
    if stop:
        return placed(interpolate(path, _trapezoids(durations, growth, dt)), frame)
    reached = np.concatenate([[0.0], np.cumsum(durations)])
    travelled = reached[-1] * _trapezoids(reached[-1:], growth.min(keepdims=True), dt)
    return placed(interpolate(path, np.interp(travelled, reached, np.arange(len(path)))), frame)


def _trapezoids(durations: np.ndarray, growth: np.ndarray, dt: float) -> np.ndarray:
    """Places at times dt apart on N moves, of which move i leads from i to i + 1.

    durations: w (N,) [s]; growth: A (N,) [1/s].
    """
    peak = np.minimum(1.0, np.sqrt(durations * growth))
    ramp = peak / growth
    cruise = durations / peak  # T without one of the ramps
    at = along(intervals((cruise + ramp) / dt))
    move = np.minimum(at.astype(np.int64), len(durations) - 1)
    cruise, ramp = cruise[move], ramp[move]
    time = (at - move) * (cruise + ramp)
    left = cruise + ramp - time
    bends = np.maximum(ramp - time, 0.0) ** 2 - np.maximum(ramp - left, 0.0) ** 2
    passed = time - ramp / 2 + bends / np.where(ramp > 0.0, 2.0 * ramp, 1.0)
    return move + np.clip(passed / cruise, 0.0, 1.0)


def _at_times(times: Any, count: int, dt: float) -> np.ndarray:
    """Places on the path at even times, given when each of its poses is reached. Raises `OptionError`."""
    moments = real_array(times, (count,), "times", OptionError)
    for i in np.flatnonzero(np.diff(moments) <= 0.0)[:1]:
        raise OptionError(f"times must increase: times[{i + 1}] = {moments[i + 1]:g} comes after {moments[i]:g}")
    total = moments[-1:] - moments[0]
    even = moments[0] + dt * np.arange(int(intervals(total / dt)[0]) + 1)
    return np.interp(even, moments, np.arange(count))
