"""`maira-qp place`: where an arm should stand for some tool poses."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import tyro

from maira_qp.apps.arguments.flags import RobotFlags, checked_seed
from maira_qp.apps.arguments.numbers import Range
from maira_qp.apps.arguments.optional import Flag, Maybe, explained
from maira_qp.apps.arguments.robot_choice import RobotChoice
from maira_qp.apps.arguments.standard_streams import name_and_stream
from maira_qp.apps.commands.view import check_viser, serve
from maira_qp.apps.left_pipes import reader_may_leave
from maira_qp.errors import OptionError, PoseError
from maira_qp.wording import figures

if TYPE_CHECKING:
    from maira_qp.robots.model.robot import Robot
    from maira_qp.scale.placement.placements import Placements
    from maira_qp.scale.reach.reach_map import ReachMap

NOT_ALL = 1
TURN = 30.0
"""Between yaw angles, where nothing is said [deg]"""


@explained
@dataclass(frozen=True, kw_only=True)
class Place:
    """Find where an arm should stand to reach the poses of a file.

    Bases are ranked by how many of the poses are reached from there. The poses are the rows of a file, as those of
    maira-qp solve --batch, in the frame in which bases are sought, z up. All bases of a grid are scored by a map of
    maira-qp reach, or, without --map, by the solver itself; then the poses are solved from the best bases, and what is
    printed is what was found: how many poses are reached, how many are proved to be out of reach, the smallest and the
    mean quality. Of the turns at one position the best is printed.

    Exit code 0: from the best base all poses are reached; 1: from none that was solved; 2: wrong use.

    Example:

        maira-qp place poses.csv --robot ur5 --step 0.2"""

    poses: tyro.conf.Positional[Path]
    """File of the poses, .csv, .npy, .npz or .parquet; -: CSV from standard input."""
    choice: RobotFlags = field(default_factory=RobotChoice)
    map: Maybe[Path] = None
    """Folder of a finished map of maira-qp reach, which has its robot; none: no map is needed."""
    x: Range = None
    """Bases from where to where along x [m, or mm with --mm], or at one x; none: wherever a pose could be reached
    from."""
    y: Range = None
    """The same along y."""
    z: Range = None
    """The same along z; none: 0, the floor."""
    yaw: Range = None
    """Turns of the base about z, from where to where, or one [rad, or deg with --deg]; none: a whole turn."""
    step: Maybe[float] = None
    """Between positions, at most [m, or mm with --mm]; > 0; none: 0.1 m."""
    turn: Maybe[float] = None
    """Between turns, at most [rad, or deg with --deg]; > 0; none: 30 deg."""
    keep: int = 10
    """How many positions are printed; >= 1."""
    quality: Literal["limit_distance", "manipulability"] = "limit_distance"
    """What makes one base better than another that reaches as many poses: the distance from the joint limits (0 at one,
    1 midway), or the manipulability."""
    seed: int = 0
    """Seed of the random starts; >= 0."""
    threads: Maybe[int] = None
    """Threads; >= 1; none: one per processor. No answer depends on it."""
    project: Flag = False
    """Take the nearest rotations to rounded ones, on purpose."""
    output: Maybe[Path] = None
    """Write the ranked bases to this .csv or .json file, in m and rad."""
    picture: Maybe[Path] = None
    """Draw the floor and the bases into this .png, .svg or .pdf."""
    view: Flag = False
    """Show the arm at the best base in the browser, with the poses as seen from there."""
    host: str = "127.0.0.1"
    """Address that --view serves at; see maira-qp view."""
    port: int = 8080
    """Port that --view serves at; see maira-qp view."""
    deg: Flag = False
    """Angles on the command line and in the file of the poses in degrees; --output stays in rad."""
    mm: Flag = False
    """Lengths on the command line and in the file of the poses in mm; --output stays in m."""
    json: Flag = False
    """One JSON value on stdout."""

    def run(self) -> int:
        """Ranks, writes, draws and prints; the exit code as the class says."""
        from maira_qp.apps.arguments.output import Units, check_picture, print_json, progress_bar
        from maira_qp.robots.model.robot import Robot
        from maira_qp.scale.placement.place import place
        from maira_qp.scale.placement.placements import checked_file

        if self.map is not None and self.choice != RobotChoice():
            raise OptionError("--map has its robot: leave out --robot, --tip, --base, --tool and --limits")
        if self.picture is not None:
            check_picture(self.picture)
        if self.output is not None:
            checked_file(self.output)
        if self.view:
            check_viser()
        seed, reach = checked_seed(self.seed), self._reach()
        robot = reach if isinstance(reach, Robot) else reach.robot
        units = Units(robot, self.deg, self.mm)
        T = self._read(robot, units)
        begin = time.monotonic()
        with progress_bar("comparing bases") as progress:
            found = place(
                reach,
                T,
                x=_scaled(self.x, units.metre),
                y=_scaled(self.y, units.metre),
                z=_scaled(self.z, units.metre) or 0.0,
                yaw=_scaled(self.yaw, units.radian) or (-math.pi, math.pi),
                step=0.1 if self.step is None else self.step / units.metre,
                turn=math.radians(TURN) if self.turn is None else self.turn / units.radian,
                keep=self.keep,
                quality=self.quality,
                seed=seed,
                threads=self.threads,
                progress=progress,
            )
        seconds = time.monotonic() - begin
        files = [] if self.output is None else [found.save(self.output)]
        if self.picture is not None:
            from maira_qp.apps import plots  # not before it is known to be installed

            made = plots.figure(size=(6.4, 5.2))
            plots.placements(made.axes[0], found)
            files.append(plots.save(made, self.picture))
        with reader_may_leave():
            said = {"seconds": seconds, "files": [str(each) for each in files]}
            print_json(found.as_dict() | said) if self.json else _show(found, units, said)
        if self.view:
            from maira_qp.apps.viewer.drawing.layers import seen_from_base

            serve(self.choice if self.map is None else robot, self.host, self.port, layers=[seen_from_base(found)])
        return 0 if found else NOT_ALL

    def _reach(self) -> ReachMap | Robot:
        """The map, or the robot. Raises `JobError`, and what `RobotChoice.load` does."""
        from maira_qp.scale.reach.reach_map import ReachMap

        return (
            self.choice.load_with_one_tip(degrees=self.deg, millimetres=self.mm)
            if self.map is None
            else ReachMap.open(self.map)
        )

    def _read(self, robot: Robot, units: Any) -> np.ndarray:
        """The poses (N, 4, 4). Raises `PoseError` for a row without one, and for a file without rows."""
        from maira_qp.io.poses import read_poses
        from maira_qp.problem.targets import FARTHEST

        name, stream = name_and_stream(self.poses)
        far = FARTHEST * robot.length
        how = {"radian": units.radian, "metre": units.metre, "farthest": far, "project": self.project}
        poses = read_poses(name, None, stream=stream, **how)
        if not len(poses):
            raise PoseError(f"{name} holds no pose: bases are ranked by the poses that are reached from them")
        for row in np.flatnonzero(~poses.valid(slice(None)))[:1].tolist():
            raise PoseError(f"{poses.table.where(row)}: a cell is empty or not finite; every row is to be a pose")
        return poses.targets(slice(None))


def _scaled(values: tuple[float, ...] | None, scale: float) -> tuple[float, ...] | None:
    """A range in m or rad; None: not given."""
    return None if values is None else tuple(value / scale for value in values)


def _show(found: Placements, units: Any, said: dict[str, Any]) -> None:
    """The ranked bases as a table on stdout."""
    from rich.table import Table

    from maira_qp.apps.arguments.output import console

    out, best, count = console(), found[0], len(found.poses)
    if best:
        out.print(f"all {count} poses are reached from the best base", style="bold green")
    else:
        out.print(f"the best base reaches {best.reached} of {count} poses", style="bold yellow")
    headings = ["reached", "no", *(f"{axis} [{units.length}]" for axis in "xyz"), f"yaw [{units.angle}]"]
    table = Table("", *headings, "least", "mean")
    for k, each in enumerate(found, start=1):
        place = [*(each.values[:3] * units.metre), each.values[3] * units.radian]
        row = [str(each.reached), str(each.unreachable), *(f"{value:.4g}" for value in place)]
        table.add_row(str(k), *row, *("" if np.isnan(v) else figures(v) for v in (each.least, each.mean)))
    for column in table.columns:
        column.justify = "right"
    out.print(table)
    out.print(f"no: proved to be out of reach; least and mean of: {found.quality.replace('_', ' ')}")
    out.print(f"{found.estimates.size} bases compared in {figures(said['seconds'])} s")
    for file in said["files"]:
        out.print(f"written: {file}", soft_wrap=True)
