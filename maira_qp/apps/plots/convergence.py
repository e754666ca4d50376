"""How a solve comes to its pose."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator

from maira_qp.apps.plots.style import COLORS, DASHES, LIMIT_COLOR, finish, styled
from maira_qp.orientation import pose_error
from maira_qp.solvers.solver import Solver

LEAST = 1e-17
"""Errors below this [m, rad] are drawn here."""


@styled
def convergence(ax: Axes, solver: Solver, target: Any, visited: np.ndarray) -> None:
    """Pose error of the tip, position [m] and orientation [rad], against the iteration.

    `visited` (K, n) [rad or m] is what `solver.solve(target, observe=visited.append)` went through: where it starts
    anew, the error jumps. The tolerances are drawn beside. `target` is `pin.SE3` or (4, 4) [m].
    """
    robot, options = solver.robot, solver.options
    T = np.asarray(getattr(target, "homogeneous", target), dtype=float)
    errors = np.array([pose_error(robot.forward(q).homogeneous, T) for q in visited])
    parts = (
        ("position [m]", errors[:, :3], options.position_tolerance),
        ("orientation [rad]", errors[:, 3:], options.orientation_tolerance),
    )
    for i, (name, part, tolerance) in enumerate(parts):
        values = np.maximum(np.linalg.norm(part, axis=1), LEAST)
        ax.plot(values, color=COLORS[i], linestyle=DASHES[i], marker="os"[i], markersize=4, label=name)
        ax.axhline(tolerance, color=LIMIT_COLOR, linestyle=DASHES[i], linewidth=1, zorder=0)
    place, where = (0.0, options.position_tolerance), ("axes fraction", "data")
    ax.annotate("tolerance", place, (4, 3), xycoords=where, textcoords="offset points", color=LIMIT_COLOR)
    ax.set_yscale("log")
    ax.xaxis.set_major_locator(MaxNLocator(8, integer=True))
    ax.set(xlabel="iteration", ylabel="pose error [m], [rad]")
    finish(ax)
