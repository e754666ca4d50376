"""Answers that pass a test of your own, several starts for one target, and joints that stay near where they are."""

import numpy as np

import maira_qp as mq

robot = mq.Robot.maira()
solver = mq.Solver(robot, redundancy=mq.Strict(mq.Posture()))
target = mq.pose([0.55, 0.1, 0.75], quaternion=[0, 1, 0, 0])


def is_welcome(q: np.ndarray) -> bool:
    """Somebody works at the right of the arm: the elbow is to stay on the left. No limit says so, a function does."""
    return bool(robot.forward(q, "link4").translation[1] > 0.15)


usual, welcome = solver.solve(target), solver.solve(target, accept=is_welcome)
for name, s in (("usual", usual), ("accepted", welcome)):
    elbow = robot.forward(s.q, "link4").translation
    print(f"{name:9} {s.status.name}, elbow at {elbow.round(3)} m, posture {s.cost:.3f}, {s.rejected} rejected")

# What no configuration passes is reached all the same, but does not count.
none = solver.solve(target, accept=lambda q: bool(robot.forward(q, "link4").translation[2] > 5.0))
print(f"\nan elbow 5 m high: {none.status.name}, {none.rejected} configurations were rejected\n  {none.explain()}")

# From where the arm stands no joint may move by more than 0.2 rad. A verdict within that box is none on the arm.
q0 = welcome.q
for step in (0.01, 0.5):
    there = mq.pose([0.55 + step, 0.1, 0.75], quaternion=[0, 1, 0, 0])
    s = solver.solve(there, q0, max_joint_change=0.2)
    print(f"\n{100 * step:.0f} cm farther: {s.status.name} {s.scope}, largest change {s.max_joint_change:.3f} rad")
    print(
        f"  at its bounds: {', '.join(s.active_limits) or 'none'}; without them {solver.solve(there, q0).status.name}"
    )

# Of several starts the best answer counts, and says which start it is from.
starts = np.random.default_rng(0).uniform(-1.5, 1.5, (8, robot.n))
best = mq.Solver(robot).solve(target, starts)
print(f"\nof {len(starts)} starts the one at {best.q0.round(2)} is the nearest: {best.max_joint_change:.3f} rad")
