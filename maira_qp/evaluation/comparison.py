"""The ways to use the redundancy against the plain reference: the same random reachable poses and starts, one table.

Weighted trades the pose for the posture: at its optimum the pose is off by about the weight. A weight that fades with
the pose error leaves the pose exact, and the posture near its optimum. Strict gives up nothing of the pose and finds
the best posture that is left. The reference (clamped, damped least squares with a pull to mid-range) has no
notion of the limits other than to clip. Each answer is judged by a forward kinematics that no method uses.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

from rich.table import Table

from maira_qp.evaluation.methods import qp_method
from maira_qp.evaluation.report import legend, percent, short, table_of
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
    """Solve random reachable poses with the reference, Weighted at each of the weights, a fading one, and Strict.

    The one that fades has the first of the weights.

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
    weighted += [qp_method(robot, "fading", backend, w, options, label=f"fading {w:g}") for w in weights[:1]]
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
    made = table_of(
        f"{robot.name}: {settings.targets} random reachable poses, from the same random starts",
        [""],
        [s.method.replace(" ", "\n") for s in comparison.summaries],
        caption=(
            f"{legend(settings, options)}\nposture cost: 1/2 |q - middle|^2, of the loosely solved"
            "\ncondition number: of the Jacobian, median"
            f"\n{GIVEN_UP}"
        ),
        caption_justify="left",
    )
    for heading, cell in ROWS.items():
        made.add_row(heading, *map(cell, comparison.summaries))
    return made


GIVEN_UP = (
    "given up: weighted: the pose, by about the weight; fading: a little posture;"
    "\nstrict: nothing of the pose; dh-clamped: poses where a limit is in the way"
)

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
