"""Two arms: TIAGo's hands go to a target each, then carry one thing between them. `pip install example-robot-data`.

A robot with several tips takes its targets by frame. While the hands carry, their pose relative to each other stands
above the pose of one of them: where the two do not go together, the grip holds and the thing stays behind.
"""

from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path

import numpy as np
from rich import print

import maira_qp as mq
from maira_qp.apps import plots

try:
    folder = distribution("example-robot-data").locate_file("cmeel.prefix/share/example-robot-data/robots")
except PackageNotFoundError:
    raise SystemExit("this example needs TIAGo's description: pip install example-robot-data") from None
left, right = "arm_left_tool_link", "arm_right_tool_link"
robot = mq.Robot.from_urdf(Path(str(folder)) / "tiago_description/robots/tiago_dual.urdf", tip=[left, right])
print(f"{robot.name}: {robot.n} joints, tips {', '.join(robot.tips)}")

solver = mq.Solver(robot, redundancy=mq.Strict(mq.Posture()))
targets = {
    left: mq.pose([0.6, 0.15, 0.9], rpy=[0.0, 0.0, -np.pi / 2]),
    right: mq.pose([0.6, -0.15, 0.9], rpy=[0.0, 0.0, np.pi / 2]),
}
s = solver.solve(targets)
print(f"\na target for each hand: {s.status.name}, {s.position_error:.0e} m, {s.orientation_error:.0e} rad,", end=" ")
print(f"limits: {', '.join(s.active_limits) or 'none'}")

held = robot.forward(s.q, right).actInv(robot.forward(s.q, left))  # the left hand as seen from the right one
grip = mq.RelativePoseTask(frame=left, reference=right, target=held)
carry = mq.Solver(robot, task=grip, tasks=[mq.PoseTask(frame=right, priority=2)])
start, dt, q = robot.forward(s.q, right), 0.02, s.q
times, slips, lags = dt * np.arange(1, 301), [], []
for time in times:
    goal = start.copy()
    away = max(0.0, 0.3 * (time - 3.0))  # in the end farther than the arms are long
    goal.translation = start.translation + np.array([away, 0.05 * np.sin(3 * time), 0.1 * np.sin(2 * time)])
    q = carry.step(q, {right: goal}, dt).q
    slip = mq.pose_error(robot.forward(q, right).actInv(robot.forward(q, left)), held)
    slips.append(1e3 * np.linalg.norm(slip[:3]))
    lags.append(1e3 * np.linalg.norm(robot.forward(q, right).translation - goal.translation))
for title, part in (("within reach", times <= 3.0), ("pulled out of reach", times > 3.0)):
    print(f"carrying, {title}: grip off by at most {np.max(np.array(slips)[part]):.4f} mm,")
    print(f"  the thing behind its goal by at most {np.max(np.array(lags)[part]):.4f} mm")

picture = plots.figure(size=(7.0, 3.6))
for index, (label, values) in enumerate({"thing behind its goal": lags, "grip off": slips}.items()):
    picture.axes[0].semilogy(times, np.maximum(values, 1e-12), color=plots.COLORS[index], label=label)
picture.axes[0].set(xlabel="time [s]", ylabel="position error [mm]")
picture.axes[0].legend(frameon=False)
picture.suptitle("two hands carry one thing: the grip holds where it stays behind")
print(f"Picture: {plots.save(picture, 'output/07_dual_arm.png')}")
