"""Configurations to start a search from, spread over the limits."""

from __future__ import annotations

import numpy as np

from maira_qp.robots.robot import Robot

LIBRARY, CORNERS = 512, 128
"""Configurations to start from whose poses are known, and how many of them at most have every joint on a limit.

A pass over them costs a fraction of an iteration. Targets near a corner of the limits are the hardest to find."""


def starting_library(robot: Robot) -> np.ndarray:
    """Configurations (LIBRARY, n): corners of the limits, the others spread evenly."""
    lower, upper = robot.drawn_range
    all_of_them = 2**robot.n <= CORNERS
    pick = np.arange(2**robot.n)[:, None] >> np.arange(robot.n) & 1 if all_of_them else _spread(CORNERS, robot.n) > 0.5
    corners = np.where(pick, upper, lower)
    share = _spread(LIBRARY - len(corners), robot.n)
    return np.concatenate([corners, np.clip((1 - share) * lower + share * upper, lower, upper)])


def _spread(count: int, n: int) -> np.ndarray:
    """Points (count, n) that fill the unit cube evenly.

    Point k is the fractional part of k a, a the powers of the root of x^(n + 1) = x + 1 (Roberts, "The unreasonable
    effectiveness of quasirandom sequences", 2018).
    """
    root = 2.0
    for _ in range(60):
        root = (1 + root) ** (1 / (n + 1))
    return (0.5 + np.outer(np.arange(count), root ** -np.arange(1.0, n + 1))) % 1
