"""The moving picture of the README: MAIRA follows a figure of eight, each joint between its limits.

`python docs/builder/moving_picture.py` draws it into docs/images/.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.animation import FuncAnimation, PillowWriter
from matplotlib.axes import Axes

import maira_qp as mq
from maira_qp.apps import plots

FRAMES, FILE = 72, Path(__file__).parents[1] / "images" / "figure_of_eight.gif"


def eight() -> np.ndarray:
    """Poses (N, 4, 4) on a closed curve in front of the arm, the tool pointing at it."""
    t = np.linspace(0.0, 2 * np.pi, FRAMES + 1)
    y, z = 0.45 * np.sin(t), 0.75 + 0.28 * np.sin(2 * t)
    return np.array([mq.pose([0.7, a, b], rpy=[0.0, np.pi / 2, 0.0]).homogeneous for a, b in zip(y, z, strict=True)])


def links(robot: mq.Robot, q: np.ndarray) -> np.ndarray:
    """The places of the arm's frames [m], from the base to the tip."""
    places = [robot.forward(q, frame).translation for frame in robot.frames]
    distinct = [place for i, place in enumerate(places) if i == 0 or np.linalg.norm(place - places[i - 1]) > 1e-6]
    return np.array(distinct)


def bars(ax: Axes, robot: mq.Robot) -> list:
    """Axes in which each joint is a mark between its limits."""
    for i in range(robot.n):
        ax.plot([0, 1], [i, i], "-", color="#CCCCCC", linewidth=7, solid_capstyle="round", zorder=0)
    marks = [ax.plot([], [], "o", color=plots.COLORS[0], markersize=9)[0] for _ in range(robot.n)]
    ax.set(xlim=(-0.08, 1.08), ylim=(robot.n - 0.4, -0.6), xticks=[0, 1], yticks=range(robot.n))
    ax.set_xticklabels(["lower limit", "upper limit"])
    ax.set_yticklabels(robot.joint_names)
    ax.grid(False)
    for spine in ax.spines.values():
        spine.set_visible(False)
    ax.tick_params(length=0)
    return marks


def main() -> None:
    """Draw it."""
    robot = mq.Robot.maira()
    poses = eight()
    path = mq.Solver(robot).track(poses, loop=True)
    assert path, path.reason
    with plots.style():
        fig = plots.figure(size=(8.4, 3.9))
        fig.clear()
        space, side = fig.add_subplot(1, 16, (1, 10), projection="3d"), fig.add_subplot(1, 16, (12, 16))
        curve = poses[:, :3, 3]
        space.plot(*curve.T, color=plots.COLORS[1], linewidth=1.5)
        (arm,) = space.plot([], [], [], "o-", color=plots.COLORS[0], linewidth=5, markersize=5, markerfacecolor="white")
        space.set(xlim=(-0.3, 0.9), ylim=(-0.6, 0.6), zlim=(0.0, 1.2), xlabel="x [m]", ylabel="y [m]", zlabel="z [m]")
        space.set_xticks([0.0, 0.4, 0.8])
        space.set_box_aspect((1, 1, 1), zoom=1.1)
        space.view_init(elev=22, azim=-55)
        space.set_title("MAIRA follows a closed path", fontsize=11)
        side.set_title("every joint between its limits", fontsize=11)
        marks = bars(side, robot)

    def draw(k: int) -> list:
        arm.set_data_3d(*links(robot, path.q[k]).T)
        for i, mark in enumerate(marks):
            mark.set_data([(path.q[k, i] - robot.lower[i]) / (robot.upper[i] - robot.lower[i])], [i])
        return [arm, *marks]

    film = FuncAnimation(fig, draw, frames=FRAMES)
    film.save(FILE, writer=PillowWriter(fps=18), dpi=88)


if __name__ == "__main__":
    main()
