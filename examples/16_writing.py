"""MAIRA writes on a tilted board: letters on a plane, the pen lifted between the strokes."""

import numpy as np
from rich import print

import maira_qp as mq
from maira_qp.apps import plots

robot, height, lift = mq.Robot.maira(), 0.1, 0.02  # [m]
board = mq.pose([0.6, 0.36, 0.55], rpy=[np.radians(60), 0, -np.pi / 2])  # x to the right, y up, z toward the robot
pen = mq.pose(rpy=[np.pi, 0, 0])  # looks at the board
text = mq.paths.letters("MAIRA QP", height, pen, lift=lift, frame=board)

path = mq.Solver(robot).track(text)
print(f"text: {len(text)} poses, {mq.paths.length(text):.2f} m with the moves through the air")
print("written whole" if path else f"not written: {path.reason}")

tip = np.linalg.inv(board.homogeneous) @ np.array([robot.forward(q).homogeneous for q in path.q])  # on the board
x, y, z = tip[:, :3, 3].T
is_down = z < lift / 1000
drawn = np.hypot(np.diff(x), np.diff(y))[is_down[1:] & is_down[:-1]].sum()
tilt = np.arctan2(np.linalg.norm(tip[:, :2, 2], axis=1), -tip[:, 2, 2])
print(f"  lines of {drawn:.2f} m, off the board by {1e6 * np.abs(z[is_down]).max():.3f} µm at most,", end=" ")
print(f"the pen tilted by {1e3 * tilt.max():.4f} mrad at most")
print(f"  largest joint step {np.degrees(path.max_joint_step):.2f}°, {path.reconfigurations} reconfigurations")

picture = plots.figure(2, 1, size=(8.0, 6.0))
picture.axes[0].plot(x, y, color=plots.COLORS[1], linewidth=0.6, linestyle=":", label="pen lifted")
picture.axes[0].plot(np.where(is_down, x, np.nan), y, color=plots.COLORS[0], label="pen down")
picture.axes[0].set(xlabel="x [m]", ylabel="y [m]", title="on the board", aspect="equal")
picture.axes[0].legend(frameon=False, ncols=2, loc="upper left", bbox_to_anchor=(0, -0.4))
plots.joint_paths(picture.axes[1], robot, path.q)
picture.axes[1].set(xlabel="pose")
picture.suptitle("MAIRA writes on a tilted board")
print(f"Picture: {plots.save(picture, 'output/16_writing.png')}")
