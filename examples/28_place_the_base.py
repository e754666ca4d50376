"""Where should the arm stand? Bases ranked for a line of tool poses, and the best of them checked by solves."""

import numpy as np

import maira_qp as mq
from maira_qp.apps import plots

robot = mq.Robot.maira()
# A seam of 1.4 m along a bench and around its corner, the tool's z axis slanted downwards, in the frame of the cell.
bench = [mq.pose([x, 0.9, 0.75], rpy=[np.pi - 0.5, 0.0, 0.0]) for x in np.linspace(-0.5, 0.5, 11)]
side = [mq.pose([0.55, y, 0.75], rpy=[np.pi, 0.5, 0.0]) for y in np.linspace(0.85, 0.45, 5)]
poses = bench + side

# On the floor: the arm may stand anywhere in a rectangle, turned by any multiple of 45 degrees.
found = mq.scale.place(robot, poses, x=(-1.0, 1.0), y=(-0.6, 1.6), step=0.1, turn=np.pi / 4, keep=5)
print(found)
best = found[0]
print(f"from the best base {best.reached} of {len(poses)} poses are reached; it is at x, y, z, yaw {best.values}")

# What is said of a base is what a solver finds there: `solution` has the joint values for each pose.
for T, s in zip(poses[:2], best.solution, strict=False):
    print(f"pose at {T.translation}: {s.status.name}, {s.position_error:.1e} m off")

# One pose after another, without a jump: a path from that base.
path = mq.Solver(robot).track([best.base.actInv(T) for T in bench])
print(f"along the bench: {'followed whole' if path else path.reason}")

picture = plots.figure(size=(6.4, 5.0))
plots.placements(picture.axes[0], found)
picture.axes[0].set_title("Where the arm may stand, seen from above", pad=28)
print(f"Picture: {plots.save(picture, 'output/28_place_the_base.png')}")
