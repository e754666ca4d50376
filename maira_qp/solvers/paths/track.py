"""Follow a path of poses: first the way along branches and self-motions, for the whole path, then each of its poses.

Some poses along the path, the knots, stand for all. Layers of configurations at some of them (`layers.py`) are linked
by dynamic programming (`line.py`); between the layers the line is filled by descents, and what turns out to jump
between two of them is not taken again. The line is smoothed in a corridor around it (`corridor.py`), and filled to all
poses. Where layers were too coarse to be linked, or the line has steps much larger than others, they are made again
finer; where the knots were too coarse, every pose is one.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from itertools import pairwise
from typing import Any

import numpy as np
from scipy.interpolate import CubicSpline

from maira_qp.problem.problem import Problem
from maira_qp.problem.targets import SEED_0, Targets, seed_words
from maira_qp.results.path_solution import PathSolution, Rules
from maira_qp.results.solution import Solution
from maira_qp.solvers.paths.continuity import is_continuous
from maira_qp.solvers.paths.corridor import filled, smoothed
from maira_qp.solvers.paths.descents import PathArrays
from maira_qp.solvers.paths.evenness import drawn_to
from maira_qp.solvers.paths.failures import ROUNDING, broken, loop_gap, missed, open_end
from maira_qp.solvers.paths.free_axis import free_axis, start_with_joint, without_turning
from maira_qp.solvers.paths.layers import Density, layer_indices, layers_of
from maira_qp.solvers.paths.line import Edge, Line, best_line
from maira_qp.solvers.paths.links import misleading
from maira_qp.solvers.paths.meter import Meter, Progress

COARSE = Density(spacing=0.3, most=150, fresh=16, cell=0.15)
DENSITIES = COARSE, COARSE.finer(), COARSE.finer().finer()
"""Of the layers that are made, one after the other; of those of a path whose knots were not followed the last."""
KNOTS = 0.03
"""What the pose moves between two knots, at most [rad]"""
REPAIRS = 6
"""How often a line is sought in the same layers, without the links that turned out to jump."""
WIDEST = 0.6
"""How far a joint may move between two layers [rad, or of the arm's length], unless one step may be larger."""
WIDER = (1.0, 4.0, 16.0)
"""A line is sought with so many times the allowed steps, for smoothing may make them small enough."""
LOOPS = 8
"""Beginnings of a loop that are tried."""
CLOSINGS = 4
"""Lines that end where they begin of which it is tried whether they lead along the path."""
NEARLY_CLOSED = 1e-3
"""A loop whose ends are no further apart [rad or m], two descents to one pose, ends with its beginning."""
CALM, NARROWER, CLOSE = 4.0, (0.5, 0.7), 30
"""A line whose largest step is at most so many times the mean step is not sought again: with steps smaller than its
largest by such factors, which one large step in the place of many small ones is not, in finer layers, and in the end in
layers at all of so many poses on either side of that step."""
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
    if by_knots is not None:
        solution = _judged(engines, path, by_knots, rules)
        if solution.success.all() and not solution.failures:
            return solution
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
    return _judged(engines, path, q, rules, others)


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
    reached = _reached(path, q)[1]
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
    """Configurations (K, n) at the poses `which` (K,), solved for by themselves, and whether they reach them (K,)."""
    alone = engines.solve_batch(targets[which], None, seed_words(seed), None, progress)
    q, reached = alone.q.copy(), alone.success.copy()
    if start is not None:
        q[0], reached[0] = start.q, start.success
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
    """A line (N, n) that is sought at knots alone, and whether none was found that does not jump between these.

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
    return q if arrived.all() else filled(path, knots, line)[0], _breaks(some, line) > 0


def _reached(path: PathArrays, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Errors (N, 2) [m, rad] by a fresh forward kinematics of each of q (N, n), and which of them reach their poses."""
    errors = path.errors(path.rows, q)
    return errors, np.asarray(path.problem.is_reached(*errors.T)) & path.keeps_limits(q)


def _judged(
    engines: Any, path: PathArrays, q: np.ndarray, rules: Rules, others: Mapping[int, Solution] | None = None
) -> PathSolution:
    """The result for configurations (N, n): the joints that were asked for, and where they do not follow the path.

    `others` are solutions for the poses that are not reached; None: nothing is said of these.
    """
    asked, (errors, reached) = path.asked, _reached(path, q)
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


def follow(
    path: PathArrays,
    known: np.ndarray,
    is_start_given: bool,
    is_loop: bool,
    rng: np.random.Generator,
    densities: Sequence[Density] = DENSITIES,
) -> np.ndarray:
    """Configurations (N, n) along a path, with as few steps beyond the window as were found.

    Args:
        path: N poses and their problem.
        known: some configuration (N, n) for each pose, which reaches it.
        is_start_given: the first of them is that of the path.
        is_loop: the last is to be the first again.
        rng: of the configurations that are drawn.
        densities: of the layers, tried one after the other.
    """
    if len(path) < 2:
        return known
    nodes, fixed = [each[None] for each in known], (is_start_given or is_loop, is_loop)
    best, least, line = None, np.inf, _loop if is_loop else _continuous_line
    if is_start_given:
        for k, q in enumerate(_continued(path, known[0])):
            nodes[k + 1] = np.concatenate([q[None], nodes[k + 1]])
    at, layers = np.arange(0), list[np.ndarray]()
    for density in densities:
        at = layer_indices(path, density.spacing)
        layers = layers_of(path, at, nodes, is_start_given, density, rng)
        through = partial(line, at=at, layers=layers, is_start_given=is_start_given)
        for times in WIDER:
            best, least = _smoother(path, best, through(path.wider(times)), fixed)
            if least <= 1.0:
                break
        if best is not None:
            best, least = _calmed(path, best, fixed, through)
            if least <= 1.0 and _is_calm(path, best):
                return best
    if best is not None:
        at = _with_all_about(at, path, int(path.largest_steps(best).argmax()))
        layers = layers_of(path, at, nodes, is_start_given, densities[-1], rng)
        through = partial(line, at=at, layers=layers, is_start_given=is_start_given)
        best, least = _calmed(path, best, fixed, through)
        if least <= 1.0:
            return best
    broken_up = _with_reconfigurations(path, known, at, layers, is_start_given)
    return broken_up if best is None or _breaks(path, broken_up) < _breaks(path, best) else best


def _smoother(
    path: PathArrays, best: np.ndarray | None, q: np.ndarray | None, fixed: tuple[bool, bool]
) -> tuple[np.ndarray | None, float]:
    """The one of two lines (N, n), or none, with the smaller largest step, the second smoothed, and that step."""
    q = None if q is None else _smoothed(path, q, fixed)
    known = [(float(path.largest_steps(each).max()), each) for each in (best, q) if each is not None]
    least, one = min(known, key=lambda each: each[0], default=(np.inf, None))
    return one, least


def _smoothed(path: PathArrays, q: np.ndarray, fixed: tuple[bool, bool]) -> np.ndarray:
    """A line (N, n) smoothed, or as it is where smoothing makes it jump."""
    smooth = smoothed(path, q, fixed)
    return smooth if not len(_jumps(path, smooth)) else q


def _jumps(path: PathArrays, q: np.ndarray) -> np.ndarray:
    """Indices (K,) of the poses to which a line (N, n) jumps from one branch to another."""
    return np.flatnonzero(~is_continuous(path, np.arange(len(q) - 1), q[:-1], q[1:])) + 1


def _calmed(
    path: PathArrays,
    best: np.ndarray,
    fixed: tuple[bool, bool],
    line: Callable[[PathArrays], np.ndarray | None],
) -> tuple[np.ndarray, float]:
    """A line (N, n), or one with smaller steps while it has a step much larger than others; and its largest step."""
    while not _is_calm(path, best):
        largest = float(path.largest_steps(best).max())
        for times in NARROWER:
            q = line(path.wider(times * largest))
            q = None if q is None else _smoothed(path, q, fixed)
            if q is not None and path.largest_steps(q).max() < largest:
                best = q
                break
        else:
            break
    return best, float(path.largest_steps(best).max())


def _with_all_about(at: np.ndarray, path: PathArrays, step: int) -> np.ndarray:
    """Indices (L,) of layers, and those of all poses about a step."""
    return np.union1d(at, np.arange(max(step + 1 - CLOSE, 0), min(step + 1 + CLOSE, len(path))))


def _is_calm(path: PathArrays, q: np.ndarray) -> bool:
    """Whether no step of a line (N, n) is much larger than others."""
    steps = path.largest_steps(q)
    return bool(steps.max() <= CALM * steps.mean())


def _breaks(path: PathArrays, q: np.ndarray) -> int:
    """How many steps of a line (N, n) are larger than allowed."""
    return int((path.largest_steps(q) > 1.0 + ROUNDING).sum())


def _loop(path: PathArrays, at: np.ndarray, layers: list[np.ndarray], is_start_given: bool) -> np.ndarray | None:
    """A line (N, n) whose end is its beginning; None: none was found from some of the beginnings."""
    begins, turns = layers[0], path.problem.turns
    if not is_start_given:
        free = best_line(layers, _windows(path, at), set(), turns, is_start_given).chosen[0]
        begins = np.concatenate([begins[[free]], np.delete(begins, free, axis=0)])[:LOOPS]
    tries = CLOSINGS
    for begin in begins:
        closed = [begin[None], *layers[1:-1], begin[None]]
        line = best_line(closed, _windows(path, at), set(), turns, is_start_given)
        if not line.reconfigurations and open_end(path.problem, line.q) is None:
            q = _continuous_line(path, at, closed, is_start_given)
            if q is not None and open_end(path.problem, q) is None:
                return q
            tries -= 1
            if not tries:
                break
    return None


def _continued(path: PathArrays, start: np.ndarray) -> Iterator[np.ndarray]:
    """Configurations (n,) at the second pose and on, each followed from the one before, as far as that goes."""
    q = start
    for k, window in enumerate(path.windows, 1):
        (there,), (arrived,) = path.descend(np.array([k]), q[None])
        if not arrived or (np.abs(there - q) > np.minimum(window, _widest(path))).any():
            return
        yield there
        q = there


def _continuous_line(
    path: PathArrays, at: np.ndarray, layers: list[np.ndarray], is_start_given: bool
) -> np.ndarray | None:
    """A line (N, n) that reaches every pose without a step beyond the window; None: none was found.

    Where a line jumps its link is not taken again, and, if it was not the first line, none that jumps between these
    layers: often there are many beside one another.
    """
    windows, forbidden = _windows(path, at), set[Edge]()
    for repair in range(REPAIRS):
        line = best_line(layers, windows, forbidden, path.problem.turns, is_start_given)
        if line.reconfigurations:
            return None
        q, amiss = _along(path, at, line)
        if not len(amiss):
            return q
        for k in np.unique(np.searchsorted(at, amiss)).tolist():
            forbidden.add(line.edge(k))
            if repair:
                forbidden |= misleading(path, at, layers, k, windows[k - 1])
    return None


def _along(path: PathArrays, at: np.ndarray, line: Line) -> tuple[np.ndarray, np.ndarray]:
    """The line through configurations at the poses `at` (L,), and the poses (K,) to which it does not lead."""
    q, arrived = filled(path, at, line.q)
    amiss = np.flatnonzero(~arrived[1:] | (path.largest_steps(q) > 1.0)) + 1
    return q, amiss if len(amiss) else _jumps(path, q)


def _widest(path: PathArrays) -> np.ndarray:
    """How far (n,) each joint may move between two layers, at most, unless one step is allowed to be larger."""
    robot = path.problem.robot
    return np.maximum(path.window / path.times, WIDEST * np.where(robot.slides, robot.length, 1.0))


def _windows(path: PathArrays, at: np.ndarray) -> np.ndarray:
    """How far (L - 1, n) each joint may move from layer to layer."""
    return np.minimum(path.some(at).windows, _widest(path))


def _with_reconfigurations(
    path: PathArrays, known: np.ndarray, at: np.ndarray, layers: list[np.ndarray], is_start_given: bool
) -> np.ndarray:
    """A line (N, n) with the fewest reconfigurations: before each it is followed pose by pose as far as that goes.

    What is lost on the way there and back is as it is `known` (N, n).
    """
    knots = best_line(layers, _windows(path, at), set(), path.problem.turns, is_start_given).q
    q, arrived = filled(path, at, knots)
    for k, (left, right) in enumerate(pairwise(at.tolist())):
        some = slice(left, right + 1)
        if arrived[some].all() and path.some(some).largest_steps(q[some]).max() <= 1.0:
            continue
        for i in range(left + 1, right):
            (q[i],), (is_there,) = path.descend(np.array([i]), q[i - 1 : i])
            step = slice(i - 1, i + 1)
            if not is_there or path.some(step).largest_steps(q[step])[0] > 1.0:
                q[i:right] = _followed_back(path, knots[k + 1], i, right)
                break
    lost = ~_reached(path, q)[1]
    q[lost] = known[lost]
    return q


def _followed_back(path: PathArrays, end: np.ndarray, first: int, last: int) -> np.ndarray:
    """Configurations at poses first, ..., last - 1, followed pose by pose from one (n,) at the pose `last`."""
    q = np.empty((last - first, path.n))
    for i in range(last - 1, first - 1, -1):
        (end,), _ = path.descend(np.array([i]), end[None])
        q[i - first] = end
    return q


def runs(holds: np.ndarray) -> Iterator[tuple[int, int]]:
    """First and past-the-last index of each run of what holds (N,)."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], holds.astype(int), [0]])))
    yield from zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True)
