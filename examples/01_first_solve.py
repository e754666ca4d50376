"""A first solve: a robot, a target, joint angles within the limits, and an honest word on them."""

import numpy as np
from rich import print

import maira_qp as mq

robot = mq.Robot.maira()
print(f"{robot.name}: {robot.n} joints, tool [bold]{robot.tip}[/]")
print("limits, °:", *(f"{np.degrees(x):.0f}" for x in robot.upper))

target = mq.pose([0.4, 0.2, 0.9], quaternion=[0.0, 1.0, 0.0, 0.0])  # metres; (w, x, y, z): tool pointing down
solver = mq.Solver(robot, redundancy=mq.Strict(mq.Posture()))

for title, goal in (("within reach", target), ("out of reach", mq.pose([1.4, 0.9, 1.2], quaternion=[0, 1, 0, 0]))):
    s = solver.solve(goal)
    print(f"\n[bold]{title}[/]: {s.status.name}, {s.status.meaning}")
    print("  q, °:", *(f"{x:.2f}" for x in np.degrees(s.q)))
    print(f"  position error {1e3 * s.position_error:.6f} mm, orientation error {1e3 * s.orientation_error:.6f} mrad")
    print(f"  {s.iterations} iterations, {s.restarts} restarts, condition number {s.condition_number:.1f}")
    print(f"  active limits: {', '.join(s.active_limits) or 'none'}")
    assert (robot.lower <= s.q).all()
    assert (s.q <= robot.upper).all()

batch = solver.solve_batch([robot.forward(robot.random_configuration(np.random.default_rng(k))) for k in range(50)])
print(f"\na batch of {len(batch)}: {batch.success.sum()} solved, worst error {1e3 * batch.position_error.max():.6f} mm")
