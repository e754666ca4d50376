"""A control loop: MAIRA follows a target that jumps, and once out of reach, in ticks of 20 ms.

Every tick keeps the limits of position, speed and acceleration: `step` is given the velocity of the last tick, and each
joint only goes so fast that it can still brake.
"""

import numpy as np
from rich import print

import maira_qp as mq
from maira_qp.apps import plots

DT = 0.02  # [s]
robot = mq.Robot.maira().limited(velocity=1.5, acceleration=6.0)  # [rad/s], [rad/s²]
solver = mq.Solver(robot)
down = [0.0, 1.0, 0.0, 0.0]  # quaternion (w, x, y, z)
plan = [  # from when [s], what, where
    (0.0, "a first target", mq.pose([0.5, 0.3, 0.9], quaternion=down)),
    (2.5, "it jumps by 0.6 m", mq.pose([0.5, -0.3, 0.9], quaternion=down)),
    (5.0, "out of reach", mq.pose([1.6, -0.9, 0.9], quaternion=down)),
    (8.5, "back again", mq.pose([0.5, -0.3, 0.9], quaternion=down)),
]

q, v = np.radians([0.0, 20.0, 0.0, 60.0, 0.0, 60.0, 0.0]), np.zeros(robot.n)
times, errors, velocities = DT * np.arange(1, 551), [], [v]
for time in times:
    _, _, target = [part for part in plan if part[0] < time][-1]
    tick = solver.step(q, target, DT, velocity=v)
    q, v = tick.q, tick.velocity
    errors.append(tick.position_error)
    velocities.append(v)
    assert (robot.lower <= q).all()
    assert (q <= robot.upper).all()

speeds, accelerations = np.abs(velocities[1:]), np.abs(np.diff(velocities, axis=0)) / DT
for (start, what, _), end in zip(plan, [*(part[0] for part in plan[1:]), times[-1]], strict=True):
    last = round(end / DT) - 1
    word = f"{1e3 * errors[last]:9.3f} mm off, joints at {speeds[last].max():.0e} rad/s"
    print(f"[bold]{start:4.1f} s[/] {what:17s} at {end:4.1f} s: {word}")
print(f"largest speed {speeds.max():.6f} of {robot.velocity_limit[0]} rad/s,", end=" ")
print(f"largest acceleration {accelerations.max():.6f} of {robot.acceleration_limit[0]} rad/s²")

picture = plots.figure(2, 1, size=(8.0, 6.0))
above, below = picture.axes
above.semilogy(times, np.maximum(1e3 * np.array(errors), 1e-6), color=plots.COLORS[0])
above.set(ylabel="position error [mm]")
for i, speed in enumerate(np.transpose(velocities[1:])):
    below.plot(times, speed, color=plots.COLORS[i], label=robot.joint_names[i])
for limit in (-robot.velocity_limit[0], robot.velocity_limit[0]):
    below.axhline(limit, color=plots.LIMIT_COLOR, linewidth=2.5, alpha=0.5)
below.set(xlabel="time [s]", ylabel="joint speed [rad/s]")
below.legend(loc="center left", bbox_to_anchor=(1.01, 0.5), frameon=False)
picture.suptitle("a target that jumps, and is once out of reach: every joint keeps its limits")
print(f"Picture: {plots.save(picture, 'output/06_control_loop.png')}")
