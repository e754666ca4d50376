"""Collisions: MAIRA keeps 2 cm from a table, a ball and itself, in a solve and in every control tick.

`CollisionLimit` is a limit like the joints' own: it holds whatever is asked for. Its shapes come from the URDF.
"""

import numpy as np
from rich import print

import maira_qp as mq
from maira_qp.apps import plots

table = mq.Box([0.8, 1.6, 0.05], mq.pose([0.7, 0.0, 0.2]), name="table")
ball = mq.Sphere(0.08, mq.pose([0.65, 0.02, 0.4]), name="ball")
robot, margin, dt = mq.Robot.maira(), 0.02, 0.01  # [m], [s]
limit = mq.CollisionLimit(obstacles=[table, ball], margin=margin)
asked = limit.of(robot)  # the limit made for this robot, to ask it for distances
solvers = {
    "without": mq.Solver(robot),
    "with limit": mq.Solver(robot, limits=[limit], options=mq.Options(max_restarts=3)),
}


def report(title, q, error):
    """A line on a configuration."""
    contact = asked.nearest(robot.at(q))
    where = f"{1e3 * contact.distance:5.1f} mm between {contact.first} and {contact.second}"
    print(f"  {title:10s} {1e3 * error:8.3f} mm off, {where}")


down = [0.0, 1.0, 0.0, 0.0]
here, there = (mq.pose([0.6, y, 0.5], quaternion=down) for y in (0.4, -0.4))  # the ball stands between
low = mq.pose([0.6, -0.4, 0.15], quaternion=down)  # inside the table
for title, goal in (("above the table", there), ("inside it", low)):
    print(f"solve, {title}:")
    for name, solver in solvers.items():
        s = solver.solve(goal)
        report(name, s.q, s.position_error)

start, distances = solvers["with limit"].solve(here).q, {}
times = dt * np.arange(1, 301)
print("3 s of ticks, past the ball, then into the table:")
for name, solver in solvers.items():
    q, distances[name] = start, []
    for time in times:
        tick = solver.step(q, there if time <= 1.5 else low, dt)
        q = tick.q
        distances[name].append(1e3 * asked.distance(robot.at(q)))
    report(name, q, tick.position_error)
    print(f"  {'':10s} nearest on the way: {min(distances[name]):.6f} mm")

picture = plots.figure(size=(7.0, 3.6))
for index, (name, values) in enumerate(distances.items()):
    picture.axes[0].plot(times, values, color=plots.COLORS[1 - index], linestyle=plots.DASHES[1 - index], label=name)
picture.axes[0].axhline(1e3 * margin, color=plots.LIMIT_COLOR, linewidth=2.5, alpha=0.5, label="margin")
picture.axes[0].set(xlabel="time [s]", ylabel="smallest distance [mm]")
picture.axes[0].legend(frameon=False)
picture.suptitle("the smallest distance, with a collision limit and without")
print(f"Picture: {plots.save(picture, 'output/09_collisions.png')}")
