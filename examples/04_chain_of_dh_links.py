"""A chain of DH links chases random targets by gradient descent and by Newton steps (pseudo-inverse), on film.

Both take a learning rate and a cap on the step of a joint; neither knows the joint limits.
"""

from math import pi

import numpy as np
from rich import print
from rich.table import Table

import maira_qp as mq
from maira_qp.apps import plots
from maira_qp.evaluation import baselines

chain = mq.DHTable(
    [
        mq.DHLink(d=0.4, alpha=pi / 2),
        mq.DHLink(a=0.5),
        mq.DHLink(a=0.4),
        mq.DHLink(a=0.1, theta=pi / 2, alpha=pi / 2),
        mq.DHLink(kind="prismatic", d=0.1, lower=0.0, upper=0.3),
        mq.DHLink(kind="fixed", a=0.05, d=0.05),
    ],
    name="workshop",
)
q = np.array([0.3, 0.9, -1.2, 0.2, 0.1])
rng, bounds = np.random.default_rng(4), [[-0.7, 0.7], [-0.7, 0.7], [0.1, 1.0]]

J, J_numerical = chain.jacobian(q), chain.finite_difference_jacobian(q)
print(f"{chain.n} joints; Jacobian against finite differences: {np.abs(J - J_numerical).max():.0e}")

table = Table(title="chasing targets, one after another, to 1 mm")
for heading in ("target, m", "gradient: steps", "off, mm", "Newton: steps", "off, mm"):
    table.add_column(heading, justify="right")
frames, goals = [], []
for _ in range(7):
    target = baselines.sample_target(bounds, rng)
    descent = baselines.gradient_descent_position(chain, target, q, rate=0.5, max_step=0.05)
    newton = baselines.newton_position(chain, target, q, step=0.3, max_step=0.05)
    numbers = [x for r in (descent, newton) for x in (f"{r.iterations}", f"{1000 * r.error:.3f}")]
    table.add_row(" ".join(f"{x:5.2f}" for x in target), *numbers)
    way = newton.history[:: max(1, len(newton.history) // 8)]
    frames += [chain.compute_htms(x) for x in (*way, *[newton.q] * 3)]
    goals += [target] * (len(way) + 3)
    q = newton.q
print(table)

still = plots.figure(space=True)
plots.draw_chain(still.axes[0], frames[-1], target=goals[-1])
still.suptitle("a chain of DH links at a target")
print(f"Picture: {plots.save(still, 'output/04_chain.png')}")
film = plots.animate_chain("output/04_chase.gif", frames, goals, rate=10)
print(f"Film: {film}, {len(frames)} frames, {film.stat().st_size / 1e6:.2f} MB")
