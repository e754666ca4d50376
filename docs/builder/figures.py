"""The figures of the site, drawn while it is built; `python docs/builder/figures.py` draws those of the repository.

Most are about an arm of two links in the plane, whose configurations are a plane too. Its limits are narrow on purpose.
"""

from __future__ import annotations

import io
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from house import house
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Rectangle
from PIL import Image

import maira_qp as mq
from maira_qp.apps import plots
from maira_qp.problem.limits.joint import Bounds
from maira_qp.problem.qp.backends import Backend
from maira_qp.problem.qp.hierarchy import Level, solve_hierarchy

ARM = mq.Robot.from_dh([mq.DHLink(a=0.6, lower=-1.2, upper=2.4), mq.DHLink(a=0.5, lower=0.4, upper=2.2)], name="plane")
BLUE, RED, GREEN, PINK, ORANGE = plots.COLORS[:5]


def drawn() -> Iterator[tuple[str, bytes]]:
    """All figures as SVG, by their names."""
    for draw in FIGURES:
        file = io.BytesIO()
        draw().savefig(file, format="svg", metadata={"Date": None})
        yield draw.__name__, file.getvalue()


def pose_error() -> Figure:
    """Three errors of orientation over the angle between the two orientations."""
    fig = plots.figure(size=(5.6, 3.4))
    (ax,) = fig.axes
    angle = np.linspace(0, np.pi, 200)
    for error, name in (
        (angle, "quaternion logarithm"),
        (2 * np.sin(angle / 2), "vector part of the quaternion, doubled"),
        (np.sin(angle), "skew part of the matrix"),
    ):
        ax.plot(np.degrees(angle), error, label=name)
    ax.set(xlabel="angle between the orientations [deg]", ylabel="length of the error [rad]")
    below(ax)
    return fig


def steps_in_a_box() -> Figure:
    """Iterations of a QP with the limits in it, and of Newton steps that are clamped afterwards."""
    target, q0 = mq.pose([-0.706, 0.528, 0.0]), np.array([-0.97, 0.78])
    solver = mq.Solver(ARM, task=mq.PositionTask(), options=mq.Options(max_restarts=0))
    inside: list[np.ndarray] = [q0]
    solver.solve(target, q0, observe=lambda q: inside.append(np.array(q)))
    clamped = [q0]
    for _ in range(12):
        q = clamped[-1]
        J, e = ARM.jacobian(q)[:2], target.translation[:2] - ARM.forward(q).translation[:2]
        clamped.append(ARM.clip(q + np.linalg.solve(J.T @ J + 1e-6 * np.eye(2), J.T @ e)))
    fig = plots.figure(size=(5.6, 4.2))
    (ax,) = fig.axes
    configuration_plane(ax, target)
    for steps, color, name in ((clamped, RED, "Newton step, then clamped"), (inside, BLUE, "QP with the limits in it")):
        path = np.degrees(np.array(steps))
        ax.plot(path[:, 0], path[:, 1], "o-", color=color, markersize=4, label=name)
    below(ax)
    return fig


def two_levels() -> Figure:
    """One step of a hierarchy, of weighted sums, and of a projection within one QP, where a limit is active."""
    row, error, wish = np.array([[1.0, 0.55]]), np.array([0.7]), np.array([-0.55, 0.75])
    upper = np.array([1.0, 0.42])
    bounds = Bounds(-upper, upper, np.zeros((0, 2)), np.zeros(0))
    pose = Level(row.T @ row, -row.T @ error, row)
    posture = Level(np.eye(2), -wish, np.eye(2))
    strict = solve_hierarchy([pose, posture], bounds, Backend("daqp"))
    assert strict is not None
    sums = []
    for weight in np.geomspace(1e-4, 1e3, 120):
        H, c = pose.H + weight * posture.H, pose.c + weight * posture.c
        sums.append(box_qp(H, c, -upper, upper))
    Z = np.array([-row[0, 1], row[0, 0]])[:, None] / np.linalg.norm(row)
    step = np.linalg.pinv(row) @ error + Z[:, 0] * (Z.T @ wish)
    clamped = np.clip(step, -upper, upper)
    fig = plots.figure(size=(5.6, 4.2))
    (ax,) = fig.axes
    x = np.linspace(-1.1, 1.1, 2)
    ax.add_patch(
        Rectangle(
            -upper, *(2 * upper), fill=False, edgecolor=plots.LIMIT_COLOR, linewidth=1.5, label="limits of the step"
        )
    )
    ax.plot(x, (error[0] - row[0, 0] * x) / row[0, 1], color="#999999", linestyle="--", label="level 1 is met")
    ax.plot(*np.array(sums).T, color=ORANGE, linestyle="-", label="weighted sums, all weights")
    for point, marker, color, name in (
        (wish, "*", GREEN, "optimum of level 2 alone"),
        (clamped, "X", RED, "null-space step, then clamped"),
        (strict, "o", BLUE, "strict hierarchy"),
    ):
        ax.plot(*point, marker, color=color, markersize=9, label=name)
    ax.set(xlabel="step of joint 1", ylabel="step of joint 2", xlim=(-1.15, 1.15), ylim=(-0.6, 1.0))
    below(ax)
    return fig


def nearest_point() -> Figure:
    """A target out of reach: the nearest configuration within the limits, and what they hold up."""
    target = mq.pose([0.55, -0.75, 0.0])
    solution = mq.Solver(ARM, task=mq.PositionTask()).solve(target)
    fig = plots.figure(1, 2, size=(8.6, 3.9))
    plane, space = fig.axes
    configuration_plane(plane, target)
    q = np.degrees(solution.q)
    slope = ARM.jacobian(solution.q)[:2].T @ (target.translation[:2] - ARM.forward(solution.q).translation[:2])
    plane.plot(*q, "o", color=BLUE, label="nearest point")
    plane.annotate(
        "", q + 20 * slope / np.linalg.norm(slope), q, arrowprops={"arrowstyle": "->", "color": RED, "linewidth": 1.8}
    )
    plane.plot([], [], color=RED, label="where the cost falls: a limit holds it up")
    below(plane)
    points = np.array(
        [[0, 0], ARM.forward(solution.q, ARM.moved_links[1]).translation[:2], ARM.forward(solution.q).translation[:2]]
    )
    space.plot(*points.T, "o-", color=BLUE, linewidth=4, label="arm at the nearest point")
    space.plot(*target.translation[:2], "X", color=RED, markersize=10, label="target")
    space.add_patch(Circle((0, 0), 1.1, fill=False, edgecolor="#BBBBBB", linestyle=":"))
    space.set(xlabel="x [m]", ylabel="y [m]", aspect="equal", xlim=(-1.2, 1.2), ylim=(-1.2, 1.2))
    below(space)
    return fig


def boxes() -> Figure:
    """The boxes of a proof: none of them holds a configuration that reaches the target."""
    target = mq.pose([0.70, -0.46, 0.0])
    solution = mq.Solver(ARM, task=mq.PositionTask()).solve(target)
    proof = solution.proof
    assert proof is not None
    fig = plots.figure(size=(5.6, 4.2))
    (ax,) = fig.axes
    configuration_plane(ax, target)
    colors = {1: "#9EC9E8", -1: "#F2C9A1", 0: "#DDDDDD"}
    for (lower, upper), side in zip(np.degrees(proof.boxes), proof.sides, strict=True):
        ax.add_patch(
            Rectangle(
                lower, *(upper - lower), facecolor=colors[int(side)], edgecolor="white", linewidth=0.8, alpha=0.75
            )
        )
    ax.plot([], [], "s", color=colors[1], label="target too far from a pivot")
    ax.plot([], [], "s", color=colors[-1], label="target too near to a pivot")
    ax.plot(*np.degrees(solution.q), "o", color=BLUE, label="nearest point")
    below(ax)
    return fig


def free_arcs() -> Figure:
    """The swivel angle along a path of MAIRA: in white what the limits leave, and the line that was found."""
    robot = mq.Robot.maira()
    angles = np.linspace(0, 2 * np.pi, 90)
    circle = [mq.pose([0.45, 0.42 * np.cos(a), 0.75 + 0.42 * np.sin(a)], rpy=[np.pi, 0, 0]) for a in angles]
    path = mq.Solver(robot).track(circle)
    fig = plots.figure(size=(6.4, 3.6))
    (ax,) = fig.axes
    plots.swivel_arcs(ax, robot, np.arange(len(path.q), dtype=float), path.q)
    ax.set_xlabel("pose of the path")
    return fig


def configuration_plane(ax: Axes, target) -> None:
    """The configurations of the arm [deg], its limits, and the pose error as contours."""
    first, second = np.linspace(-1.6, 2.8, 120), np.linspace(-0.2, 2.6, 100)
    x = 0.6 * np.cos(first)[:, None] + 0.5 * np.cos(first[:, None] + second)
    y = 0.6 * np.sin(first)[:, None] + 0.5 * np.sin(first[:, None] + second)
    error = np.hypot(x - target.translation[0], y - target.translation[1])
    ax.contour(np.degrees(first), np.degrees(second), error.T, levels=14, colors="#CCCCCC", linewidths=0.8, zorder=0)
    ends = np.degrees([ARM.lower, ARM.upper])
    ax.add_patch(
        Rectangle(
            ends[0], *(ends[1] - ends[0]), fill=False, edgecolor=plots.LIMIT_COLOR, linewidth=1.6, label="joint limits"
        )
    )
    ax.set(xlabel="joint 1 [deg]", ylabel="joint 2 [deg]")
    ax.grid(False)


def below(ax: Axes) -> None:
    """A legend below the axes."""
    ax.legend(loc="upper center", bbox_to_anchor=(0.5, -0.18), ncols=2, frameon=False)


def box_qp(H: np.ndarray, c: np.ndarray, lower: np.ndarray, upper: np.ndarray) -> np.ndarray:
    """The minimum of `1/2 x^T H x + c^T x` in a box of two dimensions, by looking at its inside, edges and corners."""
    candidates = [np.linalg.solve(H, -c)]
    for i in (0, 1):
        for bound in (lower[i], upper[i]):
            other = np.clip(-(c[1 - i] + H[0, 1] * bound) / H[1 - i, 1 - i], lower[1 - i], upper[1 - i])
            candidates.append(np.array([bound, other] if i == 0 else [other, bound]))
    allowed = [x for x in candidates if np.all((lower <= x) & (x <= upper))]
    return min(allowed, key=lambda x: 0.5 * x @ H @ x + c @ x)


def renew(root: Path) -> None:
    """Draw the figures as small pictures, for readers of the repository."""
    folder = root / "docs" / "images" / "figures"
    folder.mkdir(parents=True, exist_ok=True)
    for draw in FIGURES:
        file = io.BytesIO()
        draw().savefig(file, format="png", dpi=110)
        with Image.open(file) as picture:
            picture.convert("RGB").quantize(64).save(folder / f"{draw.__name__}.png", optimize=True)


FIGURES = (pose_error, steps_in_a_box, two_levels, nearest_point, boxes, free_arcs, house)

if __name__ == "__main__":
    renew(Path(__file__).parents[2])
