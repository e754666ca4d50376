"""`maira-qp compare`: the two redundancy methods and the plain reference, side by side."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from maira_qp.apps.arguments.flags import RobotFlags, SolverFlags
from maira_qp.apps.arguments.optional import Flag, Maybe, explained
from maira_qp.apps.arguments.robot_choice import RobotChoice
from maira_qp.problem.options import Options

if TYPE_CHECKING:
    from maira_qp.evaluation.comparison import Comparison


@explained
@dataclass(frozen=True, kw_only=True)
class Compare:
    """Compare weighted, fading and strict redundancy on random poses.

    Random reachable poses are solved with a weighted posture, a strict hierarchy and the plain DH-clamped reference.

    Example:

        maira-qp compare --robot panda --targets 100"""

    choice: RobotFlags = field(default_factory=RobotChoice)
    targets: int = 200
    """How many poses; > 0."""
    seed: int = 0
    """Seed of the poses and starts; >= 0."""
    weights: tuple[float, ...] = (1e-3, 1e-6)
    """What the posture counts against the pose, one row of the table for each; > 0."""
    backend: Maybe[str] = None
    """Who solves the QPs: compiled, daqp, ... (an unknown name lists what is installed); none: the solver's choice."""
    picture: Path = Path("output/comparison.png")
    """File of the picture."""
    options: SolverFlags = field(default_factory=Options)
    json: Flag = False
    """One JSON value on stdout in place of the table."""

    def run(self) -> int:
        """Prints the table and saves the picture, if matplotlib is there; 0."""
        from maira_qp.apps.arguments.output import NO_PICTURE, console, picture_is_possible, print_json, progress_bar
        from maira_qp.evaluation.comparison import compare, table
        from maira_qp.evaluation.report import flat

        has_picture = picture_is_possible(self.picture)
        robot = self.choice.load_with_one_tip()
        with progress_bar("solving") as progress:
            comparison = compare(
                robot,
                targets=self.targets,
                seed=self.seed,
                weights=self.weights,
                backend=self.backend,
                options=self.options,
                progress=progress,
            )
        if self.json:
            rows = [flat(summary) for summary in comparison.summaries]
            drawn = str(self.picture) if has_picture else None
            print_json({"robot": robot.name, "methods": rows, "notes": comparison.plan.notes, "picture": drawn})
        else:
            out = console()
            out.print(table(comparison))
            for note in comparison.plan.notes:
                out.print(note)
            out.print(f"picture: {self.picture}" if has_picture else NO_PICTURE, soft_wrap=True)
        if has_picture:
            picture(comparison, self.picture)
        return 0


def picture(comparison: Comparison, path: str | Path) -> None:
    """The comparison as a picture: success rates with their intervals, and pose error against posture cost."""
    from maira_qp.apps import plots

    made = plots.figure(1, 2, size=(13.0, 4.2))
    rates, trade = made.axes
    summaries, settings, options = comparison.summaries, comparison.plan.settings, comparison.plan.options
    plots.success_bars(
        rates,
        {
            f"within {options.position_tolerance:g} m,\n{options.orientation_tolerance:g} rad": {
                s.method: (s.strict, s.count) for s in summaries
            },
            f"within {settings.loose_position:g} m,\n{settings.loose_orientation:g} rad": {
                s.method: (s.loose, s.count) for s in summaries
            },
        },
    )
    rates.set_title(f"{comparison.plan.robot.name}: {settings.targets} random reachable poses")
    points = {}
    for summary in summaries:
        rows = [row for row in comparison.rows if row["method"] == summary.method]
        points[summary.method] = [row["position_error"] for row in rows], [row["posture_cost"] for row in rows]
    plots.error_against_cost(trade, points, tolerance=options.position_tolerance)
    trade.set_title("what each answer gives up: pose or posture")
    rates.legend().remove()  # the same colours and names as on the right
    plots.save(made, path)
