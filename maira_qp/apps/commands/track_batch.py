"""`maira-qp track --batch`: many paths from a file, each followed by itself, the answers into a file."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console

from maira_qp.apps.arguments.output import VERDICTS, Units, console, print_json, progress_bar
from maira_qp.apps.arguments.standard_streams import STANDARD
from maira_qp.apps.commands.answering import check_answers, write
from maira_qp.apps.commands.batch import Hints
from maira_qp.apps.left_pipes import reader_may_leave
from maira_qp.errors import PoseError
from maira_qp.io.answers import left_out
from maira_qp.io.path_rows import PathRows, PathWriter, names_of
from maira_qp.io.poses import Poses
from maira_qp.io.save import TableUnits
from maira_qp.results.path_solution import PathSolution
from maira_qp.solvers.paths.closed import check_closed
from maira_qp.solvers.solver import Solver
from maira_qp.wording import figures, in_units


@dataclass(frozen=True, kw_only=True)
class PathBatch:
    """A file of paths to be followed by one solver."""

    poses: Poses
    column: str
    """Tells the paths apart"""
    output: Path
    q0: np.ndarray | None
    """(n,) the start of each path [rad or m]; None: that of its first row, if the file holds starts"""
    arguments: Mapping[str, Any]
    """Of `Solver.track`"""

    def run(self, solver: Solver, units: Units, *, json: bool) -> int:
        """Follows, writes and prints a summary; 0 if all paths are followed whole, else 1."""
        poses, robot = self.poses, solver.robot
        paths = PathRows(poses.table, self.column)
        columns = TableUnits(units.angle == "deg", units.length == "mm")
        names = names_of(robot.joint_names, robot.slides.tolist(), columns)
        check_answers(self.output, poses.table, names)
        self._check(solver, paths)
        tally, begin = Tally(solver, poses, paths, self.q0), time.monotonic()
        with progress_bar("following") as progress:
            answered = self._answered(solver, paths, tally, progress)
            write(
                self.output,
                answered,
                lambda file, suffix: PathWriter(file, suffix, poses.table, names, columns),
                "poses",
            )
        summary = tally.summary(time.monotonic() - begin) | {"output": str(self.output)}
        is_streamed = self.output == STANDARD
        with reader_may_leave():
            print_json(summary, stderr=is_streamed) if json else _show(summary, units, console(stderr=is_streamed))
        for name in left_out(self.output, poses.table):
            console(stderr=True).print(
                f"left out of {self.output}: {name!r}, which has no entry for each pose", soft_wrap=True
            )
        return VERDICTS["CONVERGED" if tally.whole == len(paths) else "NEAREST"]

    def _check(self, solver: Solver, paths: PathRows) -> None:
        """What would end a long run in its middle. Raises `PoseError`."""
        for rows in paths:
            first = slice(rows.start, rows.start + 1)
            if self.q0 is None and not self.poses.valid(first).all():
                raise PoseError(f"{self.poses.table.where(rows.start)}: a path begins here, and its start is not whole")
            if self.arguments["loop"]:
                ends = [self.poses.targets(each)[0] for each in (first, slice(rows.stop - 1, rows.stop))]
                try:
                    check_closed(solver.problem, *ends)
                except PoseError as reason:
                    raise reason.at(self.poses.table.where(rows.stop - 1)) from None

    def _answered(
        self, solver: Solver, paths: PathRows, tally: Tally, progress: Callable[[int, int], None]
    ) -> Iterator[tuple[slice, PathSolution]]:
        """The answers to all paths, one at a time."""
        poses = self.poses
        for k, rows in enumerate(paths):
            valid = np.ones(rows.stop - rows.start, dtype=bool)
            q0 = self.q0
            if q0 is None and poses.layout.start:
                q0 = poses.starts(slice(rows.start, rows.start + 1))[0]  # type: ignore[index]

            def show(done: int, _: int, before: int = rows.start) -> None:
                progress(before + done, len(poses))

            path = solver.track(poses.targets(rows, valid), q0, progress=show, **self.arguments)
            tally.add(k, rows, path)
            yield rows, path


@dataclass
class Tally:
    """What a summary says of the answers, counted a path at a time."""

    solver: Solver
    poses: Poses
    paths: PathRows
    q0: np.ndarray | None
    whole: int = 0
    reached: int = 0
    reconfigurations: int = 0
    worst: dict[str, float] = field(default_factory=lambda: {"position_error": 0.0, "orientation_error": 0.0})
    first_not_followed: dict[str, Any] | None = None

    def __post_init__(self) -> None:
        self._hints = Hints(self.solver.robot, self.poses, self.q0)

    def add(self, k: int, rows: slice, path: PathSolution) -> None:
        """Count the answer to the k-th path."""
        self.whole += bool(path)
        self.reached += int(path.success.sum())
        self.reconfigurations += path.reconfigurations
        for name in self.worst:
            self.worst[name] = max(self.worst[name], float(getattr(path, name).max()))
        if path.first_failure is not None and self.first_not_followed is None:
            self.first_not_followed = {
                "path": self.paths.name(k),
                "at": self.poses.table.where(rows.start + path.first_failure),
                "reason": path.reason,
            }
        self._hints.add(rows, np.ones(len(path), dtype=bool), path.success)

    def summary(self, seconds: float) -> dict[str, Any]:
        """All of it, for JSON."""
        return {
            "robot": self.solver.robot.name,
            "tip": self.solver.robot.tip,
            "paths": len(self.paths),
            "followed_whole": self.whole,
            "first_not_followed": self.first_not_followed,
            "poses": len(self.poses),
            "reached": self.reached,
            "reconfigurations": self.reconfigurations,
            **{f"worst_{name}": error for name, error in self.worst.items()},
            "seconds": seconds,
            "poses_per_second": len(self.poses) / max(seconds, 1e-9),
            "hints": self._hints.said(),
        }


def _show(summary: dict[str, Any], units: Units, out: Console) -> None:
    """The summary as a table."""
    from rich.table import Table

    whole, first = summary["followed_whole"] == summary["paths"], summary["first_not_followed"]
    style = "bold green" if whole else "bold yellow"
    out.print(f"followed whole: {summary['followed_whole']} of {summary['paths']} paths", style=style)
    if first is not None:
        out.print(f"the first that is not: {first['path']}, at {first['at']}", soft_wrap=True)
        out.print(in_units(first["reason"], units.sentences))
    table = Table(show_header=False)
    table.add_row("reached", f"{summary['reached']} of {summary['poses']} poses")
    table.add_row("reconfigurations", str(summary["reconfigurations"]))
    for heading, error in units.errors(summary["worst_position_error"], summary["worst_orientation_error"]):
        table.add_row(f"worst {heading}", error)
    table.add_row("time", f"{figures(summary['seconds'])} s, {summary['poses_per_second']:,.0f} poses per second")
    table.add_row("answers", summary["output"])
    out.print(table)
    for hint in summary["hints"]:
        out.print(f"hint: {hint}", style="bold yellow")
