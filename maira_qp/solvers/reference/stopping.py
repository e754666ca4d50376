"""Ways to a stop, for joints that cannot stop at once, and by how much bent limits are broken on them."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np

from maira_qp.problem.limits.joint import Bounds, Tick, slowed_together
from maira_qp.robots.model.configuration import Configuration
from maira_qp.solvers.reference.context import Context

GLANCES = 8
"""Configurations on the way to a stop at which bent limits are looked at first."""

DOUBT = 4.0
"""A limit is looked at more closely where its room is less than so many times the second difference of the room, an
eighth of which may be lost between two glances if it changes evenly."""


def violations_ahead(at: Configuration, dq: np.ndarray, context: Context, now: Tick) -> Iterator[np.ndarray]:
    """By how much each part (k,) of the bent limits is broken where dq (n,) led to, and while the arm then brakes.

    First if each joint brakes as hard as it can, then if all slow down together, in a straight line of joint space: a
    pair of bodies that one joint drives together and another apart does not come nearer if both slow down alike. So a
    tick that is allowed leaves a way to stop that is allowed, and one of these is always there to be chosen next. The
    straight line is looked at as far as continuous braking leads, which is farther than ticks of any length do.
    """
    change, size = context.robot.acceleration_limit * now.dt**2, np.abs(dq)
    stop = size / change  # in ticks
    longest, whole = float(np.max(stop, initial=0.0)), np.floor(stop)
    change = np.where(whole > 0, change, 0.0)

    def apart(tick: int) -> np.ndarray:
        k = np.minimum(tick, whole)
        return np.sign(dq) * np.where(k > 0, k * (size - 0.5 * change * (k + 1)), 0.0)

    def together(tick: int) -> np.ndarray:
        k = min(tick, longest)
        return dq * (k - k * k / (2 * longest))

    yield _violations_along(apart, {0, *whole.astype(int).tolist()}, at, context)
    q, ticks = context.robot.kinematics.integrate(at.q, 0.5 * longest * dq), math.ceil(longest)
    if ticks > 0 and (context.robot.lower <= q).all() and (q <= context.robot.upper).all():
        yield _violations_along(together, {ticks}, at, context)


def _violations_along(
    way: Callable[[int], np.ndarray], stops: set[int], at: Configuration, context: Context
) -> np.ndarray:
    """The most by which each part (k,) of the bent limits is broken from a configuration on, `way` (n,) by the tick.

    Looked at are some ticks, those in which joints stop among them, and between these the ones about the least room,
    where it is so small that the way may bend beyond the limit in between.
    """
    rooms: dict[int, np.ndarray] = {}
    further = stops | {int(tick) for tick in np.linspace(0, max(stops), GLANCES + 1)}
    while further:
        rooms.update((tick, context.rooms(at.moved(way(tick)) if tick else at)) for tick in further)
        seen = np.array(sorted(rooms))
        further = set(_between(seen, np.array([rooms[tick] for tick in seen])))
    return np.maximum(-np.min(list(rooms.values()), axis=0), 0.0)


def _between(ticks: np.ndarray, rooms: np.ndarray) -> Iterator[int]:
    """The ticks halfway to the neighbours of those with the least room around, of rooms (t, k) at ticks (t,).

    There may be several for each part: joints that stop at different times bend the way more than once. Those count
    whose room is smaller than `DOUBT` times the largest difference around of what it changes by before and after.
    """
    if len(ticks) < 3:
        return
    rooms = np.minimum(rooms, np.max(rooms, where=np.isfinite(rooms), initial=0.0))
    around, steps = np.pad(rooms, ((1, 1), (0, 0)), constant_values=np.inf), np.diff(ticks)
    least = (rooms <= around[:-2]) & (rooms <= around[2:]) & (rooms.min(axis=0) > 0)
    bends = np.abs(np.diff(np.diff(rooms, axis=0) / steps[:, None], axis=0))
    near = np.pad(bends, ((1, 1), (0, 0)))
    near = np.maximum(np.maximum(near[:-2], bends), near[2:])  # at each tick between others, and at its neighbours
    uneven = np.pad(near, ((1, 1), (0, 0)), mode="edge")
    uneven *= np.maximum(np.append(steps[0], steps), np.append(steps, steps[-1]))[:, None]
    for i in np.flatnonzero((least & (rooms < DOUBT * uneven)).any(axis=1)):
        for k in {max(i - 1, 0), min(i, len(ticks) - 2)}:
            if ticks[k + 1] - ticks[k] > 1:
                yield int(ticks[k] + ticks[k + 1]) // 2


def with_a_way_to_stop(bounds: Bounds, at: Configuration, context: Context, now: Tick) -> Bounds:
    """The bounds with that way to slow down as their `rest` which breaks bent limits least further: apart or together.

    The last tick was allowed because one of them breaks none, which linearised limits do not know. In the second place
    counts the pace that limits on speeds allow: joints whose motions cancel at the tool brake together.
    """
    has_choice = context.is_watched or context.is_paced
    if not has_choice or not now.velocity.any() or not np.isfinite(context.robot.acceleration_limit).any():
        return bounds
    ways = [bounds.rest, np.clip(0.0, bounds.lower, bounds.upper)]
    if bounds.braking is None and (together := slowed_together(bounds, now.velocity * now.dt)) is not None:
        ways.append(together)

    here = context.violations(at) if context.is_watched else np.empty(0)

    def harm(way: np.ndarray) -> tuple[float, float]:
        ends = violations_ahead(at.moved(way), way, context, now) if context.is_watched else ()
        growth = min((float(np.maximum(ahead - here, 0.0).sum()) for ahead in ends), default=0.0)
        return growth, max(1.0, context.pace(at, way, now))

    best = min(ways, key=harm)
    return bounds if best is ways[0] else replace(bounds, braking=best, h=np.maximum(bounds.h, bounds.G @ best))
