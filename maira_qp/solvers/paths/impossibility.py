"""Prove for an S-R-S arm that poses of a path cannot be followed within the allowed steps.

All configurations that reach a pose exactly lie on circles, one for each branch, over the swivel angle psi. These are
cut into cells, and each cell put into a box of joint values. As psi changes by h, shoulder and wrist turn by h: the
middle of three axes at right angles to each other turns by at most h, the outer two by `h / sin g`, where g is how far
the first and the last axis are from being parallel, which changes by at most h itself.

Where a pose is reached within tolerances, the wrist is a little elsewhere. By that the elbow's angle differs, and
shoulder and wrist turn by no more than the elbow and the direction of the wrist do. Near the ends of the reach, where
the elbow's angle is a square root of the distance, nothing is proved.

Of the boxes at a pose only those are left that a box of the pose before is within the allowed step of. Where none is
left, no path leads there.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from maira_qp.analytic.srs.geometry import SRS
from maira_qp.kernels.paths.boxes import within_a_step
from maira_qp.problem.problem import Problem
from maira_qp.problem.targets import pose_of
from maira_qp.results.path_proof import PathProof
from maira_qp.results.path_solution import PathSolution

CELLS = (128, 512)
"""Cells of the swivel angle: if the first do not prove it, the next are tried."""
RIGHT = 1e-9
"""The outer axes are at right angles to the middle one to this cosine, or nothing is proved."""
ROUNDING = 1e-9
"""What boxes are wider than the bounds [rad]"""
STRETCHED = 1e-3
"""A wrist nearer to an end of its reach than by this share of the arm's length is too near."""
MOST = 400
"""Of a longer path so many poses are looked at: between two of them as many steps are allowed as there are."""
TURNS = (0, -1, 1)


def proof_of(problem: Problem, path: PathSolution) -> PathProof | None:
    """A proof that a path cannot be followed within its part that ends with the first failure, or goes on after it.

    None where the arm is not S-R-S, its task not the whole pose, the failure of a loop, or none was found.
    """
    srs, k = SRS.of(problem.robot) if problem.robot.is_chain else None, path.first_failure
    is_whole_pose = len(problem.tasks) == 1 and bool((problem.tasks[0].all_weights > 0.0).all())  # type: ignore
    is_step = any(each.index == k and each.is_step for each in path.failures)
    if srs is None or k is None or not is_step or not is_whole_pose or path.rules.reconfigurations:
        return None
    missed = np.flatnonzero(~path.success)
    begin, end = max([0, *(missed[missed < k] + 1)]), min([len(path), *missed[missed > k]])
    start = path.q[0] if begin == 0 and path.rules.is_start_given else None
    poses = np.array([pose_of(row).homogeneous for row in path._targets])
    options = problem.options
    within = options.position_tolerance, options.orientation_tolerance
    return path_proof(srs, poses[begin:end], within, path.allowed_step, start, begin)


def path_proof(
    srs: SRS,
    poses: np.ndarray,
    within: tuple[float, float],
    step: np.ndarray,
    start: np.ndarray | None,
    first: int,
) -> PathProof | None:
    """A proof about poses (N, 4, 4), the first of which has the index `first` in its path; None: none was found.

    Args:
        srs: the arm.
        poses: the poses.
        within: the tolerances that they are reached to [m, rad].
        step: (n,) the allowed step from pose to pose [rad].
        start: the configuration (n,) at the first of them [rad]; None: any.
        first: its index.
    """
    at_right_angles = all(abs(joint.a @ joint.b) < RIGHT and abs(joint.b @ joint.c) < RIGHT for joint in srs.joints)
    if not at_right_angles or not (np.abs([srs.lower, srs.upper]) <= 3.0 * np.pi).all():
        return None
    at = np.unique(np.linspace(0, len(poses) - 1, min(len(poses), MOST)).astype(int))
    if any(_is_near_an_end(srs, poses[k], within) for k in at):
        return None
    for cells in CELLS:
        boxes = [boxes_at(srs, poses[0], within, cells) if start is None else np.stack([start, start])[None]]
        for before, k in pairwise(at.tolist()):
            here = boxes_at(srs, poses[k], within, cells)
            found = np.empty(len(here), np.bool_)
            within_a_step(boxes[-1], here, (k - before) * step, found)
            boxes.append(here[found])
            if not found.any():
                return PathProof(first + at[: len(boxes)], tuple(boxes), step, start is not None)
    return None


def boxes_at(srs: SRS, T: np.ndarray, within: tuple[float, float], cells: int) -> np.ndarray:
    """Boxes (m, 2, 7) of joint values [rad] that hold all configurations within the limits with the tip at T (4, 4).

    `within` tolerances [m, rad], for a wrist that is not near an end of its reach.
    """
    half = np.pi / cells
    psi = -np.pi + half * (2 * np.arange(cells) + 1)
    distance, off = _distance(srs, T), _wrist_error(srs, within)
    bent = max(abs(_bend(srs, distance + side * off) - _bend(srs, distance)) for side in (-1.0, 1.0))
    turned = off / (distance - off) + bent
    turns = turned, turned + bent + within[1]
    found = [np.empty((0, 2, 7))]
    for branch in srs.elbow_branches(T):
        q, wide = srs.evaluate(branch, psi), np.full((cells, 7), bent)
        for k, (joint, circle) in enumerate(zip(srs.joints, (branch.shoulder, branch.wrist), strict=True)):
            middle = half + turns[k]
            nearest = joint.nearness(circle.at(psi)) - middle
            outer = np.where(nearest > 0.0, middle / np.sin(np.maximum(nearest, 1e-12)), np.inf)
            wide[:, 4 * k : 4 * k + 3] = np.stack([outer, np.full(cells, middle), outer], axis=1)
        wide = np.minimum(wide + ROUNDING, np.pi)
        ends = np.stack([q - wide[:, None], q + wide[:, None]], axis=2).reshape(-1, 2, 7)
        found.append(_within_limits(srs, ends))
    return np.ascontiguousarray(np.concatenate(found))


def _distance(srs: SRS, T: np.ndarray) -> float:
    """Of the wrist from the shoulder [m], with the tip at T (4, 4)."""
    return float(np.linalg.norm(srs.wrist_centre(T) - srs.shoulder))


def _wrist_error(srs: SRS, within: tuple[float, float]) -> float:
    """How far the wrist is off [m] where the tip is within tolerances."""
    return within[0] + within[1] * float(np.linalg.norm(srs.wrist - srs.tip[:3, 3]))


def _bend(srs: SRS, distance: float) -> float:
    """The angle [rad] by which the elbow is bent from the stretched arm; see `SRS.elbow_branches`."""
    smallest, largest = srs.reach
    short, long = largest**2 - distance**2, distance**2 - smallest**2
    return float(2 * np.arctan2(np.sqrt(max(short, 0.0)), np.sqrt(max(long, 0.0))))


def _is_near_an_end(srs: SRS, T: np.ndarray, within: tuple[float, float]) -> bool:
    """Whether the wrist is near the shoulder, or an end of its reach."""
    distance, (smallest, largest) = _distance(srs, T), srs.reach
    near = STRETCHED * srs.robot.length + 2.0 * _wrist_error(srs, within)
    return min(distance - smallest, largest - distance) < near


def _within_limits(srs: SRS, boxes: np.ndarray) -> np.ndarray:
    """What of boxes (m, 2, 7), at all turns of their joints, is within the limits."""
    for joint in range(7):
        low, high, turned = srs.lower[joint] - ROUNDING, srs.upper[joint] + ROUNDING, []
        for turns in TURNS:
            ends = boxes[:, :, joint] + 2 * np.pi * turns
            is_within = (ends[:, 0] <= high) & (ends[:, 1] >= low)
            some = boxes[is_within]
            some[:, :, joint] = np.clip(ends[is_within], low, high)
            turned.append(some)
        boxes = np.concatenate(turned)
    return boxes
