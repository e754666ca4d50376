"""`maira-qp compare`: the two redundancy methods and the plain reference, side by side."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import tyro

from maira_qp.apps.arguments.flags import RobotFlags, SolverFlags
from maira_qp.apps.arguments.robot_choice import RobotChoice
from maira_qp.problem.options import Options


@dataclass(frozen=True, kw_only=True)
class Compare:
    """Solve random reachable poses with a weighted posture, a strict hierarchy and the plain DH-clamped reference."""

    choice: RobotFlags = field(default_factory=RobotChoice)
    targets: int = 200
    """How many poses; > 0."""
    seed: int = 0
    """Seed of the poses and starts; >= 0."""
    weights: tuple[float, ...] = (1e-3, 1e-6)
    """What the posture counts against the pose, a row of the table each; > 0."""
    backend: str | None = None
    """Who solves the QPs: compiled, daqp, ... (an unknown name lists what is installed); None: the solver's choice."""
    picture: Path = Path("output/comparison.png")
    """File of the picture."""
    options: SolverFlags = field(default_factory=Options)
    json: tyro.conf.FlagCreatePairsOff[bool] = False
    """One JSON value on stdout in place of the table."""

    def run(self) -> int:
        """Prints the table and saves the picture, if matplotlib is there; 0."""
        from maira_qp.apps.arguments.output import NO_PICTURE, console, picture_is_possible, print_json, progress_bar
        from maira_qp.apps.commands.bench_report import flat
        from maira_qp.apps.compare import compare, picture, table

        has_picture = picture_is_possible(self.picture)
        robot = self.choice.load()
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
