"""What an S-R-S arm can still do while its tool stands still, and where its limits end that.

For a pose each branch is a curve over the swivel angle psi, and the limits leave arcs of it (`analytic.srs.arcs`).
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import MultipleLocator

from maira_qp.analytic.srs.arcs import Arc, arcs
from maira_qp.analytic.srs.geometry import BRANCHES, SRS, checked_pose
from maira_qp.apps.plots.joint_paths import draw_range, shares
from maira_qp.apps.plots.style import COLORS, finish, line, styled
from maira_qp.errors import RobotError
from maira_qp.results.solution_set import ListedSolution, Solutions
from maira_qp.robots.model.robot import Robot

SAMPLES = 721
"""Swivel angles at which a curve is drawn."""
SHADE = {"facecolor": "#DADADA", "edgecolor": "#B0B0B0", "hatch": "///", "linewidth": 0.0}
BEYOND = 0.35
"""How far beyond the limits joints are shown, in ranges."""


@styled
def self_motion(ax: Axes, target: Any, solution: ListedSolution) -> None:
    """The joints over the swivel angle [deg], each in per cent of its range: 0 and 100 % are its limits.

    The branch is that of one of `Solver(robot).solutions(target)`, which is marked. Joints are thick where all are
    within the limits; thin, on shaded ground, where one is not; none where the branch does not exist. `target` is
    `pin.SE3` or (4, 4) [m]. Raises `RobotError` for a robot that is not S-R-S, `PoseError`.
    """
    (own, place), T = _place(solution), checked_pose(target)
    robot, branch = own.robot, own.branch
    srs: SRS = SRS.of(robot)  # type: ignore[assignment]
    free = [arc for arc in arcs(srs, T) if arc.branch == branch]
    for number, arc in enumerate(free):
        psi = np.linspace(arc.lower, arc.upper, SAMPLES)
        for shift in (0.0, -2 * np.pi) if arc.upper > np.pi else (0.0,):
            _draw(ax, robot, psi + shift, arc.at(psi), linewidth=2.2, labels=number == 0 and shift == 0.0)
    for number, (low, high) in enumerate(blocked(free)):
        label = "outside the limits" if number == 0 else None
        ax.axvspan(np.degrees(low), np.degrees(high), zorder=0, label=label, **SHADE)
        psi = np.linspace(low, high, SAMPLES)
        for elbow in srs.elbow_branches(T):
            if elbow.sign == branch.elbow:
                q = srs.evaluate(elbow, psi)[:, BRANCHES.index(branch) % 4]
                _draw(ax, robot, psi, _nearest_turn(robot, q), linewidth=0.7)
    ax.axvline(_in_degrees(place), color=COLORS[1], linewidth=1.2, label="solution")
    draw_range(ax)
    ax.set_ylim(-BEYOND, 1 + BEYOND)
    _swivel_axis(ax)
    finish(ax)


@styled
def arc_bars(ax: Axes, solutions: Solutions) -> None:
    """The arcs that the limits leave of every branch, bars over the swivel angle [deg], and the best place of each.

    `solutions` are those of an S-R-S arm; the star marks the first of them. Raises `RobotError` for others.
    """
    places = [_place(one) for one in solutions]
    shown = [branch for branch in BRANCHES if any(branch == arc.branch for arc, _ in places)]
    bar = {"height": 0.5, "color": COLORS[5], "edgecolor": COLORS[0], "linewidth": 0.8}
    for i, (arc, psi) in enumerate(places):
        y = shown.index(arc.branch)
        for low, high in within_circle(arc.lower, arc.upper):
            ax.barh(y, np.degrees(high - low), left=np.degrees(low), **bar)
        place = {"marker": "*", "markersize": 13} if i == 0 else {"marker": "o", "markersize": 5}
        label = {0: "best of all", 1: "best of its arc"}.get(i)
        color = COLORS[1] if i == 0 else COLORS[6]
        ax.plot([_in_degrees(psi)], [y], linestyle="", color=color, label=label, zorder=3, clip_on=False, **place)
    ax.set_yticks(range(len(shown)), [" ".join("+" if sign > 0 else "−" for sign in branch) for branch in shown])  # noqa: RUF001
    ax.set_ylim(len(shown) - 0.4, -0.6)
    ax.set_ylabel("elbow, shoulder,\nwrist [sign]")
    _swivel_axis(ax)
    finish(ax)
    ax.grid(False, axis="y")


def blocked(free: Iterable[Arc]) -> list[tuple[float, float]]:
    """The intervals of the swivel angle [rad] in [-pi, pi] that no arc of one branch covers."""
    covered = sorted(part for arc in free for part in within_circle(arc.lower, arc.upper))
    gaps, end = [], -np.pi
    for low, high in covered:
        if low > end:
            gaps.append((end, low))
        end = max(end, high)
    return [*gaps, (end, np.pi)] if end < np.pi else gaps


def _place(solution: ListedSolution) -> tuple[Arc, float]:
    """The arc and the swivel angle [rad]. Raises `RobotError`."""
    if solution.arc is None or solution.psi is None:
        raise RobotError("only an S-R-S arm has arcs of a swivel angle")
    return solution.arc, solution.psi


def within_circle(lower: float, upper: float) -> list[tuple[float, float]]:
    """The interval [rad], in two parts where it passes pi."""
    if upper <= np.pi:
        return [(lower, upper)]
    return [(lower, np.pi), (-np.pi, upper - 2 * np.pi)]


def _in_degrees(psi: float) -> float:
    return float(np.degrees(psi if psi <= np.pi else psi - 2 * np.pi))


def _nearest_turn(robot: Robot, q: np.ndarray) -> np.ndarray:
    """The same angles (N, 7), each in the turn about the middle of its limits."""
    middle = np.where(np.isfinite(robot.lower) & np.isfinite(robot.upper), robot.middle, 0.0)
    return middle + np.pi - np.mod(np.pi - (q - middle), 2 * np.pi)


def _draw(ax: Axes, robot: Robot, psi: np.ndarray, q: np.ndarray, *, linewidth: float, labels: bool = False) -> None:
    """Lines of the joints q (N, 7) over psi (N,) [rad], broken where a joint jumps by a turn."""
    values = shares(robot, q)
    values[1:][np.abs(np.diff(q, axis=0)) > np.pi] = np.nan
    names: Sequence[str | None] = robot.joint_names if labels else [None] * robot.n
    for j, name in enumerate(names):
        ax.plot(np.degrees(psi), values[:, j], **line(j), linewidth=linewidth, label=name)


def _swivel_axis(ax: Axes) -> None:
    ax.set_xlim(-180, 180)
    ax.xaxis.set_major_locator(MultipleLocator(60))
    ax.set_xlabel("swivel angle ψ [deg]")
