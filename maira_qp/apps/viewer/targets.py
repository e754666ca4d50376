"""Where the tips are to be: a target for each."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pinocchio as pin

from maira_qp.orientation import pose_error
from maira_qp.robots.model.robot import Robot

Targets = Mapping[str, pin.SE3]
"""{tip: T_base_tool}, never changed: another target makes another mapping"""


def tools_at(robot: Robot, q: np.ndarray) -> dict[str, pin.SE3]:
    """Where the tips are at q (n,)."""
    return {tip: robot.forward(q, tip) for tip in robot.tips}


def as_asked(targets: Targets) -> Any:
    """As the verbs of a solver take them: a pose for a chain, a mapping for a tree."""
    return dict(targets) if len(targets) > 1 else next(iter(targets.values()))


def errors_between(tools: Targets, targets: Targets) -> tuple[float, float]:
    """The largest distance [m] and the largest angle [rad] between tips and their targets."""
    errors = np.array([pose_error(tools[tip], T) for tip, T in targets.items()])
    return float(np.linalg.norm(errors[:, :3], axis=1).max()), float(np.linalg.norm(errors[:, 3:], axis=1).max())
