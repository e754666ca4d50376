"""Where on a plane a tool of one orientation can be: a pose a cell, each with the solver's verdict."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from maira_qp.errors import OptionError
from maira_qp.problem.targets import FARTHEST
from maira_qp.robots.model.robot import Robot
from maira_qp.solvers.solver import Solver

PLANES = ("xy", "xz", "yz")
SAMPLES, ROOM = 1000, 1.1
"""Random configurations whose tool positions the window holds, and how much larger it is than they need."""


@dataclass(frozen=True)
class ReachSlice:
    """A plane of positions, and what the solver says of each."""

    x: np.ndarray
    """(K,) [m] along the plane's first axis"""
    y: np.ndarray
    """(K,) [m] along its second"""
    status: np.ndarray
    """(K, K) integer values of `Status`, a row a y"""


def reach_slice(
    solver: Solver,
    rotation: np.ndarray,
    *,
    plane: str = "xz",
    at: float = 0.0,
    cells: int = 80,
    progress: Callable[[int, int], object] | None = None,
    seed: int = 0,
    threads: int | None = None,
) -> ReachSlice:
    """Ask for cells x cells positions on a plane of the base, all with one orientation (3, 3).

    `plane` is "xy", "xz" or "yz", `at` its place [m] along the third axis. The window holds what the tool can reach,
    by random configurations; `progress`, `seed` and `threads` are as for `Solver.solve_batch`. Raises `OptionError`,
    `PoseError`.
    """
    if plane not in PLANES:
        raise OptionError(f"plane must be one of {', '.join(PLANES)}, got {plane!r}")
    if cells < 2:
        raise OptionError(f"cells must be 2 or more, got {cells}")
    if not abs(at) <= FARTHEST * solver.robot.length:
        raise OptionError(f"at must be within {FARTHEST:g} times the arm's length, got {at}")
    first, second = ("xyz".index(axis) for axis in plane)
    x, y = _window(solver.robot, [first, second], cells)
    targets = np.tile(np.eye(4), (cells, cells, 1, 1))
    targets[..., :3, :3] = rotation
    targets[..., :3, 3] = at
    targets[..., first, 3], targets[..., second, 3] = np.meshgrid(x, y)
    batch = solver.solve_batch(targets.reshape(-1, 4, 4), seed=seed, threads=threads, progress=progress)
    return ReachSlice(x, y, batch.status.reshape(cells, cells))


def _window(robot: Robot, axes: list[int], cells: int) -> np.ndarray:
    """The centres (2, cells) [m] of square cells along two axes that hold where the tool can be."""
    rng = np.random.default_rng(0)
    points = np.array([robot.forward(robot.random_configuration(rng)).translation[axes] for _ in range(SAMPLES)])
    low, high = points.min(axis=0), points.max(axis=0)
    width = ROOM * max((high - low).max(), 1e-3)
    steps = (np.arange(cells) + 0.5) / cells - 0.5
    return (low + high)[:, None] / 2 + width * steps
