"""The job of a data set: random poses, and the configuration and verdict of a solve for each.

Poses are uniform over the workspace, a ball that holds all that can be reached, and over all rotations: then those that
are out of reach are there too, with their proofs as labels. Or they are those of configurations that are uniform within
the limits. Rows come in groups, each with a random stream of its own, so that a row depends on the seed and its index.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from maira_qp.arrays import is_count
from maira_qp.errors import OptionError, listed, shown
from maira_qp.problem.objectives import Posture
from maira_qp.problem.options import Options
from maira_qp.problem.redundancy import Strict
from maira_qp.results.status import Status
from maira_qp.robots.model.robot import Robot, drawn
from maira_qp.scale.job import Job
from maira_qp.scale.reach.bound import reach_bound
from maira_qp.scale.reach.metrics import limit_distances, manipulabilities
from maira_qp.solvers.solver import Solver

POSES, LABELS = ("workspace", "configurations"), ("any", "posture")
GROUP = 1024
"""Rows with one random stream."""
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
    """"workspace" or "configurations\""""
    labels: str
    """"any" configuration that reaches, or the one nearest to mid-range, "posture\""""
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
        rows: int,
        poses: str = "workspace",
        labels: str = "any",
        options: Options | None = None,
        seed: int = 0,
    ) -> DatasetJob:
        """The job of a data set for a robot.

        Args:
            robot: with one tip, and a URDF.
            rows: how many, >= 1.
            poses: "workspace": uniform over the ball that holds all that can be reached, and over all rotations;
                "configurations": of configurations uniform within the limits, so that each can be reached.
            labels: "any" configuration that reaches a pose, as `Solver(robot)` finds it; "posture": the one nearest to
                the middle of the limits, as `Strict(Posture())` does.
            options: of the solver.
            seed: of the poses, and of the solver's random starts.

        Raises `OptionError` for values out of range and a reach without a bound, `RobotError` without a URDF.
        """
        if not isinstance(robot, Robot) or len(robot.tips) > 1:
            raise OptionError(f"a data set is of a robot with one tip, got {shown(robot)}")
        if not is_count(rows, 1, MOST_ROWS):
            raise OptionError(f"rows must be a positive whole number, got {shown(rows)}")
        for name, value, valid in (("poses", poses, POSES), ("labels", labels, LABELS)):
            if value not in valid:
                raise OptionError(f"{name} cannot be {shown(value)}; {listed(valid, value)}")
        if not is_count(seed):
            raise OptionError(f"seed must be a non-negative whole number, got {shown(seed)}")
        centre, radius = reach_bound(robot)
        if radius is None:
            raise OptionError("the reach of this robot has no bound, so there is no workspace to draw poses from")
        return DatasetJob(
            urdf=robot.urdf,
            tip=robot.tip,
            base=robot.base,
            joint_names=robot.joint_names,
            rows=int(rows),
            poses=poses,
            labels=labels,
            centre=(float(centre[0]), float(centre[1]), float(centre[2])),
            radius=radius,
            options=asdict(options or Options()),
            seed=int(seed),
        )

    @property
    def count(self) -> int:
        """How many rows there are."""
        return self.rows

    @property
    def block(self) -> int:
        """Rows of a file."""
        return LARGEST // (8 * (len(self.joint_names) + 14))

    def compute(self, first: int, last: int, threads: int) -> dict[str, np.ndarray]:
        """See `Job.compute`: poses (N, 7) as x, y, z and a quaternion, q (N, n), status and figures (N,)."""
        solver = _solver(self.urdf, self.tip, self.base, self.labels, tuple(self.options.items()))
        T, quaternions = self._targets(solver.robot, first, last)
        batch = solver.solve_batch(T, seed=self.seed, threads=threads)
        return {
            "pose": np.concatenate([T[:, :3, 3], quaternions], axis=1),
            "q": batch.q,
            "status": batch.status.astype(np.int8),
            "position_error": batch.position_error,
            "orientation_error": batch.orientation_error,
            "manipulability": manipulabilities(solver.robot, batch.q),
            "limit_distance": limit_distances(solver.robot, batch.q),
        }

    def _targets(self, robot: Robot, first: int, last: int) -> tuple[np.ndarray, np.ndarray]:
        """Poses (N, 4, 4) of rows, and their quaternions (N, 4), scalar first and positive."""
        from scipy.spatial.transform import Rotation  # not at the top: takes a while to load

        groups = [self._group(robot, k) for k in range(first // GROUP, -(-last // GROUP))]
        begin = first // GROUP * GROUP
        T = np.concatenate(groups)[first - begin : last - begin]
        quaternions = np.roll(Rotation.from_matrix(T[:, :3, :3]).as_quat(), 1, axis=1)
        return T, np.where(quaternions[:, :1] < 0.0, -quaternions, quaternions)

    def _group(self, robot: Robot, k: int) -> np.ndarray:
        """The poses (GROUP, 4, 4) of the k-th group."""
        from scipy.spatial.transform import Rotation

        rng = np.random.default_rng((self.seed, k))
        if self.poses == "configurations":
            if robot.sum_limits:
                q = np.array([robot.random_configuration(rng) for _ in range(GROUP)])
            else:
                q = drawn(rng, *robot.drawn_range, GROUP)
            return np.array([robot.at(each).placement(None).homogeneous for each in q])
        T = np.tile(np.eye(4), (GROUP, 1, 1))
        direction, quaternions = rng.normal(size=(GROUP, 3)), rng.normal(size=(GROUP, 4))
        away = self.radius * rng.random(GROUP) ** (1 / 3) / np.linalg.norm(direction, axis=1)
        T[:, :3, 3] = np.array(self.centre) + away[:, None] * direction
        T[:, :3, :3] = Rotation.from_quat(quaternions).as_matrix()
        return T

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
        files.end(folder, self.rows, self.block, self.seed, about | {"versions": manifest["versions"]})

    def columns(self, first: int, arrays: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
        """The columns (N,) of rows, with the names of the files that `solve --batch` reads and writes."""
        status = arrays["status"]
        names = np.array([Status(value).name for value in range(max(Status) + 1)])
        pose = dict(zip(("x", "y", "z", "qw", "qx", "qy", "qz"), arrays["pose"].T, strict=True))
        figures = {name: arrays[name] for name in list(arrays)[3:]}
        return {
            "index": np.arange(first, first + len(status)),
            **pose,
            "success": status == Status.CONVERGED,
            "status": names[status],
            **figures,
            **{f"q_{joint}": arrays["q"][:, i] for i, joint in enumerate(self.joint_names)},
        }


@lru_cache(maxsize=2)
def _solver(urdf: str, tip: str, base: str, labels: str, options: tuple[tuple[str, Any], ...]) -> Solver:
    """The solver of a job: the same in every process, for it is made from the job alone."""
    redundancy = Strict(Posture()) if labels == "posture" else None
    return Solver(Robot.from_urdf(urdf, tip=tip, base=base), redundancy=redundancy, options=Options(**dict(options)))
