"""`maira-qp track`: follow a path of poses from a file."""

from __future__ import annotations

import sys
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
import tyro

from maira_qp.apps.arguments.flags import RobotFlags, SolverFlags, checked_seed
from maira_qp.apps.arguments.numbers import JointValues
from maira_qp.apps.arguments.optional import UNSAID, Flag, Maybe, explained
from maira_qp.apps.arguments.robot_choice import RobotChoice
from maira_qp.apps.arguments.standard_streams import STANDARD, beside, name_and_stream
from maira_qp.apps.left_pipes import reader_may_leave
from maira_qp.errors import OptionError, PoseError
from maira_qp.problem.options import Options
from maira_qp.wording import figures, fixed, in_units

if TYPE_CHECKING:
    from rich.console import Console

    from maira_qp.apps.arguments.output import Units
    from maira_qp.io.poses import Poses
    from maira_qp.problem.tasks.frame import PoseTask
    from maira_qp.results.path_solution import PathSolution
    from maira_qp.results.trajectory import Trajectory
    from maira_qp.robots.model.robot import Robot

RATE = 15.0
"""Pictures of an animation a second, where that makes no more than `MOST_FRAMES`."""
MOST_FRAMES = 150
PARTS = 8
"""Parts of a path that are followed of which a summary tells."""


@explained
@dataclass(frozen=True, kw_only=True)
class Track:
    """Follow a path of poses from a file without a jump of any joint.

    Branch, turns and redundancy are chosen for the path as a whole. The file is like that of maira-qp solve --batch; a
    start q0_<joint> in its first row is the configuration there. The joint values, or with --timed the joint values,
    speeds and accelerations over time, go into --output.

    With --batch a file of many paths, which may be larger than memory: the rows of a path follow one another and have
    the same value in the column --by. Each path is followed as if it were alone. The answers stand behind what the file
    held, success, reconfiguration, position_error, orientation_error and q_<joint>, path by path.

    Examples:

        maira-qp track poses.csv
        maira-qp track poses.csv --deg --mm --timed --acceleration 300
        maira-qp track poses.csv --picture path.png --animation path.gif
        maira-qp track --batch paths.parquet --by seam

    Exit code:

        0  followed whole; with --batch: all paths
        1  not followed whole; with --batch: some are not
        2  wrong use
        3  not followed whole: a pose is proved to be out of reach"""

    poses: Annotated[Path | None, UNSAID, tyro.conf.Positional] = None
    """File of the poses, .csv, .npy, .npz or .parquet; -: CSV from standard input."""
    batch: Maybe[Path] = None
    """File of many paths, in place of one; -: CSV from standard input."""
    by: str = "path"
    """Column of --batch that tells the paths apart."""
    choice: RobotFlags = field(default_factory=RobotChoice)
    q0: JointValues = None
    """Joint values at the first pose, or near them [rad, or deg with --deg; m for a sliding joint]; none: any."""
    dt: Maybe[float] = None
    """Time from pose to pose [s]: no joint moves by more than its speed limit allows."""
    max_step: JointValues = None
    """Largest joint step from pose to pose, one for all or one each [rad, or deg with --deg; m]; none: 0.5 rad, or half
    of the arm's length."""
    max_reconfigurations: int = 0
    """So many larger steps are allowed; >= 0."""
    loop: Flag = False
    """The last pose is the first again, and the arm is to end as it began."""
    free_axis: Maybe[Literal["x", "y", "z"]] = None
    """The tool is free to turn about this axis of its own."""
    seed: int = 0
    """Seed of the configurations that are drawn; >= 0."""
    timed: Flag = False
    """Time the path within the limits below; needs maira-qp[time]."""
    velocity: JointValues = None
    """Largest speeds for --timed, one for all or one each [rad/s, or deg/s with --deg; m/s]; none: the robot's own."""
    acceleration: JointValues = None
    """Largest accelerations for --timed [rad/s^2, or deg/s^2 with --deg; m/s^2]; none: the robot's own."""
    jerk: JointValues = None
    """Largest jerks for --timed [rad/s^3, or deg/s^3 with --deg; m/s^3]; none: not limited."""
    tool_speed: Maybe[float] = None
    """Speed of the tool for --timed [m/s, or mm/s with --mm], held where the joints allow it; none: as fast as
    possible."""
    sample_time: float = 0.01
    """From sample to sample with --timed [s]; > 0."""
    output: Maybe[Path] = None
    """File of the joint values, .csv, .npy, .npz, .parquet, .json, .ros.json (a JointTrajectory of ROS 2) or .rrd (for
    Rerun), of --batch the first four; -: CSV to standard output, and the summary to stderr; none: poses.csv is
    answered in poses.path.csv, - in -."""
    picture: Maybe[Path] = None
    """Draw joints, speeds, errors, condition number and swivel angle into this .png, .svg or .pdf."""
    animation: Maybe[Path] = None
    """Draw the arm's motion into this .gif, or, where ffmpeg is installed, .mp4."""
    project: Flag = False
    """Take the nearest rotations to rounded ones, on purpose."""
    options: SolverFlags = field(default_factory=Options)
    deg: Flag = False
    """Angles in degrees: on the command line, in the file of the poses, in what is printed, and in an --output of CSV,
    NPY, NPZ or Parquet, as its headings say. Tolerances, JSON, ROS and Rerun stay in rad."""
    mm: Flag = False
    """Lengths in millimetres, in the same places; tolerances, JSON, ROS and Rerun stay in m."""
    json: Flag = False
    """The summary as one JSON value on stdout."""

    def run(self) -> int:
        """Follows, writes, draws and prints a summary; the exit code as the class says."""
        from maira_qp.apps.arguments.output import VERDICTS, Units, console, print_json, progress_bar
        from maira_qp.solvers.solver import Solver

        file = self._check_flags()
        seed, robot = checked_seed(self.seed), self.choice.load_with_one_tip(degrees=self.deg, millimetres=self.mm)
        units, solver = Units(robot, self.deg, self.mm), Solver(robot, task=self._task(), options=self.options)
        poses = self._read(file, robot, units)
        output = self.output or beside(file, "path")
        arguments = {
            "dt": self.dt,
            "max_step": None if self.max_step is None else _limits(self.max_step, "--max-step", units),
            "max_reconfigurations": self.max_reconfigurations,
            "loop": self.loop,
            "seed": seed,
        }
        if self.batch is not None:
            from maira_qp.apps.commands.track_batch import PathBatch

            q0 = self._start(poses, units) if self.q0 is not None else None
            batch = PathBatch(poses=poses, column=self.by, output=output, q0=q0, arguments=arguments)
            return batch.run(solver, units, json=self.json)
        q0, limits = self._start(poses, units), self._motion_limits(units)
        is_streamed = output == STANDARD
        self._check_files(output, poses)
        begin, targets = time.monotonic(), poses.targets(slice(None), np.ones(len(poses), dtype=bool))
        with progress_bar("following") as progress:
            path = solver.track(targets, q0, progress=progress, **arguments)
        whole = bool(path) and not path.reconfigurations
        trajectory = path.timed(**limits) if self.timed and whole else None
        seconds = time.monotonic() - begin
        written = self._write(output, path, trajectory)
        found = _summary(robot, path, poses, trajectory, seconds, q0)
        found |= {"not_timed": self.timed and trajectory is None, "files": [str(each) for each in written]}
        with reader_may_leave():
            if self.json:
                print_json(found | {"q_units": path.q_units}, stderr=is_streamed)
            else:
                _show(path, trajectory, found, units, console(stderr=is_streamed))
        return VERDICTS[_verdict(path)]

    def _task(self) -> PoseTask | None:
        """The task with a free axis; None: the whole pose."""
        from maira_qp.problem.tasks.frame import PoseTask

        if self.free_axis is None:
            return None
        return PoseTask(orientation_weight=[float(axis != self.free_axis) for axis in "xyz"], axes="target")

    def _check_flags(self) -> Path:
        """The file to read. Raises `OptionError` for flags that make no sense together."""
        file = self.poses if self.batch is None else self.batch
        if file is None:
            raise OptionError("give the file of a path, or --batch FILE with many paths")
        if self.batch is not None and self.poses is not None:
            raise OptionError(f"{self.poses} and --batch {self.batch} are both files to follow; leave one out")
        of_one = {"--timed": self.timed, "--picture": self.picture, "--animation": self.animation}
        if self.batch is not None and any(of_one.values()):
            raise OptionError(f"{next(flag for flag in of_one if of_one[flag])} is of one path; leave out --batch")
        of_timing = {name: getattr(self, name) for name in ("velocity", "acceleration", "jerk", "tool_speed")}
        given = [f"--{name.replace('_', '-')}" for name, value in of_timing.items() if value is not None]
        if given and not self.timed:
            raise OptionError(f"{' and '.join(given)} only {'counts' if len(given) == 1 else 'count'} with --timed")
        if not 0 < self.sample_time < np.inf:
            raise OptionError(f"--sample-time must be a positive number of seconds, got {self.sample_time}")
        return file

    def _read(self, file: Path, robot: Robot, units: Units) -> Poses:
        """The poses. Raises `PoseError` for a row without one, and for a file without rows."""
        from maira_qp.io.poses import blocks, read_poses
        from maira_qp.problem.targets import FARTHEST

        name, stream = name_and_stream(file)
        poses = read_poses(
            name,
            robot.joint_names,
            radian=units.radian,
            metre=units.metre,
            scale=units.scale,
            farthest=FARTHEST * robot.length,
            project=self.project,
            stream=stream,
        )
        if not len(poses):
            raise PoseError(f"{name} holds no pose: a path needs at least one")
        for rows in blocks(len(poses)):
            numbers = poses.table.numbers(rows)[:, : len(poses.layout.pose)]
            valid = np.isfinite(numbers).all(axis=1)  # starts after the first row may be missing
            for row in np.flatnonzero(~valid)[:1].tolist():
                where = poses.table.where(rows.start + row)
                raise PoseError(f"{where}: a cell is empty or not finite; a path needs every pose")
        return poses

    def _start(self, poses: Poses, units: Units) -> np.ndarray | None:
        """The configuration (n,) at the first pose, or None. Raises `OptionError` for two of them."""
        if self.q0 is None:
            starts = poses.starts(slice(0, 1), np.ones(1, dtype=bool))
            return None if starts is None else starts[0]
        if poses.layout.start:
            raise OptionError(f"--q0 and the columns q0_... of {poses.table.path} both give a start; leave one out")
        return units.read(self.q0, "--q0")

    def _motion_limits(self, units: Units) -> dict[str, Any]:
        """The arguments of `PathSolution.timed`."""
        limits = {name: getattr(self, name) for name in ("velocity", "acceleration", "jerk")}
        read = {
            name: None if values is None else _limits(values, f"--{name}", units) for name, values in limits.items()
        }
        return {
            **read,
            "tool_speed": None if self.tool_speed is None else self.tool_speed / units.metre,
            "dt": self.sample_time,
        }

    def _check_files(self, output: Path, poses: Poses) -> None:
        """Before a long run. Raises `OptionError`."""
        from maira_qp.apps.arguments.output import check_picture
        from maira_qp.io.answers import check_place
        from maira_qp.io.save import format_of

        if output != STANDARD and format_of(output) == "ros" and self.dt is None and not self.timed:
            raise OptionError(f"{output.name} needs times: give --timed, or --dt from pose to pose")
        if self.animation is not None:
            if self.animation.suffix.lower() not in (".gif", ".mp4"):
                raise OptionError(f"an animation's name ends in .gif or .mp4, not {self.animation.name!r}")
            check_picture(self.animation.with_suffix(".png"))
            if self.animation.suffix.lower() == ".mp4":
                from maira_qp.apps.plots.film import check_ffmpeg  # not before matplotlib is known to be installed

                check_ffmpeg()
        if self.picture is not None:
            check_picture(self.picture)
        for file in filter(None, (output, self.picture, self.animation)):
            if file != STANDARD:
                check_place(file, poses.table)

    def _write(self, output: Path, path: PathSolution, trajectory: Trajectory | None) -> list[Path]:
        """The files; of a path that was to be timed and could not be, only pictures."""
        from maira_qp.io.save import TableUnits, save, stream

        written, motion = [], trajectory if self.timed else path
        if motion is not None and output == STANDARD:
            with reader_may_leave():
                stream(motion, sys.stdout.buffer, "csv", TableUnits(self.deg, self.mm))
        elif motion is not None:
            written.append(save(motion, output, degrees=self.deg, millimetres=self.mm))
        if self.picture is not None:
            from maira_qp.apps import plots  # not before it is known to be installed

            written.append(plots.save(plots.path_picture(path, trajectory), self.picture))
        if self.animation is not None:
            written.append(_animate(self.animation, path, trajectory))
        return written


def _limits(values: tuple[float, ...], name: str, units: Units) -> np.ndarray:
    """Limits (n,) of the joints, from one for all or one each. Raises `ConfigurationError`."""
    return units.read(tuple(values) * len(units.joints) if len(values) == 1 else values, name)


def _verdict(path: PathSolution) -> str:
    """The name of a status: converged where the path is followed whole, else that of the pose at which it is not."""
    if path:
        return "CONVERGED"
    first = next(each for each in path.failures if each.index == path.first_failure)
    return "UNREACHABLE" if first.is_proved else "NEAREST"


def _animate(file: Path, path: PathSolution, trajectory: Trajectory | None) -> Path:
    """The arm along the path, in its own time where that is known."""
    from maira_qp.apps import plots

    robot, q = path.robot, path.q if trajectory is None else trajectory.q
    step = path.rules.dt
    seconds = trajectory.duration if trajectory is not None else len(q) / RATE if step is None else step * (len(q) - 1)
    count = int(np.clip(seconds * RATE, min(len(q), 2), min(len(q), MOST_FRAMES)))
    frames = [_links(robot, each) for each in q[np.linspace(0, len(q) - 1, count).round().astype(int)]]
    rate = float(np.clip(count / max(seconds, 1e-3), 1.0, 50.0))
    return plots.animate_chain(file, frames, [frames[-1][-1]] * count, rate=rate)


def _links(robot: Robot, q: np.ndarray) -> np.ndarray:
    """Transforms (n + 2, 4, 4) [m] of the base, of the link behind each joint, and of the tool."""
    at = robot.at(q)
    return np.array([np.eye(4), *(at.placement(frame).homogeneous for frame in (*robot.moved_links, robot.tip))])


def _summary(
    robot: Robot,
    path: PathSolution,
    poses: Poses,
    trajectory: Trajectory | None,
    seconds: float,
    q0: np.ndarray | None,
) -> dict[str, Any]:
    from maira_qp.apps.commands.batch import Hints

    hints = Hints(robot, poses, q0)
    hints.add(slice(None), np.ones(len(poses), dtype=bool), path.success)

    k = path.first_failure
    return {
        "robot": robot.name,
        "tip": robot.tip,
        "poses": len(path),
        "followed_whole": k is None,
        "first_failure": k,
        "first_failure_at": None if k is None else poses.table.where(k),
        "reason": path.reason,
        "parts": path.parts,
        "reached": int(path.success.sum()),
        "reconfigurations": path.reconfigurations,
        "largest_steps": np.abs(np.diff(path.q, axis=0)).max(axis=0, initial=0.0),
        "allowed_steps": path.allowed_step,
        "worst_position_error": path.position_error.max(),
        "worst_orientation_error": path.orientation_error.max(),
        "seconds": seconds,
        "duration": None if trajectory is None else trajectory.duration,
        "position_deviation": None if trajectory is None else vars(trajectory.position_deviation),
        "orientation_deviation": None if trajectory is None else vars(trajectory.orientation_deviation),
        "hints": hints.said(),
    }


def _in_words(first: int, last: int) -> str:
    """The poses of a part of a path."""
    return f"poses {first} to {last}" if first < last else f"pose {first} alone"


def _show(path: PathSolution, trajectory: Trajectory | None, found: dict[str, Any], units: Units, out: Console) -> None:
    """The summary as tables, for 80 columns."""
    from rich.table import Table

    from maira_qp.apps.arguments.output import folded

    k = found["first_failure"]
    if k is None:
        out.print(f"followed whole: {len(path)} poses", style="bold green")
    else:
        place = found["first_failure_at"]
        out.print(f"followed up to pose {k} of {len(path)}, {place}", style="bold yellow", soft_wrap=True)
        out.print(in_units(found["reason"], units.sentences))
        parts = ", ".join(_in_words(first, end - 1) for first, end in path.parts[:PARTS])
        out.print(f"followed: {parts}{', ...' if len(path.parts) > PARTS else ''}" if parts else "followed: nothing")
    joints = Table()
    for heading in ("joint", "from", "to", "largest step", "allowed"):
        joints.add_column(heading, justify="left" if heading == "joint" else "right", no_wrap=True)
    steps, allowed = units.write(found["largest_steps"]), units.write(found["allowed_steps"])
    low, high = units.write(path.q.min(axis=0)), units.write(path.q.max(axis=0))
    for i, name in enumerate(path.joint_names):
        numbers = fixed(low[i], 4), f"{fixed(high[i], 4)} {units.joints[i]}", f"{steps[i]:.4f}", f"{allowed[i]:.4g}"
        joints.add_row(folded(name), *numbers)
    out.print(joints)
    table = Table(show_header=False)
    table.add_row("reached", f"{found['reached']} of {len(path)}")
    table.add_row("reconfigurations", str(found["reconfigurations"]))
    for heading, error in units.errors(found["worst_position_error"], found["worst_orientation_error"]):
        table.add_row(f"worst {heading}", error)
    if trajectory is not None:
        off, turned = trajectory.position_deviation, trajectory.orientation_deviation
        table.add_row("duration", f"{trajectory.duration:.4g} s, {len(trajectory)} samples")
        metre, radian = units.metre, units.radian
        table.add_row("tool off the path", f"{off.value * metre:.2g} {units.length} at {off.time:.4g} s")
        table.add_row("tool turned off it", f"{turned.value * radian:.2g} {units.angle} at {turned.time:.4g} s")
        table.add_row("speed of the tool", f"at most {trajectory.tool_speed.max() * metre:.4g} {units.length}/s")
    elif found["not_timed"]:
        table.add_row("not timed", "only a path without a gap is; no joint values are written")
    table.add_row("time", f"{figures(found['seconds'])} s")
    out.print(table)
    for file in found["files"]:
        out.print(f"written: {file}", soft_wrap=True)
    for hint in found["hints"]:
        out.print(f"hint: {hint}", style="bold yellow")
