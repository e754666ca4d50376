"""The tool runs around a circle and points down all the while; the turn about its axis is free, the elbow has a wish.

Three levels: the position with the tool's direction, below them the elbow's place, and below that the posture.
"""

import numpy as np
from rich import print

import maira_qp as mq
from maira_qp.apps import plots

robot, dt, radius, period = mq.Robot.maira(), 0.02, 0.25, 4.0  # [s], [m], [s]
pointing = [mq.PositionTask(), mq.AxisTask(axis=[0, 0, 1], direction=[0, 0, -1])]
elbow = mq.SwivelTask(shoulder="link2", elbow="link4", wrist="link6", angle=np.radians(30), priority=2)
solver = mq.Solver(robot, task=pointing, tasks=[elbow], redundancy=mq.Strict(mq.Posture()))


def on_circle(time):
    """Where the tool is to be at a time [s]."""
    angle = 2 * np.pi * time / period
    return mq.pose([0.6 + radius * np.cos(angle), radius * np.sin(angle), 0.7])


s = solver.solve(on_circle(0.0))
print(f"start: {s.status.name}, {1e3 * s.position_error:.6f} mm, {1e3 * s.orientation_error:.6f} mrad from down")
q, rows, points = s.q, [], []
times = dt * np.arange(1, round(period / dt) + 1)
swivel = elbow.of(robot)
for time in times:
    tick = solver.step(q, on_circle(time), dt)
    q = tick.q
    tool = robot.forward(q)
    points.append(tool.translation)
    tilt = np.arctan2(np.linalg.norm(tool.rotation[:2, 2]), -tool.rotation[2, 2])
    off = np.linalg.norm(tool.translation - on_circle(time).translation)
    rows.append([1e3 * off, 1e3 * tilt, np.degrees(abs(swivel.error(robot.at(q))[0]))])
for name, unit, values in zip(("position", "tilt", "elbow"), ("mm", "mrad", "°"), np.transpose(rows), strict=True):
    print(f"  {name:8s} mean {values.mean():.6f} {unit}, largest {values.max():.6f} {unit}")
print(f"  one round of {2 * np.pi * radius:.2f} m in {period:g} s, {len(times)} ticks, and it ends", end=" ")
print(f"{np.degrees(np.abs(q - s.q).max()):.4f}° from where it began")

picture = plots.figure(1, 2, size=(10.0, 3.6))
path = np.array(points)
picture.axes[0].plot(path[:, 0], path[:, 1], color=plots.COLORS[0])
picture.axes[0].set(xlabel="x [m]", ylabel="y [m]", title="the tool, seen from above", aspect="equal")
for i, name in enumerate(("position [mm]", "tilt [mrad]", "elbow [°]")):
    picture.axes[1].semilogy(times, np.maximum(np.array(rows)[:, i], 1e-9), color=plots.COLORS[i], label=name)
picture.axes[1].set(xlabel="time [s]", ylabel="error")
picture.axes[1].legend(frameon=False)
picture.suptitle("a circle with the tool pointing down")
print(f"Picture: {plots.save(picture, 'output/08_circle.png')}")
