"""What `prefer="closest"` asks for: among all solutions the one nearest to q0, in a metric of the joints.

For one call the distance from q0 takes the place of the solver's redundancy, as its only objective.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from maira_qp.errors import OptionError, shown
from maira_qp.problem.objectives import Posture, checked_joint_weights
from maira_qp.robots.model.robot import Robot


def check_preference(prefer: object, q0: object, observe: object = None) -> None:
    """Raises `OptionError` for a preference that is none, and for what it does not go with."""
    if not isinstance(prefer, str) or prefer != "closest":
        raise OptionError(f"prefer must be 'closest', or None and without a metric, got {shown(prefer)}")
    if q0 is None:
        raise OptionError("prefer='closest' needs q0: closest to what?")
    if observe is not None:
        raise OptionError("prefer='closest' cannot be observed; leave out prefer, or observe")


def posture_at(q0: np.ndarray, metric: Any, robot: Robot) -> Posture:
    """The posture whose cost is half the squared distance from q0 (n,) in a metric, None: 1 for each joint.

    It is (n,) or (n, n), or {joint name: weight}, in which others count 1.

    Raises `OptionError`.
    """
    weights = checked_joint_weights(1.0 if metric is None else metric, "metric", robot.joint_names)
    if not weights.any():
        raise OptionError(f"metric must be {robot.n} weights >= 0, not all of them 0, got {weights.tolist()}")
    return Posture(q0, weights)
