"""Ranges: a cup kept upright within a cone, a tool that stays in its box, a yaw within 30 degrees, a slow tool.

As `limits=[...]` they hold whatever is asked for; as `task=mq.LimitTask(limit=...)` they are what is asked for.
"""

import numpy as np
from rich import print

import maira_qp as mq
from maira_qp.apps import plots

robot, dt = mq.Robot.maira(), 0.02
q0 = np.radians([0, 30, 0, 90, 0, -60, 0])
start = robot.forward(q0)
goal = start * mq.pose(start.rotation.T @ [-0.1, 0.45, 0.1], rpy=[-0.4, 0, 0.8])


def run(limits, ticks=110):
    """The configurations (ticks + 1, n) of a way to the goal within some limits."""
    solver, q = mq.Solver(robot, limits=limits), [q0]
    for _ in range(ticks):
        q.append(solver.step(q[-1], goal, dt).q)
    return np.array(q)


up = start.rotation[:, 2]  # what stands upright at the start
cup = mq.ConeLimit(direction=up, angle=np.radians(15))
box = mq.BoxLimit(lower=start.translation - 0.25, upper=start.translation + 0.25, name="cell")
slow = mq.ToolSpeedLimit(linear=0.25)
ways = {"free": run([]), "cup": run([cup]), "box": run([box]), "slow": run([slow])}


def tilt(q):
    """How far the cup leans [degrees]."""
    return np.degrees(np.arccos(np.clip(robot.forward(q).rotation[:, 2] @ up, -1, 1)))


points = {name: np.array([robot.forward(q).translation for q in way]) for name, way in ways.items()}
speeds = {name: np.linalg.norm(np.diff(p, axis=0), axis=1) / dt for name, p in points.items()}
print(f"the cup leans by {max(map(tilt, ways['free'])):.1f} degrees, in its cone by {max(map(tilt, ways['cup'])):.6f}")
print(f"the tool leaves its cell by {1e3 * max(0, np.abs(points['box'] - start.translation).max() - 0.25):.3f} mm")
print(f"the tool's speed: {speeds['free'].max():.2f} m/s, limited {speeds['slow'].max():.6f} m/s")

yaw = mq.PoseRange(position=0.01, orientation=[0.0, 0.0, np.radians(30)])  # about the target; roll and pitch exact
relaxed = mq.Solver(robot, task=mq.LimitTask(limit=yaw), redundancy=mq.Strict(mq.Posture()))
exact = mq.Solver(robot, redundancy=mq.Strict(mq.Posture()))
yaws = np.arange(-90, 91, 15)
costs = [[each.solve(start * mq.pose(rpy=[0, 0, a])).cost for a in np.radians(yaws)] for each in (exact, relaxed)]
print(
    f"posture cost over yaws: {np.mean(costs[0]):.3f} at the pose, {np.mean(costs[1]):.3f} within 1 cm and 30 degrees"
)

picture, times = plots.figure(2, 2, size=(9.0, 6.0)), dt * np.arange(111)
panels = (
    ("A cup kept upright", "time [s]", "leans [°]", times, [list(map(tilt, ways[k])) for k in ("cup", "free")], 15),
    (
        "A tool in its cell",
        "time [s]",
        "y [m]",
        times,
        [points[k][:, 1] for k in ("box", "free")],
        points["box"][0, 1] + 0.25,
    ),
    ("A slow tool", "time [s]", "speed [m/s]", times[1:], [speeds[k] for k in ("slow", "free")], 0.25),
    ("A yaw within 30°", "yaw [°]", "posture cost [rad²]", yaws, costs[::-1], None),
)
for axes, (title, across, up_axis, x, lines, bound) in zip(picture.axes, panels, strict=True):
    for index, line in enumerate(lines):
        axes.plot(x, line, color=plots.COLORS[index], linestyle=plots.DASHES[index], label=("within", "without")[index])
    if bound is not None:
        axes.axhline(bound, color=plots.LIMIT_COLOR, linewidth=2.5, alpha=0.5, label="limit")
    axes.set(title=title, xlabel=across, ylabel=up_axis)
    axes.legend(frameon=False)
picture.suptitle("ranges: a cup kept upright, a tool in its cell, a slow tool")
print(f"Picture: {plots.save(picture, 'output/24_ranges.png')}")
