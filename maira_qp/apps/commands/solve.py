"""`maira-qp solve`: joint values that put the tool at a pose."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from maira_qp.apps.arguments.flags import PoseFlags, RedundancyFlags, RobotFlags, SolverFlags, checked_seed
from maira_qp.apps.arguments.numbers import JointValues
from maira_qp.apps.arguments.optional import Flag, Maybe, explained
from maira_qp.apps.arguments.pose_choice import PoseChoice
from maira_qp.apps.arguments.redundancy_choice import RedundancyChoice
from maira_qp.apps.arguments.robot_choice import RobotChoice
from maira_qp.apps.left_pipes import reader_may_leave
from maira_qp.errors import OptionError
from maira_qp.problem.options import Options
from maira_qp.wording import figures, fixed, in_units

if TYPE_CHECKING:
    from maira_qp.apps.arguments.output import Units
    from maira_qp.results.solution import Solution
    from maira_qp.results.solution_set import Solutions
    from maira_qp.robots.model.robot import Robot

UNBOUNDED = 100_000
"""Columns of a console that cuts nothing."""


@explained
@dataclass(frozen=True, kw_only=True)
class Solve:
    """Find joint values that put the tool at a pose, within the limits.

    With --all every solution, the best first: those of all branches; of a redundant arm the best of each arc or, where
    these are not known in closed form, the local optima that were found.

    With --batch a file of poses, one per row. CSV and Parquet have columns x, y, z with qw, qx, qy, qz (scalar first)
    or with roll, pitch, yaw, or alone: then the orientation is free; or m00, m01, ... m23, the rows of the 4x4 matrix.
    Optionally a start q0_<joint> for each joint; further columns are carried along. NPZ has an array targets (N, 4, 4),
    optionally q0 (N, n); NPY is an array (N, 4, 4), or one with these columns as its fields. A row with an empty cell
    or NaN is not solved: its status is INVALID_TARGET.

    The answers stand behind what the file held: success, status, position_error [m], orientation_error [rad, empty
    where it is free], iterations, restarts, condition_number, left_q0 (whether the answer left its start for a better
    one), max_joint_change [rad or m] (how far the joint that moved most is from its start), active_limits (with ;
    between) and q_<joint> [rad or m; deg with --deg, mm with --mm]; in NPZ the same as arrays (N,), and q (N, n) and
    joint_names.

    Examples:

        maira-qp solve --position 0.4 0.2 0.9 --rpy 180 0 0 --deg
        maira-qp solve --robot panda --position 0.4 0.2 0.5 --tool 0 0 0.1 --all
        maira-qp solve --robot arm.urdf --batch poses.csv --output answers.csv

    Exit code:

        0  solved; with --batch: all rows
        1  not solved, a nearest point is printed; with --batch: some are not
        2  wrong use
        3  proved to be out of reach
        4  neither: the budget was spent
        5  with --batch: some rows hold no pose
        6  no configuration within further limits was found"""

    choice: RobotFlags = field(default_factory=RobotChoice)
    pose: PoseFlags = field(default_factory=PoseChoice)
    batch: Maybe[Path] = None
    """File with many poses, .csv, .npy, .npz or .parquet, in place of one; -: CSV from standard input."""
    output: Maybe[Path] = None
    """File of the answers to --batch, .csv, .npy, .npz or .parquet; -: CSV to standard output, and the summary to
    stderr; none: poses.csv is answered in poses.solved.csv, - in -."""
    threads: Maybe[int] = None
    """Threads that solve --batch; >= 1; none: one per processor. No answer depends on it."""
    all: Flag = False
    """List every solution that is known, ranked by how near the joints are to mid-range, in place of one."""
    q0: JointValues = None
    """Joint values to start from [rad, or deg with --deg; m for a sliding joint]; none: those of --batch, or the
    solver's own."""
    redundancy: RedundancyFlags = field(default_factory=RedundancyChoice)
    backend: Maybe[str] = None
    """Who solves the QPs: compiled, daqp, proxqp, osqp, ... (an unknown name lists what is installed); none: compiled
    where it can, else daqp."""
    seed: int = 0
    """Seed of the random starts; >= 0."""
    options: SolverFlags = field(default_factory=Options)
    position_only: Flag = False
    """The orientation is free: only the position counts."""
    deg: Flag = False
    """Angles in and out in degrees; tolerances, and errors in files and JSON, stay in rad."""
    mm: Flag = False
    """Lengths in and out in millimetres; tolerances, and errors in files and JSON, stay in m."""
    json: Flag = False
    """One JSON value on stdout; with --batch: the summary."""

    def run(self) -> int:
        """Prints the solution, or the summary of a batch; the exit code as the class says."""
        from maira_qp.apps.arguments.output import VERDICTS, Units, print_json
        from maira_qp.problem.tasks.frame import PositionTask
        from maira_qp.solvers.solver import Solver

        self._check_flags()
        seed = checked_seed(self.seed)
        redundancy = self.redundancy.load()
        robot = self.choice.load_with_one_tip(degrees=self.deg, millimetres=self.mm)
        units = Units(robot, self.deg, self.mm)
        q0 = None if self.q0 is None else units.read(self.q0, "--q0")
        others = ", or --batch FILE with many"
        target = self.pose.load(units, others, log_hint=self.all) if self.batch is None else None
        make = partial(Solver, robot, redundancy=redundancy, backend=self.backend, options=self.options)
        solver = make(task=PositionTask() if self.position_only else None)
        if self.batch is not None:
            from maira_qp.apps.commands.batch import Batch

            batch = Batch(
                path=self.batch,
                output=self.output,
                q0=q0,
                seed=seed,
                threads=self.threads,
                project=self.pose.project,
            )
            return batch.run(solver, make(task=PositionTask()), units, json=self.json)
        if self.all:
            solutions = solver.solutions(target, rng=seed)
            with reader_may_leave():
                if self.json:
                    print_json(_all_as_json(robot, units, solutions))
                else:
                    _show_all(robot, units, solutions)
            return 0 if solutions else 1
        solution = replace(solver.solve(target, q0=q0, rng=seed), target_deviation=self.pose.deviation)
        hints = [self.pose.hint(units)] if self.pose.hint(units) else []
        hints += units.hints(solution.hints)
        with reader_may_leave():
            if self.json:
                print_json(_as_json(robot, units, solution) | {"hints": hints})
            else:
                _show(robot, units, solution, hints)
        return VERDICTS[solution.status.name]

    def _check_flags(self) -> None:
        """Raises `OptionError` for flags that make no sense together."""
        if self.all and (self.batch is not None or self.q0 is not None):
            raise OptionError("--all goes neither with --batch nor with --q0")
        of_batch = {"--output": self.output, "--threads": self.threads}
        turned = [flag for flag in self.pose.given if flag in ("--quaternion", "--rpy")]
        if self.position_only and turned:
            raise OptionError(f"--position-only leaves the orientation free; leave {' and '.join(turned)} out")
        given = self.pose.given
        if self.batch is None:
            given = [flag for flag, value in of_batch.items() if value is not None]
        if given:
            verb = "counts" if len(given) == 1 else "count"
            raise OptionError(
                f"{' and '.join(given)} only {verb} {'with' if self.batch is None else 'without'} --batch"
            )


def _as_json(robot: Robot, units: Units, s: Solution) -> dict[str, Any]:
    return {
        "robot": robot.name,
        "tip": robot.tip,
        "joint_names": robot.joint_names,
        **s.as_dict(),
        "q": units.write(s.q),
        "q_units": units.joints,
        "explanation": s.explain().as_dict(),
    }


def _show(robot: Robot, units: Units, s: Solution, hints: Sequence[str]) -> None:
    """The solution as tables on stdout."""
    from rich.table import Table

    from maira_qp.apps.arguments.output import console, joint_table
    from maira_qp.results.answer import unknown_errors

    out = console()
    out.print(f"{s.status.name}: {s.status.meaning}", style="bold green" if s.success else "bold yellow")
    if not s.success:
        out.print(in_units(replace(s.explain(), hints=()).words, units.sentences))
    for hint in hints:
        out.print(f"hint: {hint}", style="bold yellow")
    if s.success and not s.optimal:
        out.print("the redundancy was not settled: a better posture for this pose may exist nearby")
    if s.target_deviation:
        out.print(f"the orientation was rounded (off by {s.target_deviation:.2g}); the nearest rotation was taken")
    if s.start_projected:
        out.print("the start --q0 was outside the joint limits and was moved onto them")
    if s.left_q0:
        out.print("the answer left the start --q0: elsewhere is better by more than the tolerances")
    remarks = [
        " ".join(limit.removeprefix(name) for limit in s.active_limits if limit.rsplit(" ", 1)[0] == name).strip()
        for name in robot.joint_names
    ]
    out.print(joint_table(robot.joint_names, units.write(s.q), units.joints, remarks))
    table = Table(show_header=False)
    known = {"position_error": s.position_error, "orientation_error": s.orientation_error} | unknown_errors(s.left_free)
    for heading, error in units.errors(*known.values()):
        table.add_row(heading, error)
    if np.isfinite(s.max_joint_change):
        table.add_row("farthest joint from --q0 [rad or m]", figures(s.max_joint_change))
    table.add_row("condition number", f"{s.condition_number:.4g}")
    table.add_row("iterations, restarts", f"{s.iterations}, {s.restarts}")
    if np.isfinite(s.cost):
        table.add_row("posture cost 1/2 |q - middle|^2", f"{s.cost:.6g}")
    table.add_row("QPs solved by", s.backend)
    out.print(table)


def _all_as_json(robot: Robot, units: Units, solutions: Solutions) -> dict[str, Any]:
    from maira_qp.results.answer import unknown_errors

    return {
        "robot": robot.name,
        "tip": robot.tip,
        "joint_names": robot.joint_names,
        "q_units": units.joints,
        "method": solutions.method,
        "is_complete": solutions.is_complete,
        "starts": solutions.starts,
        "starts_without_new": solutions.starts_without_new,
        "solutions": [
            {
                "q": units.write(one.q),
                "cost": one.cost,
                "position_error": one.position_error,
                "orientation_error": one.orientation_error,
            }
            | unknown_errors(one.left_free)
            for one in solutions
        ],
    }


def _show_all(robot: Robot, units: Units, solutions: Solutions) -> None:
    """The solutions on stdout: a table with a row each, or, where that is too wide, some lines each."""
    from rich.measure import Measurement
    from rich.table import Table

    from maira_qp.apps.arguments.output import console
    from maira_qp.display import columns, joint_entries

    out, complete = console(), "complete" if solutions.is_complete else "not proved complete"
    out.print(
        f"{len(solutions)} solutions, {solutions.method}, {complete}", style="bold green" if solutions else "bold"
    )
    if solutions.starts:
        out.print(f"{solutions.starts} random starts, {solutions.starts_without_new} since the last new solution")
    headings = [f"{name} [{unit}]" for name, unit in zip(robot.joint_names, units.joints, strict=True)]
    table = Table(*headings, "posture cost", "error [m]", "error [rad]")
    for one in solutions:
        values = [fixed(value, 5) for value in units.write(one.q)]
        table.add_row(*values, f"{one.cost:.5g}", f"{one.position_error:.1e}", f"{one.orientation_error:.1e}")
    for column in table.columns:
        column.justify = "right"
    if Measurement.get(out, out.options.update(width=UNBOUNDED), table).maximum <= out.width:
        out.print(table)
        return
    for i, one in enumerate(solutions, start=1):  # each in a few lines
        out.print(
            f"{i}. posture cost {one.cost:.5g}, {one.position_error:.1e} m and {one.orientation_error:.1e} rad off",
            style="bold",
        )
        values = [f"{fixed(value, 5)} {unit}" for value, unit in zip(units.write(one.q), units.joints, strict=True)]
        out.print("\n".join(columns(joint_entries(robot.joint_names, values), out.width, len(values))))
