"""`maira-qp bench`: success rate, time and exactness of methods on strata of targets."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import tyro

from maira_qp.apps.arguments.flags import RobotFlags, SolverFlags
from maira_qp.apps.arguments.optional import Flag, explained
from maira_qp.apps.arguments.robot_choice import RobotChoice
from maira_qp.evaluation.settings import Settings
from maira_qp.problem.options import Options

PICTURE = "success.png"


@explained
@dataclass(frozen=True, kw_only=True)
class Bench:
    """Benchmark methods and QP backends, with an independent judge.

    Each answer is judged by a forward kinematics that shares no code with the solver. A run that was stopped goes on
    where it stood when it is started again with the same flags.

    Example:

        maira-qp bench --robot iiwa14 --targets 100 --backends daqp osqp"""

    choice: RobotFlags = field(default_factory=RobotChoice)
    settings: Annotated[Settings, tyro.conf.OmitArgPrefixes, tyro.conf.arg(name="benchmark")] = field(
        default_factory=Settings
    )
    options: SolverFlags = field(default_factory=Options)
    output: Path = Path("output/bench")
    """Folder for rows.jsonl (one row per answer), rows.csv, summary.csv and success.png."""
    json: Flag = False
    """One JSON value on stdout in place of the tables."""

    def run(self) -> int:
        """Runs, or goes on with, the benchmark and reports; 0."""
        from maira_qp.apps.arguments.output import NO_PICTURE, console, picture_is_possible, print_json, progress_bar
        from maira_qp.evaluation.records import write_csv
        from maira_qp.evaluation.report import flat, legend, tables
        from maira_qp.evaluation.runner import plan, run
        from maira_qp.evaluation.statistics import summarise

        has_picture = picture_is_possible(self.output / PICTURE)
        made = plan(self.choice.load_with_one_tip(), self.settings, self.options)
        with progress_bar("solving") as progress:
            rows = run(made, self.output / "rows.jsonl", lambda done: progress(done, made.rows))
        summaries = summarise(rows)
        write_csv(self.output / "rows.csv", rows)
        write_csv(self.output / "summary.csv", [flat(summary) for summary in summaries])
        if has_picture:
            from maira_qp.apps import plots

            plots.success_picture(summaries, self.output / PICTURE)
        if self.json:
            print_json(
                {
                    "robot": made.robot.name,
                    "summaries": [flat(summary) for summary in summaries],
                    "notes": made.notes,
                    "output": str(self.output),
                }
            )
        else:
            out = console()
            for table in tables(summaries, out.width):
                out.print(table)
            out.print(legend(self.settings, self.options))
            out.print("false claims: said to be solved, but off the pose or outside the limits")
            for note in made.notes:
                out.print(note)
            made_what = "rows, summary and picture" if has_picture else "rows and summary"
            out.print(f"{made_what}: {self.output}", soft_wrap=True)
            if not has_picture:
                out.print(NO_PICTURE)
        return 0
