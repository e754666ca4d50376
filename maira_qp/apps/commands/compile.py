"""`maira-qp compile`: all machine code ahead of its first use."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal

import tyro

from maira_qp.apps.arguments.optional import Maybe, explained


@explained
@dataclass(frozen=True, kw_only=True)
class Compile:
    """Compile everything ahead, so that no first call has to.

    Runs in parallel processes; what is compiled already is left as it is."""

    verbs: Annotated[
        tuple[Literal["solve", "solve_batch", "solutions", "step", "track"], ...],
        tyro.conf.arg(metavar="VERB ...", help_behavior_hint=""),
    ] = (
        "solve",
        "solve_batch",
        "solutions",
        "step",
        "track",
    )
    """What will be called, of solve, solve_batch, solutions, step and track; none: all."""
    processes: Maybe[int] = None
    """Processes at a time; none: one for each processor."""

    def run(self) -> int:
        """Compiles, with a progress bar on a terminal; always 0."""
        from maira_qp.apps.arguments.output import console, progress_bar
        from maira_qp.kernels.jit import code_cache
        from maira_qp.solvers import ahead

        with progress_bar("compiling") as progress:
            ahead.compile(verbs=self.verbs, processes=self.processes, progress=progress)
        files = [file for file in code_cache.kept() if file.parent.name == code_cache.KEY]
        size = sum(file.stat().st_size for file in files) / 1e6
        folders = ", ".join(sorted({str(file.parent) for file in files}))
        console().print(f"{len(files)} files, {size:.1f} MB, in {folders}", soft_wrap=True)
        return 0
