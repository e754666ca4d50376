"""The job of a data set: poses, and the configurations and verdict of a solve for each.

Poses are uniform over the workspace, a ball that holds all that can be reached, and over all rotations: then those that
are out of reach are there too, with their proofs as labels. Or they are those of configurations that are uniform within
the limits, or along paths, or of a file.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from maira_qp.arrays import is_count
from maira_qp.errors import OptionError, listed, shown
from maira_qp.io.poses import FORMATS
from maira_qp.problem.objectives import Posture
from maira_qp.problem.options import Options
from maira_qp.problem.redundancy import Strict
from maira_qp.results.status import Status
from maira_qp.robots.model.robot import Robot
from maira_qp.scale.dataset import poses as sources
from maira_qp.scale.dataset.solutions import FIGURES, all_solutions
from maira_qp.scale.job import Job
from maira_qp.scale.reach.bound import reach_bound
from maira_qp.scale.reach.metrics import limit_distances, manipulabilities
from maira_qp.solvers.solver import Solver

LABELS = ("any", "posture", "all")
MOST_SOLUTIONS = 64
"""Rows of one pose with the label "all": of more solutions the best."""
LARGEST = 95_000_000
"""A file of the data set, before it is packed [bytes]."""
MOST_ROWS = 2**40


@dataclass(frozen=True, kw_only=True)
class DatasetJob(Job):
    """A table of random poses and of what a solver says of them. Made by `DatasetJob.of`."""

    urdf: str
    """Normalised URDF, with the limits that hold"""
    tip: str
    base: str
    joint_names: tuple[str, ...]
    rows: int
    poses: str
    """"workspace", "configurations", "paths" or "file\""""
    file: Mapping[str, Any] | None
    """Of a file its `path`, `sha256` and `rows`"""
    labels: str
    """"any" configuration that reaches, the one nearest to mid-range, "posture", or "all\""""
    centre: tuple[float, float, float]
    """[m] of the ball of the workspace"""
    radius: float
    """[m]"""
    options: Mapping[str, Any]
    seed: int

    kind = "dataset"
    unit = "poses"

    def __post_init__(self) -> None:
        for name in ("joint_names", "centre"):  # a manifest has lists
            object.__setattr__(self, name, tuple(getattr(self, name)))

    @staticmethod
    def of(
        robot: Robot,
        *,
        rows: int | None = None,
        poses: str | os.PathLike[str] = "workspace",
        labels: str = "any",
        options: Options | None = None,
        seed: int = 0,
    ) -> DatasetJob:
        """The job of a data set for a robot.

        Args:
            robot: with one tip, and a URDF.
            rows: how many poses, >= 1; None: all of a file.
            poses: "workspace": uniform over the ball that holds all that can be reached, and over all rotations;
                "configurations": of configurations uniform within the limits, so that each can be reached; "paths": 128
                after another along each of random motions; or a file of poses, .csv, .npy, .npz or .parquet, as
                `maira-qp solve --batch` reads them, which has to stay the same until the job is finished.
            labels: "any" configuration that reaches a pose, as `Solver(robot)` finds it; "posture": the one nearest to
                the middle of the limits, as `Strict(Posture())` does; "all": a row for each solution that
                `Solver.solutions` lists, the best 64 of them.
            options: of the solver.
            seed: of the poses, and of the solver's random starts.

        Raises `OptionError` for values out of range and a reach without a bound, `RobotError` without a URDF.
        """
        if not isinstance(robot, Robot) or len(robot.tips) > 1:
            raise OptionError(f"a data set is of a robot with one tip, got {shown(robot)}")
        source, file = _source(poses)
        if rows is None and file is not None:
            rows = file["rows"]
        if rows is None or not is_count(rows, 1, MOST_ROWS):
            raise OptionError(f"rows must be a positive whole number, got {shown(rows)}")
        if file is not None and rows > file["rows"]:
            raise OptionError(f"rows must be at most {file['rows']}, as many as the file has, got {shown(rows)}")
        if labels not in LABELS:
            raise OptionError(f"labels cannot be {shown(labels)}; {listed(LABELS, labels)}")
        if not is_count(seed):
            raise OptionError(f"seed must be a non-negative whole number, got {shown(seed)}")
        centre, radius = reach_bound(robot)
        if radius is None and source == "workspace":
            raise OptionError("the reach of this robot has no bound, so there is no workspace to draw poses from")
        return DatasetJob(
            urdf=robot.urdf,
            tip=robot.tip,
            base=robot.base,
            joint_names=robot.joint_names,
            rows=int(rows),
            poses=source,
            file=file,
            labels=labels,
            centre=(float(centre[0]), float(centre[1]), float(centre[2])),
            radius=radius or 0.0,
            options=asdict(options or Options()),
            seed=int(seed),
        )

    def is_sound(self) -> bool:
        """See `Job.is_sound`."""
        fits = isinstance(self.urdf, str) and self.labels in LABELS and self.poses in (*sources.RANDOM, "file")
        return fits and is_count(self.rows, 1, MOST_ROWS) and all(isinstance(each, str) for each in self.joint_names)

    @property
    def count(self) -> int:
        """How many rows there are."""
        return self.rows

    @property
    def block(self) -> int:
        """Poses of a file of the output."""
        columns, each = len(self.joint_names) + 14, 1
        if self.labels == "all":
            columns, each = columns + 3, MOST_SOLUTIONS
        return max(1, LARGEST // (8 * columns * each))

    def compute(self, first: int, last: int, threads: int) -> dict[str, np.ndarray]:
        """See `Job.compute`: poses (N, 7) as x, y, z and a quaternion, q (N, n), status and figures (N,)."""
        solver = _solver(self.urdf, self.tip, self.base, self.labels, tuple(self.options.items()))
        T, quaternions = self._targets(solver.robot, first, last)
        batch = solver.solve_batch(T, seed=self.seed, threads=threads)
        pose = {"pose": np.concatenate([T[:, :3, 3], quaternions], axis=1), "status": batch.status.astype(np.int8)}
        if self.labels == "all":
            return pose | all_solutions(solver, T, batch, self.seed, MOST_SOLUTIONS)
        return pose | {
            "q": batch.q,
            "position_error": batch.position_error,
            "orientation_error": batch.orientation_error,
            "manipulability": manipulabilities(solver.robot, batch.q),
            "limit_distance": limit_distances(solver.robot, batch.q),
        }

    def _targets(self, robot: Robot, first: int, last: int) -> tuple[np.ndarray, np.ndarray]:
        """Poses (N, 4, 4) of rows, and their quaternions (N, 4), scalar first and positive; NaN where there is none."""
        from scipy.spatial.transform import Rotation  # not at the top: takes a while to load

        if self.file is not None:
            T = sources.of_file(self.file["path"], self.file["sha256"], first, last)
        else:
            about = self.poses, robot, self.centre, self.radius, self.seed
            groups = [sources.group(*about, k) for k in range(first // sources.GROUP, -(-last // sources.GROUP))]
            begin = first // sources.GROUP * sources.GROUP
            T = np.concatenate(groups)[first - begin : last - begin]
        quaternions, known = np.full((len(T), 4), np.nan), np.isfinite(T).all(axis=(1, 2))
        if known.any():
            quaternions[known] = np.roll(Rotation.from_matrix(T[known, :3, :3]).as_quat(), 1, axis=1)
        return T, np.where(quaternions[:, :1] < 0.0, -quaternions, quaternions)

    def begin_output(self, folder: Path) -> None:
        """See `Job.begin_output`."""
        from maira_qp.scale.dataset import files

        files.begin(folder)

    def write_block(self, folder: Path, first: int, arrays: Mapping[str, np.ndarray]) -> None:
        """See `Job.write_block`."""
        from maira_qp.scale.dataset import files

        files.write(folder, first // self.block, self.columns(first, arrays))

    def end_output(self, folder: Path) -> None:
        """See `Job.end_output`."""
        from maira_qp.scale.dataset import files

        manifest = self.manifest()
        about = {name: manifest["job"][name] for name in manifest["job"] if name != "rows"}
        files.end(folder, -(-self.rows // self.block), self.seed, about | {"versions": manifest["versions"]})

    def columns(self, first: int, arrays: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
        """The columns (N,) of rows, with the names of the files that `solve --batch` reads and writes."""
        status, q = arrays["status"], arrays["q"]
        names = np.array([Status(value).name for value in range(max(Status) + 1)])
        figures = {name: arrays[name] for name in FIGURES}
        row, solution = np.arange(len(status)), dict[str, np.ndarray]()
        if self.labels == "all":
            shown = np.arange(MOST_SOLUTIONS) < np.maximum(arrays["solutions"], 1)[:, None]
            row, k = np.nonzero(shown)
            q, figures = q[row, k], {name: values[row, k] for name, values in figures.items()}
            solution = {"solution": k, "solutions": arrays["solutions"][row], "complete": arrays["complete"][row]}
        missing = ~np.isfinite(arrays["pose"][row, 0])  # of a file's rows without a pose: empty cells
        numbers = dict(zip(("x", "y", "z", "qw", "qx", "qy", "qz"), arrays["pose"][row].T, strict=True))
        answers = figures | {f"q_{joint}": q[:, i] for i, joint in enumerate(self.joint_names)}
        if missing.any():
            numbers = {name: np.ma.masked_array(values, mask=missing) for name, values in numbers.items()}
            answers = {name: np.ma.masked_array(values, mask=missing) for name, values in answers.items()}
        found: dict[str, np.ndarray] = {"index": first + row}
        if self.poses == "paths":
            found["path"] = found["index"] // sources.PATH
        verdict = {"success": status[row] == Status.CONVERGED, "status": names[status[row]]}
        return found | numbers | verdict | solution | answers


def _source(given: Any) -> tuple[str, dict[str, Any] | None]:
    """Where poses come from, and what is to be known of a file. Raises `OptionError`, `PoseError`."""
    if isinstance(given, os.PathLike) or (isinstance(given, str) and Path(given).suffix.lower() in FORMATS):
        return "file", sources.described(Path(given))
    if given not in sources.RANDOM:
        raise OptionError(
            f"poses cannot be {shown(given)}; {listed(sources.RANDOM, given)}; or a file, {', '.join(FORMATS)}"
        )
    return given, None


@lru_cache(maxsize=2)
def _solver(urdf: str, tip: str, base: str, labels: str, options: tuple[tuple[str, Any], ...]) -> Solver:
    """The solver of a job: the same in every process, for it is made from the job alone."""
    redundancy = Strict(Posture()) if labels == "posture" else None
    return Solver(Robot.from_urdf(urdf, tip=tip, base=base), redundancy=redundancy, options=Options(**dict(options)))
