"""Where an arm begins."""

from __future__ import annotations

import numpy as np

from maira_qp.robots.model.robot import Robot

CANDIDATES = 300


def bent_configuration(robot: Robot) -> np.ndarray:
    """A configuration (n,) to begin with: of some near the middle, above the ground and ahead, the least singular."""
    rng = np.random.default_rng(0)
    candidates = [robot.middle + 0.5 * (robot.random_configuration(rng) - robot.middle) for _ in range(CANDIDATES)]
    ground = min(0.0, float(robot.forward(robot.middle).translation[2]))
    heights = [min(robot.forward(q, link).translation[2] for link in robot.moved_links) for q in candidates]
    above = [q for q, height in zip(candidates, heights, strict=True) if height >= ground]
    ahead = [q for q in above if robot.forward(q).translation[0] > abs(robot.forward(q).translation[1])]
    return robot.clip(max(ahead or above or candidates, key=robot.manipulability))
