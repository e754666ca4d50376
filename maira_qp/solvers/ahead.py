"""Compile kernels ahead of their first use, in several processes that each do one job after another.

A job brings the engine to call one of its large kernels, on a small problem with the arrays that it makes for any
other: what a kernel is compiled for does not depend on the robot, so built-in arms stand for all.
"""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor, as_completed
from contextlib import ExitStack, suppress
from math import pi
from queue import SimpleQueue
from subprocess import PIPE, Popen
from tempfile import TemporaryFile

import numpy as np

from maira_qp.analytic.srs.geometry import SRS
from maira_qp.arrays import check_callable, is_count, is_listing
from maira_qp.errors import CompilationError, OptionError, listed, shown
from maira_qp.problem.objectives import Posture
from maira_qp.problem.redundancy import Strict, Weighted
from maira_qp.problem.targets import SEED_0, rows_of, streams
from maira_qp.robots.dh.table import DHLink, JointKind
from maira_qp.robots.model.robot import Robot
from maira_qp.solvers.solver import Solver
from maira_qp.solvers.streaming.tracker import Tracker

VERBS = ("solve", "solve_batch", "solutions", "step", "track")


def compile(
    robot_or_solver: Robot | Solver | None = None,
    *,
    verbs: Iterable[str] = VERBS,
    processes: int | None = None,
    progress: Callable[[int, int], object] | None = None,
) -> None:
    """Compile all kernels that some verbs need, and keep them for every later process: see `maira-qp cache`.

    What is compiled already is loaded.

    Args:
        robot_or_solver: for a robot what its kind of arm needs is compiled, for a solver what its redundancy needs;
            None: what every arm and every redundancy needs.
        verbs: of "solve", "solve_batch", "solutions", "step" and "track".
        processes: how many work at a time; None: as many as there are processors for this process.
        progress: called with the number of jobs that are done and their total.

    Raises `OptionError` for an unknown verb or no process, `CompilationError` where compiled code cannot be kept.
    """
    names = list(jobs(robot_or_solver, verbs))
    if processes is not None and not is_count(processes, 1):
        raise OptionError(f"processes must be a whole number >= 1, got {shown(processes)}")
    check_callable(progress, "progress", OptionError)
    count = int(processes) if processes is not None else len(os.sched_getaffinity(0))
    if os.environ.get("NUMBA_DISABLE_JIT", "0") not in ("", "0"):
        return
    from maira_qp.kernels.jit import code_cache  # heavy: Numba comes with it

    if code_cache.writable() is None:
        raise CompilationError("compiled code can be kept nowhere; set NUMBA_CACHE_DIR to a folder to write to")
    if progress is not None:
        progress(0, len(names))
    with ExitStack() as stack:
        workers = [stack.enter_context(_Worker()) for _ in range(min(count, len(names)))]
        pool = stack.enter_context(ThreadPoolExecutor(count))
        idle = SimpleQueue[_Worker]()
        for worker in workers:
            idle.put(worker)
        running = [pool.submit(_run, name, idle) for name in names]
        try:
            for done, job in enumerate(as_completed(running), 1):
                job.result()
                if progress is not None:
                    progress(done, len(names))
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            for worker in workers:
                worker.interrupt()
            raise


def jobs(robot_or_solver: Robot | Solver | None, verbs: Iterable[str]) -> Iterator[str]:
    """The names of the jobs for some verbs, the longest first. Raises `OptionError` for an unknown verb."""
    if not isinstance(robot_or_solver, (Robot, Solver, type(None))):
        raise OptionError(f"what is compiled for must be a Robot, a Solver or None, got {shown(robot_or_solver)}")
    if not isinstance(verbs, str) and not is_listing(verbs):
        raise OptionError(f"verbs must be a list of names, got {shown(verbs)}; {listed(VERBS)}")
    verbs = [verbs] if isinstance(verbs, str) else list(verbs)
    for verb in verbs:
        if not isinstance(verb, str) or verb not in VERBS:
            raise OptionError(f"no verb {shown(verb)} to compile; {listed(VERBS, verb)}")
    solver = robot_or_solver if isinstance(robot_or_solver, Solver) else None
    robot = robot_or_solver.robot if isinstance(robot_or_solver, Solver) else robot_or_solver
    is_srs = robot is None or (robot.is_chain and SRS.of(robot) is not None)
    settles = solver is None or solver.redundancy is not None
    searches = set(verbs) > {"step"} or "step" not in verbs
    wanted = {
        "step": "step" in verbs,
        "paths": "track" in verbs,
        "settle": searches and settles,
        "settle_alone": searches and settles,
        "trade_off": searches and (solver is None or isinstance(solver.redundancy, Weighted)),
        "closed_form": searches and is_srs,
        "posture_seed": searches and settles and is_srs,
        "nearest_in_closed_form": searches and is_srs,
    }
    yield from (name for name in JOBS if wanted.get(name, searches))


class _Worker:
    """A process that does jobs, one after another: what several need it compiles for the first of them."""

    CODE = "import sys; sys.path[:] = {path!r}; from maira_qp.solvers.ahead import work; work()"

    def __init__(self) -> None:
        self._errors = TemporaryFile("w+")  # noqa: SIM115 - closed on exit
        command = [sys.executable, "-c", self.CODE.format(path=sys.path)]
        self._process = Popen(command, stdin=PIPE, stdout=PIPE, stderr=self._errors, text=True)

    def __enter__(self) -> _Worker:
        return self

    def __exit__(self, *_: object) -> None:
        self._process.communicate()
        self._errors.close()

    def do(self, name: str) -> None:
        """Wait until a job is done. Raises `CompilationError` with the last line that a worker which died has said."""
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        with suppress(BrokenPipeError):
            self._process.stdin.write(f"{name}\n")
            self._process.stdin.flush()
        if self._process.stdout.readline():
            return
        code = self._process.wait()
        self._errors.seek(0)
        last = (self._errors.read().strip().splitlines() or [f"exit code {code}"])[-1]
        raise CompilationError(f"compiling {name} failed: {last}")

    def interrupt(self) -> None:
        """Make it stop, as Ctrl-C does."""
        self._process.send_signal(signal.SIGINT)


def _run(name: str, idle: SimpleQueue[_Worker]) -> None:
    """Give a job to a worker that is idle, and wait until it is done. Raises `CompilationError`."""
    worker = idle.get()
    try:
        worker.do(name)
    finally:
        idle.put(worker)


def work() -> None:
    """Do the jobs that standard input names, and write a line to standard output after each."""
    told, sys.stdout = sys.stdout, sys.stderr
    for line in sys.stdin:
        JOBS[line.strip()]()
        print("done", file=told, flush=True)


def _six_axes(kind: JointKind = "revolute") -> Robot:
    """An arm without a closed form here, its last joint of a kind."""
    alpha, d, a = (pi / 2, 0, pi / 2, -pi / 2, pi / 2, 0), (0.4, 0.1, 0.05, 0.4, 0.07, 0.1), (0.1, 0.4, 0, 0.03, 0, 0)
    links = [DHLink(a=a[i], alpha=alpha[i], d=d[i], lower=-3.0, upper=3.0) for i in range(5)]
    return Robot.from_dh([*links, DHLink(kind=kind, a=a[5], alpha=alpha[5], d=d[5])])


class _Problem:
    """One target of an arm, as the stages of the compiled engine take it."""

    def __init__(self, robot: Robot, redundancy: Strict | Weighted | None = None) -> None:
        from maira_qp.kernels.layout import Outcome, Refinement  # heavy: Numba comes with it
        from maira_qp.solvers.compiled.batch import Batch

        self.solver = Solver(robot, redundancy=redundancy)
        assert self.solver.engines.compiled is not None
        self.engine = self.solver.engines.compiled
        self.start = np.linspace(0.4, 0.9, robot.n)
        self.target = robot.forward(self.start).homogeneous
        self.q = self.start[None].copy()
        self.outcome, self.after = np.zeros((1, Outcome.WIDTH)), np.zeros((1, Refinement.WIDTH))
        self.batch = Batch(rows_of(self.target[None])[0], np.empty((0, robot.n)), np.zeros(1, np.uint64), False)

    def settle(self) -> None:
        """Of a q that does not reach the pose, kernels do what they do where few targets lead."""
        from maira_qp.solvers.compiled.refinement import refine

        refine(self.engine, self.batch.rows, None, self.q, self.after)


def _solve(robot: Robot) -> None:
    problem = _Problem(robot)
    problem.solver.solve(problem.target)


def _step() -> None:
    problem = _Problem(Robot.maira())
    Tracker(problem.solver, problem.start)  # which makes a step


def _posture_seed() -> None:
    from maira_qp.solvers.compiled.closed_form import reach_near_posture

    problem = _Problem(Robot.maira(), Strict(Posture()))
    reach_near_posture(problem.engine, problem.batch.rows, *problem.engine.posture, problem.q, problem.outcome)


def _settle(redundancy: Strict | Weighted, offset: float) -> None:
    problem = _Problem(Robot.maira(), redundancy)
    problem.q += offset
    problem.settle()


def _nearest() -> None:
    from maira_qp.solvers.compiled.refinement import finish

    problem = _Problem(_six_axes())
    finish(problem.engine, problem.batch, problem.q, problem.outcome)


def _nearest_in_closed_form() -> None:
    from maira_qp.solvers.compiled.closed_form import approach_in_closed_form

    problem = _Problem(Robot.maira())
    approach_in_closed_form(problem.engine, problem.batch, np.array([0]), problem.q, problem.outcome)


def _proofs() -> None:
    for robot in (_six_axes(), Robot.maira()):
        problem = _Problem(robot)
        problem.engine.proofs.unreachable(problem.batch.rows)


def _paths() -> None:
    from maira_qp.kernels.paths.boxes import within_a_step

    robot = Robot.maira()
    Solver(robot).track([robot.forward(robot.middle + share) for share in (0.1, 0.11, 0.12, 0.13)])
    boxes = np.zeros((1, 2, 7))
    within_a_step(boxes, boxes, np.ones(7), np.empty(1, np.bool_))


def _small() -> None:
    """What takes a second or less each."""
    from maira_qp.kernels.kinematics.unwrap import has_free_turn, unwind, unwind_free
    from maira_qp.kernels.layout import Outcome
    from maira_qp.kernels.search.seeds import has_long_slides

    problem = _Problem(_six_axes("continuous"), Weighted(Posture(), weight=1e-3))
    turns, robot = problem.engine.turns, Robot.maira()
    assert turns is not None
    for rows in (1, 2):  # a column of one row is contiguous, which makes it another type
        q, outcome = problem.q.repeat(rows, 0), problem.outcome.repeat(rows, 0)
        unwind(problem.engine.chain, turns.aim[None], outcome[:, Outcome.SUCCESS], q)
    free = problem.engine.chain, turns.aim[None], *problem.engine.posture
    has_free_turn(*free, problem.q)
    unwind_free(*free, np.ones(1, dtype=bool), problem.q)
    has_long_slides(problem.engine.chain)
    streams(problem.batch.rows, SEED_0)
    robot.jacobians(np.zeros((1, robot.n)))
    srs = SRS.of(robot)
    assert srs is not None
    srs.joints[0].decompose(np.eye(3)[None])


JOBS: dict[str, Callable[[], object]] = {
    "step": _step,
    "closed_form": lambda: _solve(Robot.maira()),
    "search": lambda: _solve(_six_axes()),
    "settle": lambda: _settle(Strict(Posture()), 0.0),
    "posture_seed": _posture_seed,
    "nearest_in_closed_form": _nearest_in_closed_form,
    "settle_alone": lambda: _settle(Strict(Posture()), 0.3),
    "trade_off": lambda: _settle(Weighted(Posture(), weight=1e-3), 0.0),
    "nearest": _nearest,
    "proofs": _proofs,
    "paths": _paths,
    "small": _small,
}
"""What is compiled by itself, the longest first; what needs other kernels too comes after their jobs."""
