"""Rank the places where an arm may stand by what it reaches from there: the inverse of a map of its reach.

All bases of a grid are scored by a map, or by verdicts alone where there is no map; then the best are solved, so that
what is reported of them is what a solver finds. A base B reaches a tool pose T if the arm reaches B^-1 T.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from maira_qp.arrays import check_callable, is_count
from maira_qp.errors import OptionError, PoseError, listed, shown
from maira_qp.orientation import rigid
from maira_qp.problem.objectives import LimitDistance
from maira_qp.problem.options import Options
from maira_qp.problem.redundancy import Strict, Weighted
from maira_qp.problem.targets import poses_of_batch
from maira_qp.robots.model.robot import Robot
from maira_qp.scale.placement.candidates import Candidates, check_steps, ends, poses_of_bases, seen_from
from maira_qp.scale.placement.estimate import QUALITIES, Scores, by_map, by_solves, by_verdicts, scores_at
from maira_qp.scale.placement.placements import Placement, Placements
from maira_qp.scale.reach.bound import reach_bound
from maira_qp.scale.reach.reach_map import ReachMap
from maira_qp.solvers.solver import Solver

SOLVED = 500_000
"""So many poses are solved after the estimate, where they are solved in compiled code."""
MISSES = 1000
"""No more bases are solved once so many poses were not reached: for arms that are no S-R-S arms these take long."""
WHOLE_TURN = (-math.pi, math.pi)


def place(
    reach: ReachMap | Robot,
    poses: Any,
    *,
    x: Any = None,
    y: Any = None,
    z: Any = 0.0,
    yaw: Any = WHOLE_TURN,
    step: float = 0.1,
    turn: float = math.pi / 6,
    keep: int = 10,
    quality: str = "limit_distance",
    redundancy: Strict | Weighted | None = None,
    seed: int = 0,
    threads: int | None = None,
    progress: Callable[[int, int], object] | None = None,
) -> Placements:
    """Rank base poses by the tool poses that the arm reaches from there.

    Each base of a grid is scored: first by the share of the poses that are reached, then by the smallest quality over
    them, then by the mean. These scores are estimates where they are those of a map. The best bases are solved, in
    all at most some 500,000 poses, and ranked by what was found; of those at one position the best yaw is kept.

    Args:
        reach: a map of the arm; or the arm, which takes longer and needs no map.
        poses: tool poses (N, 4, 4) [m] in some frame, N >= 1, or a sequence of `pin.SE3` and (4, 4) arrays.
        x: of the bases in that frame [m], a number or (lower, upper); None: wherever a pose could be reached from.
        y: the same along y.
        z: the same along z; the floor is 0.
        yaw: turn of a base about z [rad], a number or (lower, upper), at most a turn.
        step: between positions [m], at most, > 0.
        turn: between yaw angles [rad], at most, > 0.
        keep: how many positions are kept, >= 1.
        quality: "limit_distance" (0 at a joint limit, 1 midway between them) or "manipulability".
        redundancy: what the solver prefers among the configurations for a pose; None: `Strict(LimitDistance())`.
        seed: of the solver's random starts.
        threads: of the compiled engine; None: one per processor. No answer depends on it.
        progress: callback, called with how many bases are scored and how many there are.

    Raises `OptionError` for ranges and names out of range, and without `x` and `y` for an arm whose reach has no bound;
    `PoseError` for no pose, and for one that is not finite or no rotation.
    """
    if not isinstance(reach, (ReachMap, Robot)):
        raise OptionError(f"reach must be a ReachMap or a Robot, got {shown(reach)}")
    robot = reach if isinstance(reach, Robot) else reach.robot
    if len(robot.tips) > 1:
        raise OptionError(f"bases are ranked for a robot with one tip, got {shown(robot)}")
    if quality not in QUALITIES:
        raise OptionError(f"quality cannot be {shown(quality)}; {listed(QUALITIES, quality)}")
    if not is_count(keep, 1):
        raise OptionError(f"keep must be a positive whole number, got {shown(keep)}")
    check_callable(progress, "progress", OptionError)
    check_steps(step, turn)
    options = Options() if isinstance(reach, Robot) else Options(**dict(reach.job.options))
    solver = Solver(robot, redundancy=redundancy or Strict(LimitDistance()), options=options)
    T = _checked(poses)
    x, y = _where(robot, T, x, y, step)
    candidates = Candidates.of(x, y, z, yaw, step, turn)
    look = by_verdicts(reach, options, quality, seed, threads) if isinstance(reach, Robot) else by_map(reach, quality)
    estimated = scores_at(candidates.values(np.arange(len(candidates))), T, look, progress)
    chosen = _best(estimated, candidates, keep, SOLVED // len(T) if solver.backend == "compiled" else keep)
    found = scores_at(
        candidates.values(chosen), T, by_solves(solver, quality, seed, threads), least=keep, misses=MISSES
    )
    chosen = chosen[: len(found.share)]
    ranked = []
    for k in _positions(found.order, chosen, candidates)[:keep].tolist():
        values = candidates.values(chosen[k : k + 1])
        seen = seen_from(poses_of_bases(values), T)[0]
        ranked.append(
            Placement(
                values=values[0],
                estimate=float(estimated.share[chosen[k]]),
                share=float(found.share[k]),
                least=float(found.least[k]),
                mean=float(found.mean[k]),
                solution=solver.solve_batch(seen, seed=seed, threads=threads),
            )
        )
    return Placements(robot, T, candidates.axes, estimated.share.reshape(candidates.shape), quality, tuple(ranked))


def _best(estimated: Scores, candidates: Candidates, keep: int, most: int) -> np.ndarray:
    """The indices of the bases to be solved: those at the best `keep` positions, then the best `most`."""
    order = estimated.order
    positions = _positions(order, np.arange(len(order)), candidates)[:keep]
    return np.concatenate([positions, order[:most][~np.isin(order[:most], positions)]])


def _positions(order: np.ndarray, index: np.ndarray, candidates: Candidates) -> np.ndarray:
    """Of an order of bases, which have indices `index`, what is the first at its position."""
    _, first = np.unique(index[order] // candidates.shape[3], return_index=True)
    return order[np.sort(first)]


def _checked(poses: Any) -> np.ndarray:
    """Tool poses (N, 4, 4). Raises `PoseError`."""
    T = poses_of_batch(poses, "pose", "for one pose: place(reach, [pose])")
    if not len(T):
        raise PoseError("there is no pose: bases are ranked by the poses that are reached from them")
    return np.array([rigid(pose, f"pose {i}") for i, pose in enumerate(T)])


def _where(robot: Robot, T: np.ndarray, x: Any, y: Any, step: Any) -> tuple[tuple[float, float], tuple[float, float]]:
    """Ranges of x and y [m]: those given, or all from where one of the poses may be within reach, in whole steps."""
    given = [None if value is None else ends(value, name) for value, name in ((x, "x"), (y, "y"))]
    if None in given:
        centre, radius = reach_bound(robot)
        if radius is None:
            raise OptionError("the reach of this robot has no bound: give x and y")
        away = radius + float(np.hypot(centre[0], centre[1]))
        for k in (k for k in range(2) if given[k] is None):
            low, high = float(T[:, k, 3].min()) - away, float(T[:, k, 3].max()) + away
            given[k] = math.floor(low / step) * step, math.ceil(high / step) * step
    return given[0], given[1]  # type: ignore[return-value]
