"""The solver: a robot, its tasks, limits and redundancy, and the verbs that answer with one result type.

`solve` minimises `1/2 |W e(q)|^2` over `lower <= q <= upper`, e the pose error by the quaternion logarithm, by the
compiled engine (compiled.py) where that takes the problem, else by the general one (general.py).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from copy import copy
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import pinocchio as pin

from maira_qp.arrays import check_callable, is_count, is_native, is_number, real_array
from maira_qp.display import Card, Shown
from maira_qp.errors import BackendError, ConfigurationError, OptionError, listed, shown
from maira_qp.problem.levels import FARTHEST, Priorities, Targets
from maira_qp.problem.limits.joint import Limit, Tick
from maira_qp.problem.objectives import Posture
from maira_qp.problem.options import Options
from maira_qp.problem.qp.backends import Backend, available
from maira_qp.problem.redundancy import Strict, Weighted
from maira_qp.problem.targets import SEED_0, checked_seed, checked_starts
from maira_qp.problem.tasks.frame import TargetTask
from maira_qp.problem.tasks.objective import ObjectiveTask
from maira_qp.problem.tasks.task import Task
from maira_qp.results.solution import BatchSolution, Solution, Status, Step, solution_of, with_deviation
from maira_qp.robots.model.robot import Robot
from maira_qp.solvers.enumeration.closest import check_preference, posture_at
from maira_qp.solvers.reference.context import Setting
from maira_qp.solvers.reference.engine import General, residual
from maira_qp.solvers.reference.step import keeps_further_limits, tick

if TYPE_CHECKING:
    from maira_qp.results.solution_set import Solutions
    from maira_qp.solvers.compiled.engine import Compiled
    from maira_qp.solvers.compiled.step import CompiledTick

Rng = np.random.Generator | int | None

_NOT_GIVEN = float("nan")
"""A `dt` that the caller left out: an object of its own, told from a NaN that was computed."""


class Solver(Shown):
    """Constrained inverse kinematics of one robot. Immutable, so it can be shared between threads, and pickled."""

    def __init__(
        self,
        robot: Robot,
        *,
        task: Task | Sequence[Task] | None = None,
        tasks: Sequence[Task | ObjectiveTask] = (),
        limits: Sequence[Limit] = (),
        redundancy: Weighted | Strict | None = None,
        backend: str | Backend | None = None,
        options: Options | None = None,
    ) -> None:
        """A solver for a robot.

        Args:
            robot: the arm, with its tip and joint limits.
            task: what is to be reached: `PositionTask()`, `LookAtTask(point=...)`, ..., or several of them; None:
                `PoseTask()` for each tip of the robot.
            tasks: further tasks and objectives, at the same priority or at lower ones. Those that have no target of
                their own take it from the call, by their frame.
            limits: further limits, such as `LinearLimit(A, b)`; the joint limits always hold.
            redundancy: `Weighted(...)`, `Strict(...)`, or None: the pose alone.
            backend: who solves each QP: the name of an installed backend of qpsolvers, or `Backend(name, settings)`;
                "compiled": the search runs in compiled code, what it leaves by daqp; None: "compiled" for one task of
                the tip of a serial chain without further limits, else "daqp", with control ticks in compiled code
                where that knows the tasks.
            options: tolerances and budgets.

        Raises `OptionError`, `FrameError`, `BackendError`.
        """
        _check_type(robot, Robot, "robot", "mq.Robot.maira() or mq.Robot.from_urdf(...)")
        _check_type(options, (Options, type(None)), "options", "mq.Options(...)")
        _check_type(redundancy, (Weighted, Strict, type(None)), "redundancy", "mq.Strict(mq.Posture())")
        for name, value in (("tasks", tasks), ("limits", limits)):
            _check_type(value, (list, tuple), name, "a list")
        for limit in limits:
            _check_type(limit, Limit, "limit", "mq.LinearLimit(A, b)")
        self.robot = robot
        self._priorities = Priorities.of(robot, task, tasks, redundancy)
        options = options or Options()
        self._compiled: Compiled | None = None
        screening: Compiled | None = None
        self._compiled_tick: CompiledTick | None = None
        if backend is not None and not isinstance(backend, (str, Backend)):
            raise BackendError(f"backend must be a name or mq.Backend(name, settings), got {shown(backend)}")
        if backend is None or backend == "compiled":
            from maira_qp.solvers.compiled.engine import Compiled  # heavy: Numba comes with it
            from maira_qp.solvers.compiled.step import CompiledTick

            self._compiled_tick = CompiledTick.of(self._priorities, options)
            possible = Compiled.of(self._priorities, options)
            if isinstance(possible, Compiled):
                self._compiled, screening = (None, possible) if limits else (possible, None)
            if backend == "compiled" and self._compiled is None:
                reason = possible if isinstance(possible, str) else "it has limits beside those of the joints"
                raise BackendError(f"the compiled engine cannot take this: {reason}; {listed(available())}")
        if not isinstance(backend, Backend):
            backend = Backend("daqp" if backend is None or backend == "compiled" else backend)
        further = tuple(limit.of(robot) for limit in limits)
        self._setting = Setting(robot, further, self._priorities.turns.window, backend, options)
        self._setting.check()
        self._general = General(self._priorities, self._setting, self._compiled, screening)

    @property
    def options(self) -> Options:
        """Tolerances and budgets."""
        return self._setting.options

    @property
    def tasks(self) -> tuple[Task, ...]:
        """The tasks of the first level: what a solve is to reach."""
        return self._priorities.first

    @property
    def redundancy(self) -> Weighted | Strict | None:
        """What was asked for beside the tasks."""
        return self._priorities.redundancy

    @property
    def limits(self) -> tuple[Limit, ...]:
        """All limits, the robot's own first."""
        return self._setting.limits

    @property
    def _search_engine(self) -> Compiled | None:
        """The compiled engine, unless tasks of several levels are first searched for together."""
        return None if len(self._priorities.all_tasks) > len(self.tasks) else self._compiled

    @property
    def backend(self) -> str:
        """Who solves the QPs: "compiled", or the backend's name."""
        return self._setting.backend.name if self._compiled is None else "compiled"

    def _card(self) -> Card:
        wish, further = self.redundancy, self._setting.further
        names = [type(objective).__name__ for objective in wish.objectives] if wish is not None else []
        weight = f", weight={wish.weight:g}" if isinstance(wish, Weighted) else ""
        tasks = [f"{task.priority}: {type(task).__name__}{_frame_of(task)}" for task in self._priorities.all_tasks]
        return Card(
            title=f"Solver of {self.robot.title}",
            facts=(
                ("tasks by priority", ", ".join(tasks)),
                ("redundancy", "none" if wish is None else f"{type(wish).__name__}({', '.join(names)}{weight})"),
                ("limits beside those of the joints", ", ".join(type(limit).__name__ for limit in further)),
                ("backend", self.backend),
                ("joints", ", ".join(self.robot.joint_names)),
            ),
        )

    def solve(
        self,
        target: Any = None,
        q0: Any = None,
        rng: Rng = None,
        *,
        observe: Callable[[np.ndarray], object] | None = None,
        prefer: str | None = None,
        metric: Any = None,
    ) -> Solution:
        """Joint angles that put the tool at the target.

        Args:
            target: `pin.SE3` or (4, 4), T_base_tool [m]; where tasks of several frames need one, {frame: pose}; where
                all have their own, None.
            q0: start (n,) [rad or m]; None: of a few hundred known configurations the one nearest to the target, and to
                the posture that the redundancy wishes for; joints with a turn or more then end at the one nearest to
                that posture. A start outside the limits is moved onto them.
                With q0, the answer leaves its basin or turn only for a result better by more than the tolerances, and
                says so: `left_q0` and `max_joint_change`. It is where the descent from q0 ends, at the pose or at a
                nearest point, unless another start leads to the pose, or to a nearest point whose weighted error |W e|
                is smaller by more than |W (position_tolerance, orientation_tolerance)|, with `Weighted` once traded
                off. From there the redundancy is optimised along the self-motion. Each joint ends at the whole turn
                nearest to q0, or where the redundancy's objective is higher there, at one nearer to its optimum.
            rng: generator or seed of what is random about the starts; None: seed 0, so that the same call gives the
                same answer. Other seeds begin elsewhere, and may find another configuration that reaches the target.
            observe: called with each configuration (n,) on the way, starts included, for pictures of the iteration;
                with it, nothing runs in compiled code.
            prefer: "closest": of all `solutions` the one nearest to q0 by `sum_i metric_i (q_i - q0_i)^2`, of which
                `cost` is then half: for this call that distance takes the place of the solver's redundancy. Global for
                S-R-S arms, as complete as the list for others, and without regard to the deadline. Where no solution is
                known, the usual verdict from q0. None: the first that is found.
            metric: joint weights (n,), >= 0; None: 1.

        Raises `PoseError`, `ConfigurationError`, `OptionError` for what cannot be meant; the rest is a `Status`.
        """
        seed = SEED_0 if rng is None else checked_seed(rng)
        check_callable(observe, "observe", OptionError)
        if prefer is not None or metric is not None:
            check_preference(prefer, q0, observe)
            closest = self._closest(self._priorities.targets(target), posture_at(q0, metric, self.robot), seed)
            return with_deviation(closest, target)
        return self._answer(target, q0, seed, observe)

    def _answer(
        self, target: Any, q0: Any, seed: np.ndarray, observe: Callable[[np.ndarray], object] | None = None
    ) -> Solution:
        """A solve by the engine that takes it."""
        start = q0 if q0 is None or is_native(q0, (self.robot.n,)) else self._start(q0)
        engine = self._search_engine
        if engine is None or observe is not None or self.options.deadline is not None:
            solution = self._general.solve(self._priorities.targets(target), self._start(start), seed, observe)
            return with_deviation(solution, target)
        native = self._native(target)
        fault, q, outcome, after = engine.solve(native, start, seed)
        if fault:  # said in words, rounded, or for the general engine
            targets = self._priorities.targets(target)
            if fault == engine.NOT_RIGID:
                return with_deviation(self._answer(targets, start, seed), target)
            return self._general.solve(targets, self._start(start), seed)
        found, _, spent, _, position, orientation, moved, _, left = outcome
        reached = optimal = found > 0.0
        gradient = cost = math.nan
        if after:
            arrived, more, gradient, cost, position, orientation = after
            reached, spent, optimal = arrived > 0.0, spent + more, gradient <= self.options.stationarity_tolerance
        if not optimal or not (engine.settles or self._priorities.is_done_by_search):
            return self._general.finish(q, outcome, self._priorities.targets(target), self._start(start))
        return solution_of(
            q=q,
            success=reached,
            status=Status.CONVERGED if reached else Status.UNREACHABLE if found < 0.0 else Status.NEAREST,
            position_error=position,
            orientation_error=orientation,
            iterations=int(spent),
            restarts=int(outcome[1]),
            cost=cost,
            projected_gradient=gradient,
            optimal=True,
            start_projected=moved > 0.0,
            target_deviation=0.0,
            left_q0=left > 0.0,
            backend="compiled",
            _start=None if start is None else start.copy(),
            _setting=self._setting,
            _asked=(self._priorities, native.copy()),
        )

    def solve_batch(
        self,
        targets: Any,
        q0: Any = None,
        seed: int = 0,
        *,
        threads: int | None = None,
        progress: Callable[[int, int], object] | None = None,
        prefer: str | None = None,
        metric: Any = None,
    ) -> BatchSolution:
        """`solve` for each of N targets: `batch[i].q` is that of `solve(targets[i], q0, rng=seed)`.

        To the bit on one machine with one set of versions; on another to the tolerances, with the same verdict. Each
        target has a random stream of its own, made from the seed and the target itself, so that no answer depends on
        the order of the batch, on how it is split, or on the number of threads. A target with NaN or inf in it is
        not solved, and costs no other anything: its status is INVALID_TARGET, its q and all numbers are NaN.

        Args:
            targets: (N, 4, 4), or a sequence of `pin.SE3` and (4, 4) arrays; where tasks of several frames need one,
                {frame: (N, 4, 4)} or N mappings {frame: pose}.
            q0: a start (n,) for all, or (N, n) one each; None: as for `solve`.
            seed: non-negative integer.
            threads: how many threads the compiled engine may use; None: one a processor. No answer depends on it.
            progress: called now and then, from this thread, with how many targets are done and how many there are.
            prefer, metric: as for `solve`.

        Raises `PoseError`, `ConfigurationError` or `OptionError`, naming the target, before anything is solved.
        """
        if threads is not None and not is_count(threads, 1):
            raise OptionError(f"threads must be a positive whole number, got {shown(threads)}")
        check_callable(progress, "progress", OptionError)
        rows, deviations = self._priorities.rows(targets)
        starts = checked_starts(q0, len(rows), self.robot.n)
        words = checked_seed(seed)
        postures = None
        if prefer is not None or metric is not None:
            check_preference(prefer, starts)
            postures = [posture_at(start, metric, self.robot) for start in starts]  # type: ignore[union-attr]
        batch = BatchSolution.blank(self._setting, self.backend, starts, (self._priorities, rows))
        batch.target_deviation[:] = deviations
        finite = np.isfinite(rows[:, 0, 0])
        engine = self._search_engine
        if postures is not None or engine is None or self.options.deadline is not None or not engine.takes(starts):
            batch.q[:] = self.robot.middle
            for i in range(len(rows)):
                if finite[i]:
                    targets = self._priorities.of_row(rows[i])
                    if postures is not None:
                        batch.put(i, self._closest(targets, postures[i], words))
                    else:
                        batch.put(i, self._general.solve(targets, None if starts is None else starts[i], words))
                if progress is not None:
                    progress(i + 1, len(rows))
            batch.refuse(~finite)
            return batch
        all_of_it = self._priorities.is_done_by_search or engine.settles
        told = progress if all_of_it else None  # else what takes the time is yet to come
        left: dict[int, list[float]] = {}

        def put(part: slice, outcome: np.ndarray, after: np.ndarray) -> None:
            batch.put_found(part, outcome, after, self.options.stationarity_tolerance)
            unfinished = finite[part] & ~batch.optimal[part] if all_of_it else finite[part]
            for i in np.flatnonzero(unfinished).tolist():
                left[part.start + i] = outcome[i].tolist()

        one, q = np.ascontiguousarray(rows[:, 0]), batch.q
        engine.solve_batch(one, starts, words, threads, told, q, put)
        for i in sorted(left):
            start = None if starts is None else starts[i]
            batch.put(i, self._general.finish(q[i].copy(), left[i], self._priorities.of_row(rows[i]), start))
            if progress is not None and not all_of_it:
                progress(i + 1, len(rows))
        if progress is not None and not (all_of_it or finite[-1:].all()):
            progress(len(rows), len(rows))
        batch.refuse(~finite)
        return batch

    def solutions(self, target: Any, rng: Rng = None) -> Solutions:
        """All configurations within the limits that put the tip at the target, the best first.

        They are ranked by the redundancy's first objective, `Posture()` without one. S-R-S arms: in closed form, all
        arcs of the swivel angle with the best configuration of each, so that the first is the global optimum. Arms of
        six joints: isolated solutions, each whole turn within the limits one of its own; from EAIK's closed form where
        that is installed (`maira-qp[closed-form]`) and knows the arm, else numerical: what descents from random starts
        find until none has found a new one for long. Other redundant arms: the same, with each descent settled at the
        objective's optimum along its self-motion; the list holds these local optima. See `Solutions`.

        Args:
            target: as for `solve`.
            rng: as for `solve`: generator or seed of the random starts.

        Raises `PoseError`; `OptionError` for other tasks than one `PoseTask` of the tip, for further limits, and for a
        robot that is no serial chain.
        """
        from maira_qp.solvers.enumeration.all_solutions import all_solutions  # heavy: Numba comes with it

        targets, redundancy = self._priorities.targets(target), self.redundancy
        objective = Posture() if redundancy is None else redundancy.objectives[0]
        seed = SEED_0 if rng is None else checked_seed(rng)
        return all_solutions(self._priorities, self._setting, self._compiled, targets, objective.of(self.robot), seed)

    def _closest(self, targets: Targets, posture: Posture, seed: np.ndarray) -> Solution:
        """The nearest of all solutions to a posture, settled there, and of what is found from it.

        A list that is not complete may lack what a descent from the posture leads to.
        """
        from maira_qp.solvers.enumeration.all_solutions import nearest_solution

        q0, by_distance = posture.q_ref, self._with_redundancy(Strict(posture))
        q = nearest_solution(by_distance._priorities, self._setting, self._compiled, targets, posture, seed)
        near = by_distance._answer(targets, q0, seed)
        if q is None:
            return near
        listed = by_distance._answer(targets, q, seed)
        if near.success and not (listed.success and listed.cost < near.cost):
            return near
        return replace(listed, _start=q0, left_q0=near.left_q0, start_projected=near.start_projected)

    def _with_redundancy(self, redundancy: Strict) -> Solver:
        """The same solver with another redundancy, made for the robot."""
        other = copy(self)
        other._priorities = replace(self._priorities, redundancy=redundancy)
        other._compiled = None if self._compiled is None else self._compiled.preferring(redundancy)
        other._general = replace(self._general, priorities=other._priorities, compiled=other._compiled)
        return other

    def step(
        self,
        q: Any,
        target: Any = None,
        dt: float = _NOT_GIVEN,
        *,
        velocity: Any = None,
        deadline: float | None = None,
        keep_direction: bool = False,
    ) -> Step:
        """One control tick of dt [s] from q (n,) toward the target, within all limits.

        The hierarchy's QPs are solved once at q, level by level. A joint outside its limits comes back at its limit
        speed.

        Args:
            q: configuration (n,) of now [rad or m].
            target: as for `solve`.
            dt: length of the tick [s].
            velocity: velocity (n,) of now [rad/s or m/s], that of the last tick; needed where the robot has limits on
                the acceleration, which are kept against it.
            deadline: levels that are not solved after this time [s] are left out; None: all are solved.
            keep_direction: where limits do not allow the motion that the tasks of the first level ask for, scale it,
                all tasks by the same factor in [0, 1], which may be 0 at a limit of a joint; False: do what is nearest
                to it by least squares, in whatever direction. Levels below move in the null space as ever. What a joint
                must do to brake or to come back within limits goes before. By the general engine.

        Raises `PoseError`, `ConfigurationError`, `OptionError`.
        """
        if dt is _NOT_GIVEN:
            raise OptionError("a tick needs its length dt in seconds: step(q, target, dt)")
        if not is_number(dt) or not 0 < dt < math.inf:
            raise OptionError(f"dt must be a positive number of seconds, got {shown(dt)}")
        if deadline is not None and not (is_number(deadline) and deadline > 0):
            raise OptionError(f"deadline must be a positive number of seconds, got {shown(deadline)}")
        if not isinstance(keep_direction, (bool, np.bool_)):
            raise OptionError(f"keep_direction must be True or False, got {shown(keep_direction)}")
        is_general = deadline is not None or keep_direction
        step = None if is_general else self._compiled_step(q, target, float(dt), velocity)
        if step is not None:
            return step
        n = self.robot.n
        if velocity is None and np.isfinite(self.robot.acceleration_limit).any():
            raise OptionError("limits on the acceleration need the velocity of now: step(..., velocity=last.velocity)")
        now = np.zeros(n) if velocity is None else real_array(velocity, (n,), "velocity", ConfigurationError)
        targets, q = self._priorities.targets(target), real_array(q, (n,), "q", ConfigurationError)
        step = None if is_general else self._compiled_step(q, targets, float(dt), now)
        if step is not None:  # all that was amiss was the kind of the arrays
            return step
        cost, wish = self._priorities.costs(targets)
        at, now = self.robot.at(q), Tick(float(dt), now)
        q_next, speed, status = tick(cost, wish, at, self._setting, now, deadline, bool(keep_direction))
        position, orientation = residual(cost, self.robot.at(q_next))
        return Step(speed, q_next, position, orientation, status, self._setting.backend.name, self._setting)

    def _compiled_step(self, q: Any, target: Any, dt: float, velocity: Any) -> Step | None:
        """A tick by the kernel; None if it does not take this, or other limits than those of the joints bind."""
        done = None if self._compiled_tick is None else self._compiled_tick.tick(target, q, dt, velocity)
        if done is None or not keeps_further_limits(self._setting, q, done[0], dt, velocity):
            return None
        ahead, speed, position, orientation, status = done
        return Step(speed, ahead, position, orientation, status, "compiled", self._setting)

    def _start(self, q0: Any) -> np.ndarray | None:
        return None if q0 is None else real_array(q0, (self.robot.n,), "q0", ConfigurationError)

    def _native(self, target: Any) -> np.ndarray:
        """A target (4, 4) that kernels take, and check. Raises `PoseError` for what is no array of that kind."""
        T = np.ascontiguousarray(target.homogeneous) if isinstance(target, pin.SE3) else target
        far = FARTHEST * self.robot.length
        if is_native(T, (4, 4)) and not max(abs(T[0, 3]), abs(T[1, 3]), abs(T[2, 3])) > far:
            return T
        (pose,) = self._priorities.targets(target).values()
        return np.ascontiguousarray(pose.homogeneous)


def _frame_of(task: Task) -> str:
    return f"({task.frame})" if isinstance(task, TargetTask) else ""


def _check_type(value: Any, types: Any, name: str, example: str) -> None:
    if not isinstance(value, types):
        raise OptionError(f"{name} must be something like {example}, got {shown(value)}")
