"""What the tests of the kernels share: robots, the arrays of a problem, and work to do it in."""

from functools import cache
from typing import Any

import numpy as np
import pytest
from numba import config

import maira_qp as mq
from maira_qp.kernels.jit.arena import Arena
from maira_qp.kernels.layout import Outcome
from maira_qp.kernels.search.levenberg_marquardt import LANES_ARENA
from maira_qp.kernels.search.multi_start import SEARCH, search
from maira_qp.problem.tasks.frame import FrameTask
from maira_qp.solvers.compiled.engine import Compiled
from support.robots import load

nine_robots = pytest.mark.parametrize(
    "name", ["maira", "panda", "xarm7", "ur5_limited", "pr2_arm", "tiago", "kinova", "irb140", "talos_arm"]
)
"""Axes along x, y, z, against them and skew; six to eight joints, prismatic and continuous ones among them."""

three_tasks = pytest.mark.parametrize(
    "task", [mq.PoseTask(), mq.PositionTask(), mq.OrientationTask()], ids=lambda task: type(task).__name__
)


def few(count: int) -> int:
    """So many cases, or, where the kernels run as plain Python, a twentieth of them, at most 12."""
    return min(max(1, count // 20), 12) if config.DISABLE_JIT else count


def first_in_plain_python(*cases):
    """All of these cases, or, where the kernels run as plain Python, the first alone."""
    return cases[:1] if config.DISABLE_JIT else cases


@cache
def arm(name: str) -> mq.Robot:
    """A robot by its name."""
    return mq.Robot.maira() if name == "maira" else load(name)


def compiled(
    robot: mq.Robot, task: FrameTask | None = None, redundancy: mq.Strict | None = None, **options
) -> Compiled:
    """The arrays of a problem."""
    problem = mq.Solver(robot, task=task, redundancy=redundancy, options=mq.Options(**options)).engines.compiled
    assert problem is not None
    return problem


def configurations(robot: mq.Robot, rng: np.random.Generator, count: int) -> np.ndarray:
    """Random ones within the limits (count, n)."""
    return np.array([robot.random_configuration(rng) for _ in range(count)])


def row_of(target) -> np.ndarray:
    """A pose as (12,): R by rows, then p."""
    T = np.asarray(getattr(target, "homogeneous", target))
    return np.r_[T[:3, :3].ravel(), T[:3, 3]]


def reachable_rows(robot: mq.Robot, rng: np.random.Generator, count: int) -> np.ndarray:
    """Poses (count, 12) of the tool at random configurations."""
    return np.array([row_of(robot.forward(q)) for q in configurations(robot, rng, count)])


def kinematic_work(n: int, *lanes: int) -> tuple[np.ndarray, ...]:
    """axes, origins, tool, e, J"""
    shapes = (n, 3), (n, 3), (12,), (6,), (n, 6)
    return tuple(np.full((*shape, *lanes), np.nan) for shape in shapes)


def rubbish(arena: Arena, *dimensions: int) -> tuple[np.ndarray, ...]:
    """The memories of an arena, which hold numbers that nobody may read."""
    memories = arena.empty(*dimensions)
    for memory in memories:
        memory.fill(np.nan if memory.dtype == float else -(2**62))
    return memories


def descents(n: int) -> Any:
    """Eight descents of a chain of n joints, none of them begun."""
    lanes = LANES_ARENA.plain(n, *rubbish(LANES_ARENA, n))
    lanes.state.fill(1.0)
    return lanes


def search_for(
    problem: Compiled,
    rows: np.ndarray,
    starts: np.ndarray | None = None,
    streams: np.ndarray | None = None,
    shuffled: bool = False,
    first: int = 0,
    last: int | None = None,
    memory: tuple[np.ndarray, ...] | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """q (N, n) and outcomes (N, 9) of the kernel `search` for the targets (N, 12), in memory that holds rubbish."""
    n, last = problem.robot.n, problem.last_attempt if last is None else last
    streams = np.arange(len(rows), dtype=np.uint64) if streams is None else streams
    memory = memory or rubbish(SEARCH, n, last - first + 1)
    q, outcome = np.full((len(rows), n), np.nan), np.full((len(rows), Outcome.WIDTH), np.nan)
    search(
        problem.chain,
        problem.settings,
        problem.seeds.configurations,
        problem.seeds.features,
        problem.candidates,
        shuffled,
        rows,
        np.empty((0, n)) if starts is None else starts,
        streams,
        first,
        last,
        *memory,
        q,
        outcome,
    )
    return q, outcome
