"""Time a path: how fast its curve is run through from rest to rest, within limits of speed, acceleration and jerk.

Without a limit of the jerk by toppra, which is time-optimal: the speed along the curve is as large as the limits allow
at every place of a grid. With one by ruckig, which takes the whole curve as one axis: constants of speed, acceleration
and jerk along it that no joint's limits are exceeded with anywhere,

    |q'| v <= velocity,   |q''| v^2 + |q'| a <= acceleration,   |q'''| v^3 + 3 |q''| v a + |q'| j <= jerk,

on two curves: over the joints' distance, and over toppra's time, on which what must be slow is long; the quicker one
is taken; the second, where the tool's speed is to be constant. Either law is then stretched by the factor by which the
limits, looked at densely, are exceeded or not used up.

Sources: Pham and Pham, "A new approach to time-optimal path parameterization based on reachability analysis", 2018;
Berscheid and Kroeger, "Jerk-limited real-time trajectory generation with arbitrary target states", 2021.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from importlib import import_module
from typing import Any

import numpy as np
from scipy.interpolate import CubicHermiteSpline, PPoly

from maira_qp.arrays import is_number
from maira_qp.errors import OptionError, shown
from maira_qp.results.answer import Origin
from maira_qp.results.path_solution import PathSolution
from maira_qp.results.trajectory import Deviation, MotionLimits, Trajectory
from maira_qp.robots.model.joint_values import joint_values
from maira_qp.robots.model.robot import Robot
from maira_qp.solvers.paths.curve import curve_through, deviations, distances, knots_of

GRID = 3_000
"""So many places along a curve at least at which speeds are chosen, and limits looked at."""
CELLS = 3
"""So many of them at least between two poses of a short path."""
LONG = 30_000
"""On a long path: about so many places, and one between two poses."""
BLOCK = 50_000
"""So many places are looked at together, which bounds the memory."""
WITHIN = np.array([1e-6, 0.25, 0.5, 0.75, 1.0 - 1e-6])
"""Where limits are looked at between two places: at both ends, where accelerations jump, from inside."""
MARGIN = 1.0 + 1e-6
"""So much slower than what was looked at needs: limits may be nearer to be exceeded in between."""
MOST_SAMPLES = 10_000_000
"""Of one trajectory."""
LARGEST = 1e100
"""Limits beyond it are as good as none, and too large to compute with."""
ROUNDS = 20
"""How often a trajectory is made slower until its samples keep the limits."""


@dataclass(frozen=True, eq=False)
class Motion:
    """A curve that is run through by a law: the place u on it over time."""

    curve: CubicHermiteSpline
    law: PPoly
    limits: MotionLimits
    robot: Robot

    @property
    def duration(self) -> float:
        """[s]"""
        return float(self.law.x[-1])

    def slower(self, factor: float) -> Motion:
        """The same in `factor` times the time."""
        powers = float(factor) ** -np.arange(len(self.law.c) - 1, -1, -1)
        return Motion(self.curve, PPoly(self.law.c * powers[:, None], self.law.x * factor), self.limits, self.robot)

    def derivatives(self, t: np.ndarray) -> list[np.ndarray]:
        """q, velocity, acceleration and jerk (M, n) at times (M,), by the chain rule."""
        place, v, a, j = (self.law(t, k)[:, None] for k in range(4))
        place = np.clip(place[:, 0], self.curve.x[0], self.curve.x[-1])
        q, q1, q2, q3 = (self.curve(place, k) for k in range(4))
        return [q, q1 * v, q2 * v**2 + q1 * a, q3 * v**3 + 3.0 * q2 * v * a + q1 * j]

    def excess(self) -> float:
        """How many times slower it must be to keep the limits; below 1: how much quicker it may be."""
        ends = _divided(self.law.x, _parts(CELLS * len(self.curve.x), len(self.law.c[0])))
        blocks = np.array_split(np.arange(len(ends) - 1), math.ceil(len(ends) / BLOCK))
        times = ((ends[cells, None] + WITHIN * np.diff(ends)[cells, None]).ravel() for cells in blocks)
        return max(excess(self.robot, self.limits, *self.derivatives(t)) for t in times)

    @cached_property
    def places(self) -> tuple[np.ndarray, np.ndarray]:
        """Times and places, dense and increasing."""
        t = _divided(self.law.x, _parts(8 * len(self.curve.x), len(self.law.c[0])))
        return t, np.maximum.accumulate(self.law(t))

    def time_at(self, place: Any) -> np.ndarray:
        """When it passes a place, or places."""
        t, u = self.places
        return np.interp(place, u, t)


def excess(
    robot: Robot, limits: MotionLimits, q: np.ndarray, v: np.ndarray, a: np.ndarray, j: np.ndarray | None
) -> float:
    """By what factor a motion through samples (M, n) must be slower to keep the limits of speed and above."""
    factors = [(np.abs(v) / limits.velocity).max(), np.sqrt((np.abs(a) / limits.acceleration).max())]
    if limits.jerk is not None and j is not None:
        factors.append(np.cbrt((np.abs(j) / limits.jerk).max()))
    if limits.tool_speed is not None:
        factors.append(tool_speeds(robot, q, v).max() / limits.tool_speed)
    return float(max(factors))


def tool_speeds(robot: Robot, q: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Speeds (M,) of the tool's origin [m/s] at configurations and velocities (M, n)."""
    return np.linalg.norm((robot.jacobians(q)[:, :3] @ v[:, :, None])[:, :, 0], axis=1)


def timed(
    path: PathSolution,
    origin: Origin,
    *,
    velocity: Any,
    acceleration: Any,
    jerk: Any,
    dt: Any,
    tool_speed: Any,
    longest_part: bool,
) -> Trajectory:
    """See `PathSolution.timed`."""
    limits = _limits(origin.problem.robot, velocity, acceleration, jerk, tool_speed)
    if not is_number(dt) or not 0 < dt < np.inf:
        raise OptionError(f"dt must be a positive number of seconds, got {shown(dt)}")
    part, robot = _part(path, longest_part), origin.problem.robot
    q = path.q[part]
    gone = distances(robot, q)
    kept = knots_of(gone)
    if len(kept) == 1:
        return _at_rest(q, part.start, limits, origin)
    _check_count(float((np.abs(np.diff(q, axis=0)).sum(axis=0) / limits.velocity).max()), float(dt))
    motion = _quickest(robot, limits, gone[kept], q[kept])
    motion = _on_samples(motion, float(dt))
    return _trajectory(motion, float(dt), np.interp(gone, gone[kept], motion.curve.x), part.start, origin)


def _limits(robot: Robot, velocity: Any, acceleration: Any, jerk: Any, tool_speed: Any) -> MotionLimits:
    """The limits, checked. Raises `OptionError`."""
    limited = robot.limited(velocity=velocity, acceleration=acceleration)
    for name in ("velocity", "acceleration"):
        for i in np.flatnonzero(np.isinf(getattr(limited, f"{name}_limit"))):
            raise OptionError(
                f"the robot has no limit of the {name} of {robot.joint_names[i]!r}",
                python=f"give timed({name}=...), a number, one for each joint, or {{joint name: value}}",
                shell=f"give --{name}, one for all joints or one each",
            )
    if jerk is not None:
        jerk = joint_values(robot.joint_names, jerk, "jerk", np.full(robot.n, np.inf))
        if not (jerk > 0.0).all():
            raise OptionError(f"jerk must be positive, got {shown(jerk.tolist())}")
        jerk = None if np.isinf(jerk).all() else np.minimum(jerk, LARGEST)
    if tool_speed is not None and (not is_number(tool_speed) or not 0 < tool_speed < np.inf):
        raise OptionError(f"tool_speed must be a positive number [m/s], got {shown(tool_speed)}")
    speed = None if tool_speed is None else float(tool_speed)
    fastest, change = np.minimum([limited.velocity_limit, limited.acceleration_limit], LARGEST)
    return MotionLimits(robot.lower, robot.upper, fastest, change, jerk, speed)


def _part(path: PathSolution, longest_part: bool) -> slice:
    """The poses to be timed. Raises `OptionError`."""
    parts = [slice(*part) for part in path.parts]
    if not parts:
        raise OptionError("there is nothing to time: the path has no pose that is reached")
    if not longest_part and (len(parts) > 1 or parts[0] != slice(0, len(path))):
        if path.first_failure is None:
            what = f"the path has a reconfiguration before pose {int(path.breaks[0])}, at which the arm leaves it"
        else:
            what = f"the path is not followed beyond pose {path.first_failure}: {path.reason}"
        raise OptionError(f"{what}; timed(..., longest_part=True) times the longest part without such a place")
    return max(parts, key=lambda each: each.stop - each.start)


def _quickest(robot: Robot, limits: MotionLimits, u: np.ndarray, q: np.ndarray) -> Motion:
    """The motion through configurations (K, n) at places (K,) that keeps all limits."""
    motion = _by_toppra(robot, limits, u, q)
    if limits.jerk is None:
        return motion
    time = motion.time_at(motion.curve.x)
    clocks = (u, time) if limits.tool_speed is None else (time,)  # on toppra's time the tool's speed is constant
    return min((_by_ruckig(robot, limits, limits.jerk, clock, q) for clock in clocks), key=lambda each: each.duration)


def _by_toppra(robot: Robot, limits: MotionLimits, u: np.ndarray, q: np.ndarray) -> Motion:
    """Time-optimal on a grid of places, then stretched until the limits hold between these too.

    toppra's tolerances are absolute: it is given a curve of length 1 that takes about a second, accelerations up to 1.
    """
    toppra = _module("toppra")
    u = u / u[-1]
    curve = curve_through(u, q, robot)
    grid = _divided(u, _parts(min(CELLS * len(u), LONG), len(u) - 1))
    speeds = np.abs(curve(grid, 1))
    second = float((speeds / limits.velocity).max())  # the time unit: the quickest at constant speed
    second = max(second, float(np.sqrt((speeds / limits.acceleration).max())))
    unit = limits.acceleration * second**2
    rates, changes = limits.velocity * second / unit, np.ones(robot.n)
    constraints = [
        toppra.constraint.JointVelocityConstraint(np.column_stack([-rates, rates])),
        toppra.constraint.JointAccelerationConstraint(np.column_stack([-changes, changes])),
    ]
    if limits.tool_speed is not None:
        largest = limits.tool_speed * second / np.maximum(tool_speeds(robot, curve(grid), curve(grid, 1)), 1e-12)
        constraints.append(_largest_speeds(toppra, largest))
    program = toppra.algorithm.TOPPRA(constraints, _Path(curve, unit), gridpoints=grid, solver_wrapper="seidel")
    program.compute_parameterization(0.0, 0.0)
    v = program.problem_data.sd_vec
    if v is None or not np.isfinite(v).all() or not (v[1:] + v[:-1] > 0.0).all():
        raise OptionError("toppra finds no timing of this path; larger limits, or poses that lie closer, may have one")
    cells = np.diff(grid)
    times = np.concatenate([[0.0], (2.0 * cells / (v[1:] + v[:-1])).cumsum()])
    law = PPoly(np.array([0.5 * np.diff(v) / np.diff(times), v[:-1], grid[:-1]]), times)
    motion = Motion(curve, law, limits, robot).slower(second)
    return motion.slower(MARGIN * motion.excess())


class _Path:
    """A curve as toppra asks for it, each joint in a unit (n,) of its own."""

    def __init__(self, curve: CubicHermiteSpline, unit: np.ndarray) -> None:
        self.curve, self.unit, self.path_interval, self.dof = curve, unit, curve.x[[0, -1]], len(unit)

    def __call__(self, places: np.ndarray, order: int = 0) -> np.ndarray:
        return self.curve(places, order) / self.unit


def _largest_speeds(toppra: Any, largest: np.ndarray) -> Any:
    """toppra's constraint on the speeds along a curve at the places of a grid (G,)."""
    constraint = toppra.constraint.LinearConstraint()
    bounds = np.column_stack([np.zeros(len(largest)), largest**2])
    constraint.compute_constraint_params = lambda *_: (None, None, None, None, None, None, bounds)
    return constraint


def _by_ruckig(robot: Robot, limits: MotionLimits, jerk: np.ndarray, u: np.ndarray, q: np.ndarray) -> Motion:
    """One law for all of a curve through configurations (K, n) at places (K,), stretched to use the limits up.

    As toppra, ruckig is given a curve of length 1 that takes about a second.
    """
    ruckig, u = _module("ruckig"), u / u[-1]
    curve = curve_through(u, q, robot)
    places = (u[:-1, None] + WITHIN * np.diff(u)[:, None]).ravel()
    with np.errstate(divide="ignore"):
        one, two, three = (1.0 / np.abs(curve(places, k)).max(axis=0) for k in (1, 2, 3))
    fast, change = limits.velocity, limits.acceleration
    v = min((fast * one).min(), np.sqrt((change * two / 2.0).min()), np.cbrt((jerk * three / 3.0).min()))
    a = min((change * one / 2.0).min(), (jerk * two / (9.0 * v)).min())
    j = float((jerk * one / 3.0).min())
    second = max(1.0 / v, a**-0.5, j ** (-1.0 / 3.0))
    asked = ruckig.InputParameter(1)
    asked.target_position, asked.max_velocity = [1.0], [v * second]
    asked.max_acceleration, asked.max_jerk = [a * second**2], [j * second**3]
    found = ruckig.Trajectory(1)
    try:
        ruckig.Ruckig(1).calculate(asked, found)
    except ruckig.RuckigError:
        raise OptionError(
            "the limits are too far apart to be timed with: look at velocity, acceleration, jerk"
        ) from None
    profile = found.profiles[0][0]
    times = np.concatenate([[0.0], np.cumsum(profile.t)])
    phases = np.flatnonzero(np.diff(times) > 0.0)
    c = np.array([np.divide(profile.j, 6.0), np.divide(profile.a[:7], 2.0), profile.v[:7], profile.p[:7]])
    law = PPoly(c[:, phases], np.append(times[phases], times[-1]))
    motion = Motion(curve, law, limits, robot).slower(second)
    return motion.slower(MARGIN * motion.excess())


def _on_samples(motion: Motion, dt: float) -> Motion:
    """The motion, slowed down to last a multiple of dt, and until its samples keep the limits."""
    for _ in range(ROUNDS):
        _check_count(motion.duration, dt)
        count = np.ceil(motion.duration / dt * (1.0 - 1e-12))
        motion = motion.slower(max(count * dt / motion.duration, 1.0))
        samples = motion.derivatives(np.arange(count + 1) * dt)
        if excess(motion.robot, motion.limits, *samples) <= 1.0:
            break
        motion = motion.slower(1.0 + 1e-3)
    return motion


def _check_count(duration: float, dt: float) -> None:
    """Raises `OptionError` where a duration [s] has more samples than are made."""
    if duration / dt > MOST_SAMPLES:
        raise OptionError(f"dt={dt:g} s cuts {duration:.3g} s into {duration / dt:.3g} samples, more than are made")


def _trajectory(motion: Motion, dt: float, places: np.ndarray, first: int, origin: Origin) -> Trajectory:
    """The samples, and the deviations; `places` (P,) of the poses on the curve."""
    times = np.arange(round(motion.duration / dt) + 1) * dt
    q, velocity, acceleration, _ = motion.derivatives(times)
    velocity[[0, -1]] = 0.0
    found = [
        Deviation(value, float(motion.time_at(place)), first + int(np.searchsorted(places, place, "right")) - 1)
        for value, place in deviations(motion.robot, motion.curve)
    ]
    return Trajectory(
        times,
        np.clip(q, motion.limits.lower, motion.limits.upper),
        velocity,
        acceleration,
        tool_speeds(motion.robot, q, velocity),
        first,
        motion.time_at(places),
        found[0],
        found[1],
        motion.limits,
        origin,
    )


def _at_rest(q: np.ndarray, first: int, limits: MotionLimits, origin: Origin) -> Trajectory:
    """That of a pose, once or repeated: one sample."""
    rest, nowhere = np.zeros_like(q[:1]), Deviation(0.0, 0.0, first)
    none = np.zeros(1)
    return Trajectory(none, q[:1].copy(), rest, rest, none, first, np.zeros(len(q)), nowhere, nowhere, limits, origin)


def _parts(least: int, intervals: int) -> int:
    """Into how many parts intervals must be cut to be so many at least, and `GRID`."""
    return max(math.ceil(max(least, GRID) / intervals), 1)


def _divided(x: np.ndarray, parts: int) -> np.ndarray:
    """Increasing numbers (K,), and those that cut each interval between them into so many parts."""
    return np.append((x[:-1, None] + np.arange(parts) / parts * np.diff(x)[:, None]).ravel(), x[-1])


def _module(name: str) -> Any:
    """A library of the extra. Raises `OptionError`."""
    try:
        return import_module(name)
    except ImportError:
        raise OptionError(f"timing a path needs {name}: pip install 'maira-qp[time]'") from None
