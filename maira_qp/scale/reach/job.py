"""The job of a reachability map: for each cell of positions, the verdict on every orientation, and the best of each."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from maira_qp.arrays import is_count, is_number
from maira_qp.errors import OptionError, shown
from maira_qp.problem.options import Options
from maira_qp.results.status import Reach
from maira_qp.robots.model.robot import Robot
from maira_qp.scale.job import Job
from maira_qp.scale.reach.bound import reach_bound
from maira_qp.scale.reach.grid import Orientations, Positions
from maira_qp.scale.reach.metrics import limit_distances, manipulabilities
from maira_qp.solvers.reachability import reachability
from maira_qp.solvers.solver import Solver

POSES, CONFIGURATIONS = 16_384, 2_048
"""Poses that are solved together, and configurations that are judged together: what fits into the caches."""
BLOCK = 4_000_000
"""Poses of a block of the output, at most, if a plane of cells has no more."""
RESTARTS = 15
"""Of descents, where nothing is said"""
ALIGNED = 1e-6
"""Share of a cell by which an end of the box may be beyond a cell's face and still be at it."""
MOST = 2**40
"""Most poses of a map."""


@dataclass(frozen=True, kw_only=True)
class ReachJob(Job):
    """A map of what the tip of an arm reaches. Made by `ReachJob.of`."""

    urdf: str
    """Normalised URDF, with the limits that hold."""
    tip: str
    base: str
    cell: float
    """Edge of the cells [m]"""
    lower: tuple[int, int, int]
    """Lower corner of the grid, in cells"""
    shape: tuple[int, int, int]
    """Cells along x, y and z"""
    directions: int
    """Directions of the tool's z axis"""
    rolls: int
    """Rolls about it"""
    centre: tuple[float, float, float]
    """A point [m] from which the tip is never farther than"""
    radius: float | None
    """this [m]; None: no bound is known"""
    options: Mapping[str, Any]
    """Of the solver, see `Options`"""
    proof_boxes: int | None
    """See `ReachJob.of`"""
    seed: int

    kind = "reach"
    unit = "poses"

    def __post_init__(self) -> None:
        for name in ("lower", "shape", "centre"):  # a manifest has lists
            object.__setattr__(self, name, tuple(getattr(self, name)))

    @staticmethod
    def of(
        robot: Robot,
        *,
        cell: float = 0.05,
        directions: int = 200,
        rolls: int = 1,
        box: Sequence[Sequence[float]] | None = None,
        options: Options | None = None,
        proof_boxes: int | None = 0,
        seed: int = 0,
    ) -> ReachJob:
        """The job of mapping what the tip of a robot reaches.

        Args:
            robot: with one tip, and a URDF.
            cell: edge of the cells [m], > 0.
            directions: of the tool's z axis, uniform over the sphere, >= 1.
            rolls: about each of them, uniform over a turn, >= 1.
            box: ((x0, x1), (y0, y1), (z0, z1)) [m], which the grid will cover; None: all that can be reached.
            options: of the solver; None: those of a solve, but `max_restarts=15`, after which few poses are missed.
            proof_boxes: for arms that are no S-R-S arms: boxes of joint values that the proof that a pose is out of
                reach may take, >= 0; None: as many as in a solve, which there takes nearly all of the time; 0: no such
                proofs, so that what is not reached is undecided.
            seed: of the solver's random starts.

        Raises `OptionError` for values out of range, for a robot with several tips, and without a box for one whose
        reach has no bound; `RobotError` for a robot of which there is no URDF.
        """
        if not isinstance(robot, Robot) or len(robot.tips) > 1:
            raise OptionError(f"a map is of a robot with one tip, got {shown(robot)}")
        if not (is_number(cell) and 0 < cell < math.inf):
            raise OptionError(f"cell must be a positive number of metres, got {shown(cell)}")
        for name, value in (("directions", directions), ("rolls", rolls)):
            if not is_count(value, 1):
                raise OptionError(f"{name} must be a positive whole number, got {shown(value)}")
        if proof_boxes is not None and not is_count(proof_boxes):
            raise OptionError(f"proof_boxes must be a non-negative whole number, got {shown(proof_boxes)}")
        if not is_count(seed):
            raise OptionError(f"seed must be a non-negative whole number, got {shown(seed)}")
        centre, radius = reach_bound(robot)
        if box is None:
            if radius is None:
                raise OptionError("the reach of this robot has no bound: give a box")
            box = [(float(c) - radius, float(c) + radius) for c in centre]
        lower, shape = _cells(box, float(cell))
        if math.prod(shape) * directions * rolls > MOST:
            raise OptionError(f"a map of {math.prod(shape)} cells and {directions * rolls} orientations is too large")
        return ReachJob(
            urdf=robot.urdf,
            tip=robot.tip,
            base=robot.base,
            cell=float(cell),
            lower=lower,
            shape=shape,
            directions=int(directions),
            rolls=int(rolls),
            centre=(float(centre[0]), float(centre[1]), float(centre[2])),
            radius=radius,
            options=asdict(options or Options(max_restarts=RESTARTS)),
            proof_boxes=proof_boxes,
            seed=int(seed),
        )

    def is_sound(self) -> bool:
        """See `Job.is_sound`."""
        counts = (*self.shape, self.directions, self.rolls)
        numbers = (self.cell, *self.centre, *self.lower)
        fits = len(self.shape) == len(self.lower) == len(self.centre) == 3 and isinstance(self.urdf, str)
        return fits and all(is_count(n, 1) for n in counts) and all(is_number(x) for x in numbers) and self.cell > 0

    @cached_property
    def positions(self) -> Positions:
        """The grid of cells."""
        return Positions(self.cell, self.lower, self.shape)

    @cached_property
    def orientations(self) -> Orientations:
        """The grid of orientations."""
        return Orientations(self.directions, self.rolls)

    @property
    def count(self) -> int:
        """How many cells there are."""
        return self.positions.count

    @property
    def units_per_item(self) -> int:
        """Poses of a cell."""
        return self.directions * self.rolls

    @property
    def block(self) -> int:
        """Cells of a block of the output: planes of one x, as many as are not too much together."""
        plane = self.shape[1] * self.shape[2]
        return plane * max(1, min(self.shape[0], BLOCK // (plane * self.units_per_item)))

    def compute(self, first: int, last: int, threads: int) -> dict[str, np.ndarray]:
        """See `Job.compute`: the arrays of `store.CELLS`, and `verdict` (cells, directions, rolls)."""
        solver, step = (
            _solver(self.urdf, self.tip, self.base, tuple(self.options.items())),
            POSES // self.units_per_item,
        )
        parts = [
            self._cells(solver, at, min(at + max(1, step), last), threads) for at in range(first, last, max(1, step))
        ]
        return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}

    def _cells(self, solver: Solver, first: int, last: int, threads: int) -> dict[str, np.ndarray]:
        """The arrays of cells that are computed together."""
        points, orientations = self.positions.centres(first, last), self.units_per_item
        verdict = np.full((len(points), orientations), Reach.UNREACHABLE, dtype=np.int8)
        best = {name: np.full((len(points), orientations), -1.0) for name in ("manipulability", "limit_distance")}
        near = np.flatnonzero(self._is_near(points, solver.options.position_tolerance))
        if len(near):
            targets = np.zeros((len(near), orientations, 4, 4))
            targets[..., :3, :3] = self.orientations.rotations.reshape(-1, 3, 3)
            targets[..., :3, 3], targets[..., 3, 3] = points[near, None], 1.0
            how = {"seed": self.seed, "threads": threads, "proof_boxes": self.proof_boxes}
            found = reachability(solver, targets.reshape(-1, 4, 4), **how)
            verdict[near] = found.verdict.reshape(len(near), -1)
            reached = np.flatnonzero(found.verdict == Reach.REACHABLE)
            rows, columns = near[reached // orientations], reached % orientations
            for some in (slice(at, at + CONFIGURATIONS) for at in range(0, len(reached), CONFIGURATIONS)):
                q, place = found.q[reached[some]], (rows[some], columns[some])
                best["manipulability"][place] = manipulabilities(solver.robot, q)
                best["limit_distance"][place] = limit_distances(solver.robot, q)
        return {"verdict": verdict.reshape(-1, self.directions, self.rolls), **_summary(verdict, self.rolls, best)}

    def _solver(self) -> Solver:
        return _solver(self.urdf, self.tip, self.base, tuple(self.options.items()))

    def _is_near(self, points: np.ndarray, tolerance: float) -> np.ndarray:
        """Which points (N, 3) [m] the tip may be at: the others are beyond its reach by more than the tolerance."""
        if self.radius is None:
            return np.ones(len(points), dtype=bool)
        x, y, z = (points - self.centre).T
        return np.sqrt(x * x + y * y + z * z) <= self.radius + tolerance

    def begin_output(self, folder: Path) -> None:
        """See `Job.begin_output`."""
        from maira_qp.scale.reach import store  # heavy: Zarr comes with it

        store.begin(folder, self.positions, self.orientations, self.block, self._attributes())

    def write_block(self, folder: Path, first: int, arrays: Mapping[str, np.ndarray]) -> None:
        """See `Job.write_block`."""
        from maira_qp.scale.reach import store

        store.write_block(folder, self.positions, first, arrays)

    def end_output(self, folder: Path) -> None:
        """See `Job.end_output`."""
        from maira_qp.scale.reach import store

        store.end(folder)

    def _attributes(self) -> dict[str, Any]:
        """What is said of the map as a whole."""
        robot = self._solver().robot
        limits = {
            name: [float(low) if np.isfinite(low) else None, float(high) if np.isfinite(high) else None]
            for name, low, high in zip(robot.joint_names, robot.lower, robot.upper, strict=True)
        }
        names = ("urdf", "tip", "base", "cell", "lower", "options", "proof_boxes", "seed")
        manifest = self.manifest()
        return {
            "robot": robot.name,
            "joint_limits": limits,
            **{name: manifest["job"][name] for name in names},
            "versions": manifest["versions"],
        }


@lru_cache(maxsize=2)
def _solver(urdf: str, tip: str, base: str, options: tuple[tuple[str, Any], ...]) -> Solver:
    """The solver of a job: the same in every process, for it is made from the job alone."""
    return Solver(Robot.from_urdf(urdf, tip=tip, base=base), options=Options(**dict(options)))


def _summary(verdict: np.ndarray, rolls: int, best: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """What is known of cells as a whole, from verdicts (cells, orientations) and the figures of what was reached."""
    open_ones = (verdict.reshape(len(verdict), -1, rolls) == Reach.REACHABLE).any(axis=2)
    shares = {kind.name.lower(): (verdict == kind).sum(axis=1) / verdict.shape[1] for kind in Reach}
    largest = {name: values.max(axis=1) for name, values in best.items()}
    return {
        **{name: share.astype(np.float32) for name, share in shares.items()},
        "directions_open": open_ones.sum(axis=1).astype(np.uint32),
        **{name: np.where(values < 0.0, np.nan, values).astype(np.float32) for name, values in largest.items()},
    }


def _cells(box: Any, cell: float) -> tuple[tuple[int, int, int], tuple[int, int, int]]:
    """The lower corner, in cells, and the shape of a grid that covers a box. Raises `OptionError`."""
    try:
        ends = np.array(box, dtype=float)
    except (TypeError, ValueError):
        ends = np.empty(0)
    if ends.shape != (3, 2) or not np.isfinite(ends).all() or not (ends[:, 0] < ends[:, 1]).all():
        raise OptionError(f"box must be ((x0, x1), (y0, y1), (z0, z1)) in metres, lower ends first, got {shown(box)}")
    if not (np.abs(ends) <= MOST * cell).all():
        raise OptionError(f"the box {shown(box)} has too many cells of {cell} m")
    lower = np.floor(ends[:, 0] / cell + ALIGNED).astype(int).tolist()
    upper = np.ceil(ends[:, 1] / cell - ALIGNED).astype(int).tolist()
    shape = [max(1, b - a) for a, b in zip(lower, upper, strict=True)]
    return (lower[0], lower[1], lower[2]), (shape[0], shape[1], shape[2])
