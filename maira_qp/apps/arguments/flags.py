"""What several commands take as flags: the robot, a pose, the redundancy, the solver's options, a seed."""

from __future__ import annotations

from typing import Annotated

import tyro

from maira_qp.apps.arguments.pose_choice import PoseChoice
from maira_qp.apps.arguments.redundancy_choice import RedundancyChoice
from maira_qp.apps.arguments.robot_choice import RobotChoice
from maira_qp.errors import OptionError
from maira_qp.problem.options import Options

RobotFlags = Annotated[RobotChoice, tyro.conf.OmitArgPrefixes, tyro.conf.arg(name="robot")]
PoseFlags = Annotated[PoseChoice, tyro.conf.OmitArgPrefixes, tyro.conf.arg(name="pose")]
RedundancyFlags = Annotated[RedundancyChoice, tyro.conf.OmitArgPrefixes, tyro.conf.arg(name="redundancy")]
SolverFlags = Annotated[
    Options,
    tyro.conf.OmitArgPrefixes,
    tyro.conf.arg(name="solver", help="When a pose counts as reached, how long to try, and how far to trust a step."),
]


def checked_seed(value: int) -> int:
    """The seed, checked. Raises `OptionError`."""
    if value < 0:
        raise OptionError(f"--seed must be 0 or more, got {value}")
    return value
