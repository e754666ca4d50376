"""MAIRA's redundancy in two ways: a weighted posture task, and a strict null-space hierarchy.

Weighted trades pose for posture: the larger its weight, the better the posture and the worse the pose. Strict takes the
best posture that costs the pose nothing.
"""

import numpy as np
from rich import print
from rich.table import Table

import maira_qp as mq
from maira_qp.apps import plots

robot, rng = mq.Robot.maira(), np.random.default_rng(11)
targets = [robot.forward(robot.random_configuration(rng)) for _ in range(30)]
starts = [robot.random_configuration(rng) for _ in targets]


def run(redundancy):
    """Median pose residual (position [m] and orientation [rad] together) and mean posture cost [rad^2]."""
    solver = mq.Solver(robot, redundancy=redundancy)
    answers = [solver.solve(T, q0=q0, rng=0) for T, q0 in zip(targets, starts, strict=True)]
    residual = np.median([np.hypot(s.position_error, s.orientation_error) for s in answers])
    cost = np.mean([0.5 * np.sum((s.q - robot.middle) ** 2) for s in answers])
    return residual, cost, sum(s.success for s in answers)


table = Table("method", "pose residual, median", "posture cost, mean, rad²", "solved to 1e-6")
weights = 10.0 ** np.arange(-8, 0.5)
curve = [run(mq.Weighted(mq.Posture(), weight)) for weight in weights]
strict, pose_only = run(mq.Strict(mq.Posture())), run(None)
rows = [
    ("pose only", pose_only),
    *((f"weighted, {w:.0e}", r) for w, r in zip(weights, curve, strict=True)),
    ("strict", strict),
]
for name, (residual, cost, solved) in rows:
    table.add_row(name, f"{residual:.1e}", f"{cost:.3f}", f"{solved} of {len(targets)}")
print(table)

picture = plots.figure(2, 2)
residuals, costs, _ = zip(*curve, strict=True)
plots.trade_off(picture.axes[0], weights, residuals, costs, strict=strict[:2])
methods = {"strict": mq.Strict(mq.Posture()), "weighted, 0.1": mq.Weighted(mq.Posture(), 0.1)}
visited = {name: [] for name in methods}
for ax, (name, redundancy) in zip(picture.axes[2:], methods.items(), strict=True):
    solver = mq.Solver(robot, redundancy=redundancy)
    solver.solve(targets[0], q0=starts[0], observe=visited[name].append)
    path = [starts[0]]
    for _ in range(200):  # control ticks of 20 ms: one QP, or one hierarchy of QPs, each
        path.append(solver.step(path[-1], targets[0], 0.02).q)
    plots.joint_paths(ax, robot, path, times=0.02 * np.arange(201))
    ax.set_title(name)
numbers = {name: [robot.condition_number(q) for q in path] for name, path in visited.items()}
plots.condition_numbers(picture.axes[1], numbers)
picture.suptitle("weighted or strict: pose against posture, and the way of the joints")
print(f"Picture: {plots.save(picture, 'output/05_two_methods.png')}")
