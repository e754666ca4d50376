"""Places of a chain that few joints move: where axes of turning joints meet, or pass each other.

They tell much about whether a pose can be reached, see `kernels.certificates.branch_and_bound`.
"""

from __future__ import annotations

import numpy as np

from maira_qp.analytic.joint_axes import screws
from maira_qp.analytic.lines import MEETS_WITHIN, foot, meeting
from maira_qp.robots.model.robot import Robot


def tool_points(robot: Robot) -> np.ndarray:
    """Points (k, 3) [m] in the axes of the tip, most of them on the last axis.

    They are the tip, its foot on the last axis, that of the axis before, which an offset wrist keeps near its centre,
    and where the last axes meet. The robot must be a chain, `Robot.is_chain`.
    """
    origins, axes = screws(robot)
    slides, tip = robot.slides, robot.forward(np.zeros(robot.n))
    p = tip.translation
    found = [p]
    if not slides[-1]:
        found.append(origins[-1] + (axes[-1] @ (p - origins[-1])) * axes[-1])
    if robot.n > 1 and not slides[-2:].any():
        found.append(origins[-1] + foot(origins[[-1, -2]], axes[[-1, -2]]) * axes[-1])
    for count in (2, 3):  # a wrist
        if count <= robot.n and not slides[-count:].any():
            point, off = meeting(origins[-count:], axes[-count:])
            if off <= MEETS_WITHIN * robot.length:
                found.append(point)
    return _distinct((np.array(found) - p) @ tip.rotation, robot.length)


def pivots(robot: Robot) -> np.ndarray:
    """Points on the axes of a chain's turning joints, (m, 2): the joint, and how far from its origin [m].

    They are the feet of the common normals with the axes before and behind.
    """
    origins, axes = screws(robot)
    slides, found = robot.slides, []
    for i in np.flatnonzero(~slides):
        near = [j for j in (i - 1, i + 1) if 0 <= j < robot.n and not slides[j]]
        feet = [foot(origins[[i, j]], axes[[i, j]]) for j in near] or [0.0]
        found += [(i, along) for along in _distinct(np.array(feet)[:, None], robot.length)[:, 0]]
    return np.array(found, dtype=float).reshape(-1, 2)


def _distinct(points: np.ndarray, length: float) -> np.ndarray:
    """The points (k, d) without those that are there already, to `MEETS_WITHIN` of a length."""
    kept: list[np.ndarray] = []
    for point in points:
        if all(np.linalg.norm(point - other) > MEETS_WITHIN * length for other in kept):
            kept.append(point)
    return np.array(kept)
