"""What the viewer is about, without a browser: a robot, targets, and how the arm follows them.

`tick` moves the arm by one control tick. What takes longer than a tick has time for, a verdict on the targets, a solver
with other obstacles, all solutions, is a `Job`: `next_job` hands it out, it may run in any thread, and its answer is
written back between two ticks. Jobs look at arrays and objects that ticks replace and never change.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np
import pinocchio as pin

from maira_qp.apps.viewer.answers import Ghosts, Job, ghosts_of
from maira_qp.apps.viewer.motion.arm import AT_REST, Arm
from maira_qp.apps.viewer.motion.elbow import Elbow, elbow_finder
from maira_qp.apps.viewer.motion.history import History, Moment
from maira_qp.apps.viewer.motion.motions import Along, Go, Replay, Swivel
from maira_qp.apps.viewer.motion.recording import Recording
from maira_qp.apps.viewer.outlook import Outlook
from maira_qp.apps.viewer.paths.followed import Followed, Station
from maira_qp.apps.viewer.paths.pursuit import Pursuit
from maira_qp.apps.viewer.paths.route import Route
from maira_qp.apps.viewer.start import bent_configuration
from maira_qp.apps.viewer.targets import Targets, as_asked, errors_between, tools_at
from maira_qp.apps.viewer.view import View, limits_at
from maira_qp.apps.viewer.workplace import Method, Workplace
from maira_qp.errors import FrameError, OptionError, listed
from maira_qp.problem.pose import as_pose
from maira_qp.robots.collision.shapes import Shape
from maira_qp.robots.model.robot import Robot

FARTHEST = 2.5
"""How far a target may be dragged from the base, in lengths of the arm."""
RESTS = 20
"""Ticks after which a target that was not moved counts as put down, and an arm that did not move as resting."""


class Session:
    """One robot at work. Not for several threads at once, jobs aside."""

    def __init__(self, robot: Robot, directories: Sequence[str] = ()) -> None:
        """At rest in a well-bent configuration, targets in the tools; meshes are sought in `directories`."""
        self.robot, self.home = robot, bent_configuration(robot)
        self.workplace, self.arm = Workplace(robot, directories), Arm(robot, self.home)
        self.targets: Targets = tools_at(robot, self.home)
        self.selected = robot.tip
        """The tip whose target is typed, and is moved by keys."""
        self.has_base_axes = False
        """Targets are dragged and moved by keys along the axes of the base, not along their own."""
        self.shows_ghosts = False
        self.recording = Recording(robot)
        self.is_recording = False
        self._outlook = Outlook(self.workplace, self.arm, self.targets)
        self._history = History(Moment(self.home, self.targets))
        self._path = Pursuit()
        self._find_elbow = elbow_finder(robot) if len(robot.tips) == 1 else None
        self._elbow: tuple[np.ndarray, Elbow | None] | None = None
        self._target_still = 0
        self._ghosts: Ghosts | None = None
        self._are_ghosts_stale = False

    @property
    def q(self) -> np.ndarray:
        """Where the joints are (n,)."""
        return self.arm.q

    @property
    def target(self) -> pin.SE3:
        """Where the selected tip is to be."""
        return self.targets[self.selected]

    # What is asked for of the arm

    def select(self, tip: str) -> None:
        """The target that is typed is that of another tip. Raises `FrameError`."""
        if tip not in self.robot.tips:
            raise FrameError(listed(self.robot.tips, tip))
        self.selected = tip

    def move_target(self, T: np.ndarray, tip: str | None = None) -> None:
        """The arm follows a target (4, 4) of a tip, the selected one if none is named, which is brought back to
        `FARTHEST`. Raises `PoseError`."""
        target = as_pose(T)
        far = float(np.linalg.norm(target.translation)) / (FARTHEST * self.robot.length)
        moved = pin.SE3(target.rotation, target.translation / max(far, 1.0))
        self.arm.follow()
        self._targets_are({**self.targets, self.selected if tip is None else tip: moved})

    def use_axes(self, has_base_axes: bool) -> None:
        """Whether targets are dragged and moved by keys along the axes of the base, or along their own."""
        self.has_base_axes = has_base_axes

    def nudge(self, axis: int, way: float) -> None:
        """The selected target moves along an axis (0 to 2) by some way [m]."""
        T = self.target.homogeneous.copy()
        T[:3, 3] += way * (np.eye(3) if self.has_base_axes else T[:3, :3])[:, axis]
        self.move_target(T)

    def set_joint(self, index: int, value: float) -> None:
        """One joint [rad or m] is set by hand, and the targets go with the tools."""
        q = self.q.copy()
        q[index] = value
        self.arm.put(q)
        self._targets_to_tools()

    def set_swivel(self, psi: float) -> None:
        """The elbow moves to a place on its curve [rad or m], as far as that goes. Raises `OptionError` without one."""
        elbow = self.elbow
        if elbow is None:
            raise OptionError(
                "the way of the elbow is not known: the arm must be redundant, stand still, and not be stretched"
            )
        self.arm.start(Swivel(self.robot, elbow, psi))

    def go_home(self) -> None:
        """The arm goes to where it began, and the targets with it; `undo` leads back even if the arm was on its way."""
        self._history.rest(Moment(self.q, self.targets))
        self._go_to(Moment(self.home, tools_at(self.robot, self.home)))

    def undo(self) -> None:
        """The arm goes back to where it last rested. Raises `OptionError` if it was nowhere else."""
        moment = self._history.undo(Moment(self.q, self.targets))
        if moment is None:
            raise OptionError("there is nothing to undo: the arm is where it began")
        self._go_to(moment)

    def redo(self) -> None:
        """The arm goes where it was before it went back. Raises `OptionError` if it did not."""
        moment = self._history.redo()
        if moment is None:
            raise OptionError("there is nothing to redo")
        self._go_to(moment)

    def stop(self) -> None:
        """The arm stands still, and the targets are where the tools are."""
        self.arm.halt()
        self._targets_to_tools()

    def show_ghosts(self, wanted: bool) -> None:
        """Whether all solutions are sought."""
        self.shows_ghosts, self._ghosts, self._are_ghosts_stale = wanted, None, True

    def go_to_ghost(self, index: int) -> None:
        """The arm goes to one of the solutions shown, counted round and round. Raises `OptionError` without any."""
        if self._ghosts is None or not len(self._ghosts.q):
            raise OptionError("no solutions are shown")
        self.arm.start(Go(self.robot, self._ghosts.q[index % len(self._ghosts.q)]))

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
        self.arm.start(Replay(self.robot, self.recording))

    # What is asked for of its workplace

    def use(self, method: Method, weight: float) -> None:
        """How the redundancy is used, and the weight of "weighted". Raises `OptionError`."""
        self.workplace.use(method, weight)
        self._forget_path()
        self.arm.follow()
        self._targets_are(self.targets)

    def put_obstacle(self, shape: Shape) -> None:
        """An obstacle is there, or another than it was, by its name."""
        self.workplace.put(shape)
        self._obstacles_changed()

    def move_obstacle(self, name: str, T: np.ndarray) -> None:
        """An obstacle is put to a pose (4, 4). Raises `PoseError`."""
        shape = self.workplace.obstacles.get(name)
        if shape is not None:  # it may have been taken away while it was dragged
            self.put_obstacle(replace(shape, pose=as_pose(T)))  # type: ignore[type-var]

    def remove_obstacles(self, name: str | None = None) -> None:
        """One obstacle is taken away; None: all. Raises `OptionError`."""
        self.workplace.remove(name)
        self._obstacles_changed()

    def avoid(self, wanted: bool) -> None:
        """Whether the arm keeps clear of the obstacles."""
        self.workplace.avoid(wanted)
        self._forget_path()

    # What is asked for of a path

    def lay(self, route: Route) -> None:
        """The path is another; what was found for the last one is forgotten. Raises `OptionError` if it is too long."""
        self._path.lay(route)
        self._leave_path()

    def follow_path(self, is_from_here: bool) -> None:
        """The path is to be followed from near where the arm is, or from any configuration. Raises `OptionError`."""
        self._path.seek(self.q if is_from_here else None, partial(self._begin_path, self.targets))
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
        """The arm goes on along the path, by so many poses per second at most. Raises `OptionError`."""
        self._along_path().play(rate)

    def pause_path(self) -> None:
        """The arm stays at the pose of the path that it is at, if it is at one."""
        if isinstance(self.arm.motion, Along):
            self.arm.motion.stand_at(self.arm.motion.station.index)

    def explain_path(self) -> None:
        """A proof is looked for that the path cannot be followed further. Raises `OptionError`."""
        self._path.explain()

    # What happens

    def tick(self, dt: float) -> View:
        """Moves the arm by dt [s] at most as far as its limits allow, and says what there is to see."""
        motion = self.arm.tick(dt, self.workplace.solver, as_asked(self.targets))
        if isinstance(motion, Replay):
            self._targets_to_tools()
        elif isinstance(motion, Along):
            self._target_to_pose(motion)
        elif isinstance(motion, Swivel):
            self._elbow = self.q, motion.elbow
        self.workplace.look(self.q)
        self._target_still += 1
        if self.arm.motion is None and min(self._target_still, self.arm.still) == RESTS:
            self._history.rest(Moment(self.q, self.targets))
        if self.is_recording:
            self.recording.add(self.q, dt)
            self.is_recording = not self.recording.is_full
        return self._view()

    def next_job(self) -> Job | None:
        """What is to be found out next, if anything is; the solutions aside."""
        job = self.workplace.next_job(self._outlook.solver_is_another)
        if job is None and not isinstance(self.arm.motion, Along):
            job = self._outlook.verdict_job()
        job = job or self._outlook.other_way_job()
        if job is None and self._find_elbow is not None and self.arm.still > 0 and not self._is_elbow_known:
            find, q = self._find_elbow, self.q
            return Job(lambda: (q, find(q)), self._use_elbow)
        if job is None and self._target_still >= RESTS and len(self.targets) == 1:
            return self._outlook.reason_job()
        return job

    def next_long_job(self) -> Job | None:
        """A path, its proof, what runs into what, or the solutions of targets that rest: this may take seconds."""
        job = None if self.workplace.is_rebuilding else self._path.next_job(self.workplace.solver)
        job = job or self.workplace.next_long_job()
        if job is not None or self._target_still < RESTS:
            return job
        if len(self.targets) > 1 and (job := self._outlook.reason_job()) is not None:
            return job
        if not (self.shows_ghosts and self._are_ghosts_stale):
            return None
        self._are_ghosts_stale = False
        return Job(partial(ghosts_of, self.workplace.plain, self.targets), self._use_ghosts)

    @property
    def route(self) -> Route:
        """The path that is to be followed."""
        return self._path.route

    @property
    def has_swivel(self) -> bool:
        """The elbow can be moved on its own: the arm is redundant."""
        return self._find_elbow is not None

    @property
    def elbow(self) -> Elbow | None:
        """Where the elbow is on its curve, once that is known."""
        return self._elbow[1] if self._is_elbow_known and self._elbow is not None else None

    # Targets

    def _go_to(self, moment: Moment) -> None:
        self.arm.start(Go(self.robot, moment.q))
        self._targets_are(moment.targets)

    def _targets_to_tools(self) -> None:
        self._targets_are(tools_at(self.robot, self.q))

    def _target_to_pose(self, along: Along) -> None:
        """The target is where the tool is to be on the path."""
        pose = along.station.path.route.poses[along.station.index]
        if not np.array_equal(self.targets[self.robot.tip].homogeneous, pose):
            self._targets_are({**self.targets, self.robot.tip: pin.SE3(pose)})

    def _targets_are(self, targets: Targets) -> None:
        self.targets, self._target_still = targets, 0
        self._are_ghosts_stale = True
        self._outlook.targets_are(targets)

    # Paths

    @property
    def _station(self) -> Station | None:
        """Where on the path the arm is; None: it is moved by something else."""
        return self.arm.motion.station if isinstance(self.arm.motion, Along) else None

    def _along_path(self) -> Along:
        """The motion along the path that was followed, begun if it is not. Raises `OptionError`."""
        if isinstance(self.arm.motion, Along):
            return self.arm.motion
        if self._path.followed is None:
            raise OptionError("no path is followed yet: choose one, and press Follow")
        along = Along(self.robot, self._path.followed)
        self.arm.start(along)
        return along

    def _begin_path(self, targets: Targets, path: Followed) -> None:
        """It is shown, unless something else was done with the arm since its targets were these."""
        if self.targets is targets and self.arm.motion is None:
            self.arm.start(Along(self.robot, path))

    def _leave_path(self) -> None:
        if isinstance(self.arm.motion, Along):
            self.arm.halt()

    def _forget_path(self) -> None:
        """What was found of a path does not hold for another problem."""
        self._path.forget()
        self._leave_path()

    def _obstacles_changed(self) -> None:
        if self.workplace.is_avoiding:
            self._forget_path()

    # Jobs and their answers

    @property
    def _is_elbow_known(self) -> bool:
        return self._elbow is not None and float(np.abs(self._elbow[0] - self.q).max()) < AT_REST

    def _use_elbow(self, answer: tuple[np.ndarray, Elbow | None]) -> None:
        self._elbow = answer

    def _use_ghosts(self, ghosts: Ghosts) -> None:
        self._ghosts = ghosts

    def _view(self) -> View:
        robot, q, workplace, outlook = self.robot, self.q, self.workplace, self._outlook
        tools = tools_at(robot, q)
        position, orientation = errors_between(tools, self.targets)
        ghosts = self._ghosts if self._ghosts is not None and self._ghosts.targets is self.targets else None
        return View(
            q=q,
            tools=tools,
            targets=self.targets,
            selected=self.selected,
            has_base_axes=self.has_base_axes,
            position_error=position,
            orientation_error=orientation,
            condition_number=robot.condition_number(q),
            at_limit=limits_at(robot, q),
            clearances=workplace.clearances,
            overlaps=workplace.overlaps,
            tick_seconds=self.arm.tick_seconds,
            verdict=outlook.verdict,
            standing=outlook.standing(self._station, position, orientation),
            too_near=workplace.too_near,
            in_the_way=outlook.in_the_way,
            ghosts=ghosts,
            elbow=self.elbow,
            path=self._path.view(self._station),
            notice=workplace.notice,
        )
