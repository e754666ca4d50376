"""`maira-qp dataset`: random poses with what a solver says of each."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from maira_qp.apps.arguments.flags import RobotFlags, SolverFlags, checked_seed
from maira_qp.apps.arguments.optional import Flag, Maybe, explained
from maira_qp.apps.arguments.robot_choice import RobotChoice
from maira_qp.apps.commands.jobs.running import RunChoice, RunFlags
from maira_qp.apps.left_pipes import reader_may_leave
from maira_qp.problem.options import Options


@explained
@dataclass(frozen=True, kw_only=True)
class Dataset:
    """Make a data set of poses with their solutions, in Parquet.

    Poses are random, or from a file; those that are proved to be out of reach are among them. The data set is a folder
    of files of at most 100 MB, laid out as LeRobot's format 3 has it: data/chunk-000/file-000.parquet, ... and
    meta/info.json. Its columns are those of solve --batch: x, y, z [m], qw, qx, qy, qz, success, status, errors [m,
    rad], manipulability, limit_distance (0 at a limit, 1 midway), q_<joint> [rad, or m]; with --labels all also
    solution and solutions, which of how many, and complete, whether these are all. Whatever interrupts a run, the same
    command goes on with it, as does maira-qp job resume FOLDER. Exit code 0: the data set is finished, or the part that
    --shard names is done.

    Example:

        maira-qp dataset --rows 1000000 --output poses"""

    choice: RobotFlags = field(default_factory=RobotChoice)
    output: Path
    """Folder of the table; new, or that of the same table, begun before."""
    rows: Maybe[int] = None
    """How many poses; >= 1; none: all of a file."""
    poses: str = "workspace"
    """workspace: uniform over the ball that holds all that can be reached, and over all rotations; configurations:
    those of joint values uniform within the limits; paths: 128 after another along each of random motions; or a file of
    poses, .csv, .npy, .npz or .parquet, as those of solve --batch."""
    labels: Literal["any", "posture", "all"] = "any"
    """any joint values that reach the pose; posture: those nearest to the middle of the limits; all: a row for each
    solution, at most 64."""
    seed: int = 0
    """Seed of the poses and of the random starts; >= 0."""
    options: SolverFlags = field(default_factory=Options)
    how: RunFlags = field(default_factory=RunChoice)
    json: Flag = False
    """One JSON value on stdout: the summary."""

    def run(self) -> int:
        """Runs the job and prints a summary; 0."""
        from maira_qp.apps.arguments.output import print_json
        from maira_qp.apps.commands.jobs.running import carry_out, show
        from maira_qp.io.parquet_table import check_pyarrow
        from maira_qp.scale.dataset.job import DatasetJob

        check_pyarrow()
        self.how.options()
        job = DatasetJob.of(
            self.choice.load_with_one_tip(),
            rows=self.rows,
            poses=self.poses,
            labels=self.labels,
            options=self.options,
            seed=checked_seed(self.seed),
        )
        state, said = carry_out(job, self.output, self.how, "solving")
        with reader_may_leave():
            title = f"the table is in {self.output}" if state.finished else f"{state.done} of {state.total} poses done"
            print_json(said) if self.json else show(said, title)
        return 0
