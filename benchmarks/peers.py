"""maira_qp against other solvers, in one run: `python benchmarks/peers.py --robots maira panda --targets 2000`.

Inverse kinematics from random starts to 1e-6 m and 1e-6 rad, nearby targets, control ticks, and targets out of reach,
one thread. `pip install 'maira-qp[bench]'` brings the peers; those that are missing are left out, with a remark. Tables
and picture are written beside this script.
"""

import os

os.environ.update(dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1"))  # before NumPy

from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import tyro
from peers import arms, clock, line_up, ours, picture, report, results
from rich.console import Console
from rich.progress import Progress

from maira_qp.evaluation.targets import FAR_AWAY, NEARBY
from maira_qp.io.atomic_write import replace_text

HERE = Path(__file__).parent
WARM_UP, FAR_WARM_UP, GIVE_UP, TICKS, TICK = 20, 2, 20, 500, 0.01
"""Targets for the warm-up, more of them out of reach, those out of reach; at most so many ticks; a tick [s]."""


@dataclass(frozen=True, kw_only=True)
class Settings:
    """What to race."""

    robots: tuple[arms.Name, ...] = arms.ARMS
    """On which arms."""
    targets: int = 2000
    """Targets an arm, the same for all solvers."""
    rounds: int = 3
    """Rounds over them; the fastest of each solver counts."""
    seed: int = 0
    """Seed of targets and starts."""


def main(settings: Settings) -> None:
    """Race on every arm, print the tables as they come, and write them and the picture at the end."""
    console = Console(record=True, width=report.WIDTH, markup=False, highlight=False)
    outcomes = []
    progress = Progress(console=Console(stderr=True), transient=True, auto_refresh=False)  # no thread beside the race
    with TemporaryDirectory() as folder, progress as bar:
        for name in settings.robots:
            outcomes.append(compete(arms.load(name, Path(folder)), settings, bar))
            for remark in outcomes[-1].remarks:
                console.print(f"{name}: {remark}")
            for table in report.tables(outcomes[-1]):
                console.print(table)
    console.print(report.conditions(settings.targets, settings.rounds))
    replace_text(HERE / "peers.txt", console.export_text())
    picture.draw(outcomes, HERE / "peers.png")


def compete(arm: arms.Arm, settings: Settings, bar: Progress) -> results.Outcome:
    """All races on one arm."""
    single, remarks = line_up.line_up(arm)
    everybody = [*single, *ours.batches(arm)]
    for stratum, count in (("uniform", WARM_UP), (FAR_AWAY, FAR_WARM_UP)):
        warm = arm.ask(stratum, count, settings.seed + 1)
        clock.warm_up(everybody, warm.targets, warm.starts)

    def race(title: str, who: list, asked: arms.Questions, rounds: int, given_starts: bool) -> list[results.Row]:
        task = bar.add_task(f"{arm.name}, {title}", total=clock.turns(who, len(asked.targets), rounds))

        def advance() -> None:
            bar.update(task, advance=1, refresh=True)

        runs = clock.race(who, asked.targets, asked.starts, given_starts=given_starts, rounds=rounds, advance=advance)
        bar.remove_task(task)
        return results.judged(who, runs, asked, arm.judge)

    far, near, beyond = (
        arm.ask(stratum, count, settings.seed)
        for stratum, count in (("uniform", settings.targets), (NEARBY, settings.targets), (FAR_AWAY, GIVE_UP))
    )
    return results.Outcome(
        arm.name,
        remarks,
        race("random targets", everybody, far, settings.rounds, given_starts=False),
        race("nearby targets", single, near, settings.rounds, given_starts=True),
        race("out of reach", single, beyond, 1, given_starts=False),
        ticks([each for each in single if each.step is not None], near, settings.rounds, arm),
    )


def ticks(who: list, asked: arms.Questions, rounds: int, arm: arms.Arm) -> list[results.Tick]:
    """Control ticks toward nearby targets."""
    targets, q = asked.targets[:TICKS], asked.starts[:TICKS]
    timed = clock.ticks(who, targets, q, TICK, rounds)
    return [results.ticked(each, mean, v, q, TICK, arm.judge) for each, (mean, v) in zip(who, timed, strict=True)]


if __name__ == "__main__":
    main(tyro.cli(Settings, description=__doc__))
