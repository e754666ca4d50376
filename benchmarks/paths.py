"""maira_qp against other ways to follow a path, in one run: `python benchmarks/paths.py --robots maira --paths 20`.

Paths that can be followed, since a random joint motion was made first and then forgotten: `Solver.track` beside
`solve` and `step` from pose to pose, Pink, Mink, ssik and roboplan. With `--folder` the paths are CSV files, a pose a
line, as `maira_qp.paths.from_csv` reads them, in the base of the robot. `pip install 'maira-qp[bench]'` brings the
peers; those that are missing are left out, with a remark. The tables are written beside this script.
"""

import os

os.environ.update(dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1"))  # before NumPy

from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory

import tyro
from paths import judging, line_up, motions, race, report, results
from peers import arms
from rich.console import Console
from rich.progress import Progress

from maira_qp.evaluation.contestant import Contestant
from maira_qp.io.atomic_write import replace_text

HERE = Path(__file__).parent
LONG: tuple[arms.Name, ...] = ("maira", "panda")
"""Who follows long paths."""


@dataclass(frozen=True, kw_only=True)
class Settings:
    """What to follow."""

    robots: tuple[arms.Name, ...] = tuple(arms.SOURCES)
    """With which arms."""
    paths: int = 20
    """Paths an arm, the same for all methods."""
    poses: int = motions.POSES
    """Poses a path."""
    seed: int = 0
    """Seed of the paths."""
    lengths: tuple[int, ...] = (10_000,)
    """Poses of long paths, of MAIRA and Panda, which only `track` follows."""
    folder: Path | None = None
    """Follow the CSV files in it instead of made paths."""
    criterion: judging.Criterion = field(default_factory=judging.Criterion)
    """What counts as followed whole."""


def main(settings: Settings) -> None:
    """Race with every arm, print the tables as they come, and write them at the end."""
    console = Console(record=True, width=report.WIDTH, markup=False, highlight=False)
    progress = Progress(console=Console(stderr=True), transient=True, auto_refresh=False)  # no thread beside the race
    files = [] if settings.folder is None else motions.read(settings.folder)
    lengths: list[report.Length] = []
    with TemporaryDirectory() as folder, progress as bar:
        for name in settings.robots:
            arm = arms.load(name, Path(folder))
            contestants, remarks = line_up.line_up(arm, settings.criterion)
            for remark in remarks:
                console.print(f"{name}: {remark}")
            everybody = Race(arm, contestants, settings.criterion, bar)
            everybody.free_and_true(motions.made(arm, 1, settings.poses, settings.seed + 1))  # warms up
            if settings.folder is not None:
                console.print(report.of_files(name, settings.folder.name, files, everybody.run(files)))
                continue
            made = motions.made(arm, settings.paths, settings.poses, settings.seed)
            free, true = everybody.free_and_true(made)
            for line in report.errors(*free, *true):
                console.print(f"{name}: {line}")
            console.print(report.of_motions(name, made, free, true))
            if name in LONG:
                track = Race(arm, contestants[:1], settings.criterion, bar)
                lengths += [track.length(poses, settings.seed) for poses in settings.lengths]
    if lengths:
        console.print(report.of_lengths(lengths))
    console.print(report.conditions(settings.criterion))
    written = "paths.txt" if settings.folder is None else f"paths_{settings.folder.name}.txt"
    replace_text(HERE / written, console.export_text())


@dataclass(frozen=True)
class Race:
    """Contestants with one arm."""

    arm: arms.Arm
    contestants: list[Contestant]
    criterion: judging.Criterion
    bar: Progress

    def run(self, paths: list[motions.Path], *, starts_given: bool = False) -> list[results.Row]:
        """Everybody along every path, as the judge sees it."""
        title = f"{self.arm.name}, {'true' if starts_given else 'free'} starts"
        task = self.bar.add_task(title, total=len(paths) * len(self.contestants))

        def advance() -> None:
            self.bar.update(task, advance=1, refresh=True)

        runs = race.race(paths, self.contestants, starts_given=starts_given, advance=advance)
        self.bar.remove_task(task)
        return results.judged(self.contestants, runs, paths, self.arm.judge, self.criterion)

    def free_and_true(self, paths: list[motions.Path]) -> tuple[list[results.Row], list[results.Row]]:
        """From free starts, and from the true ones."""
        return self.run(paths), self.run(paths, starts_given=True)

    def length(self, poses: int, seed: int) -> report.Length:
        """The first contestant along one motion of so many poses."""
        row = self.run(motions.made(self.arm, 1, poses, seed))[0]
        return report.Length(self.arm.name, poses, row.verdicts[0].whole, row.seconds[0])


if __name__ == "__main__":
    main(tyro.cli(Settings, description=__doc__))
