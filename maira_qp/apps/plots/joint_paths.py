"""Joints between their limits."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator, PercentFormatter

from maira_qp.apps.plots.style import LIMIT_COLOR, finish, line, styled
from maira_qp.robots.model.robot import Robot


@styled
def joint_paths(ax: Axes, robot: Robot, path: Any, *, times: Any = None) -> None:
    """Joints (K, n) [rad or m] over times (K,) [s], each in per cent of its range: 0 and 100 % are its limits.

    Without times the configurations are counted, as the iterations of a solve. A joint without limits has the range -pi
    to pi.
    """
    path = np.asarray(path, dtype=float)
    x = np.arange(len(path)) if times is None else np.asarray(times, dtype=float)
    for i, (name, share) in enumerate(zip(robot.joint_names, shares(robot, path).T, strict=True)):
        ax.plot(x, share, **line(i), label=name)
    draw_range(ax)
    ax.xaxis.set_major_locator(MaxNLocator(6, integer=times is None))
    ax.set_xlabel("iteration" if times is None else "time [s]")
    finish(ax)


def shares(robot: Robot, q: np.ndarray) -> np.ndarray:
    """Where joints (..., n) [rad or m] are in their ranges: 0 at the lower limit, 1 at the upper; 0 if locked."""
    lower = np.where(np.isfinite(robot.lower), robot.lower, -np.pi)
    upper = np.where(np.isfinite(robot.upper), robot.upper, np.pi)
    return (q - lower) / np.where(upper > lower, upper - lower, 1.0)


def draw_range(ax: Axes) -> None:
    """The vertical axis of shares, with both limits."""
    for limit in (0.0, 1.0):
        ax.axhline(limit, color=LIMIT_COLOR, linewidth=2.5, alpha=0.5, zorder=0)
    ax.yaxis.set_major_formatter(PercentFormatter(1.0))
    ax.set_ylabel("joint, in its range [%]")
