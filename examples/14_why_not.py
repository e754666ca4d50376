"""Impossible, or did the solver give up? Verdicts, what proves them, and which limits stand in the way."""

import numpy as np

import maira_qp as mq

robot = mq.Robot.maira().limited(upper={"joint4": 2.0}, lower={"joint4": -2.0})
solver = mq.Solver(robot)
folded = mq.Robot.maira().forward([0.3, 0.5, 0.1, 2.2, 0.4, -0.6, 0.2])  # joint4 0.2 rad beyond its limit
targets = {
    "within reach": mq.pose([0.6, 0.2, 0.9], quaternion=[0, 1, 0, 0]),
    "beyond the arm": mq.pose([1.5, 0.0, 1.5]),
    "the elbow folded too far": folded,
}

for name, target in targets.items():
    s = solver.solve(target)
    print(f"\n{name}: {s.status.name}\n  {s.explain()}")

# What proves it can be checked without the code that found it: here, that no elbow angle within the limits will do.
proof = solver.solve(folded).proof
shoulder, link = proof.shoulder, 0.7  # both of MAIRA's links
distance = np.linalg.norm(proof.wrist - shoulder)
elbow = np.pi - np.arccos(1 - distance**2 / (2 * link**2))  # the law of cosines
print(f"\nchecked by hand: shoulder and wrist {distance:.4f} m apart need the elbow at ±{elbow:.4f} rad, ±2 is allowed")

# Why, as data: releasing the limit shows by how much the joint is short.
for limit in solver.solve(folded).explain().limits:
    print(f"{limit.name}: costs {limit.multiplier:.3g} per rad; {limit.further:.4f} rad further reach the target")
