"""The published paths of CppFlow and IKLink: `python benchmarks/public_paths.py --cppflow CPPFLOW --iklink IKLINK`.

The arguments are folders into which github.com/jstmn/cppflow and github.com/uwgraphics/IKLink have been cloned.
CppFlow's problems for the Fetch without obstacles count as followed by its own criterion: every pose within 0.1 mm and
0.1 degrees, no joint step over 7 degrees or 2 cm. The trace of IKLink, 767 poses of a hand that a person moved, asks a
Panda for as few reconfigurations as possible. Times are of one thread, the best of some calls. The table is written
beside this script.
"""

import os

os.environ.update(dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1"))  # before NumPy

import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import tyro
import yaml
from rich.console import Console
from scipy.spatial.transform import Rotation

import maira_qp as mq
from maira_qp.evaluation.report import machine, table_of, versions
from maira_qp.io.atomic_write import replace_text

HERE = Path(__file__).parent
BASES = {"fetch_arm": "torso_lift_link", "fetch": "base_link"}
"""Robots of CppFlow's problems, and the link that their joints begin at"""
NEAR, STEP, SLIDE = (1e-4, np.deg2rad(0.1)), np.deg2rad(7.0), 0.02
"""CppFlow's criterion: errors [m, rad], and steps of turning [rad] and of sliding joints [m]"""


@dataclass(frozen=True, kw_only=True)
class Settings:
    """Where the paths are."""

    cppflow: Path
    """Folder of CppFlow."""
    iklink: Path
    """Folder of IKLink."""
    calls: int = 5
    """Calls of which the fastest counts."""


@dataclass(frozen=True)
class Row:
    """A path, and how it was followed."""

    name: str
    robot: str
    path: mq.PathSolution
    is_valid: bool
    seconds: float


def main(settings: Settings) -> None:
    """Follow all of them, print the table and write it."""
    console = Console(record=True, width=130, markup=False, highlight=False)
    rows = [*cppflow(settings), iklink(settings)]
    table = table_of(
        "published paths",
        ("path", "robot (joints)"),
        ("poses", "valid", "reconfigurations", "largest step [deg]", "length [rad]", "errors [m, rad]", "time [ms]"),
    )
    for row in rows:
        steps = np.diff(row.path.q, axis=0)[:, ~row.path.robot.slides]
        errors = f"{row.path.position_error.max():.0e}, {row.path.orientation_error.max():.0e}"
        figures = [str(len(row.path.q)), "yes" if row.is_valid else "no", str(row.path.reconfigurations)]
        figures += [f"{np.rad2deg(np.abs(steps).max()):.2f}", f"{np.linalg.norm(steps, axis=1).sum():.1f}", errors]
        table.add_row(row.name, row.robot, *figures, f"{1e3 * row.seconds:.0f}")
    console.print(table)
    console.print(f"{machine()}; {versions('numpy', 'numba', 'pin')}")
    replace_text(HERE / "public_paths.txt", console.export_text())


def cppflow(settings: Settings) -> list[Row]:
    """Its problems without obstacles, of the robots that `BASES` names."""
    urdf, rows = settings.iklink / "configs" / "urdfs" / "fetch.urdf", []
    for file in sorted((settings.cppflow / "cppflow" / "problems").glob("*.yaml")):
        problem = yaml.safe_load(file.read_text())
        if problem["robot"] not in BASES or problem.get("obstacles") or "mini" in file.stem:
            continue
        robot = mq.Robot.from_urdf(urdf, "gripper_link", BASES[problem["robot"]])
        frame = problem["path_offset_frame"]
        at = robot.forward(np.zeros(robot.n), frame).translation if frame != robot.base else np.zeros(3)
        csv = settings.cppflow / "cppflow" / "paths" / f"{problem['path_name']}.csv"
        table = np.loadtxt(csv, delimiter=",", skiprows=1)
        poses = posed(table[:, 1:4] + at + problem["path_xyz_offset"], table[:, [5, 6, 7, 4]])
        poses[:, :3, :3] = poses[:, :3, :3] @ np.array(problem["path_R_offset"], dtype=float)
        step = np.where(robot.slides, SLIDE, STEP)
        path, seconds = followed(mq.Solver(robot), poses, settings.calls, max_step=step)
        errors = path.position_error.max() < NEAR[0] and path.orientation_error.max() < NEAR[1]
        is_valid = bool(errors and (np.abs(np.diff(path.q, axis=0)) < step).all())
        rows.append(Row(problem["path_name"], f"{robot.name} ({robot.n})", path, is_valid, seconds))
    return rows


def iklink(settings: Settings) -> Row:
    """Its trace, of two reconfigurations at most."""
    robot = mq.Robot.from_urdf(settings.iklink / "configs" / "urdfs" / "panda.urdf", "panda_hand", "world")
    (file,) = sorted((settings.iklink / "input_trajectories").glob("panda*.csv"))
    table = np.loadtxt(file, delimiter=",", skiprows=1)
    poses = posed(table[:, 1:4], table[:, 4:8])
    path, seconds = followed(mq.Solver(robot), poses, settings.calls, max_reconfigurations=2)
    return Row("a hand", f"{robot.name} ({robot.n})", path, bool(path), seconds)


def posed(positions: np.ndarray, quaternions: np.ndarray) -> np.ndarray:
    """Poses (N, 4, 4) from positions (N, 3) [m] and quaternions (N, 4), scalar last."""
    poses = np.tile(np.eye(4), (len(positions), 1, 1))
    poses[:, :3, 3], poses[:, :3, :3] = positions, Rotation.from_quat(quaternions).as_matrix()
    return poses


def followed(solver: mq.Solver, poses: np.ndarray, calls: int, **rules: Any) -> tuple[mq.PathSolution, float]:
    """A path, and the time that the fastest of some calls took [s]."""
    path, seconds = solver.track(poses, **rules), []
    for _ in range(calls):
        begin = time.perf_counter()
        path = solver.track(poses, **rules)
        seconds.append(time.perf_counter() - begin)
    return path, min(seconds)


if __name__ == "__main__":
    main(tyro.cli(Settings, description=__doc__))
