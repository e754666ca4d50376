"""A camera on MAIRA's hand keeps a point in sight while the hand goes where it is told, at another priority.

Both ways round: look first and move as far as that allows, or move first and look as well as that allows.
"""

import numpy as np
from rich import print

import maira_qp as mq
from maira_qp.apps import plots

robot, dt = mq.Robot.maira(), 0.02  # [s]
point = np.array([0.9, 0.0, 0.3])  # what is looked at [m]
times = dt * np.arange(1, 251)


def goal(time):
    """Where the hand is to be at a time [s]: to and fro above the point, and for a while out of reach."""
    away = 1.2 if 2.0 < time <= 3.5 else 0.0
    return mq.pose([0.5, 0.4 * np.sin(1.5 * time) + away, 0.9 + away])


solvers = {
    "look first": mq.Solver(robot, task=mq.LookAtTask(point=point), tasks=[mq.PositionTask(priority=2)]),
    "move first": mq.Solver(robot, task=mq.PositionTask(), tasks=[mq.LookAtTask(point=point, priority=2)]),
}
start = solvers["move first"].solve(goal(0.0), q0=np.radians([0.0, 0.0, 0.0, 80.0, 0.0, 60.0, 0.0])).q
rows = {}
for name, solver in solvers.items():
    q, errors = start, []
    for time in times:
        q = solver.step(q, goal(time), dt).q
        hand = robot.forward(q)
        sight = point - hand.translation
        aside = np.linalg.norm(np.cross(hand.rotation[:, 2], sight))
        look = np.arctan2(aside, hand.rotation[:, 2] @ sight)  # between the hand's z axis and the point
        errors.append([1e3 * look, 1e3 * np.linalg.norm(hand.translation - goal(time).translation)])
    rows[name] = np.array(errors)
    for title, part in (("in reach", times <= 2.0), ("out of reach", (times > 2.5) & (times <= 3.5))):
        look, place = rows[name][part].mean(axis=0)
        print(f"{name}, {title:12s}: {look:9.4f} mrad beside the point, {place:8.4f} mm off, mean")

picture = plots.figure(1, 2, size=(10.0, 3.6))
for k, unit in enumerate(("direction [mrad]", "place [mm]")):
    for i, name in enumerate(rows):
        values, style = np.maximum(rows[name][:, k], 1e-6), plots.DASHES[i]
        picture.axes[k].semilogy(times, values, color=plots.COLORS[i], linestyle=style, label=name)
    picture.axes[k].set(xlabel="time [s]", ylabel=f"error of the {unit}")
    picture.axes[k].legend(frameon=False)
picture.suptitle("look first, or move first: what each order of priorities costs")
print(f"Picture: {plots.save(picture, 'output/10_look_at.png')}")
