"""A path that was followed: joints, speeds, errors, condition numbers, and where its elbow could have been."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator, MultipleLocator, PercentFormatter, StrMethodFormatter

from maira_qp.analytic.srs.arcs import arcs
from maira_qp.analytic.srs.geometry import SRS
from maira_qp.apps.plots.joint_paths import joint_paths
from maira_qp.apps.plots.self_motion import within_circle
from maira_qp.apps.plots.style import COLORS, LIMIT_COLOR, figure, finish, line, styled
from maira_qp.apps.viewer.motion.elbow import elbow_of
from maira_qp.results.path_solution import PathSolution
from maira_qp.results.trajectory import Trajectory
from maira_qp.robots.model.robot import Robot, condition_numbers

MOST_ARCS = 120
"""So many poses at most whose arcs are drawn."""
MOST_SHOWN = 1.5
"""Steps larger than so many times what is allowed leave the picture."""
LEAST = 1e-17
"""Errors below this are drawn here."""


@styled
def path_picture(path: PathSolution, trajectory: Trajectory | None = None) -> Figure:
    """Draw a path in panels, over the time where there is one: the trajectory's, or that of `track(..., dt=...)`.

    From the top: joints in their ranges, speeds or steps in their limits, errors of the tool, condition number, and
    of an S-R-S arm the swivel angle in the arcs that the limits leave of its branch. A trajectory shows its own poses.
    Raises `OptionError` for a path that was pickled, and does not know its robot.
    """
    robot, poses = path.robot, np.arange(len(path))
    if trajectory is not None:
        poses = trajectory.first_pose + np.arange(len(trajectory.pose_times))
    srs = SRS.of(robot)
    heights = (1.6, 1.2, 1.0, 0.8, 1.4)[: 4 if srs is None else 5]
    made = figure(len(heights), 1, size=(8.0, 2.0 * sum(heights)), heights=heights)
    joints, speeds, errors, condition, *swivel = made.axes
    if trajectory is not None:
        x, name = trajectory.pose_times, "time [s]"
        joint_paths(joints, robot, trajectory.q, times=trajectory.times)
        joint_rates(speeds, robot, trajectory.times, trajectory.velocity / trajectory.limits.velocity)
        speeds.set_ylabel("speed, of its\nlimit [%]")
    else:
        x, name = (poses, "pose") if path.rules.dt is None else (path.rules.dt * poses, "time [s]")
        joint_paths(joints, robot, path.q, times=x)
        joint_rates(speeds, robot, x[1:], np.diff(path.q, axis=0) / path.allowed_step)
        speeds.set_ylabel("step, of the\nlargest allowed [%]")
    pose_errors(errors, x, path.position_error[poses], path.orientation_error[poses])
    numbers = condition_numbers(robot.jacobians(np.ascontiguousarray(path.q[poses])))
    condition.plot(x, np.where(np.isfinite(numbers), numbers, np.nan), **line(0))
    condition.set(yscale="log", ylabel="condition\nnumber [-]")
    for axis in (condition.yaxis.set_major_formatter, condition.yaxis.set_minor_formatter):
        axis(StrMethodFormatter("{x:g}"))
    for ax in swivel:
        swivel_arcs(ax, robot, x, path.q[poses])
    for ax in made.axes:
        ax.set_xlim(x[0], x[-1] if x[-1] > x[0] else x[0] + 1.0)
        ax.set_xlabel(name if ax is made.axes[-1] else "")
        ax.xaxis.set_major_locator(MaxNLocator(6, integer=name == "pose"))
        if ax is condition:
            ax.grid(True)
    return made


@styled
def joint_rates(ax: Axes, robot: Robot, x: np.ndarray, shares: np.ndarray) -> None:
    """Speeds or steps (K, n) of the joints over x (K,), in shares of what is allowed: 100 % are the limits."""
    for i, name in enumerate(robot.joint_names):
        ax.plot(x, shares[:, i], **line(i), label=name)
    for limit in (-1.0, 1.0):
        ax.axhline(limit, color=LIMIT_COLOR, linewidth=2.5, alpha=0.5, zorder=0)
    largest = min(max(np.abs(shares).max(initial=1.0), 1.0), MOST_SHOWN)
    ax.set_ylim(-1.1 * largest, 1.1 * largest)
    ax.yaxis.set_major_formatter(PercentFormatter(1.0))
    finish(ax)


@styled
def pose_errors(ax: Axes, x: np.ndarray, position: np.ndarray, orientation: np.ndarray) -> None:
    """Errors (N,) of the tool at the poses of a path [m] and [rad]."""
    ax.plot(x, np.maximum(position, LEAST), **line(0), label="position [m]")
    ax.plot(x, np.maximum(orientation, LEAST), **line(1), label="orientation [rad]")
    ax.set(yscale="log", ylabel="error")
    finish(ax)


@styled
def swivel_arcs(ax: Axes, robot: Robot, x: np.ndarray, q: np.ndarray) -> None:
    """The swivel angle [deg] of an S-R-S arm at configurations (N, 7) over x (N,), in the arcs that are free.

    Bars are what the joint limits leave of the branch that each configuration is on. Draws nothing for other arms.
    """
    srs = SRS.of(robot)
    if srs is None:
        return
    shown = np.unique(np.linspace(0, len(q) - 1, min(len(q), MOST_ARCS)).round().astype(int))
    width = np.diff(x[shown], append=np.nan)
    width = np.where(np.isnan(width), width[0] if len(width) > 1 else 1.0, width)
    psi, bars = np.full(len(shown), np.nan), list[tuple[float, ...]]()
    for i, k in enumerate(shown.tolist()):
        elbow = elbow_of(srs, q[k])
        if elbow is None:
            continue
        psi[i] = np.degrees(np.remainder(elbow.psi + np.pi, 2 * np.pi) - np.pi)
        for arc in arcs(srs, robot.forward(q[k])):
            if arc.branch == elbow.curve.branch:
                ends = np.degrees(within_circle(arc.lower, arc.upper))
                bars += [(float(x[k]), float(width[i]), low, high - low) for low, high in ends.tolist()]
    if bars:
        left, widths, bottoms, tall = np.transpose(bars)
        ax.bar(left, tall, widths, bottoms, align="edge", color=COLORS[5], alpha=0.45, linewidth=0.0)
    jumps = np.flatnonzero(np.abs(np.diff(psi)) > 180.0) + 1
    ax.plot(np.insert(x[shown].astype(float), jumps, np.nan), np.insert(psi, jumps, np.nan), color=COLORS[1])
    ax.set_ylim(-180, 180)
    ax.yaxis.set_major_locator(MultipleLocator(90))
    ax.set_ylabel("swivel angle [deg]\nin its free arcs")
    ax.grid(True)
