"""`maira-qp solve`: joint values that put the tool at a pose."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import tyro

from maira_qp.apps.commands.flags import JointValues, Position, Quaternion, RobotFlags, Rpy, SolverFlags
from maira_qp.apps.commands.robot_choice import RobotChoice
from maira_qp.errors import OptionError, PoseError
from maira_qp.solvers.options import Options

if TYPE_CHECKING:
    from maira_qp.apps.commands.output import Angles
    from maira_qp.problem.redundancy import Strict, Weighted
    from maira_qp.robots.robot import Robot
    from maira_qp.solvers.solution import Solution
    from maira_qp.solvers.solutions import Solutions

DEFAULT_WEIGHT = 1e-3

VERDICTS = {"CONVERGED": 0, "NEAREST": 1, "UNREACHABLE": 3, "BUDGET_SPENT": 4}
"""Exit codes by the name of the status."""


@dataclass(frozen=True, kw_only=True)
class Solve:
    """Joint values that put the tool at a pose, inside the joint limits. The exit code is the verdict: 0 solved; 1 a
    nearest point; 3 proved to be out of reach; 4 the budget was spent; 2 misuse.

    With --all every solution, the best first: those of all branches, of a redundant arm the best of each arc or, where
    it is not known in closed form, the local optima that were found.

    With --batch FILE many poses, a pose a row. CSV and Parquet have columns x, y, z [m] with qw, qx, qy, qz (scalar
    first) or with roll, pitch, yaw [rad, or deg with --deg]; or m00, m01, ... m23, the rows of the 4x4 matrix (m30 to
    m33 may follow); if you like, a start q0_<joint> for each joint; further columns are carried along. NPZ has an array
    targets (N, 4, 4); if you like, q0 (N, n). A row with an empty cell or NaN is not solved, and spoils no other.

    The answers stand behind what the file held: success, status, position_error [m], orientation_error [rad],
    iterations, restarts, condition_number, active_limits (with ; between) and q_<joint> [rad, or deg with --deg; m for
    a sliding joint]; in NPZ the same as arrays (N,), and q (N, n) and joint_names. Exit code 0: all solved; 1: some
    not."""

    choice: RobotFlags = field(default_factory=RobotChoice)
    position: Position = None
    """Wanted position of the tool in the base [m]; must be given unless --matrix holds it, or --batch is given."""
    quaternion: Quaternion = None
    """Wanted orientation as a unit quaternion, scalar first; without any orientation: that of the base."""
    rpy: Rpy = None
    """Wanted orientation as roll, pitch, yaw about fixed axes [rad, or deg with --deg]."""
    matrix: Path | None = None
    """File with the wanted pose as 4x4 numbers (or 3x3, the orientation alone): text, .json or .npy."""
    project: tyro.conf.FlagCreatePairsOff[bool] = False
    """Take the nearest rotation to a rounded matrix or quaternion, on purpose."""
    batch: Path | None = None
    """File with many poses, .csv, .npz or .parquet, in place of one."""
    output: Path | None = None
    """File of the answers to --batch, .csv, .npz or .parquet; none: poses.csv is answered in poses.solved.csv."""
    threads: int | None = None
    """Threads that solve --batch; >= 1; none: one a processor. No answer depends on it."""
    all: tyro.conf.FlagCreatePairsOff[bool] = False
    """List every solution that is known, ranked by how near the joints are to mid-range, in place of one."""
    q0: JointValues = None
    """Joint values to start from [rad, or deg with --deg; m for a sliding joint]; none: those of --batch, or the
    solver's own."""
    redundancy: Literal["none", "weighted", "strict"] = "none"
    """Joints near mid-range: no wish (none), traded for the pose at --weight, or as far as the pose allows (strict)."""
    weight: float | None = None
    """What the posture counts with --redundancy weighted beside the squared pose error; > 0; none: 1e-3."""
    backend: str | None = None
    """Who solves the QPs: compiled, daqp, proxqp, osqp, ... (an unknown name lists what is installed); none: compiled
    where it can, else daqp."""
    seed: int = 0
    """Seed of the random starts; >= 0."""
    options: SolverFlags = field(default_factory=Options)
    deg: tyro.conf.FlagCreatePairsOff[bool] = False
    """Joint values and --rpy in and out in degrees; tolerances stay in rad."""
    json: tyro.conf.FlagCreatePairsOff[bool] = False
    """One JSON value on stdout; with --batch: the summary."""

    def run(self) -> int:
        """Prints the solution, or the summary of a batch; the exit code as the class says."""
        from maira_qp.apps.commands.output import Angles, print_json
        from maira_qp.solvers.solver import Solver

        self._check_flags()
        seed = checked_seed(self.seed)
        redundancy = self._redundancy()
        robot = self.choice.load()
        angles = Angles(robot, self.deg)
        q0 = None if self.q0 is None else angles.read(self.q0)
        target = self._target(angles) if self.batch is None else None
        solver = Solver(robot, redundancy=redundancy, backend=self.backend, options=self.options)
        if self.batch is not None:
            from maira_qp.apps.commands.batch import Batch

            batch = Batch(
                path=self.batch,
                output=self.output,
                q0=q0,
                seed=seed,
                threads=self.threads,
                project=self.project,
            )
            return batch.run(solver, angles, json=self.json)
        if self.all:
            solutions = solver.solutions(target, rng=seed)
            if self.json:
                print_json(_all_as_json(robot, angles, solutions))
            else:
                _show_all(robot, angles, solutions)
            return 0 if solutions else 1
        solution = solver.solve(target, q0=q0, rng=seed)
        if self.json:
            print_json(_as_json(robot, angles, solution))
        else:
            _show(robot, angles, solution)
        return VERDICTS[solution.status.name]

    def _check_flags(self) -> None:
        """Raises `OptionError` for flags that make no sense together."""
        one = ("position", "quaternion", "rpy", "matrix")
        pointless = ("output", "threads") if self.batch is None else one
        if self.all and (self.batch is not None or self.q0 is not None):
            raise OptionError("--all goes neither with --batch nor with --q0")
        given = [f"--{name}" for name in pointless if getattr(self, name) is not None]
        if given:
            verb = "counts" if len(given) == 1 else "count"
            raise OptionError(
                f"{' and '.join(given)} only {verb} {'with' if self.batch is None else 'without'} --batch"
            )

    def _redundancy(self) -> Weighted | Strict | None:
        from maira_qp.problem.objectives import Posture
        from maira_qp.problem.redundancy import Strict, Weighted

        if self.weight is not None and self.redundancy != "weighted":
            raise OptionError("--weight only counts with --redundancy weighted")
        if self.redundancy == "weighted":
            return Weighted(Posture(), DEFAULT_WEIGHT if self.weight is None else self.weight)
        return Strict(Posture()) if self.redundancy == "strict" else None

    def _target(self, angles: Angles) -> Any:
        """The wanted pose. Raises `PoseError` if it is not given, or given twice; `OSError`."""
        from maira_qp.problem.pose import pose

        matrix = None if self.matrix is None else read_matrix(self.matrix)
        whole = matrix is not None and matrix.shape == (4, 4)
        if self.position is None and not whole:
            raise PoseError("where to? give --position X Y Z, --matrix FILE with a 4x4 pose, or --batch FILE with many")
        if self.position is not None and whole:
            raise PoseError("--position and a 4x4 --matrix both give a position; leave one out")
        return pose(
            (0.0, 0.0, 0.0) if self.position is None else self.position,
            quaternion=self.quaternion,
            rpy=None if self.rpy is None else np.array(self.rpy) / angles.one,
            matrix=matrix,
            project=self.project,
        )


def checked_seed(value: int) -> int:
    """The seed, checked. Raises `OptionError`."""
    if value < 0:
        raise OptionError(f"--seed must be 0 or more, got {value}")
    return value


def read_matrix(path: Path) -> np.ndarray:
    """Numbers from a file: .npy, .json, or text with blanks or commas between. Raises `PoseError`, `OSError`."""
    try:
        if path.suffix.lower() == ".npy":
            return np.load(path, allow_pickle=False)
        text = path.read_text(encoding="utf-8")
        if path.suffix.lower() == ".json":
            import json

            return np.array(json.loads(text), dtype=float)
        rows = [line.replace(",", " ").split() for line in text.splitlines()]
        return np.array([[float(word) for word in row] for row in rows if row])
    except (ValueError, TypeError, EOFError) as reason:
        raise PoseError(f"{path} does not hold a matrix of numbers: {reason}") from None


def _as_json(robot: Robot, angles: Angles, s: Solution) -> dict[str, Any]:
    return {
        "robot": robot.name,
        "tip": robot.tip,
        "joint_names": robot.joint_names,
        **s.as_dict(),
        "q": angles.write(s.q),
        "q_units": angles.units,
        "status": s.status.name,
        "explanation": s.explain().as_dict(),
    }


def _show(robot: Robot, angles: Angles, s: Solution) -> None:
    """The solution as tables on stdout."""
    from rich.table import Table

    from maira_qp.apps.commands.output import console, joint_table

    out = console()
    out.print(f"{s.status.name}: {s.status.meaning}", style="bold green" if s.success else "bold yellow")
    if not s.success:
        out.print(str(s.explain()))
    if s.success and not s.optimal:
        out.print("the redundancy was not settled: a better posture for this pose may exist nearby")
    if s.start_projected:
        out.print("the start --q0 was outside the joint limits and was moved onto them")
    remarks = [
        " ".join(limit.removeprefix(name) for limit in s.active_limits if limit.rsplit(" ", 1)[0] == name).strip()
        for name in robot.joint_names
    ]
    out.print(joint_table(robot.joint_names, angles.write(s.q), angles.units, remarks))
    table = Table(show_header=False)
    table.add_row("position error [m]", f"{s.position_error:.3g}")
    table.add_row("orientation error [rad]", f"{s.orientation_error:.3g}")
    table.add_row("condition number", f"{s.condition_number:.4g}")
    table.add_row("iterations, restarts", f"{s.iterations}, {s.restarts}")
    if np.isfinite(s.cost):
        table.add_row("posture cost 1/2 |q - middle|^2", f"{s.cost:.6g}")
    table.add_row("QPs solved by", s.backend)
    out.print(table)


def _all_as_json(robot: Robot, angles: Angles, solutions: Solutions) -> dict[str, Any]:
    return {
        "robot": robot.name,
        "tip": robot.tip,
        "joint_names": robot.joint_names,
        "q_units": angles.units,
        "method": solutions.method,
        "is_complete": solutions.is_complete,
        "starts": solutions.starts,
        "starts_without_new": solutions.starts_without_new,
        "solutions": [
            {
                "q": angles.write(one.q),
                "cost": one.cost,
                "position_error": one.position_error,
                "orientation_error": one.orientation_error,
            }
            for one in solutions
        ],
    }


def _show_all(robot: Robot, angles: Angles, solutions: Solutions) -> None:
    """The solutions as a table on stdout, a row each."""
    from rich.table import Table

    from maira_qp.apps.commands.output import console

    out, complete = console(), "complete" if solutions.is_complete else "not proved complete"
    out.print(
        f"{len(solutions)} solutions, {solutions.method}, {complete}", style="bold green" if solutions else "bold"
    )
    if solutions.starts:
        out.print(f"{solutions.starts} random starts, {solutions.starts_without_new} since the last new solution")
    table = Table()
    for name, unit in zip(robot.joint_names, angles.units, strict=True):
        table.add_column(f"{name} [{unit}]", justify="right")
    for name in ("posture cost", "error [m]", "error [rad]"):
        table.add_column(name, justify="right")
    for one in solutions:
        values = [f"{value:.5f}" for value in angles.write(one.q)]
        table.add_row(*values, f"{one.cost:.5g}", f"{one.position_error:.1e}", f"{one.orientation_error:.1e}")
    out.print(table)
