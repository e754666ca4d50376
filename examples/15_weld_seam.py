"""A welding seam around a box: lines with rounded corners, at constant speed, the torch leaning against each side."""

import numpy as np
from rich import print

import maira_qp as mq
from maira_qp.apps import plots

robot, speed, dt = mq.Robot.maira(), 0.02, 0.05  # [m/s], [s]
box = mq.pose([0.55, 0.0, 0.35])  # the workpiece; the seam runs around its foot
half, edge = (0.10, 0.15), 0.02  # 20 cm by 30 cm, its corners cut by 2 cm
torch = mq.pose(rpy=[np.radians(180 - 30), 0, np.pi])  # from above, leaning by 30° toward +y


def side(k, *along):
    """Poses of the torch on the k-th side of the box, counterclockwise, so far along it [m] from its middle."""
    turned = mq.pose(rpy=[0, 0, k * np.pi / 2])
    return [turned * mq.pose([x, -half[1 - k % 2], 0]) * torch for x in along]


corners = side(0, 0, half[0] - edge)  # it begins and ends in the middle of the first side
for k in (1, 2, 3):
    corners += side(k, edge - half[k % 2], half[k % 2] - edge)
corners += side(0, edge - half[0], 0)
seam = mq.paths.polyline(corners, blend=0.01, step=0.002, frame=box)
welded = mq.paths.waypoints(seam, dt, stop=False, speed=speed, acceleration=0.05)
print(f"seam: {mq.paths.length(seam):.3f} m with rounded corners, {len(welded)} poses, {dt * (len(welded) - 1):.1f} s")

path = mq.Solver(robot).track(welded, dt=dt)
print("followed whole" if path else f"not followed: {path.reason}")
tool = np.array([robot.forward(q).homogeneous for q in path.q])
off = np.array([mq.pose_error(T, T_d) for T, T_d in zip(tool, welded, strict=True)])
moved = np.linalg.norm(np.diff(tool[:, :3, 3], axis=0), axis=1) / dt
rates = np.abs(np.diff(path.q, axis=0)) / dt
fastest = np.argmax(rates.max(axis=0) / robot.velocity_limit)
print(f"  off the seam by {1e6 * np.linalg.norm(off[:, :3], axis=1).max():.3f} µm at most")
print(f"  torch speed {1e3 * np.median(moved):.2f} mm/s, at most {1e3 * moved.max():.2f} mm/s")
print(f"  {robot.joint_names[fastest]} is nearest to its speed limit:", end=" ")
print(f"{np.degrees(rates[:, fastest].max()):.1f} of {np.degrees(robot.velocity_limit[fastest]):.0f} °/s")

picture = plots.figure(1, 2, size=(10.0, 3.6))
tips, handles = tool[::20, :2, 3], tool[::20, :2, 3] - 0.06 * tool[::20, :2, 2]
picture.axes[0].plot(*np.stack([tips, handles], axis=1).T, color=plots.COLORS[1], linewidth=0.8, linestyle="-")
picture.axes[0].plot(*tool[:, :2, 3].T, color=plots.COLORS[0], linestyle="-")
picture.axes[0].set(xlabel="x [m]", ylabel="y [m]", title="seam and torch, seen from above", aspect="equal")
plots.joint_paths(picture.axes[1], robot, path.q, times=dt * np.arange(len(welded)))
picture.suptitle("a weld seam around a box: the torch leans, each joint within its range")
print(f"Picture: {plots.save(picture, 'output/15_weld_seam.png')}")
