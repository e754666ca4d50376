"""Follow a path of poses: first the way along branches and self-motions, for the whole path, then each of its poses.

Some poses along the path, the knots, stand for all: a line is sought through them (`following.py`), and filled to all
poses. Where the knots were too coarse, every pose is one.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from scipy.interpolate import CubicSpline

from maira_qp.problem.problem import Problem
from maira_qp.problem.targets import SEED_0, Targets, seed_words
from maira_qp.results.path_solution import PathSolution, Rules
from maira_qp.results.solution import Solution
from maira_qp.results.status import Status
from maira_qp.solvers.paths.continuity import is_continuous
from maira_qp.solvers.paths.corridor import filled
from maira_qp.solvers.paths.descents import PathArrays
from maira_qp.solvers.paths.evenness import drawn_to
from maira_qp.solvers.paths.failures import ROUNDING, broken, loop_gap, missed, open_end
from maira_qp.solvers.paths.following import DENSITIES, breaks, follow
from maira_qp.solvers.paths.free_axis import free_axis, start_with_joint, without_turning
from maira_qp.solvers.paths.layers import layer_indices
from maira_qp.solvers.paths.meter import Meter, Progress

KNOTS = 0.03
"""What the pose moves between two knots, at most [rad]"""
NEARLY_CLOSED = 1e-3
"""A loop whose ends are no further apart [rad or m], two descents to one pose, ends with its beginning."""
KNOTS_DONE, ALONE_DONE, PARTS_DONE = 0.4, 0.6, 0.9
"""Shares of the work that are done with the knots, the poses by themselves and the parts, as a rule of thumb."""


def track(
    engines: Any,
    targets: Targets,
    q0: np.ndarray | None,
    seed: int,
    rules: Rules,
    progress: Progress | None = None,
) -> PathSolution:
    """Follow the path of N targets from a start (n,), or from any, by some rules.

    `engines` are those of the problem, see `solvers.dispatch`. Poses that nothing was found to reach divide the path:
    each part between them is followed by itself.
    """
    meter = Meter(progress, len(targets))
    solution = _track(engines, targets, q0, seed, rules, meter)
    meter.reach(1.0)
    return solution


def _track(
    engines: Any, targets: Targets, q0: np.ndarray | None, seed: int, rules: Rules, meter: Meter
) -> PathSolution:
    following = engines.following
    targets, start, step = _as_followed(engines.problem, following.problem, targets, q0, rules)
    rows, count = np.ascontiguousarray(targets.rows[:, 0]), len(targets)
    path = PathArrays(following.compiled, rows, np.arange(count), step, engines.problem, meter.beat)
    rng, first = np.random.default_rng(seed), None
    if start is not None and count:
        first = following.solve(targets.poses(0), start, SEED_0)
    by_knots, is_broken = _followed_by_knots(following, path, targets, first, seed, rules.loop, rng, meter)
    first_try = None if by_knots is None else _judged(engines, path, by_knots, rules)
    if first_try is not None and first_try.success.all() and not first_try.failures:
        return first_try
    q, reached = _alone(following, targets, first, np.arange(count), seed, meter.stage(KNOTS_DONE, ALONE_DONE))
    parts_done, densities = meter.stage(ALONE_DONE, PARTS_DONE), DENSITIES[-1:] if is_broken else DENSITIES
    for begin, end in runs(reached):
        parts_done(begin, count)
        part, is_start_given = path.some(slice(begin, end)), begin == 0 and first is not None
        is_loop = rules.loop and end - begin == count
        line = follow(part, q[begin:end], is_start_given, is_loop, rng, densities)
        q[begin:end] = _drawn(part, line, is_start_given, is_loop)
    others = _nearest(following, path, targets, q, start, meter.stage(PARTS_DONE, 1.0))
    if rules.loop and count:
        _close(path, q)
    solution = _judged(engines, path, q, rules, others)
    if first_try is not None and first_try.success.all() and len(first_try.failures) < len(solution.failures):
        return first_try
    return solution


def _as_followed(
    asked: Problem, followed: Problem, targets: Targets, q0: np.ndarray | None, rules: Rules
) -> tuple[Targets, np.ndarray | None, np.ndarray]:
    """Targets, start and steps of the problem that is followed: of an arm with a joint more where the tool may turn."""
    axis = free_axis(asked)
    if axis is None:
        which = [targets.keys.index(key) for key in followed.target_keys]
        return Targets(followed.target_keys, targets.rows[:, which], targets.deviations), q0, rules.step
    if len(targets):
        targets = without_turning(targets, axis, rules.loop)
        if q0 is not None:
            q0 = start_with_joint(asked.robot, q0, next(iter(targets.poses(0).values())), axis)
    return targets, q0, np.append(rules.step, np.inf)


def _nearest(
    engines: Any,
    path: PathArrays,
    targets: Targets,
    q: np.ndarray,
    start: np.ndarray | None,
    progress: Progress,
) -> dict[int, Solution]:
    """Solutions by index for the poses that q (N, n) does not reach, into q: each from the last that is reached."""
    reached = path.reached(q)[1]
    lost, there = np.flatnonzero(~reached), np.flatnonzero(reached)
    if not len(lost):
        return {}
    before = np.maximum(np.searchsorted(there, lost) - 1, 0)
    starts = q[there[before]] if len(there) else q[lost] if start is None else np.tile(start, (len(lost), 1))
    nearest = engines.solve_batch(targets[lost], starts, SEED_0, None, progress)
    q[lost] = nearest.q
    return dict(zip(lost.tolist(), nearest, strict=True))


def _close(path: PathArrays, q: np.ndarray) -> None:
    """Let a line (N, n), in place, end with its beginning where it nearly does, if that reaches its last pose."""
    gap = loop_gap(path.problem, q)
    end = q[-1] - gap
    if np.abs(gap).max() <= NEARLY_CLOSED and path.problem.is_reached(*path.errors(path.rows[-1:], end[None])[0]):
        q[-1] = end


def _alone(
    engines: Any, targets: Targets, start: Any, which: np.ndarray, seed: int, progress: Progress
) -> tuple[np.ndarray, np.ndarray]:
    """Configurations (K, n) at the poses `which` (K,), solved for by themselves, and whether they reach them (K,).

    Poses that are not reached so, and not proved out of reach, are tried from those of their neighbours that are.
    """
    alone = engines.solve_batch(targets[which], None, seed_words(seed), None, progress)
    q, reached = alone.q.copy(), alone.success.copy()
    if start is not None:
        q[0], reached[0] = start.q, start.success
    lost = np.flatnonzero(~reached & (alone.status != Status.UNREACHABLE))
    first = 0 if start is None else 1
    for ks, step in ((lost, 1), (lost[::-1], -1)):
        for k in ks[ks >= first].tolist():
            if not reached[k] and 0 <= k - step < len(q) and reached[k - step]:
                beside = engines.solve(targets.poses(int(which[k])), q[k - step], SEED_0)
                q[k], reached[k] = beside.q, beside.success
    return q, reached


def _followed_by_knots(
    engines: Any,
    path: PathArrays,
    targets: Targets,
    start: Solution | None,
    seed: int,
    is_loop: bool,
    rng: np.random.Generator,
    meter: Meter,
) -> tuple[np.ndarray | None, bool]:
    """A line (N, n) that is sought at knots alone, and whether it is broken between some.

    None: they are as many as the poses, or not all are reached.
    """
    knots = layer_indices(path, KNOTS)
    if 2 * len(knots) > len(path):
        return None, False
    known, reached = _alone(engines, targets, start, knots, seed, meter.stage(0.0, 0.5 * KNOTS_DONE))
    if not reached.all():
        return None, False
    some = path.some(knots)
    line = _drawn(some, follow(some, known, start is not None, is_loop, rng), start is not None, is_loop)
    meter.reach(KNOTS_DONE)
    q, arrived = filled(path, knots, line, CubicSpline)
    return q if arrived.all() else filled(path, knots, line)[0], breaks(some, line) > 0


def _judged(
    engines: Any, path: PathArrays, q: np.ndarray, rules: Rules, others: Mapping[int, Solution] | None = None
) -> PathSolution:
    """The result for configurations (N, n): the joints that were asked for, and where they do not follow the path.

    `others` are solutions for the poses that are not reached; None: nothing is said of these.
    """
    asked, (errors, reached) = path.asked, path.reached(q)
    found = [missed(k, solution) for k, solution in (others or {}).items() if not reached[k]]
    both, leads = reached[:-1] & reached[1:], path.largest_steps(q) <= 1.0 + ROUNDING
    if (both & leads).any():
        steps = np.flatnonzero(both & leads)
        leads[steps] = is_continuous(path, steps, q[steps], q[steps + 1])
    own = np.ascontiguousarray(q[:, : asked.robot.n])
    found += [broken(asked, own, k + 1, rules) for k in np.flatnonzero(both & ~leads).tolist()]
    if rules.loop and len(q) and (end := open_end(asked, own)) is not None:
        found.append(end)
    failures = tuple(sorted(found, key=lambda each: each.index))
    return PathSolution(own, reached, errors[:, 0], errors[:, 1], rules, failures, path.rows, engines)


def _drawn(path: PathArrays, q: np.ndarray, is_start_given: bool, is_loop: bool) -> np.ndarray:
    """A line (N, n), nearer to the posture of the problem that was asked, if it has one."""
    posture = path.asked.posture
    return q if posture is None else drawn_to(path, q, (is_start_given or is_loop, is_loop), posture)


def runs(holds: np.ndarray) -> Iterator[tuple[int, int]]:
    """First and past-the-last index of each run of what holds (N,)."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], holds.astype(int), [0]])))
    yield from zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True)
