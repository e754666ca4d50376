"""`maira-qp reach`: a map of what an arm reaches."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from maira_qp.apps.arguments.flags import RobotFlags, SolverFlags, checked_seed
from maira_qp.apps.arguments.optional import Flag, Maybe, explained
from maira_qp.apps.arguments.robot_choice import RobotChoice
from maira_qp.apps.commands.jobs.running import RunChoice, RunFlags
from maira_qp.apps.left_pipes import reader_may_leave
from maira_qp.problem.options import Options

if TYPE_CHECKING:
    from maira_qp.scale.reach.job import ReachJob


@explained
@dataclass(frozen=True, kw_only=True)
class Reach:
    """Map what an arm reaches, cell by cell, into a Zarr folder.

    For each cell of a grid of positions: the share of orientations that are reached, proved to be out of reach, or
    neither; the directions that are open; the best manipulability and distance from the joint limits of the
    configurations found. The folder is opened by maira_qp.scale.ReachMap, and by xarray. Whatever interrupts a run, the
    same command goes on with it, as does maira-qp job resume FOLDER. Exit code 0: the map is finished, or the part that
    --shard names is done.

    Example:

        maira-qp reach --robot ur5 --cell 0.1 --directions 50 --output map.zarr"""

    choice: RobotFlags = field(default_factory=RobotChoice)
    output: Path
    """Folder of the map; new, or that of the same map, begun before."""
    cell: float = 0.05
    """Edge of the cells [m]; > 0."""
    directions: int = 200
    """Directions of the tool's z axis, uniform over the sphere; >= 1."""
    rolls: int = 1
    """Rolls about each direction, uniform over a turn; >= 1."""
    box: Maybe[tuple[float, float, float, float, float, float]] = None
    """What the grid is to cover, X0 X1 Y0 Y1 Z0 Z1 [m]; none: all that can be reached."""
    proof_boxes: int = 0
    """For arms that are no S-R-S arms: boxes of joint values that the proof that a pose is out of reach may take; >= 0;
    0: no such proofs, so that what is not reached is undecided; a solve takes 2000, which there takes nearly all of the
    time."""
    seed: int = 0
    """Seed of the random starts; >= 0."""
    options: SolverFlags = field(default_factory=lambda: Options(max_restarts=15))
    how: RunFlags = field(default_factory=RunChoice)
    json: Flag = False
    """One JSON value on stdout: the summary."""

    def run(self) -> int:
        """Runs the job and prints a summary; 0."""
        from maira_qp.apps.arguments.output import print_json
        from maira_qp.apps.commands.jobs.running import carry_out, show
        from maira_qp.scale.reach.job import ReachJob
        from maira_qp.scale.reach.store import check_zarr

        check_zarr()
        self.how.options()
        box = None if self.box is None else [self.box[i : i + 2] for i in (0, 2, 4)]
        job = ReachJob.of(
            self.choice.load_with_one_tip(),
            cell=self.cell,
            directions=self.directions,
            rolls=self.rolls,
            box=box,
            options=self.options,
            proof_boxes=self.proof_boxes,
            seed=checked_seed(self.seed),
        )
        state, said = carry_out(job, self.output, self.how, "mapping")
        said |= {"cells": job.count, "orientations": job.units_per_item}
        if state.finished:
            said |= shares(self.output, job)
        with reader_may_leave():
            title = f"the map is in {self.output}" if state.finished else f"{state.done} of {state.total} poses done"
            print_json(said) if self.json else show(said, title)
        return 0


def shares(folder: Path, job: ReachJob) -> dict[str, Any]:
    """The shares of all poses of a finished map that are reached, proved to be out of reach, and neither."""
    from maira_qp.scale.reach.reach_map import ReachMap

    opened = ReachMap(folder, job)
    return {name: float(opened.values(name).mean(dtype=float)) for name in ("reachable", "unreachable", "undecided")}
