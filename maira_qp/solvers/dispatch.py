"""Which engine runs when, and why: the engines of one problem, and the choice between them for each call.

The compiled engine takes what it knows, the reference engine everything. `Engines.choice` says which and gives the
reason in words; `tables` sums it up, for the documentation.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import pinocchio as pin

from maira_qp.arrays import is_native
from maira_qp.errors import BackendError, listed, shown
from maira_qp.problem.box import SCOPE
from maira_qp.problem.limits.joint import Tick
from maira_qp.problem.limits.linear import LinearLimit
from maira_qp.problem.problem import Problem
from maira_qp.problem.qp.backends import Backend, available
from maira_qp.problem.qp.costs import TaskCost
from maira_qp.problem.targets import SEED_0, Poses, Targets, is_pose, poses_of
from maira_qp.results.batch import BatchSolution
from maira_qp.results.path_solution import PathSolution, Rules
from maira_qp.results.solution import Solution, solution_of
from maira_qp.results.status import status_of
from maira_qp.results.step import Step, step_of
from maira_qp.results.trajectory import Trajectory
from maira_qp.robots.model.edits import unused
from maira_qp.solvers.analysis.sensitivity import dq_dtarget
from maira_qp.solvers.reference.context import Context
from maira_qp.solvers.reference.engine import ReferenceEngine, residual
from maira_qp.solvers.reference.step import brake, keeps_further_limits, tick

if TYPE_CHECKING:
    from maira_qp.results.certificate import Proof
    from maira_qp.results.explanation import Explanation
    from maira_qp.results.path_proof import PathProof
    from maira_qp.solvers.compiled.engine import Compiled
    from maira_qp.solvers.compiled.step import CompiledTick

COMPILED = "compiled"

ASKED = "a QP backend was asked for"

MOST_KEPT = 64
"""Engines that are kept for problems with parts switched off."""

SOLVES = (
    (
        "one pose, position or orientation task of the tip of a serial chain of 1 to some 30 joints, or of an offset "
        "in it; joint limits; no redundancy, or `Weighted` or `Strict` with one `Posture` or `LimitDistance`",
        "compiled (Numba): for S-R-S arms the closed form, then the search, settling of the redundancy, nearest points",
        '`"compiled"`',
    ),
    (
        "the same with another objective, or several, a matrix as the weights of a posture, or with tasks below",
        "the search compiled, the rest by the reference engine",
        '`"compiled"`',
    ),
    (
        "the same with a `deadline`, or a redundancy that cannot be settled at a singular pose",
        "the search compiled, the rest by the reference engine",
        '`"compiled"`',
    ),
    (
        'several tasks, trees, further limits, mimic joints, `observe=...`, or `backend="daqp"` and the like',
        "the reference engine: Pinocchio and the backend, an iteration at a time",
        "its name",
    ),
)
"""What a solve is asked, who answers, and what `Solution.backend` says."""

STEPS = (
    (
        "every task but `LimitTask` and classes of one's own, at any levels; a posture as the only thing in its level, "
        "or `Weighted`; limits of speed and acceleration; chains and trees without mimic joints",
        "compiled",
    ),
    (
        "the same with collisions or other further limits",
        "compiled in the ticks in which these do not bind, reference in the others",
    ),
    (
        "other tasks and objectives, matrices as weights, mimic joints, a `deadline`, `keep_direction`, or "
        '`backend="daqp"` and the like',
        "reference",
    ),
)
"""What a tick is asked, and who answers."""


def tables() -> str:
    """The two tables of the documentation, in Markdown."""
    solves = _table(("`solve`, `solve_batch`", "engine", "`s.backend`"), SOLVES)
    return f"{solves}\n\n{_table(('`step`', 'engine'), STEPS)}"


def _table(head: tuple[str, ...], rows: Iterable[tuple[str, ...]]) -> str:
    return "\n".join([_row(head), "|" + "---|" * len(head), *map(_row, rows)])


def _row(cells: tuple[str, ...]) -> str:
    return f"| {' | '.join(cells)} |"


Observer = Callable[[np.ndarray], object]
Progress = Callable[[int, int], object]


class Choice(NamedTuple):
    """Which engine runs a call."""

    engine: str
    """ "compiled", or the name of the QP backend of the reference engine"""
    reason: str
    """Why, in words"""

    def __str__(self) -> str:
        return f"{self.engine}: {self.reason}"


@dataclass(frozen=True, eq=False)
class Engines:
    """The engines of a problem. A result asks them later for what it did not hold: see `results.answer.Origin`."""

    problem: Problem
    backend: Backend
    """Who solves the QPs of the reference engine"""
    is_compiled_wanted: bool
    """The compiled engine runs where it can"""
    donor: Engines | None = None
    """The engines of a problem that differs in numbers alone: what they are made of is used again"""
    change: np.ndarray | None = None
    """Of a batch with `max_joint_change` (n,) [rad or m]: each answer is from the engines of its own box"""

    @staticmethod
    def build(problem: Problem, backend: str | Backend | None = None) -> Engines:
        """The engines of a problem, with who solves each QP, see `Solver`. Raises `BackendError`, `OptionError`."""
        if backend is not None and not isinstance(backend, (str, Backend)):
            raise BackendError(f"backend must be a name or mq.Backend(name, settings), got {shown(backend)}")
        is_compiled_wanted = backend is None or backend == COMPILED
        solving = backend if isinstance(backend, Backend) else Backend("daqp" if is_compiled_wanted else str(backend))
        engines = Engines(problem, solving, is_compiled_wanted)
        if backend == COMPILED and engines.refusal:
            raise BackendError(f"the compiled engine cannot take this: {engines.refusal}; {listed(available())}")
        engines.reference.context.check()
        engines.compiled_tick  # noqa: B018  (now, not in the first tick)
        return engines

    def with_problem(self, problem: Problem) -> Engines:
        """The engines of a problem of the same robot, such as that of a call, see `Problem.of_call`.

        They are made of these where it differs in numbers: in targets, postures, weights, restarts. Where parts of it
        are switched off, or it has others, engines that are made for such problems are kept.
        """
        if problem.differs_in_limits_alone(self.problem) or problem.is_active == self.problem.is_active:
            return Engines(problem, self.backend, self.is_compiled_wanted, self)
        others = self._of_other_parts
        if problem.is_active not in others:
            if len(others) >= MOST_KEPT:
                others.clear()
            others[problem.is_active] = Engines(problem, self.backend, self.is_compiled_wanted, self)
        return others[problem.is_active].with_problem(problem)

    @cached_property
    def _of_other_parts(self) -> dict[tuple[bool, ...], Engines]:
        """Engines of problems with others of the parts switched off, by which of them count."""
        return {}

    def of_call(self, target: Any, weights: Any = None) -> tuple[Engines, Any]:
        """The engines of a call, and what of its target they need: poses. See `Problem.of_call`."""
        problem = self.problem
        if weights is None and not (isinstance(target, Mapping) and target.keys() - problem.target_keys):
            return self, problem.split(target)[0] if problem.takers else target
        problem, poses = self.problem.of_call(target, weights)
        return self if problem is self.problem else self.with_problem(problem), poses

    def with_obstacles(self, poses: Any) -> Engines:
        """The engines of a call in which obstacles stand elsewhere, {name: pose} or None; see `Problem`."""
        if poses is None:
            self.problem.check_placed()
            return self
        return self.with_problem(self.problem.with_obstacles(poses))

    def about(self, target: Any) -> Engines:
        """The engines with hard limits about the target of a call, where some need it. Raises `PoseError`."""
        if not self.problem.limits_need_targets:
            return self
        targets = target if isinstance(target, Targets) else self.problem.target(target)
        return self.with_problem(self.problem.toward(targets.poses()))

    def about_one(self, path: Any) -> tuple[Engines, Any]:
        """The engines of a path with hard limits about what is one for all of its poses, and the rest of the path."""
        problem = self.problem
        if not (problem.limits_need_targets and isinstance(path, Mapping)):
            return self, path
        keys = path.keys() - problem.hierarchy.target_keys
        values = {key: path[key] for key in keys if is_pose(path[key])}
        rest = {key: value for key, value in path.items() if key not in values}
        return (self.with_problem(problem.with_values(values)), rest) if values else (self, path)

    @cached_property
    def of_solves(self) -> Engines:
        """The engines of solves, which know nothing of tasks that ask for motion."""
        problem = self.problem.of_solves
        return self if problem is self.problem else self.with_problem(problem)

    @cached_property
    def of_tip(self) -> Engines:
        """The engines of the same problem where its only task is that of the tip: an offset is that of a tool.

        Where the task has none they are these. What is known of the tip alone (the closed form, proofs, paths, the
        compiled engine) is asked of these.
        """
        problem, donor = self.problem, self.donor
        if problem.tool is None:
            return self
        if donor is not None and donor.problem.robot is problem.robot and donor.problem.tool is problem.tool:
            donor = donor.of_tip
            return Engines(problem.of_tool(donor.problem.robot), self.backend, self.is_compiled_wanted, donor)
        robot = problem.robot.with_tool(problem.tool, unused("tool", problem.robot.frames))
        return Engines(problem.of_tool(robot), self.backend, self.is_compiled_wanted)

    @cached_property
    def _unsupported(self) -> str:
        """Why the compiled engine cannot solve the problem, its additional limits aside; empty: it can."""
        if not self.is_compiled_wanted:
            return ASKED
        if self.of_tip is not self:
            return self.of_tip._unsupported
        if self._differs_in_limits_alone:
            return self.donor._unsupported  # type: ignore[union-attr]
        from maira_qp.solvers.compiled.problem_arrays import unsupported  # heavy: Numba comes with it

        return unsupported(self.problem)

    def within(self, start: np.ndarray, change: np.ndarray) -> Engines:
        """The same where no joint may be farther from a start (n,) than a change (n,). Raises `ConfigurationError`."""
        return Engines(self.problem.within(start, change), self.backend, self.is_compiled_wanted, self)

    def boxed_by(self, change: np.ndarray) -> Engines:
        """The same for a batch whose answers are within a change (n,) of their starts."""
        return Engines(self.problem, self.backend, self.is_compiled_wanted, self, change)

    def near(self, start: np.ndarray | None) -> Engines:
        """The engines that answered from a start (n,)."""
        return self if self.change is None or start is None else self.within(start, self.change)

    @property
    def scope(self) -> str:
        """What verdicts hold for: empty, the limits of the joints, or the box about a start as well."""
        return SCOPE if self.change is not None or self.problem.box is not None else ""

    @property
    def refusal(self) -> str:
        """Why the compiled engine cannot solve the problem as it is; empty: it can."""
        limits = self.problem.additional_limits
        return self._unsupported or ("it has limits beside those of the joints" if limits else "")

    @cached_property
    def compiled(self) -> Compiled | None:
        """Solves the problem but for its additional limits, if it can."""
        if self._unsupported:
            return None
        if self.of_tip is not self:
            return self.of_tip.compiled
        from maira_qp.solvers.compiled.engine import Compiled

        given = None if self.donor is None else self.donor.compiled
        return Compiled.build(self.problem) if given is None else given.of_problem(self.problem)

    @cached_property
    def context(self) -> Context:
        """The problem with who solves its QPs."""
        return Context(self.problem, self.backend)

    @cached_property
    def reference(self) -> ReferenceEngine:
        """Solves every problem, with the compiled engine where that helps."""
        searching, screening = (None, self.compiled) if self.refusal else (self.compiled, None)
        return ReferenceEngine(self.context, searching, screening, self.of_tip.problem)

    @cached_property
    def tick_refusal(self) -> str:
        """Why the compiled engine cannot take control ticks of the problem, its additional limits aside."""
        if not self.is_compiled_wanted:
            return ASKED
        if self._differs_in_limits_alone or self._differs_in_numbers:
            return self.donor.tick_refusal  # type: ignore[union-attr]
        from maira_qp.solvers.compiled.step import unsupported  # heavy: Numba comes with it

        return unsupported(self.problem)

    @cached_property
    def compiled_tick(self) -> CompiledTick | None:
        """Takes the problem's control ticks but for its additional limits, if it can."""
        if self.tick_refusal:
            return None
        if self._differs_in_limits_alone:
            return self.donor.compiled_tick  # type: ignore[union-attr]
        if self._differs_in_numbers:
            return self.donor.compiled_tick.with_problem(self.problem)  # type: ignore[union-attr]
        from maira_qp.solvers.compiled.step import CompiledTick

        return CompiledTick.build(self.problem)

    @cached_property
    def _differs_in_limits_alone(self) -> bool:
        """The problem has the donor's tasks and redundancy."""
        return self.donor is not None and self.problem.differs_in_limits_alone(self.donor.problem)

    @cached_property
    def _differs_in_numbers(self) -> bool:
        """The problem has the parts of the donor's, with other data."""
        donor = self.donor
        if donor is None or donor.problem.robot is not self.problem.robot:
            return False
        return self.problem.has_parts_of(donor.problem)

    @property
    def name(self) -> str:
        """Who solves the QPs: "compiled", or the backend's name."""
        return self.backend.name if self.refusal else COMPILED

    @cached_property
    def searching(self) -> Compiled | None:
        """The compiled engine, where it makes whole solves."""
        several = len(self.problem.hierarchy.all_tasks) > len(self.problem.tasks)
        return None if self.refusal or several or self.problem.options.deadline is not None else self.compiled

    @cached_property
    def is_compiled_whole(self) -> bool:
        """The compiled engine takes the redundancy too."""
        return self.compiled is not None and (self.problem.is_pose_alone or self.compiled.settles)

    def choice(
        self, verb: str, *, observe: bool = False, deadline: bool = False, keep_direction: bool = False
    ) -> Choice:
        """Which engine runs a call of a verb: "solve" (and "solve_batch"), "step", or "track", which must have one."""
        if verb == "track":
            joints = "one task of the tip of a chain"
            if self.compiled is None:
                joints += ", with a joint more for the axis about which the tool is free to turn"
            return Choice(COMPILED, joints)
        if verb == "step":
            asked = "a deadline is kept" if deadline else "the direction is kept" if keep_direction else ""
            if reason := self.tick_refusal or asked:
                return Choice(self.backend.name, reason)
            binding = ""
            if self.problem.additional_limits:
                binding = f"; ticks in which a limit beside those of the joints binds are made by {self.backend.name}"
            return Choice(COMPILED, f"it knows all tasks and objectives{binding}")
        if self.refusal or observe:
            return Choice(self.backend.name, self.refusal or "each configuration on the way is observed")
        if self.searching is None:
            below = "its tasks have several levels" if self.problem.options.deadline is None else "there is a deadline"
            return Choice(COMPILED, f"the search; the rest by {self.backend.name}, as {below}")
        if self.is_compiled_whole:
            return Choice(COMPILED, "one task of the tip of a chain, and at most one posture")
        reason = "its objectives are no posture with joint weights (n,)"
        return Choice(COMPILED, f"the search; the redundancy by {self.backend.name}, as {reason}")

    def solve(self, target: Any, q0: np.ndarray | None, seed: np.ndarray, observe: Observer | None = None) -> Solution:
        """Solve for one target, from a start (n,) or none. Raises `PoseError`, `FrameError`."""
        compiled = self.searching
        if compiled is None or observe is not None:
            return self._by_reference(self.problem.target(target), q0, seed, observe)
        fault, row, q, outcome, after = compiled.solve(self._native(target), q0, seed)
        if fault:  # said in words, rounded, or for the reference engine
            targets = self.problem.target(target)
            if fault == compiled.NOT_RIGID:
                solution = self.solve(targets.poses(), q0, seed)
                return replace(solution, target_deviation=float(targets.deviations[0]))
            return self._by_reference(targets, q0, seed)
        found, attempt, spent, _, position, orientation, moved, _, left = outcome
        reached = optimal = found > 0.0
        gradient = cost = math.nan
        if after:
            arrived, more, gradient, cost, position, orientation = after
            reached, spent = arrived > 0.0, spent + more
            optimal = gradient <= self.problem.options.stationarity_tolerance
        if not optimal or not self.is_compiled_whole:
            return self.from_here(self.reference.finish(q, outcome, row, q0))
        return solution_of(
            q=q,
            success=reached,
            status=status_of(reached=reached, breaks_limits=False, proved=found < 0.0, stationary=True),
            position_error=position,
            orientation_error=orientation,
            iterations=int(spent),
            restarts=int(attempt),
            cost=cost,
            projected_gradient=gradient,
            optimal=True,
            start_projected=moved > 0.0,
            target_deviation=0.0,
            left_q0=left > 0.0,
            backend=COMPILED,
            _start=None if q0 is None else q0.copy(),
            _target=row,
            _origin=self,
        )

    def _by_reference(
        self, targets: Targets, q0: np.ndarray | None, seed: np.ndarray, observe: Observer | None = None
    ) -> Solution:
        solution = self.reference.solve(targets, q0, seed, observe)
        return self.from_here(solution, float(targets.deviations[0]))

    def from_here(self, solution: Solution, deviation: float = 0.0) -> Solution:
        """A solution of the reference engine, which knows its origin."""
        return replace(solution, target_deviation=deviation, _origin=self)

    def _native(self, target: Any) -> np.ndarray:
        """A target (4, 4) that kernels take, and check. Raises `PoseError` for what is no array of that kind."""
        if isinstance(target, Mapping) and target.keys() == set(self.problem.target_keys):
            (target,) = target.values()
        T = np.ascontiguousarray(target.homogeneous) if isinstance(target, pin.SE3) else target
        if is_native(T, (4, 4)):
            return T  # type: ignore[no-any-return]
        (pose,) = self.problem.target(target).poses().values()
        return np.ascontiguousarray(pose.homogeneous)

    def solve_batch(
        self,
        targets: Targets,
        starts: np.ndarray | None,
        seed: np.ndarray,
        threads: int | None,
        progress: Progress | None,
    ) -> BatchSolution:
        """Solve for N targets, from starts (N, n) or none."""
        batch = BatchSolution.blank(self, self.name, starts, targets)
        compiled, finite, count = self.searching, targets.is_finite, len(targets)
        if compiled is None or not compiled.takes(starts):
            for i in range(count):
                if finite[i]:
                    start = None if starts is None else starts[i]
                    batch.put(i, self.reference.solve(targets[i], start, seed))
                if progress is not None:
                    progress(i + 1, count)
            batch.refuse(~finite)
            return batch
        all_of_it = self.is_compiled_whole  # else what takes the time is yet to come
        rows = np.ascontiguousarray(targets.rows[:, 0])
        outcomes = compiled.solve_batch(rows, starts, seed, threads, progress if all_of_it else None)
        batch.put_arrays(outcomes.fields(self.problem.options.stationarity_tolerance))
        left = np.flatnonzero(finite & ~(batch.optimal & all_of_it)).tolist()
        for i in left:
            start = None if starts is None else starts[i]
            q, outcome = outcomes.q[i].copy(), outcomes.search[i].tolist()
            batch.put(i, self.reference.finish(q, outcome, targets.rows[i], start))
            if progress is not None and not all_of_it:
                progress(i + 1, count)
        if progress is not None and not (all_of_it or finite[-1:].all()):
            progress(count, count)
        batch.refuse(~finite)
        return batch

    @cached_property
    def following(self) -> Engines | None:
        """The engines that follow paths: of the first level, or of an arm with a joint more; None: there are none."""
        from maira_qp.solvers.paths.free_axis import free_axis, with_joint

        if self.compiled is not None:
            return self.with_problem(self.problem.of_first_level()).of_tip
        problem = self.of_tip.problem
        axis = None if self.refusal == ASKED else free_axis(problem)
        return None if axis is None else Engines.build(with_joint(problem, axis))

    @property
    def path_refusal(self) -> str:
        """Why no path can be followed with this problem; empty: it can."""
        from maira_qp.solvers.paths.free_axis import hint

        for limit in self.problem.additional_limits:
            if limit.target_key is not None:
                return _one_for_all(self.problem, limit)
            if isinstance(limit, LinearLimit) and limit.has_equation:
                return f"its {limit.key!r} holds a sum of joints at one value, which along paths mimic joints do"
        return f"{self.refusal}{hint(self.problem)}" if self.following is None else ""

    def track(
        self, targets: Targets, q0: np.ndarray | None, seed: int, rules: Rules, progress: Progress | None = None
    ) -> PathSolution:
        """Follow the path of N targets, from a start (n,) or any, by some rules, if `path_refusal` is empty."""
        from maira_qp.solvers.paths.track import track  # heavy: Numba comes with it

        return replace(track(self.of_tip, targets, q0, seed, rules, progress), _origin=self)

    def timed(self, path: PathSolution, **limits: Any) -> Trajectory:
        """A path with times. Raises `OptionError`."""
        from maira_qp.solvers.paths.timing import timed  # heavy: SciPy's interpolation comes with it

        return timed(path, self, **limits)

    def compiled_step(self, q: Any, target: Any, dt: float, velocity: Any) -> Step | None:
        """A tick by the kernel; None if it does not take this, or limits beside those of the joints bind."""
        done = None if self.compiled_tick is None else self.compiled_tick.tick(target, q, dt, velocity)
        if done is None:
            return None
        if self.problem.additional_limits and not keeps_further_limits(self.context, q, done[0], dt, velocity):
            return None
        ahead, speed, position, orientation, status = done
        return step_of(
            velocity=speed,
            q=ahead,
            position_error=position,
            orientation_error=orientation,
            status=status,
            backend=COMPILED,
            _origin=self,
        )

    def reference_step(
        self, q: np.ndarray, targets: Targets, now: Tick, deadline: float | None, keep_direction: bool
    ) -> Step:
        """A tick by the reference engine."""
        at, context = self.problem.robot.at(q), self.context
        cost, secondary = self.problem.costs_of_tick(targets.poses(), at, now)
        ahead, speed, status = tick(cost, secondary, at, context, now, deadline, keep_direction)
        aimed = TaskCost(tuple(task for task in cost.tasks if not task.is_of_ticks))
        position, orientation = residual(aimed, self.problem.robot.at(ahead))
        return Step(speed, ahead, position, orientation, status, self.backend.name, self)

    def brake(self, q: np.ndarray, now: Tick) -> tuple[np.ndarray, np.ndarray]:
        """Configuration (n,) and velocity (n,) after a tick that stops the arm, or slows it as much as limits allow."""
        return brake(self.problem.robot.at(q), self.context, now)

    def explain(self, solution: Solution) -> Explanation:
        """Why a solve ended as it did."""
        from maira_qp.solvers.analysis.explanation import explain

        return explain(solution, self._poses(solution), self.context, self._resolve)

    def _resolve(self, problem: Problem, poses: Poses, q0: np.ndarray) -> Solution:
        # in compiled code where that is possible, unless somebody else was asked for
        backend = None if self.backend == Backend("daqp") else self.backend
        return Engines.build(problem, backend).solve(dict(poses) or None, q0, SEED_0)

    def jacobian(self, solution: Solution) -> np.ndarray:
        """The derivative (n, 6) of an answer by its target. Raises `SensitivityError`."""
        at = self.problem.robot.at(solution.q)
        return dq_dtarget(self._poses(solution), at, self.context, solution.success)

    def proof(self, solution: Solution) -> Proof | None:
        """What proves that the target of a solution is out of reach."""
        return self._proof(self._poses(solution))

    def _proof(self, poses: Poses) -> Proof | None:
        from maira_qp.solvers.certificates import Proofs  # heavy: Numba comes with it

        proofs = Proofs.build(self.of_tip.problem)
        return None if proofs is None else proofs.proof(poses)

    def path_proof(self, path: PathSolution) -> Proof | PathProof | None:
        """What proves that a path cannot be followed past its first failure."""
        from maira_qp.solvers.paths.impossibility import proof_of  # heavy: Numba comes with it

        k = path.first_failure
        if k is None:
            return None
        if not path.success[k]:
            return self._proof(poses_of(self.problem.target_keys, path._targets[k][None]))
        return proof_of(self.of_tip.problem, path)

    def _poses(self, solution: Solution) -> Poses:
        return poses_of(self.problem.target_keys, solution._target)


def _one_for_all(problem: Problem, limit: Any) -> str:
    """Why a hard limit about the poses of a path is refused, and what to do."""
    kind, followed = type(limit).__name__, problem.hierarchy.target_keys[0]
    key = limit.target_key if limit.target_key != followed else limit.key if limit.name else "range"
    name = "" if limit.name else f"a name, {kind}(..., name={key!r}), and "
    return (
        f"its {kind} is about the target of a call, and needs one for all poses, as its limits stay the same: "
        f"give it {name}one value, track({{{followed!r}: poses, {key!r}: pose}}), or a target of its own; how far the "
        "tool may be from each pose is what the weights of its task say"
    )
