"""A seam at the edge of reach: proved impossible as it lies, and how far its frame has to move until it is followed."""

import numpy as np
from rich import print

import maira_qp as mq
from maira_qp.apps import plots

robot = mq.Robot.maira()
solver = mq.Solver(robot)
seam = mq.paths.arc(*(mq.pose([x, y, 0.0], rpy=[np.pi, 0, 0]) for x, y in ((0.0, -0.4), (0.15, 0.0), (0.0, 0.4))))
table = mq.pose([1.3, 0.0, 0.5])  # the frame that the seam is given in


def followed(shift):
    """The seam, its frame moved toward the robot [m], as the arm follows it."""
    return solver.track(mq.paths.in_frame(seam, mq.pose([-shift, 0, 0]) * table))


path = followed(0.0)
print(f"as it lies: {len(path)} poses, followed up to pose {path.first_failure}: {path.reason}")
print(f"  proof: {path.proof.words if path.proof else 'none'}")
print(f"  followed: {', '.join(f'poses {first} to {end - 1}' for first, end in path.parts)}")
shifts = np.arange(0.0, 0.3, 0.01)
shift = next(shift for shift in shifts if followed(shift))
repaired = followed(shift)
print(f"moved by {1e3 * shift:.0f} mm: followed whole, largest step {repaired.max_joint_step:.4f} rad")

picture = plots.figure(1, 2, size=(10.0, 3.6))
for name, moved, color in (("as it lies", 0.0, plots.COLORS[1]), ("moved", shift, plots.COLORS[0])):
    line = mq.paths.in_frame(seam, mq.pose([-moved, 0, 0]) * table)[:, :2, 3]
    picture.axes[0].plot(*line.T, color=color, label=name)
    missed = ~followed(moved).success
    picture.axes[0].plot(*line[missed].T, "x", color=color)
picture.axes[0].set(xlabel="x [m]", ylabel="y [m]", title="seam from above; crosses: out of reach", aspect="equal")
picture.axes[0].set_xlim(0.6, 1.6)
picture.axes[0].legend(loc="lower left")
plots.joint_paths(picture.axes[1], robot, repaired.q)
picture.axes[1].set(xlabel="pose", title="the arm along the moved seam")
picture.suptitle("a seam at the edge of reach, and how far its frame has to move")
print(f"Picture: {plots.save(picture, 'output/19_edge_of_reach.png')}")
