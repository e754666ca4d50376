"""`maira-qp job`: what became of a job in a folder; going on with it; whether its files are what was written."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import tyro

from maira_qp.apps.arguments.optional import Flag, command, explained
from maira_qp.apps.commands.jobs.running import RunChoice, RunFlags
from maira_qp.apps.left_pipes import reader_may_leave

INCOMPLETE = DAMAGED = 1
Folder = Annotated[Path, tyro.conf.Positional]


@explained
@dataclass(frozen=True, kw_only=True)
class JobStatus:
    """Say how much of a job is done, and who works on it.

    Exit code 0: it is finished; 1: not yet."""

    folder: Folder
    """Folder of the job."""
    json: Flag = False
    """One JSON value on stdout."""

    def run(self) -> int:
        """Prints the state; the exit code as the class says."""
        from maira_qp.apps.arguments.output import print_json
        from maira_qp.apps.commands.jobs.running import show
        from maira_qp.scale.run import state_of

        state = state_of(self.folder)
        with reader_may_leave():
            if self.json:
                print_json(state.as_dict())
            else:
                owner = (
                    "nobody" if state.owner is None else "process {pid} of the machine {host!r}".format(**state.owner)
                )
                share = f"{100 * state.done / max(state.total, 1):.4g} %"
                said = {"job": state.kind, state.unit: state.total, "done": f"{state.done:,} ({share})"}
                show(said | {"finished": state.finished, "in use by": owner or "nobody"}, str(self.folder))
        return 0 if state.finished else INCOMPLETE


@explained
@dataclass(frozen=True, kw_only=True)
class JobResume:
    """Go on with the job of a folder until it is finished.

    A finished output that is damaged is made again."""

    folder: Folder
    """Folder of the job."""
    how: RunFlags = field(default_factory=RunChoice)
    json: Flag = False
    """One JSON value on stdout."""

    def run(self) -> int:
        """Runs what is left; 0."""
        from maira_qp.apps.arguments.output import print_json
        from maira_qp.apps.commands.jobs.running import carry_out, show
        from maira_qp.scale.run import renewed

        state, said = carry_out(renewed(self.folder), self.folder, self.how, "going on")
        with reader_may_leave():
            print_json(said) if self.json else show(said, f"{state.done} of {state.total} {state.unit} done")
        return 0


@explained
@dataclass(frozen=True, kw_only=True)
class JobVerify:
    """Read all files of a job and compare their checksums.

    Exit code 0: all are what was written; 1: some are not."""

    folder: Folder
    """Folder of the job."""
    json: Flag = False
    """One JSON value on stdout."""

    def run(self) -> int:
        """Prints what is damaged; the exit code as the class says."""
        from maira_qp.apps.arguments.output import console, print_json
        from maira_qp.scale.run import verify

        found = verify(self.folder)
        with reader_may_leave():
            if self.json:
                print_json({"folder": str(found.folder), "checked": found.checked, "damaged": list(found.damaged)})
            else:
                out = console()
                out.print(f"{found.checked} files checked, {len(found.damaged)} damaged or missing", soft_wrap=True)
                for name in found.damaged:
                    out.print(f"damaged: {name}", soft_wrap=True)
                if found.damaged:
                    out.print(f"to make them again: maira-qp job resume {self.folder}", soft_wrap=True)
        return 0 if found else DAMAGED


JobActions = command(JobStatus, "status") | command(JobResume, "resume") | command(JobVerify, "verify")


@explained
@dataclass(frozen=True, kw_only=True)
class Job:
    """Look at a job of reach or dataset, go on with it, check its files.

    Example:

        maira-qp job status map.zarr"""

    action: tyro.conf.OmitSubcommandPrefixes[tyro.conf.OmitArgPrefixes[JobActions]]  # type: ignore[valid-type]
    """What to do with it."""

    def run(self) -> int:
        """Does what was asked for."""
        return self.action.run()
