"""Three examples of a lecture on the KUKA LBR iiwa 14 R820, from q = 0: the joint angles that it prints beside ours.

Its own algorithms (pseudo-inverse, the same with motion in the null space) know no limits; the solver holds them.
"""

from functools import partial

import numpy as np
from rich import print
from rich.table import Table

import maira_qp as mq
from maira_qp.apps import plots
from maira_qp.evaluation import baselines

robot = mq.Robot.iiwa14()
arm, lower, upper = robot.dh, robot.lower, robot.upper
solver = mq.Solver(robot, redundancy=mq.Strict(mq.LimitDistance()))
point = mq.pose([0.526, 0.0, 0.78]).homogeneous
rounded = [[0.997, 0.046, -0.063, 0.358], [-0.078, 0.527, -0.847, -0.484], [-0.006, 0.849, 0.528, 0.825], [0, 0, 0, 1]]
target = mq.pose(matrix=rounded).homogeneous  # the rotation nearest to three decimals
climb = partial(baselines.limit_distance_gradient, arm)  # away from the limits, for algorithm 3

position_only = {
    "lecture": lambda q0: np.radians([0, -95.584, 0, -68.874, 0, 61.447, 0]),
    "also right": lambda q0: np.radians([0, 0, 0, 90, 0, 0, 0]),
    "algorithm 1": lambda q0: baselines.newton_position(arm, point[:3, 3], q0).q,
    "mq.Solver": lambda q0: mq.Solver(robot, task=mq.PositionTask()).solve(point, q0=q0).q,
}
pose = {
    "lecture 2": lambda q0: np.radians([173.98, 26.64, -61.56, -73.01, -114.87, 40.73, 37.9]),
    "algorithm 2": lambda q0: baselines.newton_pose(arm, target, q0).q,
    "lecture 3": lambda q0: np.radians([-87.28, -28.15, 65.39, 73.01, -148.2, -68.95, -171.69]),
    "algorithm 3": lambda q0: baselines.newton_null_space(arm, target, q0, climb, alpha=100).q,
    "mq.Solver": lambda q0: solver.solve(target, q0=q0).q,
}

for title, goal, methods in (("Example 1: a point", point, position_only), ("Examples 2 and 3: a pose", target, pose)):
    columns = [[f"A{i + 1}, °" for i in range(7)] + ["off, mm", "off, mrad", "breaks"]]
    for method in methods.values():
        q = method(np.zeros(7))
        shift, turn = np.split(1000 * mq.pose_error(arm.forward(q), goal), 2)
        errors = [f"{np.linalg.norm(shift):.3f}", "free" if goal is point else f"{np.linalg.norm(turn):.3f}"]
        broken = " ".join(f"A{i + 1}" for i in range(7) if not lower[i] <= q[i] <= upper[i])
        columns.append([f"{x:.3f}" for x in np.degrees(q).round(3) + 0.0] + errors + [broken or "none"])
    table = Table("", *methods, title=title)
    for row in zip(*columns, strict=True):
        table.add_row(*row)
    print(table)
print("The lecture's answer to Example 3 breaks a limit as well: A7 by 1.69°.")
counts, starts = {}, np.random.default_rng(3).uniform(lower, upper, (100, 7))
print("From 100 random starts, at the target to 1 mm and 1 mrad, within all limits:")
for name in ("algorithm 2", "algorithm 3", "mq.Solver"):
    ends = [q for q in map(pose[name], starts) if ((lower <= q) & (q <= upper)).all()]
    counts[name] = (sum(bool(np.abs(mq.pose_error(arm.forward(q), target)).max() < 1e-3) for q in ends), 100)
    print(f"  {name} {counts[name][0]}")
picture = plots.figure(size=(7, 2.2))
plots.success_bars(picture.axes[0], {"100 starts": counts})
picture.suptitle("targets solved within the limits: the lecture's methods and mq.Solver")
print(f"Picture: {plots.save(picture, 'output/03_within_limits.png')}")
