"""`maira-qp solve --batch`: many poses from a file, the answers into a file."""

from __future__ import annotations

import re
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console

from maira_qp.apps.arguments.output import VERDICTS, Units, console, print_json, progress_bar
from maira_qp.apps.arguments.standard_streams import STANDARD, beside, name_and_content
from maira_qp.apps.left_pipes import reader_may_leave
from maira_qp.errors import OptionError, PoseError
from maira_qp.io.answers import check_names, check_output, columns, left_out, stream_answers, write_answers
from maira_qp.io.poses import Poses, blocks, read_poses
from maira_qp.problem.targets import FARTHEST
from maira_qp.results.answer import ERRORS, unknown_errors
from maira_qp.results.batch import BatchSolution
from maira_qp.results.status import Status
from maira_qp.robots.model.robot import Robot
from maira_qp.robots.unit_hints import degrees_hint, degrees_hint_of_angles, millimetres_hint_of_many
from maira_qp.solvers.solver import Solver

REMARKS = {
    "nearest": "NEAREST: a nearest point, not at the pose",
    "budget_spent": "BUDGET_SPENT: neither reached nor a nearest point",
    "unreachable": "UNREACHABLE: proved",
    "limits_broken": "LIMITS_BROKEN: no configuration within the further limits was found",
    "invalid_target": "INVALID_TARGET: rows without a pose (an empty cell, or not finite)",
    "first_not_solved": "the first that is not solved",
    "targets_rounded": "orientations that were rounded; the nearest rotations were taken",
    "positions_alone": "positions without an orientation, which is free",
    "starts_moved_onto_limits": "starts outside the joint limits, moved onto them",
    "starts_left": "answers that left their start: elsewhere is better by more than the tolerances",
    "redundancy_not_settled": "solved, but the redundancy was not settled",
}
"""What the summary says only where there is something to say."""


@dataclass(frozen=True, kw_only=True)
class Batch:
    """A file of poses to be solved by one solver."""

    path: Path
    output: Path | None
    """None: beside the input, `poses.csv` to `poses.solved.csv`, and standard input to standard output"""
    q0: np.ndarray | None
    """(n,) the start of all [rad or m]; None: those of the file, if it holds any"""
    seed: int
    threads: int | None
    project: bool

    def run(self, solver: Solver, positions: Solver, units: Units, *, json: bool) -> int:
        """Solves, writes and prints a summary; 0 if all are solved, 5 if a row holds no pose, else 1.

        `positions` solves a file that holds positions alone.
        """
        joints = solver.robot.joint_names
        output = self.output or beside(self.path, "solved")
        is_streamed = output == STANDARD
        name, content = name_and_content(self.path)
        poses = read_poses(
            name,
            joints,
            radian=units.radian,
            metre=units.metre,
            scale=units.scale,
            position_only=True,
            farthest=FARTHEST * solver.robot.length,
            project=self.project,
            content=content,
        )
        if poses.layout.form == "position":
            solver = positions
        if self.q0 is not None and poses.layout.start:
            raise OptionError(f"--q0 and the columns q0_... of {name} both give a start; leave one out")
        if is_streamed:
            check_names(False, poses.table, joints)
        else:
            check_output(output, poses.table, joints)
        begin = time.monotonic()
        with progress_bar("solving") as progress:
            answers = columns(self._solved(solver, poses, progress))
        seconds = time.monotonic() - begin
        answers["q"] = units.write(answers["q"])
        if is_streamed:
            with reader_may_leave():
                stream_answers(sys.stdout.buffer, ".csv", poses.table, answers, joints)
        else:
            write_answers(output, poses.table, answers, joints)
        hints = unit_hints(solver.robot, poses, answers["success"], self.q0)
        summary = _summary(solver, poses, answers, seconds, hints) | {"output": str(output)}
        with reader_may_leave():
            print_json(summary, stderr=is_streamed) if json else _show(summary, units, console(stderr=is_streamed))
        for name in left_out(output, poses.table):
            console(stderr=True).print(
                f"left out of {output}: {name!r}, which has no entry for each pose", soft_wrap=True
            )
        if not poses.valid.all():
            return VERDICTS["INVALID_TARGET"]
        return VERDICTS["CONVERGED" if answers["success"].all() else "NEAREST"]

    def _solved(self, solver: Solver, poses: Poses, progress: Callable[[int, int], None]) -> Iterator[BatchSolution]:
        for rows in blocks(len(poses)):
            q0 = poses.starts(rows) if self.q0 is None else self.q0

            def show(done: int, _: int, before: int = rows.start) -> None:
                progress(before + done, len(poses))

            try:
                yield solver.solve_batch(poses.targets(rows), q0, self.seed, threads=self.threads, progress=show)
            except PoseError as reason:
                raise PoseError(_with_place(str(reason), poses, rows.start)) from None


def _with_place(message: str, poses: Poses, begin: int) -> str:
    """A message on target i of a block, with its place in the file."""
    return re.sub(r"target (\d+)", lambda match: f"pose of {poses.table.where(begin + int(match[1]))}", message)


def _summary(
    solver: Solver, poses: Poses, answers: dict[str, np.ndarray], seconds: float, hints: list[str]
) -> dict[str, Any]:
    solved, valid, count = answers["success"], poses.valid, len(poses)
    worst = {name: answers[name][valid].max() if valid.any() else None for name in ERRORS.values()}
    worst |= unknown_errors(solver.problem.left_free)
    unsettled = solved & ~answers["optimal"]
    return {
        "robot": solver.robot.name,
        "tip": solver.robot.tip,
        "backend": solver.backend,
        "poses": count,
        "solved": int(solved.sum()),
        **{status.name.lower(): int((answers["status"] == status.name).sum()) for status in list(Status)[1:]},
        "without_pose": int((~valid).sum()),
        "first_not_solved": None if solved.all() else poses.table.where(int(np.argmin(solved))),
        "positions_alone": len(poses) if poses.layout.form == "position" else 0,
        "targets_rounded": int((poses.deviation > 0).sum()),
        "worst_target_deviation": poses.deviation.max(initial=0.0),
        "starts_moved_onto_limits": int(answers["start_projected"][valid].sum()),
        "starts_left": int(answers["left_q0"].sum()),
        "redundancy_not_settled": 0 if solver.redundancy is None else int(unsettled.sum()),
        **{f"worst_{name}": error for name, error in worst.items()},
        "seconds": seconds,
        "poses_per_second": count / max(seconds, 1e-9),
        "hints": hints,
    }


def unit_hints(robot: Robot, poses: Poses, solved: np.ndarray, q0: np.ndarray | None) -> list[str]:
    """What looks like millimetres or degrees where metres and radians are asked for."""
    numbers, form = poses.table.numbers[poses.valid & ~solved], poses.layout.form
    hints = [millimetres_hint_of_many(numbers[:, [3, 7, 11] if form == "matrix" else [0, 1, 2]] / poses.metre, robot)]
    if poses.radian == 1.0:
        angles = poses.table.numbers[poses.valid, 3:6] if form == "rpy" else np.empty(0)
        starts = poses.starts(slice(None)) if q0 is None else q0[None]
        worst = np.empty((0, robot.n)) if starts is None else starts[np.abs(starts).max(axis=1).argsort()[-1:]]
        hints += [degrees_hint_of_angles(angles, "roll, pitch, yaw")]
        hints += [degrees_hint(start, robot, "a start") for start in worst]
    flags = {"degrees": "--deg", "millimetres": "--mm"}
    return [f"{hint} ({flag})" for hint in hints for word, flag in flags.items() if word in hint]


def _show(summary: dict[str, Any], units: Units, out: Console) -> None:
    """The summary as a table."""
    from rich.table import Table

    whole = summary["solved"] == summary["poses"]
    out.print(f"solved {summary['solved']} of {summary['poses']}", style="bold green" if whole else "bold yellow")
    table = Table(show_header=False)
    for name, meaning in REMARKS.items():
        if summary[name]:
            table.add_row(meaning, str(summary[name]))
    if summary["without_pose"] < summary["poses"]:
        for heading, error in units.errors(summary["worst_position_error"], summary["worst_orientation_error"]):
            table.add_row(f"worst {heading}", error)
    rate = summary["poses_per_second"]
    table.add_row("time", f"{summary['seconds']:.3g} s, {rate:{',.0f' if rate >= 10 else '.2g'}} poses a second")
    table.add_row("QPs solved by", summary["backend"])
    table.add_row("answers", summary["output"])
    out.print(table)
    for hint in summary["hints"]:
        out.print(f"hint: {hint}", style="bold yellow")
