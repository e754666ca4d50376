"""maira_qp, Pink and Mink in five scenes of control ticks: `python benchmarks/scenes.py`.

An arm that reaches, two arms, a circle, self-collision, and a hand that looks at a point; each is written with the
library's own calls (benchmarks/scenes/ours.py, with_pink.py, with_mink.py), from the same URDF, start and targets.
`pip install 'maira-qp[bench]'` brings the peers; those that are missing are left out, with a remark. The tables are
written beside this script, and into docs/against_pink_and_mink.md.
"""

import os

os.environ.update(dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1"))  # before NumPy

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import tyro
from rich.console import Console
from scenes import judging, line_up, problems, race, report

from maira_qp.io.atomic_write import replace_text

HERE = Path(__file__).parent
PAGE = HERE.parent / "docs" / "against_pink_and_mink.md"


@dataclass(frozen=True, kw_only=True)
class Settings:
    """What to run."""

    scenes: tuple[Literal["reach", "dual", "circle", "collision", "look"], ...] = tuple(problems.SCENES)
    """Which scenes; only a run of all of them is written down."""
    rounds: int = 3
    """Rounds over each; the fastest time of each tick counts."""


def main(settings: Settings) -> None:
    """Run every scene, print the tables as they come, and write them at the end."""
    console = Console(record=True, width=report.WIDTH, markup=False, highlight=False)
    outcomes, told = [], set()
    for name in settings.scenes:
        scene = problems.SCENES[name]()
        taking_part, remarks = line_up.line_up(scene)
        for remark in remarks:
            if remark not in told:
                console.print(remark)
                told.add(remark)
        runs = race.race(scene, taking_part, settings.rounds)
        verdicts = [judging.verdict(scene, run.q) for run in runs]
        console.print(report.table(scene, taking_part, runs, verdicts))
        if scene.srdf is not None:
            console.print(report.distances(scene, taking_part, verdicts))
        outcomes.append((scene, taking_part, runs, verdicts))
    console.print(report.ratios(outcomes))
    console.print(report.conditions(settings.rounds))
    if set(settings.scenes) == set(problems.SCENES):
        replace_text(HERE / "scenes.txt", "".join(f"{line.rstrip()}\n" for line in console.export_text().splitlines()))
        replace_text(PAGE, report.between(PAGE.read_text(), "scenes", report.markdown(outcomes)))


if __name__ == "__main__":
    main(tyro.cli(Settings, description=__doc__))
