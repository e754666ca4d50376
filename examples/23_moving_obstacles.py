"""A ball flies through the arm's place: where it is goes with each tick, and the arm gives way and comes back.

`CollisionLimit(obstacles={"ball": ...})` loads all shapes once; `step(..., obstacles={"ball": pose})` moves one.
"""

import numpy as np
from rich import print

import maira_qp as mq
from maira_qp.apps import plots

robot, margin, dt = mq.Robot.maira(), 0.02, 0.02  # [m], [s]
limit = mq.CollisionLimit(obstacles={"ball": mq.Sphere(0.1)}, margin=margin, self_collision=False, influence=0.5)
solver = mq.Solver(robot, limits=[limit], redundancy=mq.Strict(mq.Posture()))
asked = limit.of(robot)  # the limit made for this robot, to ask it for distances

q = np.radians([0, 30, 0, 90, 0, -60, 0])
home, still, times = robot.forward(q), robot.at(q), dt * np.arange(1, 251)
distances, without, errors = [], [], []
for time in times:
    ball = mq.pose(home.translation + np.array([0.05, 0.4 * time - 1.0, 0.0]))  # 0.4 m/s along y, through the hand
    tick = solver.step(q, home, dt, obstacles={"ball": ball})
    q = tick.q
    now = asked.with_obstacles({"ball": ball})
    distances.append(1e3 * now.distance(robot.at(q)))
    without.append(1e3 * now.distance(still))
    errors.append(1e3 * tick.position_error)
print(f"nearest on the way: {min(distances):.2f} mm; an arm that stands still: {min(without):.1f} mm")
print(f"pushed out of its pose by {max(errors):.0f} mm, and back within {errors[-1]:.3f} mm")

picture = plots.figure(1, 2, size=(9.0, 3.4))
left, right = picture.axes
left.plot(times, distances, color=plots.COLORS[0], label="the arm that gives way")
left.plot(times, without, color=plots.COLORS[1], linestyle=plots.DASHES[1], label="one that stands still")
left.axhline(1e3 * margin, color=plots.LIMIT_COLOR, linewidth=2.5, alpha=0.5, label="margin")
left.set(title="A ball on its way through", xlabel="time [s]", ylabel="smallest distance [mm]")
left.legend(frameon=False)
right.plot(times, errors, color=plots.COLORS[0])
right.set(title="The tool gives way and comes back", xlabel="time [s]", ylabel="off its pose [mm]")
picture.suptitle("a ball flies through the arm's place: where it is goes with each tick")
print(f"Picture: {plots.save(picture, 'output/23_moving_obstacles.png')}")
