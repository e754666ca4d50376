r"""A bound on the reach of an arm: a centre, and a distance from it that the tool exceeds in no configuration.

Pick a point on the axis of each moving joint. Turning about an axis moves none of its points, so from one point to the
next there is a rigid body of fixed length l_k, and by the triangle inequality the tool is no further from the first
point than

    l_1 + l_2 + ... + l_m                 (a sliding joint adds the farthest that it slides)

whatever the points. The first joint only turns what follows about its own axis, so the centre is put on that axis
opposite to the second point, and l_1 is the second point's distance from the axis. The sum is convex in where the
points are on their axes, and the smallest sum is the tightest bound: exact for arms without lateral offsets.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from scipy.optimize import minimize

from maira_qp.evaluation.judge import PathJoint

SMOOTHING = 1e-6
"""Lengths are smoothed by this [m] for the minimiser, not in the bound."""


def reach(path: Sequence[PathJoint], low: np.ndarray, high: np.ndarray) -> tuple[np.ndarray, float]:
    """Centre (3,) in the base and bound [m] for the joints of a path, q between `low` and `high` (n,)."""
    joints: list[PathJoint] = []
    bodies = [np.eye(4)]  # from one moving joint to the next, the first from the base
    for joint in path:
        bodies[-1] = bodies[-1] @ joint.origin
        if joint.driver is not None:
            joints.append(joint)
            bodies.append(np.eye(4))

    def vectors(points: np.ndarray) -> list[np.ndarray]:
        """From each point to the next, in the joint's frame; the last to the tool."""
        on_axis = [joint.axis * (0.0 if joint.sliding else s) for joint, s in zip(joints, points, strict=True)]
        ends = [*on_axis[1:], np.zeros(3)]
        steps = [T[:3, :3] @ end + T[:3, 3] for T, end in zip(bodies[1:], ends, strict=True)]
        first = steps[0] if joints[0].sliding else steps[0] - (joints[0].axis @ steps[0]) * joints[0].axis
        return [first, *(step - start for step, start in zip(steps[1:], on_axis[1:], strict=True))]

    def smooth_length(points: np.ndarray) -> float:
        return sum(math.sqrt(float(v @ v) + SMOOTHING**2) for v in vectors(points))

    points = minimize(smooth_length, np.zeros(len(joints)), method="BFGS").x
    points = min((points, np.zeros(len(joints))), key=lambda p: sum(np.linalg.norm(vectors(p), axis=1)))
    slides = [_slide(joint, low, high) for joint in joints]
    length = float(np.linalg.norm(vectors(points), axis=1).sum()) + (slides[0][1] - slides[0][0]) / 2
    length += sum(max(abs(least), abs(most)) for least, most in slides[1:])
    second = np.zeros(3) if len(joints) == 1 or joints[1].sliding else joints[1].axis * points[1]
    along = sum(slides[0]) / 2 if joints[0].sliding else float(joints[0].axis @ (bodies[1] @ [*second, 1.0])[:3])
    return bodies[0][:3, 3] + bodies[0][:3, :3] @ (along * joints[0].axis), length


def _slide(joint: PathJoint, low: np.ndarray, high: np.ndarray) -> tuple[float, float]:
    """The least and the greatest value of a sliding joint [m]; zero for one that turns."""
    if not joint.sliding:
        return (0.0, 0.0)
    first, second = (joint.value(q) for q in (low, high))
    return min(first, second), max(first, second)
