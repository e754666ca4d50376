"""The solver: a robot, its tasks, limits and redundancy, and the verbs that answer with one result type.

`solve` minimises `1/2 |W e(q)|^2` over `lower <= q <= upper`, e the pose error by the quaternion logarithm, by the
compiled engine where that takes the problem, else by the reference engine: see dispatch.py.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from maira_qp.arrays import check_callable, is_count, is_native, is_number
from maira_qp.display import Card, Shown
from maira_qp.errors import OptionError, PoseError, listed, shown
from maira_qp.problem.limits.joint import Limit, Tick
from maira_qp.problem.objectives import Posture
from maira_qp.problem.options import Options
from maira_qp.problem.problem import Problem
from maira_qp.problem.qp.backends import Backend
from maira_qp.problem.redundancy import Strict, Weighted
from maira_qp.problem.target_frames import in_base, renamed
from maira_qp.problem.targets import SEED_0, checked_seed
from maira_qp.problem.tasks.frame import TargetTask
from maira_qp.problem.tasks.objective import ObjectiveTask
from maira_qp.problem.tasks.task import Task
from maira_qp.results.batch import BatchSolution
from maira_qp.results.path_solution import PathSolution, Rules
from maira_qp.results.solution import Solution
from maira_qp.results.step import Step
from maira_qp.robots.model.joint_values import joint_array, joint_values
from maira_qp.robots.model.robot import Robot
from maira_qp.solvers.calls import about_targets, first_of, of_calls, targets_of
from maira_qp.solvers.dispatch import Choice, Engines
from maira_qp.solvers.paths.closed import check_closed
from maira_qp.solvers.selection import Demands, answer, answer_calls, answer_each, best_of, starts_of
from maira_qp.solvers.tools import MOST_TOOLS, key_of, names_for, on_frames

if TYPE_CHECKING:
    from maira_qp.results.solution_set import Solutions

Rng = np.random.Generator | int | None

_NOT_GIVEN = float("nan")
"""A `dt` that the caller left out: an object of its own, told from a NaN that was computed."""

LARGEST_STEP = 0.5
"""How far a joint moves between two poses of a path at most [rad, or of the arm's length], unless it is said."""

ANY_STEP = 1e9
"""A larger step is no limit either [rad or m], and may be too large a number to compute with."""

VERBS = ("solve", "solve_batch", "step", "track")
"""What `Solver.engine_for` knows."""


class Solver(Shown):
    """Constrained inverse kinematics of one robot. Immutable, so it can be shared between threads, and pickled.

    ```python
    import maira_qp as mq

    robot = mq.Robot.maira()
    solver = mq.Solver(robot, redundancy=mq.Strict(mq.Posture()))
    target = mq.pose([0.4, 0.2, 0.9], quaternion=[0, 1, 0, 0])
    s = solver.solve(target)  # one pose
    batch = solver.solve_batch([target, target])  # many
    t = solver.step(robot.middle, target, dt=0.01)  # one control tick
    path = solver.track(mq.paths.circle(target, 0.05))  # a path
    ```
    """

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
            task: the task of highest priority, `PositionTask()`, `LookAtTask(point=...)`, ..., or several of them;
                None: `PoseTask()` for each tip of the robot.
            tasks: additional tasks and objectives, at the same priority or at lower ones. A task without a target of
                its own takes it from the call, by its frame.
            limits: additional hard limits, such as `LinearLimit(A, b)`; the joint limits always hold, and so do the
                limits of sums that the robot brings with it (`Robot.sum_limits`).
            redundancy: secondary objective: `Weighted(...)`, `Strict(...)`, or None: the tasks alone.
            backend: QP backend: the name of an installed backend of qpsolvers, or `Backend(name, settings)`;
                "compiled": compiled code, with daqp for what it does not know; None: the default, "compiled" for one
                task of the tip of a serial chain without additional limits, else "daqp", with control ticks in
                compiled code where it knows the tasks. `engine_for` says which engine runs a call.
            options: tolerances and budgets.

        Raises `OptionError`, `FrameError`, `BackendError`.
        """
        problem = Problem.build(robot, task=task, tasks=tasks, limits=limits, redundancy=redundancy, options=options)
        self.problem = problem.with_limits_of_robot()
        self.engines = Engines.build(self.problem, backend)
        self._given = {
            "task": tuple(task) if isinstance(task, list) else task,
            "tasks": tuple(tasks),
            "limits": tuple(limits),
            "redundancy": redundancy,
            "backend": backend,
            "options": options,
        }
        self._for_tools = dict[Any, Solver]()
        self._renamed = dict[str, str]()

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_for_tools": {}}

    @property
    def robot(self) -> Robot:
        """The arm, with its tip and joint limits."""
        return self.problem.robot

    @property
    def options(self) -> Options:
        """Tolerances and budgets."""
        return self.problem.options

    @property
    def tasks(self) -> tuple[Task, ...]:
        """The tasks of the first level: what a solve is to reach."""
        return self.problem.tasks

    @property
    def redundancy(self) -> Weighted | Strict | None:
        """What was asked for beside the tasks."""
        return self.problem.redundancy

    @property
    def limits(self) -> tuple[Limit, ...]:
        """All limits, the robot's own first."""
        return self.problem.limits

    @property
    def backend(self) -> str:
        """Who solves the QPs: "compiled", or the backend's name."""
        return self.engines.name

    @property
    def names(self) -> tuple[str, ...]:
        """What calls call tasks, objectives and limits by, see `solve`: names, frames, or words for their classes."""
        return tuple(self.problem.places)

    def limited(self, **limits: Any) -> Solver:
        """The same solver for `robot.limited(**limits)`. Raises `OptionError`."""
        return Solver(self.robot.limited(**limits), **self._given)

    def with_tool(self, tool: Any, name: Any = "tool") -> Solver:
        """The same solver for `robot.with_tool(tool, name)`: errors and tolerances are those of the tool's frame.

        What is asked of the tip is asked of the tool; tasks and objectives of other frames stay as they are. Raises
        `PoseError`, `FrameError`.
        """
        robot = self.robot.with_tool(tool, name)
        tools = dict(zip(self.robot.tips, robot.tips, strict=True))
        return Solver(robot, **on_frames(self._given, tools))

    def _for(self, tool: Any) -> Solver:
        """The solver for a tool, which is kept and takes targets by the names of the tips; this one for None."""
        if tool is None:
            return self
        key = key_of(tool)
        solver = self._for_tools.get(key)
        if solver is None:
            solver = self.with_tool(tool, names_for(tool, self.robot))
            solver._renamed = dict(zip(self.robot.tips, solver.robot.tips, strict=True))
            for oldest in list(self._for_tools)[: 1 - MOST_TOOLS]:
                self._for_tools.pop(oldest, None)
            self._for_tools[key] = solver
        return solver

    def _of_call(
        self,
        engines: Engines,
        target: Any,
        weights: Any = None,
        q: np.ndarray | None = None,
        in_frame: str | None = None,
        base: Any = None,
    ) -> tuple[Engines, Any]:
        """The engines of a call, and the poses that they need in the base, the tips as this solver calls them."""
        if self._renamed:
            target, weights = (renamed(each, self._renamed) for each in (target, weights))
        if in_frame is not None or base is not None:
            target = in_base(target, engines.problem, q, in_frame, base)
        return engines.of_call(target, weights)

    def _card(self) -> Card:
        wish, further = self.redundancy, self.problem.additional_limits
        names = [type(objective).__name__ for objective in wish.objectives] if wish is not None else []
        weight = f", weight={wish.weight:g}" if isinstance(wish, Weighted) else ""
        tasks = [
            f"{task.priority}: {type(task).__name__}{_frame_of(task)}" for task in self.problem.hierarchy.all_tasks
        ]
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
        tool: Any = None,
        in_frame: str | None = None,
        base: Any = None,
        accept: Callable[[np.ndarray], bool] | None = None,
        max_joint_change: Any = None,
        seed: int | None = None,
        weights: Mapping[str, float] | None = None,
        obstacles: Mapping[str, Any] | None = None,
    ) -> Solution:
        """Compute joint values that put the tool at the target.

        Args:
            target: T_base_tool as `pin.SE3` or (4, 4) [m]; None where all tasks have their own. Or a mapping, for
                tasks of several frames, and for whatever is to be another than the solver was built with in this call:
                `{"tool0": pose, "gaze": point, "posture": q, "swivel": angle}`. Its keys are the names of tasks,
                objectives and limits, or their frames, or a word for their class, see `Solver.names`.
            q0: start (n,) [rad or m], or {joint name: value}, in which joints that are not named are at the posture of
                the redundancy, or in the middle of their limits.
                None: of 512 known configurations the one nearest to the target and to the posture of the redundancy;
                joints whose range is a turn or more then end at the turn nearest to that posture. A start outside the
                limits is clipped to them.
                With q0, the answer leaves its basin or turn only for a result better by more than the tolerances, and
                reports it: `left_q0` and `max_joint_change`. It is where the descent from q0 ends, at the pose or at a
                nearest point, unless another start leads to the pose, or to a nearest point whose weighted error |W e|
                is smaller by more than |W (position_tolerance, orientation_tolerance)|; with `Weighted`, the error
                after the trade-off counts. From there the redundancy is optimised along the self-motion. Each joint
                ends at the whole turn nearest to q0, or, where the objective is higher there, at one nearer to the
                optimum.
                Several starts (K, n): the target is solved from each, and the best answer counts: success first, then
                the least objective of the redundancy (`Weighted`: weighted sum), without one the least displacement
                from its own start; where none reaches the target the least error |W e|. `s.q0` is its start.
            rng: generator or seed of the random starts; None: seed 0, so that the same call gives the same answer.
                Other seeds begin elsewhere, and may find another configuration that reaches the target.
            seed: the same as `rng=seed`, by the name that it has in `solve_batch` and `track`.
            observe: callback, called with each iterate (n,), starts included; the reference engine runs then.
            prefer: "closest": of all `solutions` the one nearest to q0 by `sum_i metric_i (q_i - q0_i)^2`, of which
                `cost` is then half: for this call that distance takes the place of the solver's redundancy. Global for
                S-R-S arms, as complete as the list for others, and without regard to the deadline. Where no solution is
                known, the usual verdict from q0. None: the first that is found.
            metric: joint weights (n,), >= 0, or {joint name: weight}, in which others count 1, or a matrix M (n, n) for
                `(q - q0)^T M (q - q0)`; None: 1.
            tool: T_tip_tool, a tool in the tip for this call, as for `with_tool`; kept for later calls.
            in_frame: frame of the robot in which the target is given, its poses, points and directions, such as that of
                a camera, as it stands at q0; without q0 one that does not move. `obstacles` are in the base.
            base: T_room_base: where the base stands in the room in which the target is given, as for `in_frame`.
            accept: test of one's own, f(q) -> bool of a read-only q (n,): an answer that reaches the target counts only
                if it returns True. Else others are looked for, and the best that is accepted is returned: other
                branches and whole turns, and places along the self-motion, from which the redundancy is settled as far
                as what is accepted goes. f may be called some thousand times; what it raises passes. If none is
                accepted, the status is REJECTED, and q is the usual answer; `s.rejected` is how many were rejected.
            max_joint_change: hard limits about q0 for this call: no joint of the answer is farther from q0 than this, a
                number, (n,), or {joint name: value} with others free [rad or m]. What is said of limits then holds
                within that box, and `s.scope` says so: UNREACHABLE is no verdict on the arm itself.
            weights: {name: factor} for the weights of tasks and objectives in this call, >= 0; 0 switches one off. What
                is alone at its level, such as an objective of `Strict`, is minimised whatever its weight: there
                factors other than 0 change nothing.
            obstacles: {name: pose}: where obstacles of a `CollisionLimit` stand in this call; needed for those of a
                mapping that were made without a pose. Nothing is loaded again.

        Raises `PoseError`, `FrameError`, `ConfigurationError`, `OptionError` for invalid arguments; an outcome is a
        `Status`.
        """
        words = _words_of(rng, seed)
        check_callable(observe, "observe", OptionError)
        solver = self._for(tool)
        call = partial(solver._of_call, solver.engines.of_solves.with_obstacles(obstacles), target, weights)
        engines, poses = call()
        problem = engines.problem
        wishes = {"prefer": prefer, "metric": metric, "accept": accept, "max_joint_change": max_joint_change}
        demands = Demands.checked(self.robot, q0, observe=observe, **wishes)
        starts = None if is_native(q0, (self.robot.n,)) else starts_of(q0, problem)
        if starts is not None:
            placed = [call(start, in_frame, base) for start in starts]
            each = [(engines, engines.problem.target(poses)) for engines, poses in placed]
            return best_of(
                [
                    answer(own.about(one), one, start, words, demands, observe)
                    for (own, one), start in zip(each, starts, strict=True)
                ]
            )
        is_plain = in_frame is None and demands is None and is_native(q0, (self.robot.n,))
        start = q0 if is_plain else problem.start(q0)
        if in_frame is not None or base is not None:
            engines, poses = call(start, in_frame, base)
        engines = engines.about(poses)
        if demands is None:
            return engines.solve(poses, start, words, observe)
        return answer(engines, engines.problem.target(poses), start, words, demands, observe)

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
        tool: Any = None,
        in_frame: str | None = None,
        base: Any = None,
        accept: Callable[[np.ndarray], bool] | None = None,
        max_joint_change: Any = None,
        weights: Mapping[str, float] | None = None,
        obstacles: Mapping[str, Any] | None = None,
    ) -> BatchSolution:
        """`solve` for each of N targets: `batch[i].q` is that of `solve(targets[i], q0, rng=seed)`.

        To the bit on one machine with one set of versions; on another to the tolerances, with the same verdict. Each
        target has a random stream of its own, made from the seed and the target itself, so that no answer depends on
        the order of the batch, on how it is split, or on the number of threads. A target with NaN or inf in it is
        not solved, and costs no other anything: its status is INVALID_TARGET, its q and all numbers are NaN.

        Args:
            targets: (N, 4, 4), or a sequence of `pin.SE3` and (4, 4) arrays; or a mapping as for `solve`, whose values
                have an axis N before their own, or are one for all; or N mappings.
            q0: a start (n,) for all, or (N, n) one each, or mappings as for `solve`, in which values may be (N,);
                None: as for `solve`.
            seed: non-negative integer.
            threads: number of threads of the compiled engine; None: one per processor. No answer depends on it.
            progress: callback, called from this thread with the number of targets that are done and their total.
            prefer, metric, tool, in_frame, accept, max_joint_change, weights, obstacles: as for `solve`; with
                `max_joint_change` targets that share a start are solved together, and each start takes some
                milliseconds more.
            base: T_room_base as for `solve`, or (N, 4, 4) one for each target, or for one target.

        Raises `PoseError`, `ConfigurationError` or `OptionError`, naming the target, before anything is solved.
        """
        if threads is not None and not is_count(threads, 1):
            raise OptionError(f"threads must be a positive whole number, got {shown(threads)}")
        check_callable(progress, "progress", OptionError)
        solver = self._for(tool)
        if solver._renamed:
            targets, weights = (renamed(each, solver._renamed) for each in (targets, weights))
        engines, q = solver.engines.of_solves.with_obstacles(obstacles), None
        if in_frame is not None and q0 is not None:
            of_each, poses, count = of_calls(engines, targets, weights)
            q = (problem := first_of(of_each).problem).starts(q0, len(targets_of(problem, poses, count)))
        if in_frame is not None or base is not None:
            targets = in_base(targets, engines.problem, q, in_frame, base)
        of_each, poses, count = of_calls(engines, targets, weights)
        problem = first_of(of_each).problem
        asked = targets_of(problem, poses, count)
        starts, of_each = problem.starts(q0, len(asked)), about_targets(of_each, asked)
        words = checked_seed(seed)
        wishes = {"prefer": prefer, "metric": metric, "accept": accept, "max_joint_change": max_joint_change}
        demands = Demands.checked(self.robot, starts, **wishes)
        if not isinstance(of_each, Engines):
            return answer_calls(of_each, asked, starts, words, progress, demands)
        if demands is None:
            return of_each.solve_batch(asked, starts, words, threads, progress)
        return answer_each(of_each, asked, starts, words, threads, progress, demands)

    def solutions(
        self,
        target: Any,
        rng: Rng = None,
        *,
        seed: int | None = None,
        tool: Any = None,
        in_frame: str | None = None,
        base: Any = None,
    ) -> Solutions:
        """List all configurations within the limits that put the tip at the target, the best first.

        They are ranked by the redundancy's first objective, `Posture()` without one. S-R-S arms: in closed form, all
        arcs of the swivel angle with the best configuration of each, so that the first is the global optimum. Arms of
        six joints: isolated solutions, each whole turn within the limits one of its own; from EAIK's closed form where
        that is installed (`maira-qp[closed-form]`) and knows the arm, else numerical: what descents from random starts
        find until none has found a new one for long. Other redundant arms: the same, with each descent settled at the
        objective's optimum along its self-motion; the list holds these local optima. See `Solutions`.

        Args:
            target: as for `solve`.
            rng, seed: as for `solve`: generator or seed of the random starts.
            tool, in_frame, base: as for `solve`.

        What is listed keeps the limits beside those of the joints: of arcs it is the best of each piece that does. For
        other tasks than one `PoseTask` of the tip, for trees and mimic joints: numerically by the reference engine,
        which takes seconds.

        Raises `PoseError`, `FrameError`.
        """
        from maira_qp.solvers.enumeration.all_solutions import all_solutions  # heavy: Numba comes with it

        solver = self._for(tool)
        engines, target = solver._of_call(
            solver.engines.of_solves.with_obstacles(None), target, None, None, in_frame, base
        )
        targets = engines.problem.target(target)
        redundancy, engine = engines.problem.redundancy, engines.about(targets).of_tip.reference
        objective = Posture() if redundancy is None else redundancy.objectives[0]
        words = _words_of(rng, seed)
        return all_solutions(engine.context, engine.compiled, targets, objective.of(solver.robot), words)

    def track(
        self,
        path: Any,
        q0: Any = None,
        dt: float | None = None,
        *,
        max_step: Any = None,
        max_reconfigurations: int = 0,
        loop: bool = False,
        seed: int = 0,
        progress: Callable[[int, int], object] | None = None,
        tool: Any = None,
        in_frame: str | None = None,
        base: Any = None,
    ) -> PathSolution:
        """Follow a path of poses: joint values for each, so that no joint jumps from one pose to the next.

        Branch, whole turns and redundancy are chosen for the path as a whole: layers of configurations along it are
        linked by dynamic programming, and the line through them is smoothed along the self-motions. A `Posture` or
        `LimitDistance` of the solver then draws on it, as far as its largest step grows by a fifth at most; other
        objectives and lower tasks play no part. The line is found, not proved: where none was found, the result says
        how far the path is followed and what stands in the way.

        Args:
            path: N poses as for `solve_batch`; in a mapping one value for all of them of what is no pose of the path.
            q0: configuration (n,) at the first pose, or near it [rad or m], or {joint name: value} as for `solve`;
                None: any.
            dt: time from pose to pose [s]: no joint moves by more than its velocity limit times dt.
            max_step: largest joint step from pose to pose, a number, (n,) or {joint name: value} [rad or m]; None, and
                for joints that are not named: 0.5 rad, or half of the arm's length. With `dt`, both hold.
            max_reconfigurations: larger steps that are allowed, at which the arm is to leave the path.
            loop: the path ends at the pose where it begins, and the arm is to end as it began, so that it can go round
                again.
            seed: non-negative integer; other seeds begin from other configurations.
            progress: callback, called from this thread with the number of poses that are done, by an estimate of the
                work, and their total; every fraction of a second in long paths. What it raises ends the call.
            tool, in_frame, base: as for `solve`; the frame as it stands at q0.

        The problem must be one that the compiled engine takes, one task of the tip of a chain, or leave the tool free
        to turn about one of its axes: `PoseTask(orientation_weight=[1, 1, 0], axes="target")`. Limits beside those of
        the joints, such as collisions, are kept at each pose and halfway between two.

        Raises `PoseError`, `ConfigurationError`, `OptionError`.
        """
        check_callable(progress, "progress", OptionError)
        solver, start = self._for(tool), self.problem.start(q0)
        engines, path = solver._of_call(
            solver.engines.of_solves.with_obstacles(None), path, None, start, in_frame, base
        )
        engines, path = engines.about_one(path)
        targets = engines.problem.targets(path, "path pose")
        if not targets.is_finite.all():
            raise PoseError(f"the path pose {int(np.flatnonzero(~targets.is_finite)[0])} holds NaN or inf")
        if not is_count(max_reconfigurations, 0):
            raise OptionError(f"max_reconfigurations must be a whole number from 0, got {shown(max_reconfigurations)}")
        if not isinstance(loop, (bool, np.bool_)):
            raise OptionError(f"loop must be True or False, got {shown(loop)}")
        checked_seed(seed)
        rules = Rules(solver._largest_step(dt, max_step), int(max_reconfigurations), dt, bool(loop), q0 is not None)
        _check_followed(engines)
        if loop and len(targets):
            check_closed(solver.problem, *(next(iter(targets.poses(k).values())) for k in (0, len(targets) - 1)))
        return engines.track(targets, start, int(seed), rules, progress)

    def _largest_step(self, dt: Any, max_step: Any) -> np.ndarray:
        """How far (n,) each joint may move from pose to pose. Raises `OptionError`."""
        robot = self.robot
        step = np.where(robot.slides, LARGEST_STEP * robot.length, LARGEST_STEP)
        if max_step is not None:
            step = joint_values(robot.joint_names, max_step, "max_step", step)
            if not (step > 0.0).all():
                raise OptionError(f"max_step must be positive, got {shown(max_step)}")
            step = np.minimum(step, ANY_STEP)
        if dt is None:
            return step
        if not is_number(dt) or not 0 < dt < math.inf:
            raise OptionError(f"dt must be a positive number of seconds, got {shown(dt)}")
        return np.minimum(step, robot.velocity_limit * float(dt))

    def step(
        self,
        q: Any,
        target: Any = None,
        dt: float = _NOT_GIVEN,
        *,
        velocity: Any = None,
        deadline: float | None = None,
        keep_direction: bool = False,
        tool: Any = None,
        in_frame: str | None = None,
        base: Any = None,
        weights: Mapping[str, float] | None = None,
        obstacles: Mapping[str, Any] | None = None,
    ) -> Step:
        """Compute one control step of dt [s] from q (n,) toward the target, within all limits.

        The hierarchical QP is solved once at q, level by level. A joint outside its limits returns at its limit speed.

        Args:
            q: current configuration (n,) [rad or m], or {joint name: value}.
            target: as for `solve`.
            dt: length of the tick [s].
            velocity: current velocity (n,) [rad/s or m/s], or {joint name: value}, that of the last step; needed where
                the robot has acceleration limits, which are kept relative to it.
            deadline: levels that are not solved after this time [s] are left out; None: all are solved.
            keep_direction: where limits do not allow the motion that the tasks of the first level ask for, scale it,
                all tasks by the same factor in [0, 1], which may be 0 at a limit of a joint; False: do what is nearest
                to it by least squares, in whatever direction. Levels below move in the null space as ever. What a joint
                must do to brake or to come back within limits goes before. By the reference engine.
            tool, base, weights, obstacles: as for `solve`.
            in_frame: as for `solve`, the frame as it stands at q.

        Raises `PoseError`, `FrameError`, `ConfigurationError`, `OptionError`.
        """
        if dt is _NOT_GIVEN:
            raise OptionError("a tick needs its length dt in seconds: step(q, target, dt)")
        if not is_number(dt) or not 0 < dt < math.inf:
            raise OptionError(f"dt must be a positive number of seconds, got {shown(dt)}")
        if deadline is not None and not (is_number(deadline) and deadline > 0):
            raise OptionError(f"deadline must be a positive number of seconds, got {shown(deadline)}")
        if not isinstance(keep_direction, (bool, np.bool_)):
            raise OptionError(f"keep_direction must be True or False, got {shown(keep_direction)}")
        solver = self._for(tool)
        if in_frame is not None or isinstance(q, Mapping):
            q = self.robot.configuration(q)
        if isinstance(velocity, Mapping):
            velocity = joint_array(velocity, self.robot.joint_names, "velocity")
        engines = solver.engines.with_obstacles(obstacles)
        engines, target = solver._of_call(engines, target, weights, q, in_frame, base)
        engines = engines.about(target)
        by_reference = deadline is not None or keep_direction
        step = None if by_reference else engines.compiled_step(q, target, float(dt), velocity)
        if step is not None:
            return step
        joints = self.robot.joint_names
        if velocity is None and np.isfinite(self.robot.acceleration_limit).any():
            raise OptionError("limits on the acceleration need the velocity of now: step(..., velocity=last.velocity)")
        now = np.zeros(len(joints)) if velocity is None else joint_array(velocity, joints, "velocity")
        targets, q = engines.problem.target(target), joint_array(q, joints, "q")
        step = None if by_reference else engines.compiled_step(q, targets.poses(), float(dt), now)
        if step is not None:  # all that was amiss was the kind of the arrays
            return step
        return engines.reference_step(q, targets, Tick(float(dt), now), deadline, bool(keep_direction))

    def engine_for(
        self, verb: str = "solve", *, observe: bool = False, deadline: bool = False, keep_direction: bool = False
    ) -> Choice:
        """Which engine runs a call, and why: `print(solver.engine_for("step"))`.

        Args:
            verb: "solve", "solve_batch", "step" or "track".
            observe: for `solve` with `observe=...`.
            deadline, keep_direction: for `step` with these.

        Raises `OptionError` for another verb, and for "track" where no path can be followed.
        """
        if not isinstance(verb, str) or verb not in VERBS:
            raise OptionError(f"no engine for {shown(verb)}; {listed(VERBS, verb)}")
        engines = self.engines if verb == "step" else self.engines.of_solves
        if verb == "track":
            _check_followed(engines)
        return engines.choice(verb, observe=observe, deadline=deadline, keep_direction=keep_direction)


def _words_of(rng: Rng, seed: int | None) -> np.ndarray:
    """The words of a generator or a seed; of neither those of seed 0. Raises `OptionError` for both."""
    if seed is not None:
        if rng is not None:
            raise OptionError("rng and seed both begin the random starts; leave one out")
        return checked_seed(seed)
    return SEED_0 if rng is None else checked_seed(rng)


def _check_followed(engines: Engines) -> None:
    """Raises `OptionError` where no engine follows paths with their problem."""
    if reason := engines.path_refusal:
        raise OptionError(f"a path is followed by the compiled engine, which cannot take this: {reason}")


def _frame_of(task: Task) -> str:
    return f"({task.frame})" if isinstance(task, TargetTask) else ""
