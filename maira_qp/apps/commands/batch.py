"""`maira-qp solve --batch`: many poses from a file, the answers into a file."""

from __future__ import annotations

import re
import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console

from maira_qp.apps.arguments.output import VERDICTS, Units, console, print_json, progress_bar
from maira_qp.apps.arguments.standard_streams import STANDARD, beside, name_and_stream
from maira_qp.apps.commands.answering import check_answers, write
from maira_qp.apps.left_pipes import reader_may_leave
from maira_qp.errors import OptionError, PoseError
from maira_qp.io.answers import Answered, AnswerWriter, columns, left_out, names_of
from maira_qp.io.poses import Poses, blocks, read_poses
from maira_qp.problem.targets import FARTHEST
from maira_qp.results.answer import ERRORS, unknown_errors
from maira_qp.results.status import Status
from maira_qp.robots.model.robot import Robot
from maira_qp.robots.unit_hints import degrees_hint, degrees_hint_of_angles, millimetres_hint_of_many
from maira_qp.solvers.solver import Solver
from maira_qp.wording import figures

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
        name, stream = name_and_stream(self.path)
        poses = read_poses(
            name,
            joints,
            radian=units.radian,
            metre=units.metre,
            scale=units.scale,
            position_only=True,
            farthest=FARTHEST * solver.robot.length,
            project=self.project,
            stream=stream,
        )
        if poses.layout.form == "position":
            solver = positions
        if self.q0 is not None and poses.layout.start:
            raise OptionError(f"--q0 and the columns q0_... of {name} both give a start; leave one out")
        check_answers(output, poses.table, names_of(joints))
        tally, begin = Tally(solver, poses, self.q0), time.monotonic()
        with progress_bar("solving") as progress:
            answered = self._answered(solver, poses, units, tally, progress)
            write(output, answered, lambda file, suffix: AnswerWriter(file, suffix, poses.table, joints), "poses")
        seconds = time.monotonic() - begin
        summary = tally.summary(seconds) | {"output": str(output)}
        is_streamed = output == STANDARD
        with reader_may_leave():
            print_json(summary, stderr=is_streamed) if json else _show(summary, units, console(stderr=is_streamed))
        for name in left_out(output, poses.table):
            console(stderr=True).print(
                f"left out of {output}: {name!r}, which has no entry for each pose", soft_wrap=True
            )
        if tally.without_pose:
            return VERDICTS["INVALID_TARGET"]
        return VERDICTS["CONVERGED" if tally.solved == tally.count else "NEAREST"]

    def _answered(
        self, solver: Solver, poses: Poses, units: Units, tally: Tally, progress: Callable[[int, int], None]
    ) -> Iterator[Answered]:
        """The answers to all poses, a block at a time."""
        for rows in blocks(len(poses)):
            valid = poses.valid(rows)
            T, deviations = poses.targets_and_deviations(rows, valid)
            q0 = poses.starts(rows, valid) if self.q0 is None else self.q0

            def show(done: int, _: int, before: int = rows.start) -> None:
                progress(before + done, len(poses))

            try:
                batch = solver.solve_batch(T, q0, self.seed, threads=self.threads, progress=show)
            except PoseError as reason:
                raise PoseError(_with_place(str(reason), poses, rows.start)) from None
            answers = columns(batch)
            tally.add(rows, valid, deviations, answers)
            answers["q"] = units.write(answers["q"])
            yield rows, answers


def _with_place(message: str, poses: Poses, begin: int) -> str:
    """A message on target i of a block, with its place in the file."""
    return re.sub(r"target (\d+)", lambda match: f"pose of {poses.table.where(begin + int(match[1]))}", message)


class Tally:
    """What a summary says of the answers, counted a block at a time."""

    def __init__(self, solver: Solver, poses: Poses, q0: np.ndarray | None) -> None:
        """Nothing is counted yet."""
        self._solver, self._poses, self._hints = solver, poses, Hints(solver.robot, poses, q0)
        self.count = self.solved = self.without_pose = 0
        self._first_not_solved: int | None = None
        self._sums: Counter[str] = Counter()
        self._worst: dict[str, float] = {}

    def add(self, rows: slice, valid: np.ndarray, deviations: np.ndarray, answers: Mapping[str, np.ndarray]) -> None:
        """Count the answers to some rows, of which those that are `valid` hold a pose."""
        solved = answers["success"]
        if self._first_not_solved is None and not solved.all():
            self._first_not_solved = rows.start + int(np.argmin(solved))
        self.count += len(solved)
        self.solved += int(solved.sum())
        self.without_pose += int((~valid).sum())
        self._sums.update(answers["status"].tolist())
        self._sums["rounded"] += int((deviations > 0).sum())
        self._sums["projected"] += int(answers["start_projected"][valid].sum())
        self._sums["left"] += int(answers["left_q0"].sum())
        self._sums["unsettled"] += int((solved & ~answers["optimal"]).sum())
        worst = {name: answers[name][valid] for name in ERRORS.values()}
        for name, values in (worst | {"deviation": deviations}).items():
            if len(values):
                self._worst[name] = max(self._worst.get(name, 0.0), float(values.max()))
        self._hints.add(rows, valid, solved)

    def summary(self, seconds: float) -> dict[str, Any]:
        """All of it, for JSON."""
        solver, first = self._solver, self._first_not_solved
        positions = self._poses.layout.form == "position"
        worst = {name: self._worst.get(name) for name in ERRORS.values()} | unknown_errors(solver.problem.left_free)
        return {
            "robot": solver.robot.name,
            "tip": solver.robot.tip,
            "backend": solver.backend,
            "poses": self.count,
            "solved": self.solved,
            **{status.name.lower(): self._sums[status.name] for status in list(Status)[1:]},
            "without_pose": self.without_pose,
            "first_not_solved": None if first is None else self._poses.table.where(first),
            "positions_alone": self.count if positions else 0,
            "targets_rounded": self._sums["rounded"],
            "worst_target_deviation": self._worst.get("deviation", 0.0),
            "starts_moved_onto_limits": self._sums["projected"],
            "starts_left": self._sums["left"],
            "redundancy_not_settled": 0 if solver.redundancy is None else self._sums["unsettled"],
            **{f"worst_{name}": error for name, error in worst.items()},
            "seconds": seconds,
            "poses_per_second": self.count / max(seconds, 1e-9),
            "hints": self._hints.said(),
        }


class Hints:
    """What looks like millimetres or degrees where metres and radians are asked for: of all rows the worst."""

    def __init__(self, robot: Robot, poses: Poses, q0: np.ndarray | None) -> None:
        """`q0` (n,) is the start of all, None: those of the poses."""
        self._robot, self._poses = robot, poses
        self._farthest, self._angles = np.empty((0, 3)), np.empty(0)
        self._start = np.empty((0, robot.n)) if q0 is None else q0[None]
        self._starts_of_rows = q0 is None

    def add(self, rows: slice, valid: np.ndarray, solved: np.ndarray) -> None:
        """Look at some rows, of which those that are `valid` hold a pose."""
        poses, numbers, form = self._poses, self._poses.table.numbers(rows), self._poses.layout.form
        position = numbers[valid & ~solved][:, [3, 7, 11] if form == "matrix" else [0, 1, 2]] / poses.metre
        self._farthest = _largest(np.concatenate([self._farthest, position[np.isfinite(position).all(axis=1)]]))
        if form == "rpy":
            self._angles = np.atleast_1d(np.abs(np.append(self._angles, numbers[valid, 3:6])).max(initial=0.0))
        starts = poses.starts(rows, valid) if self._starts_of_rows else None
        if starts is not None:
            self._start = _largest(np.concatenate([self._start, starts]))

    def said(self) -> list[str]:
        """The hints, each with the flag that it is about."""
        hints = [millimetres_hint_of_many(self._farthest, self._robot)] if self._poses.metre == 1.0 else []
        if self._poses.radian == 1.0:
            hints += [degrees_hint_of_angles(self._angles, "roll, pitch, yaw")]
            hints += [degrees_hint(start, self._robot, "a start") for start in self._start]
        flags = {"degrees": "--deg", "millimetres": "--mm"}
        return [f"{hint} ({flag})" for hint in hints for word, flag in flags.items() if word in hint]


def _largest(rows: np.ndarray) -> np.ndarray:
    """Of rows (N, k) the one (1, k) that is farthest out; none of none."""
    if not len(rows):
        return rows
    k = int(np.linalg.norm(rows, axis=1).argmax())
    return rows[k : k + 1]


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
    table.add_row("time", f"{figures(summary['seconds'])} s, {rate:{',.0f' if rate >= 10 else '.2g'}} poses per second")
    table.add_row("QPs solved by", summary["backend"])
    table.add_row("answers", summary["output"])
    out.print(table)
    for hint in summary["hints"]:
        out.print(f"hint: {hint}", style="bold yellow")
