"""How the joints follow their target: `solution.jacobian()` finds where a robot stands, and moves it without a solve.

The robot's base is a little off its place. It was sent to eight poses and its joint angles were read; Gauss-Newton on
the six numbers of the misplacement explains them, with the derivatives that inverse kinematics gives of itself.
"""

import numpy as np
import pinocchio as pin
from rich import print
from rich.table import Table

import maira_qp as mq

robot, rng = mq.Robot.maira(), np.random.default_rng(1)
solver = mq.Solver(robot, redundancy=mq.Strict(mq.Posture()))


def misplaced(x, target):
    """A target of the workshop, as the robot sees it whose base is displaced by x (6,) [m, rad]."""
    return pin.SE3(pin.exp3(x[3:]), x[:3]).actInv(target)


def by_misplacement(x, seen):
    """How the twist of such a target follows x, (6, 6): `dp = -A (dx + w x p)`, `dphi = -w`, by the left Jacobian."""
    A, K = pin.exp3(x[3:]).T, pin.skew(seen.translation)
    turn = pin.Jexp3(x[3:])  # of exp(x) by a turn in its own axes
    return np.block([[-A, K @ turn], [np.zeros((3, 3)), -turn]])


true = np.array([0.012, -0.020, 0.008, 0.010, -0.015, 0.030])  # [m, rad]
targets = [mq.pose([0.5, 0.08 * k - 0.3, 0.7 + 0.05 * (k % 3)], rpy=[np.pi, 0.3, 0.2 * k]) for k in range(8)]
readings = np.array([solver.solve(misplaced(true, T)).q for T in targets]) + 1e-5 * rng.normal(size=(8, 7))

x, table = np.zeros(6), Table(title="where the base stands")
for heading in ("step", "off, mm", "off, mrad", "joints explained to, mrad"):
    table.add_column(heading, justify="right")
for step in range(5):
    answers = [solver.solve(misplaced(x, T), q0=q) for T, q in zip(targets, readings, strict=True)]
    left = readings - [s.q for s in answers]
    off = 1e3 * (x - true)
    numbers = (np.linalg.norm(off[:3]), np.linalg.norm(off[3:]), 1e3 * np.sqrt(np.mean(left**2)))
    table.add_row(str(step), *(f"{value:.5f}" for value in numbers))
    J = [s.jacobian() @ by_misplacement(x, misplaced(x, T)) for s, T in zip(answers, targets, strict=True)]
    x = x + np.linalg.lstsq(np.vstack(J), left.ravel(), rcond=None)[0]
print(table)

table = Table(title="the joints moved by the derivative, without a solve")
for heading in ("target moved, mm", "off the pose, mm", "off the solve, mrad"):
    table.add_column(heading, justify="right")
s = solver.solve(targets[4])
for distance in (1e-3, 1e-2, 1e-1):
    target = pin.SE3(targets[4].rotation, targets[4].translation + np.array([0.0, 0.0, distance]))
    q = robot.clip(s.q + s.jacobian() @ [0.0, 0.0, distance, 0.0, 0.0, 0.0])
    off = 1e3 * np.linalg.norm(robot.forward(q).translation - target.translation)
    table.add_row(f"{1e3 * distance:.0f}", f"{off:.4f}", f"{1e3 * np.abs(q - solver.solve(target, q0=q).q).max():.4f}")
print(table)
