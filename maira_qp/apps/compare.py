"""The two redundancy methods against the plain reference: the same random reachable poses, the same starts, one table.

Weighted trades the pose for the posture: at its optimum the pose is off by about the weight. Strict gives up nothing of
the pose and takes what posture is left. The reference (clamped, damped least squares with a pull to mid-range) has no
notion of the limits other than to clip. Each answer is judged by a forward kinematics that no method uses.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from rich.table import Table

from maira_qp.apps.commands.bench_report import legend, percent, short
from maira_qp.evaluation.methods import qp_method
from maira_qp.evaluation.runner import Plan, measure, plan
from maira_qp.evaluation.settings import Settings
from maira_qp.evaluation.statistics import Summary, summarise
from maira_qp.problem.objectives import Posture
from maira_qp.problem.options import Options
from maira_qp.problem.redundancy import Strict
from maira_qp.robots.model.robot import Robot
from maira_qp.solvers.solver import Solver


@dataclass(frozen=True)
class Comparison:
    """What came out: a row for each method and target, a summary for each method."""

    plan: Plan
    rows: list[dict[str, Any]]
    summaries: list[Summary]


def compare(
    robot: Robot,
    *,
    targets: int = 200,
    seed: int = 0,
    weights: Sequence[float] = (1e-3, 1e-6),
    backend: str | None = None,
    options: Options | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> Comparison:
    """Solve random reachable poses with the reference, with Weighted at each of the weights, and with Strict.

    `backend` None is the solver's own choice. `progress` is told the rows done and the rows in all.
    Raises `OptionError`, `BackendError`.
    """
    options = options or Options()
    backend = backend or Solver(robot, redundancy=Strict(Posture()), options=options).backend
    settings = Settings(
        methods=("dh-clamped", "strict"), backends=(backend,), strata=("uniform",), targets=targets, seed=seed
    )
    made = plan(robot, settings, options)
    weighted = [qp_method(robot, "weighted", backend, w, options, label=f"weighted {w:g}") for w in weights]
    made = replace(made, methods=[*made.methods[:-1], *weighted, made.methods[-1]])
    rows = []
    for row in measure(made):
        rows.append(row)
        if progress is not None:
            progress(len(rows), made.rows)
    return Comparison(made, rows, summarise(rows))


def table(comparison: Comparison) -> Table:
    """The comparison as a table that a person can read."""
    settings, options, robot = comparison.plan.settings, comparison.plan.options, comparison.plan.robot
    made = Table(
        title=f"{robot.name}: {settings.targets} random reachable poses, from the same random starts",
        title_justify="left",
        title_style="bold",
        caption=(
            f"{legend(settings, options)}\nposture cost: 1/2 |q - middle|^2, of the loosely solved"
            "\ncondition number: of the Jacobian, median"
        ),
        caption_justify="left",
    )
    summaries = comparison.summaries
    made.add_column("")
    for s in summaries:
        made.add_column(s.method, justify="right")
    for heading, cell in ROWS.items():
        made.add_row(heading, *map(cell, summaries))
    return made


ROWS: dict[str, Callable[[Summary], str]] = {
    "solved": lambda s: percent(s.rate),
    "loosely": lambda s: percent(s.loose / s.count),
    "error, median [m]": lambda s: short(s.position_error[0]),
    "error, max [m]": lambda s: short(s.position_error[1]),
    "error, median [rad]": lambda s: short(s.orientation_error[0]),
    "error, max [rad]": lambda s: short(s.orientation_error[1]),
    "posture cost, mean": lambda s: "-" if s.posture_cost is None else f"{s.posture_cost:.2f}",
    "out of limits": lambda s: str(s.violations),
    "iterations, mean": lambda s: f"{s.iterations[1]:.1f}",
    "condition number": lambda s: f"{s.condition_number:.1f}",
    "time, median [ms]": lambda s: f"{1e3 * s.time[0]:.2f}",
}
"""The figures of the table, a row each."""


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
