"""The solver: a robot, its tasks, limits and redundancy, and the verbs that answer with one result type.

`solve` minimises `1/2 |W e(q)|^2` over `lower <= q <= upper`, e the pose error by the quaternion logarithm: a search
over starts reaches the pose (search.py, descent.py), the redundancy is settled on the self-motion (settling.py), and
the verdict is read off a fresh forward kinematics of the configuration that is returned.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

import numpy as np
import pinocchio as pin

from maira_qp.arrays import real_array
from maira_qp.errors import ConfigurationError, OptionError, PoseError
from maira_qp.problem.backends import Backend
from maira_qp.problem.costs import TaskCost, tasks_toward
from maira_qp.problem.limits import Limit, LinearLimit, PositionLimit, VelocityLimit
from maira_qp.problem.pose import as_pose
from maira_qp.problem.redundancy import Strict, Weighted
from maira_qp.problem.tasks import FrameTask, PoseTask
from maira_qp.robots.configuration import Configuration
from maira_qp.robots.robot import Robot
from maira_qp.solvers.descent import Budget
from maira_qp.solvers.options import Options
from maira_qp.solvers.search import nearest, search, stationarity
from maira_qp.solvers.setting import Setting
from maira_qp.solvers.settling import settle
from maira_qp.solvers.solution import BatchSolution, Solution, Status, Step, active_limits
from maira_qp.solvers.tick import tick

Rng = np.random.Generator | int | None


class Solver:
    """Constrained inverse kinematics of one robot. Immutable, so it can be shared between threads, and pickled."""

    def __init__(
        self,
        robot: Robot,
        *,
        task: FrameTask | None = None,
        tasks: Sequence[FrameTask] = (),
        limits: Sequence[Limit] = (),
        redundancy: Weighted | Strict | None = None,
        backend: str | Backend = "daqp",
        options: Options | None = None,
    ) -> None:
        """A solver for a robot.

        Args:
            robot: the arm, with its tip and joint limits.
            task: what of the target is to be reached: `PoseTask()` (default), `PositionTask()`, `OrientationTask()`.
            tasks: further tasks, each with a target of its own, to be reached together with the first.
            limits: further limits, such as `LinearLimit(A, b)`; the joint limits always hold.
            redundancy: `Weighted(...)`, `Strict(...)`, or None: the pose alone.
            backend: who solves each QP: the name of an installed backend of qpsolvers, or `Backend(name, settings)`.
            options: tolerances and budgets.

        Raises `OptionError`, `FrameError`, `BackendError`.
        """
        _check_type(robot, Robot, "robot", "mq.Robot.maira() or mq.Robot.from_urdf(...)")
        _check_type(options, (Options, type(None)), "options", "mq.Options(...)")
        _check_type(redundancy, (Weighted, Strict, type(None)), "redundancy", "mq.Strict(mq.Posture())")
        tasks = (PoseTask() if task is None else task, *tasks)
        for number, each in enumerate(tasks):
            _check_type(each, FrameTask, "task", "mq.PoseTask(), mq.PositionTask(), mq.OrientationTask()")
            robot.frame_id(each.frame or robot.tip)
            if number > 0 and each.target is None:
                raise OptionError("a further task needs a target of its own: mq.PoseTask(frame=..., target=...)")
        for limit in limits:
            _check_type(limit, Limit, "limit", "mq.LinearLimit(A, b)")
            if isinstance(limit, LinearLimit) and limit.A.shape[1] != robot.n:
                raise OptionError(f"A of a LinearLimit needs {robot.n} columns, one a joint, not {limit.A.shape[1]}")
        self.robot = robot
        self.tasks = tuple(tasks)
        self.redundancy = None if redundancy is None else redundancy.of(robot)
        own = (PositionLimit(robot.lower, robot.upper), VelocityLimit(robot.velocity_limit))
        backend = backend if isinstance(backend, Backend) else Backend(backend)
        self._setting = Setting(robot, (*own, *limits), backend, options or Options())
        self._setting.admitted(robot.middle)  # the limits leave something

    @property
    def options(self) -> Options:
        """Tolerances and budgets."""
        return self._setting.options

    @property
    def limits(self) -> tuple[Limit, ...]:
        """All limits, the robot's own first."""
        return self._setting.limits

    @property
    def backend(self) -> str:
        """The QP backend's name."""
        return self._setting.backend.name

    def __repr__(self) -> str:
        return f"Solver({self.robot!r}, redundancy={self.redundancy!r}, backend={self.backend!r})"

    def solve(
        self, target: Any, q0: Any = None, rng: Rng = None, *, observe: Callable[[np.ndarray], object] | None = None
    ) -> Solution:
        """Joint angles that put the tool at the target.

        Args:
            target: `pin.SE3` or (4, 4), T_base_tool [m].
            q0: start (n,) [rad or m]; None: a random one. A start outside the limits is moved onto them.
            rng: generator or seed of the random starts; None: seed 0, so that the same call gives the same answer.
            observe: called with each configuration (n,) on the way, starts included, for pictures of the iteration.

        Raises `PoseError`, `ConfigurationError`, `OptionError` for what cannot be meant; the rest is a `Status`.
        """
        pose = self._target(target)
        start = None if q0 is None else real_array(q0, (self.robot.n,), "q0", ConfigurationError)
        stream = rng if isinstance(rng, np.random.Generator) else _seed(0 if rng is None else rng, "rng")
        return self._solve(pose, start, lambda: np.random.default_rng(stream), observe)

    def solve_batch(self, targets: Any, q0: Any = None, seed: int = 0) -> BatchSolution:
        """`solve` for each of N targets, each with a random stream of its own, made from (seed, its index) alone.

        Args:
            targets: (N, 4, 4), or a sequence of `pin.SE3` and (4, 4) arrays.
            q0: a start (n,) for all, or (N, n) one each; None: random ones.
            seed: non-negative integer.

        Raises `PoseError`, `ConfigurationError` or `OptionError`, naming the target, before anything is solved.
        """
        poses = [self._target(target, f"target {i}: ") for i, target in enumerate(_listed(targets))]
        starts = _starts(q0, len(poses), self.robot.n)
        seed = _seed(seed, "seed")
        solutions = [
            self._solve(pose, start, lambda i=i: np.random.default_rng([seed, i]))
            for i, (pose, start) in enumerate(zip(poses, starts, strict=True))
        ]
        return BatchSolution.of(solutions, self.robot.n, self.backend)

    def step(self, q: Any, target: Any, dt: float) -> Step:
        """One control tick of dt [s] from q (n,) toward the target, within position and velocity limits.

        The hierarchy's QP is solved once at q: level 1 the pose, level 2 the redundancy (`Strict`), or both in one
        (`Weighted`). A joint outside its limits comes back at its limit speed.
        Raises `PoseError`, `ConfigurationError`, `OptionError`.
        """
        if not isinstance(dt, (int, float, np.number)) or not 0 < dt < math.inf:
            raise OptionError(f"dt must be a positive number of seconds, got {dt!r}")
        pose = self._target(target)
        at = self.robot.at(real_array(q, (self.robot.n,), "q", ConfigurationError))
        cost = tasks_toward(self.tasks, pose)
        q_next, velocity = tick(cost, self.redundancy, at, self._setting, float(dt))
        position, orientation = _residual(cost, self.robot.at(q_next))
        return Step(velocity, q_next, position, orientation, active_limits(self.robot, q_next))

    def _target(self, target: Any, name: str = "") -> pin.SE3:
        if isinstance(target, Mapping):
            raise PoseError(f"{name}one target a call, not a mapping; further frames go in Solver(tasks=[...])")
        try:
            return as_pose(target)
        except PoseError as reason:
            raise PoseError(f"{name}{reason}") from None

    def _solve(
        self,
        target: pin.SE3,
        q0: np.ndarray | None,
        rng: Callable[[], np.random.Generator],
        observe: Callable[[np.ndarray], object] | None = None,
    ) -> Solution:
        """Search, settle, verdict."""
        setting, options = self._setting, self.options
        budget = Budget(options.deadline, observe)
        cost = tasks_toward(self.tasks, target)
        start = None if q0 is None else setting.admitted(q0)

        def reached(at: Configuration) -> bool:
            position, orientation = _residual(cost, at)
            return position <= options.position_tolerance and orientation <= options.orientation_tolerance

        found = search(cost, start, setting, budget, rng, reached)
        at, stationary, gradient = found.best.at, False, math.nan
        if not found.best.reached:
            at = nearest(cost, found.best, setting, budget).at
            gradient = stationarity(cost, at, setting)
            stationary = gradient <= options.stationarity_tolerance
        elif self.redundancy is not None:
            settled = settle(self.redundancy, cost, at, setting, budget, reached)
            at, gradient = settled.at, settled.projected_gradient
            stationary = gradient <= options.stationarity_tolerance
        fresh = self.robot.at(self.robot.clip(at.q))
        success = reached(fresh)
        position, orientation = _residual(cost, fresh)
        if success:
            status = Status.CONVERGED
        else:
            status = Status.NEAREST if stationary else Status.BUDGET_SPENT
        return Solution(
            q=fresh.q.copy(),
            success=success,
            status=status,
            position_error=position,
            orientation_error=orientation,
            iterations=budget.iterations,
            restarts=found.restarts,
            condition_number=self.robot.condition_number(fresh.q),
            active_limits=active_limits(self.robot, fresh.q),
            cost=self._objective_cost(fresh),
            projected_gradient=gradient,
            start_projected=bool(start is not None and (start != q0).any()),
            backend=self.backend,
        )

    def _objective_cost(self, at: Configuration) -> float:
        if self.redundancy is None:
            return math.nan
        first = self.redundancy.objectives[0] if isinstance(self.redundancy, Strict) else self.redundancy.objective
        return first.cost(at)


def _residual(cost: TaskCost, at: Configuration) -> tuple[float, float]:
    """The largest position error [m] and orientation error [rad] of all tasks."""
    residuals = [task.residual(at) for task in cost.tasks]
    return max(r[0] for r in residuals), max(r[1] for r in residuals)


def _check_type(value: Any, types: Any, name: str, example: str) -> None:
    if not isinstance(value, types):
        raise OptionError(f"{name} must be something like {example}, got {value!r:.80}")


def _seed(value: Any, name: str) -> int:
    if not isinstance(value, (int, np.integer)) or isinstance(value, bool) or value < 0:
        raise OptionError(f"{name} must be a non-negative integer (or, for rng, a Generator), got {value!r:.80}")
    return int(value)


def _listed(targets: Any) -> list:
    if isinstance(targets, (pin.SE3, str, bytes)) or not isinstance(targets, Iterable):
        raise PoseError("targets must be a sequence of poses, (N, 4, 4); for one target use solve")
    return list(targets)


def _starts(q0: Any, count: int, n: int) -> Sequence[np.ndarray | None]:
    if q0 is None:
        return [None] * count
    if np.ndim(q0) == 1:
        return [real_array(q0, (n,), "q0", ConfigurationError)] * count
    return list(real_array(q0, (count, n), "q0", ConfigurationError))
