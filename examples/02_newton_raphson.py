"""Newton-Raphson: 15 random configurations of the iiwa14, each position solved from two random guesses.

Then the same method on a planar arm of two links, where the answer is known in closed form.
"""

import numpy as np
from rich import print
from rich.table import Table

import maira_qp as mq
from maira_qp.apps import plots
from maira_qp.evaluation import baselines

STEP, EPS = 1.0, 1e-4  # share of a full Newton step; [m]
rng, arm = np.random.default_rng(2), mq.Robot.iiwa14().dh

title = f"iiwa14, Newton-Raphson on the position: step {STEP:g}, eps {1000 * EPS:g} mm;\n"
table = Table(title=title + "guesses A and B, and how far apart they end")
for heading in ("", "target, m", "steps A, B", "error A, B, μm", "joints, °", "tools, °"):
    table.add_column(heading, justify="right", no_wrap=True)
errors, view = [], plots.figure(space=True)
for k in range(15):
    point = arm.forward(rng.uniform(arm.lower, arm.upper))[:3, 3]
    guesses = rng.uniform(arm.lower, arm.upper, (2, arm.n))
    results = [baselines.newton_position(arm, point, q0, step=STEP, tolerance=EPS) for q0 in guesses]
    poses = [arm.forward(r.q) for r in results]
    errors.append([1e6 * np.linalg.norm(T[:3, 3] - point) for T in poses])
    joints = np.angle(np.exp(1j * (results[0].q - results[1].q)))
    row = [f"{k + 1}", " ".join(f"{x:5.2f}" for x in point), ", ".join(f"{r.iterations:2d}" for r in results)]
    row += [", ".join(f"{e:5.2f}" for e in errors[-1]), f"{np.degrees(np.abs(joints).max()):.0f}"]
    table.add_row(*row, f"{np.degrees(np.linalg.norm(mq.pose_error(*poses)[3:])):.0f}")
    for i, result in enumerate(results if k == 0 else []):
        plots.draw_chain(view.axes[0], arm.compute_htms(result.q), target=point, label=f"guess {'AB'[i]}", index=i)
print(table)
print(
    f"Position error over 30 runs: mean {np.mean(errors):.2f} μm, standard deviation {np.std(errors, ddof=1):.2f} μm.\n"
)
print("Why the end poses differ: three equations, seven unknowns, so the solutions")
print("fill a surface of four dimensions, and each guess meets it somewhere else.\n")

a1, a2 = 0.7, 0.5
planar = mq.DHTable([mq.DHLink(a=a1), mq.DHLink(a=a2)])
gaps = []
for _ in range(15):
    x, y, _z = point = planar.forward(rng.uniform(planar.lower, planar.upper))[:3, 3]
    elbow = np.arccos((x**2 + y**2 - a1**2 - a2**2) / (2 * a1 * a2))
    exact = [(np.arctan2(y, x) - np.arctan2(a2 * np.sin(e), a1 + a2 * np.cos(e)), e) for e in (elbow, -elbow)]
    result = baselines.newton_position(planar, point, rng.uniform(planar.lower, planar.upper), tolerance=1e-9)
    if result.converged:
        gaps.append(min(np.abs(np.angle(np.exp(1j * (result.q - q)))).max() for q in np.array(exact)))
print(
    f"Against the closed form of a planar 2R arm: {len(gaps)} of 15 guesses converged, each\n"
    f"within {max(gaps):.0e} rad of one of the two exact solutions, elbow up or elbow down;\n"
    f"the other {15 - len(gaps)} still jumped to and fro after 200 steps."
)
view.axes[0].legend()
view.suptitle("one position, two guesses: two configurations of the iiwa14")
print(f"Picture: {plots.save(view, 'output/02_two_guesses.png')}")
