"""How a job is run from the command line: flags, progress, what is said at the end."""

from __future__ import annotations

import re
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import tyro

from maira_qp.apps.arguments.optional import Maybe, explained
from maira_qp.errors import OptionError
from maira_qp.wording import figures

if TYPE_CHECKING:
    from maira_qp.scale.job import Job
    from maira_qp.scale.run import JobState


@explained
@dataclass(frozen=True, kw_only=True)
class RunChoice:
    """Who does a job, and which part of it. No result depends on any of these."""

    engine: Literal["processes", "here", "dask", "ray"] = "processes"
    """processes of this machine, or here: this process alone, or a cluster of dask or ray."""
    workers: Maybe[int] = None
    """Workers at a time; >= 1; none: one per processor, or as many as the cluster has."""
    address: str = ""
    """Of a scheduler of dask or ray that runs already, such as tcp://head:8786; none: a cluster of this machine."""
    shard: str = ""
    """I/N: the I-th of N parts, and no output: for arrays of tasks, such as SLURM's. Once all parts are done, the same
    command without --shard writes the output."""
    time_limit: Maybe[float] = None
    """Seconds after which a worker of processes that still does its shard is ended, and the shard done again; > 0;
    none: 600. For the engine processes alone."""

    def options(self) -> dict[str, Any]:
        """As `scale.run` takes them. Raises `OptionError`."""
        part = None
        if self.shard:
            match = re.fullmatch(r"(\d{1,9})/(\d{1,9})", self.shard)
            if match is None or not 1 <= int(match[1]) <= int(match[2]):
                raise OptionError(f"--shard takes I/N with 1 <= I <= N, such as 3/16, not {self.shard!r}")
            part = int(match[1]), int(match[2])
        return {
            "engine": self.engine,
            "workers": self.workers,
            "address": self.address,
            "part": part,
            "time_limit": self.time_limit,
        }


RunFlags = Annotated[RunChoice, tyro.conf.OmitArgPrefixes, tyro.conf.arg(name="run")]


def carry_out(job: Job, folder: Path, choice: RunChoice, label: str) -> tuple[JobState, dict[str, Any]]:
    """Run a job, or go on with it, with a progress bar: its state, and what to say of the run.

    Ctrl-C, and a disk that is full, say how to go on. Raises `JobError`, `OptionError`, `OSError`.
    """
    from maira_qp.apps.arguments.output import progress_bar
    from maira_qp.scale.manifest import MANIFEST
    from maira_qp.scale.run import run

    options, begin = choice.options(), time.monotonic()
    counted: list[int] = []

    try:
        with progress_bar(label) as show:

            def progress(done: int, total: int) -> None:
                counted.append(done)
                show(done, total)

            state = run(job, folder, progress=progress, **options)
    except (KeyboardInterrupt, OSError) as reason:
        if isinstance(reason, OSError) and reason.filename is None:
            reason.filename = str(folder)
        if (folder / MANIFEST).exists():
            sys.stderr.write(f"what was done is kept: maira-qp job resume {folder}\n")
        raise
    seconds, now = time.monotonic() - begin, counted[-1] - counted[0] if counted else 0
    said = {
        "folder": str(folder),
        state.unit: state.total,
        "done": state.done,
        "done_now": now,
        "finished": state.finished,
        "seconds": seconds,
        f"{state.unit}_per_second": now / max(seconds, 1e-9),
    }
    return state, said


def show(said: dict[str, Any], title: str) -> None:
    """What is said of a run or a job, as a table on stdout."""
    from rich.table import Table

    from maira_qp.apps.arguments.output import console

    out, table = console(), Table(show_header=False)
    for name, value in said.items():
        text = figures(value) if isinstance(value, float) else f"{value:,}" if type(value) is int else str(value)
        table.add_row(name.replace("_", " "), text)
    out.print(title, style="bold green" if said.get("finished", True) else "bold yellow")
    out.print(table)
