"""What the viewer is about, without a browser: a robot, a target, and how the arm follows it.

`tick` moves the arm by one control tick. What takes longer than a tick has time for, a verdict on the target, a solver
with other obstacles, all solutions, is a `Job`: `next_job` hands it out, it may run in any thread, and its answer is
written back between two ticks. Jobs look at arrays and objects that ticks replace and never change.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import Literal

import numpy as np
import pinocchio as pin

from maira_qp.apps.viewer.answers import Fitted, Ghosts, Job, Verdict, explained, fitted, ghosts_of, verdict_on
from maira_qp.apps.viewer.drawing.surroundings import Clearance, clearances, first_in_the_way, too_near
from maira_qp.apps.viewer.motion.elbow import Elbow, elbow_finder
from maira_qp.apps.viewer.motion.motions import Along, Go, Motion, Replay, Swivel
from maira_qp.apps.viewer.motion.recording import Recording
from maira_qp.apps.viewer.paths.followed import Followed, Station
from maira_qp.apps.viewer.paths.pursuit import Pursuit
from maira_qp.apps.viewer.paths.route import Route
from maira_qp.apps.viewer.start import bent_configuration
from maira_qp.apps.viewer.view import Standing, View, limits_at
from maira_qp.errors import OptionError
from maira_qp.orientation import pose_error
from maira_qp.problem.limits.collision import CollisionLimit
from maira_qp.problem.objectives import Posture
from maira_qp.problem.pose import as_pose
from maira_qp.problem.redundancy import Strict, Weighted
from maira_qp.results.solution import Solution
from maira_qp.robots.collision.shapes import Shape
from maira_qp.robots.model.robot import Robot
from maira_qp.solvers.solver import Solver

Method = Literal["strict", "weighted", "none"]
METHODS: tuple[Method, ...] = ("strict", "weighted", "none")

FARTHEST = 2.5
"""How far the target may be dragged from the base, in lengths of the arm."""
SMOOTHING = 0.05
"""Share of the last tick in the time that is shown."""
AT_REST = 1e-4
"""An arm that moves less in a tick [rad, or m] stands still."""
STUCK = 15
"""Ticks of standing still, after which an arm goes to the solver's answer, if that is nearer to the target."""
AWAY = 1e-4
"""An error [m, or rad] above this is not what is left of a motion that fades away."""
RESTS = 20
"""Ticks after which a target that was not moved counts as put down."""


class Session:
    """One robot at work. Not for several threads at once, jobs aside."""

    def __init__(self, robot: Robot, directories: Sequence[str] = ()) -> None:
        """At rest in a well-bent configuration, the target in the tool; meshes are sought in `directories`."""
        self.robot, self.directories = robot, tuple(directories)
        self.q = bent_configuration(robot)
        self.target = robot.forward(self.q)
        self.method: Method = "strict"
        self.weight = 1e-3
        self.obstacles: dict[str, Shape] = {}
        self.is_avoiding = False
        self.shows_ghosts = False
        self.recording = Recording(robot)
        self.is_recording = False
        self._path = Pursuit()
        self._find_elbow = elbow_finder(robot)
        self._solver = Solver(robot, redundancy=self.redundancy)
        self._plain = Solver(robot)
        self._limit: CollisionLimit | None = None
        self._motion: Motion | None = None
        self._is_following = False
        self._velocity = np.zeros(robot.n)
        self._still = 0
        self._target_still = 0
        self._tick_seconds = 0.0
        self._fitted_to: tuple[dict[str, Shape], bool] = self.obstacles, self.is_avoiding
        self._tried: Solution | None = None
        self._in_the_way: Clearance | None = None
        self._clearances: list[Clearance] = []
        self._verdict: Verdict | None = verdict_on(self._solver, self._plain, self.target, self.q)
        self._ghosts: Ghosts | None = None
        self._elbow: tuple[np.ndarray, Elbow | None] | None = None
        self._notice = ""
        self._is_rebuilding = False
        self._stale = {"verdict"}

    # What is asked for

    def move_target(self, T: np.ndarray) -> None:
        """The arm follows a target (4, 4), which is brought back to `FARTHEST`. Raises `PoseError`."""
        target = as_pose(T)
        far = float(np.linalg.norm(target.translation)) / (FARTHEST * self.robot.length)
        self.target = pin.SE3(target.rotation, target.translation / max(far, 1.0))
        self._follow()

    def set_joint(self, index: int, value: float) -> None:
        """One joint [rad or m] is set by hand, and the target goes with the tool."""
        q = self.q.copy()
        q[index] = value
        self._halt()
        self.q = self.robot.clip(q)
        self._target_to_tool()

    def set_swivel(self, psi: float) -> None:
        """The elbow moves to a place on its curve [rad or m], as far as that goes. Raises `OptionError` without one."""
        elbow = self.elbow
        if elbow is None:
            raise OptionError(
                "the way of the elbow is not known: the arm must be redundant, stand still, and not be stretched"
            )
        self._start(Swivel(self.robot, elbow, psi))

    def use(self, method: Method, weight: float) -> None:
        """How the redundancy is used, and the weight of "weighted". Raises `OptionError`."""
        if method not in METHODS:
            raise OptionError(f"the redundancy is used as {', '.join(METHODS)}, not {method!r}")
        Weighted(Posture(), weight)  # is it a weight?
        self.method, self.weight = method, weight
        self._forget_path()
        self._rebuild()
        self._follow()

    def put_obstacle(self, shape: Shape) -> None:
        """An obstacle is there, or elsewhere than it was, by its name."""
        self.obstacles = {**self.obstacles, shape.name: shape}
        self._obstacles_changed()

    def move_obstacle(self, name: str, position: np.ndarray) -> None:
        """An obstacle is put to a position (3,) [m]."""
        shape = self.obstacles[name]
        self.put_obstacle(replace(shape, pose=pin.SE3(shape.pose.rotation, np.array(position))))  # type: ignore[type-var]

    def remove_obstacles(self) -> None:
        """Nothing is in the way."""
        self.obstacles = {}
        self._obstacles_changed()

    def avoid(self, wanted: bool) -> None:
        """Whether the arm keeps clear of the obstacles."""
        self.is_avoiding = wanted
        self._forget_path()
        self._rebuild()

    def show_ghosts(self, wanted: bool) -> None:
        """Whether all solutions are sought."""
        self.shows_ghosts, self._ghosts = wanted, None
        self._stale.add("ghosts")

    def go_to_ghost(self, index: int) -> None:
        """The arm goes to one of the solutions shown, counted round and round. Raises `OptionError` without any."""
        if self._ghosts is None or not len(self._ghosts.q):
            raise OptionError("no solutions are shown")
        self._start(Go(self.robot, self._ghosts.q[index % len(self._ghosts.q)]))

    def record(self, wanted: bool) -> None:
        """Recording begins anew, or ends."""
        if wanted:
            self.recording = Recording(self.robot)
        self.is_recording = wanted

    def play(self) -> None:
        """The recording is played. Raises `OptionError` without one."""
        if not len(self.recording):
            raise OptionError("nothing is recorded yet")
        self.is_recording = False
        self._start(Replay(self.robot, self.recording))

    def stop(self) -> None:
        """The arm stands still, and the target is where the tool is."""
        self._halt()
        self._target_to_tool()

    # What is asked for of a path

    def lay(self, route: Route) -> None:
        """The path is another; what was found for the last one is forgotten. Raises `OptionError` if it is too long."""
        self._path.lay(route)
        self._leave_path()

    def follow_path(self, is_from_here: bool) -> None:
        """The path is to be followed from near where the arm is, or from any configuration. Raises `OptionError`."""
        self._path.seek(self.q if is_from_here else None, partial(self._begin_path, self.target))
        self._leave_path()

    def cancel_path(self) -> None:
        """The path is not to be followed any more. Raises `OptionError` unless it is being followed."""
        self._path.cancel()

    def stand_at(self, index: int) -> None:
        """The arm is shown at a pose of the path, the nearest that there is. Raises `OptionError`."""
        self._along_path().stand_at(index)

    def stand_at_next_failure(self) -> None:
        """The arm is shown where the path fails next, counted round and round. Raises `OptionError`."""
        along = self._along_path()
        along.stand_at(along.station.path.next_failure(along.station.index))

    def play_path(self, rate: float) -> None:
        """The arm goes on along the path, by so many poses a second at most. Raises `OptionError`."""
        self._along_path().play(rate)

    def pause_path(self) -> None:
        """The arm stays at the pose of the path that it is at, if it is at one."""
        if isinstance(self._motion, Along):
            self._motion.stand_at(self._motion.station.index)

    def explain_path(self) -> None:
        """A proof is looked for that the path cannot be followed further. Raises `OptionError`."""
        self._path.explain()

    # What happens

    def tick(self, dt: float) -> View:
        """Moves the arm by dt [s] at most as far as its limits allow, and says what there is to see."""
        before = self.q
        if self._motion is not None:
            self.q = np.clip(self._motion.next(self.q, dt), self.robot.lower, self.robot.upper)
            if isinstance(self._motion, Replay):
                self._target_to_tool()
            if isinstance(self._motion, Along):
                self._target_to_pose(self._motion)
            if isinstance(self._motion, Swivel):
                self._elbow = self.q, self._motion.elbow
            if self._motion.is_done:
                self._motion = None
        elif self._is_following:
            self._tick_toward_target(dt)
        self._clearances = [] if self._limit is None else clearances(self._limit, self.q)
        moved = float(np.abs(self.q - before).max())
        self._target_still += 1
        self._still = self._still + 1 if moved < AT_REST else 0
        if self.is_recording:
            self.recording.add(self.q, dt)
            self.is_recording = not self.recording.is_full
        return self._view()

    def next_job(self) -> Job | None:
        """What is to be found out next, if anything is; the solutions aside."""
        if "solver" in self._stale:
            given = self.robot, self.redundancy, self.obstacles, self.directories, self.is_avoiding
            write = partial(self._use_solver, (self.obstacles, self.is_avoiding))
            return self._taken("solver", Job(partial(fitted, *given), write))
        if "verdict" in self._stale and not isinstance(self._motion, Along):
            given = self._solver, self._plain, self.target, self.q
            return self._taken("verdict", Job(partial(verdict_on, *given), self._use_verdict))
        if self._wants_another_way:
            return self._other_way()
        if self._find_elbow is not None and self._still > 0 and not self._is_elbow_known:
            find, q = self._find_elbow, self.q
            return Job(lambda: (q, find(q)), self._use_elbow)
        verdict = self._verdict
        if verdict is not None and verdict.lacks_reason and self._target_still >= RESTS:
            return Job(partial(explained, verdict), self._use_verdict)
        return None

    def next_long_job(self) -> Job | None:
        """A path, its proof, or the solutions of a target that rests, if they are asked for: this may take seconds."""
        job = None if self._is_rebuilding else self._path.next_job(self._solver)
        if job is not None:
            return job
        if not self.shows_ghosts or "ghosts" not in self._stale or self._target_still < RESTS:
            return None
        return self._taken("ghosts", Job(partial(ghosts_of, self._plain, self.target), self._use_ghosts))

    @property
    def route(self) -> Route:
        """The path that is to be followed."""
        return self._path.route

    @property
    def redundancy(self) -> Strict | Weighted | None:
        """As the solver takes it."""
        if self.method == "none":
            return None
        return Strict(Posture()) if self.method == "strict" else Weighted(Posture(), self.weight)

    @property
    def has_swivel(self) -> bool:
        """The elbow can be moved on its own: the arm is redundant."""
        return self._find_elbow is not None

    @property
    def elbow(self) -> Elbow | None:
        """Where the elbow is on its curve, once that is known."""
        return self._elbow[1] if self._is_elbow_known and self._elbow is not None else None

    # Motions

    def _follow(self) -> None:
        self._halt()
        self._is_following = True
        self._target_moved()

    def _start(self, motion: Motion) -> None:
        self._halt()
        self._motion = motion

    def _halt(self) -> None:
        self._motion, self._is_following = None, False
        self._velocity = np.zeros(self.robot.n)
        self._still = 0

    def _target_to_tool(self) -> None:
        self.target = self.robot.forward(self.q)
        self._target_moved()

    def _target_to_pose(self, along: Along) -> None:
        """The target is where the tool is to be on the path."""
        pose = along.station.path.route.poses[along.station.index]
        if not np.array_equal(self.target.homogeneous, pose):
            self.target = pin.SE3(pose)
            self._target_moved()

    def _target_moved(self) -> None:
        self._target_still = 0
        self._stale |= {"verdict", "ghosts"}

    def _tick_toward_target(self, dt: float) -> None:
        """One control tick."""
        begin = time.perf_counter()
        step = self._solver.step(self.q, self.target, dt, velocity=self._velocity)
        seconds = time.perf_counter() - begin
        self._tick_seconds += SMOOTHING * (seconds - self._tick_seconds) if self._tick_seconds else seconds
        self.q, self._velocity = step.q, step.velocity

    # Paths

    @property
    def _station(self) -> Station | None:
        """Where on the path the arm is; None: it is moved by something else."""
        return self._motion.station if isinstance(self._motion, Along) else None

    def _along_path(self) -> Along:
        """The motion along the path that was followed, begun if it is not. Raises `OptionError`."""
        if isinstance(self._motion, Along):
            return self._motion
        if self._path.followed is None:
            raise OptionError("no path is followed yet: choose one, and press Follow")
        along = Along(self.robot, self._path.followed)
        self._start(along)
        return along

    def _begin_path(self, target: pin.SE3, path: Followed) -> None:
        """It is shown, unless something else was done with the arm since its target was this one."""
        if self.target is target and self._motion is None:
            self._start(Along(self.robot, path))

    def _leave_path(self) -> None:
        if isinstance(self._motion, Along):
            self._halt()

    def _forget_path(self) -> None:
        """What was found of a path does not hold for another problem."""
        self._path.forget()
        self._leave_path()

    # Another way round, where ticks get no further or the arm is where it must not be

    @property
    def _answer(self) -> Solution | None:
        """What the solver says of the target as it is, among the obstacles as they are."""
        verdict = self._verdict
        if verdict is None or verdict.target is not self.target or not self._is_fitted:
            return None
        return None if self._stale & {"verdict", "solver"} else verdict.solution

    @property
    def _is_fitted(self) -> bool:
        """The solver and the distances are those for the obstacles as they are."""
        obstacles, is_avoiding = self._fitted_to
        return obstacles is self.obstacles and is_avoiding == self.is_avoiding

    @property
    def _too_near(self) -> list[Clearance]:
        return too_near(self._clearances) if self.is_avoiding else []

    @property
    def _wants_another_way(self) -> bool:
        """There is an answer to go to that was not tried yet."""
        answer = self._answer
        if self._motion is not None or answer is None or answer is self._tried:
            return False
        stuck = self._is_following and self._still >= STUCK and self._is_worse_than(answer)
        return stuck or (self._still > 0 and bool(self._too_near))

    def _is_worse_than(self, answer: Solution) -> bool:
        """The tool is farther from the target than it would be there."""
        error = pose_error(self.robot.forward(self.q), self.target)
        position, orientation = np.linalg.norm(error[:3]), np.linalg.norm(error[3:])
        return bool(position > answer.position_error + AWAY or orientation > answer.orientation_error + AWAY)

    def _other_way(self) -> Job:
        """Whether the way to the answer is clear, if it has to be."""
        answer, q, limit = self._answer, self.q, self._limit if self.is_avoiding else None
        assert answer is not None
        self._tried = answer

        def write(blocking: Clearance | None) -> None:
            if self._answer is answer and self._motion is None:
                self._in_the_way = blocking
                if blocking is None:
                    self._motion, self._still = Go(self.robot, answer.q), 0

        return Job(lambda: None if limit is None else first_in_the_way(limit, q, answer.q), write)

    def _standing(self, position: float, orientation: float) -> Standing:
        """Of the arm as it is drawn, with what is left of the errors [m, rad]."""
        options, answer = self._solver.options, self._answer
        station = self._station
        if station is not None and station.index in station.path.failures:
            return Standing.OFF_PATH
        if self._too_near:
            return Standing.TOO_NEAR
        if station is not None:
            return Standing.ON_PATH
        if not self._is_fitted:
            return Standing.UNKNOWN
        if position <= options.position_tolerance and orientation <= options.orientation_tolerance:
            return Standing.REACHED
        if answer is None:
            return Standing.UNKNOWN
        if answer is self._tried and self._motion is None and self._still >= STUCK and self._is_worse_than(answer):
            return Standing.HELD_UP
        return Standing.MOVING if answer.success else Standing.ANSWERED

    # Jobs and their answers

    def _taken(self, name: str, job: Job) -> Job:
        self._stale.discard(name)
        return job

    def _rebuild(self) -> None:
        self._is_rebuilding = True
        self._stale.add("solver")

    def _obstacles_changed(self) -> None:
        if self.is_avoiding:
            self._forget_path()
        self._rebuild()

    def _use_solver(self, fitted_to: tuple[dict[str, Shape], bool], answer: Fitted) -> None:
        self._fitted_to = fitted_to
        self._solver, self._limit, self._notice = answer
        self._is_rebuilding = "solver" in self._stale
        self._still = 0
        self._stale.add("verdict")

    def _use_verdict(self, verdict: Verdict) -> None:
        self._verdict = verdict

    @property
    def _is_elbow_known(self) -> bool:
        return self._elbow is not None and float(np.abs(self._elbow[0] - self.q).max()) < AT_REST

    def _use_elbow(self, answer: tuple[np.ndarray, Elbow | None]) -> None:
        self._elbow = answer

    def _use_ghosts(self, ghosts: Ghosts) -> None:
        self._ghosts = ghosts

    def _view(self) -> View:
        robot, q = self.robot, self.q
        tool = robot.forward(q)
        error = pose_error(tool, self.target)
        ghosts = self._ghosts if self._ghosts is not None and self._ghosts.target is self.target else None
        position, orientation = float(np.linalg.norm(error[:3])), float(np.linalg.norm(error[3:]))
        return View(
            q=q,
            tool=tool,
            target=self.target,
            position_error=position,
            orientation_error=orientation,
            condition_number=robot.condition_number(q),
            at_limit=limits_at(robot, q),
            clearances=self._clearances,
            tick_seconds=self._tick_seconds,
            verdict=self._verdict,
            standing=self._standing(position, orientation),
            too_near=self._too_near,
            in_the_way=self._in_the_way if self._answer is self._tried else None,
            ghosts=ghosts,
            elbow=self.elbow,
            path=self._path.view(self._station),
            notice=self._notice,
        )
