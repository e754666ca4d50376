"""Maps of the reach beside RM4D (Rudorfer, ICRA 2025): `python benchmarks/rm4d.py --rm4d FOLDER`.

The folder is one into which github.com/mrudorfer/rm4d has been cloned. Its map is taken from there, its robots, which
need PyBullet, are not: it is filled with 10 million configurations uniform within the limits, as by its own script, but
by our forward kinematics, which is faster, and configurations that collide are not left out, in no row. Only those
count whose tool is over the floor, where its map is. Robots are its own Panda and MAIRA.

Poses are drawn as it draws them: uniform in the cylinder about the map, with uniform rotations. What is true of them is
what a solve says, at 1e-6 m and rad (RM4D judges itself by an inverse kinematics that may be 25 off, millimetres and
degrees together): a configuration, or a proof that there is none. Poses of which there is neither are left out; in a
second table they count as out of reach. Maps of ours are named by cell and directions: that of RM4D's grid of
positions, asked by what is around each pose and by the nearest pose alone, and one of 10 cm of RM4D's size. Times are
of one thread, processor time; a query of RM4D is a call for each pose, ours is one for all of them; sizes are those of
the verdicts in memory. The tables are written beside this script.
"""

import os

os.environ.update(dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1"))  # before NumPy
os.environ["MPLBACKEND"] = "Agg"

import importlib
import sys
import tempfile
import time
import types
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import tyro
from rich.console import Console
from rich.progress import Progress
from rich.table import Table
from scipy.spatial.transform import Rotation

import maira_qp as mq
from maira_qp.evaluation.judge import Judge
from maira_qp.evaluation.report import machine, table_of, versions
from maira_qp.io.atomic_write import replace_text
from maira_qp.solvers.reachability import reachability

HERE = Path(__file__).parent
PART = 20_000
"""Configurations that are drawn together."""
CELL, COARSE, DIRECTIONS = 0.05, 0.1, 200
"""Edges of cells [m], the first of RM4D too, and directions of the tool in each"""
FIGURES = ("accuracy", "false positives", "precision", "recall", "build [s]", "size [MB]", "query [us]")


@dataclass(frozen=True, kw_only=True)
class Settings:
    """What to compare with, and how much of it."""

    rm4d: Path
    """Folder of RM4D."""
    samples: int = 10_000_000
    """Configurations that its map is filled with."""
    poses: int = 100_000
    """Poses that the maps are asked about."""
    boxes: int = 20_000
    """Boxes of joint values that a proof may take, for the Panda."""


@dataclass(frozen=True)
class Arm:
    """A robot, and the space that the maps are of: x and y from -radius to radius, z from 0 to height [m]."""

    name: str
    robot: mq.Robot
    radius: float
    height: float

    @property
    def box(self) -> list[tuple[float, float]]:
        """The same for a job."""
        return [(-self.radius, self.radius), (-self.radius, self.radius), (0.0, self.height)]


class Row(NamedTuple):
    """What a map says, and what it takes."""

    name: str
    said: np.ndarray
    """(N,) whether poses can be reached"""
    build: float
    """[s]"""
    size: int
    """[bytes]"""
    query: float
    """[s] per pose"""


def main(settings: Settings) -> None:
    """Make the maps, ask them, print the tables and write them."""
    console = Console(record=True, width=126, markup=False, highlight=False)
    theirs = map_of(settings.rm4d)
    panda = settings.rm4d / "rm4d" / "robots" / "assets" / "franka_panda" / "panda166.urdf"
    arms = (
        Arm("MAIRA", mq.Robot.maira(), 1.55, 2.0),  # all of its reach over the floor
        Arm("Panda", mq.Robot.from_urdf(panda, tip="panda_grasptarget"), 1.05, 1.35),
    )
    for arm in arms:
        poses = drawn(arm, settings.poses)
        true = truth(arm, poses, settings.boxes)
        rm4d = filled(theirs, arm, settings.samples, poses)
        coarse = rm4d.size // mq.scale.ReachJob.of(arm.robot, cell=COARSE, directions=1, box=arm.box).count
        rows = [*mapped(arm, CELL, DIRECTIONS, poses), *mapped(arm, COARSE, coarse, poses)[:1], rm4d]
        is_known = true != mq.Reach.UNDECIDED
        console.print(judged(f"{arm.name}: decided poses, {is_known.mean():.1%} of {len(poses)}", rows, true, is_known))
        if not is_known.all():
            every = np.ones(len(poses), dtype=bool)
            console.print(judged(f"{arm.name}: all poses, undecided ones as out of reach", rows, true, every))
    console.print(f"RM4D: 5 cm, 36 angles, {settings.samples} configurations; proofs by {settings.boxes} boxes at most")
    console.print(f"{machine()}; {versions('numpy', 'numba')}")
    replace_text(HERE / "rm4d.txt", console.export_text())


def map_of(folder: Path) -> Any:
    """RM4D's class of maps, without what its package imports besides."""
    package = types.ModuleType("cloned_rm4d")
    package.__path__ = [str(folder / "rm4d")]
    sys.modules["cloned_rm4d"] = package
    return importlib.import_module("cloned_rm4d.reachability_map").ReachabilityMap4D


def drawn(arm: Arm, count: int) -> np.ndarray:
    """Poses (count, 4, 4) uniform in the cylinder of an arm and over all rotations."""
    rng = np.random.default_rng(27)
    T = np.tile(np.eye(4), (count, 1, 1))
    T[:, :3, :3] = Rotation.from_quat(rng.normal(size=(count, 4))).as_matrix()
    away, angle = arm.radius * np.sqrt(rng.random(count)), 2 * np.pi * rng.random(count)
    T[:, :3, 3] = np.column_stack([away * np.cos(angle), away * np.sin(angle), arm.height * rng.random(count)])
    return T


def truth(arm: Arm, poses: np.ndarray, boxes: int) -> np.ndarray:
    """What a solve says of poses (N, 4, 4): values of `Reach` (N,)."""
    solver, said = mq.Solver(arm.robot), np.full(len(poses), mq.Reach.UNDECIDED, dtype=np.int8)

    def solve(part: slice) -> None:
        said[part] = reachability(solver, poses[part], threads=1, proof_boxes=boxes).verdict

    in_parts(f"{arm.name}: truth", len(poses), 1000, solve)
    return said


def mapped(arm: Arm, cell: float, directions: int, poses: np.ndarray) -> list[Row]:
    """Our map, asked by all poses around each of `poses` and by the nearest alone."""
    job = mq.scale.ReachJob.of(arm.robot, cell=cell, directions=directions, box=arm.box)
    job.compute(0, 1, 1)  # what is made once
    with tempfile.TemporaryDirectory() as folder, Progress(console=Console(stderr=True)) as progress:
        bar = progress.add_task(f"{arm.name}: {cell} m", total=job.count * job.units_per_item)
        begin = time.process_time()
        mq.scale.run(job, folder, engine="here", progress=lambda done, _: progress.update(bar, completed=done))
        build, rows = time.process_time() - begin, []
        reach = mq.scale.ReachMap.open(folder)
        for nearest in (False, True):
            said = reach.query(poses[:1], nearest=nearest)  # what is read once
            begin = time.process_time()
            said = reach.query(poses, nearest=nearest) == mq.Reach.REACHABLE
            query = (time.process_time() - begin) / len(poses)
            name = f"maira_qp, {100 * cell:.0f} cm x {directions}{', nearest' if nearest else ''}"
            rows.append(Row(name, said, build, reach.verdict.nbytes, query))
    return rows


def filled(theirs: Any, arm: Arm, samples: int, poses: np.ndarray) -> Row:
    """RM4D's map, filled with so many configurations, and asked."""
    rng, robot = np.random.default_rng(42), arm.robot
    walk = Judge(robot.urdf, robot.base, robot.tip, robot.joint_names)
    sides = [-arm.radius, arm.radius]
    reach = theirs(xy_limits=sides, z_limits=[0, arm.height], voxel_res=CELL)

    def fill(part: slice) -> None:
        count = part.stop - part.start
        while count:
            T = walk.forward(rng.uniform(robot.lower, robot.upper, (PART, robot.n)))
            T = T[(T[:, 2, 3] >= 0.0) & (T[:, 2, 3] < arm.height)][:count]
            count -= len(T)
            for one in T:
                reach.mark_reachable(reach.get_indices_for_ee_pose(one))

    begin = time.process_time()
    in_parts(f"{arm.name}: RM4D", samples, PART, fill)
    build, said = time.process_time() - begin, np.zeros(len(poses), dtype=bool)
    begin = time.process_time()
    for k, one in enumerate(poses):
        said[k] = reach.is_reachable(reach.get_indices_for_ee_pose(one))
    return Row("RM4D", said, build, reach.map.nbytes, (time.process_time() - begin) / len(poses))


def in_parts(name: str, count: int, size: int, work: Callable[[slice], None]) -> None:
    """Do some work by parts, with a bar."""
    with Progress(console=Console(stderr=True)) as progress:
        bar = progress.add_task(name, total=count)
        for first in range(0, count, size):
            last = min(first + size, count)
            work(slice(first, last))
            progress.update(bar, completed=last)


def judged(title: str, rows: list[Row], true: np.ndarray, is_known: np.ndarray) -> Table:
    """The table of some maps, by the poses (N,) of which something is known."""
    true = true[is_known] == mq.Reach.REACHABLE
    table = table_of(f"{title}; {true.mean():.1%} of these can be reached", ("map",), FIGURES)
    for row in rows:
        said = row.said[is_known]
        shares = np.mean(said == true), np.mean(said[~true]), np.mean(true[said]), np.mean(said[true])
        costs = f"{row.build:.1f}", f"{row.size / 1e6:.1f}", f"{1e6 * row.query:.2f}"
        table.add_row(row.name, *(f"{100 * share:.2f} %" for share in shares), *costs)
    return table


if __name__ == "__main__":
    main(tyro.cli(Settings, description=__doc__))
