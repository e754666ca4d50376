"""What is true of a run, by the walk over the URDF; distances between the links by Pinocchio alone."""

from __future__ import annotations

import warnings
from dataclasses import replace

import numpy as np
import pinocchio as pin

from maira_qp.evaluation.judge import Judge, Verdict
from scenes.problems import CAMERA, Scene


def verdict(scene: Scene, q: np.ndarray) -> Verdict:
    """Of a run q (N + 1, n) [rad], the start first: a figure a tick (N,); the smallest distance is that of them all.

    A scene that looks has angles alone: position errors are NaN.
    """
    judge = Judge(scene.urdf, scene.robot.base, scene.tips, scene.robot.joint_names)
    targets = {} if scene.looks else {tip: scene.poses(tip) for tip in scene.tips}
    found = replace(judge.verdict(q, targets, scene.dt), distance=smallest_distance(scene, q[1:]))
    if not scene.looks:
        return found
    hand = judge.forward(q[1:])
    axis, sight = hand[:, :3, :3] @ CAMERA, scene.targets - hand[:, :3, 3]
    angle = np.arctan2(np.linalg.norm(np.cross(axis, sight), axis=1), (axis * sight).sum(axis=1))
    return replace(found, position_error=np.full(len(angle), np.nan), orientation_error=angle)


def smallest_distance(scene: Scene, q: np.ndarray) -> float:
    """Between any two of the links' convex hulls in the pairs that the SRDF leaves [m]; NaN without one.

    Raises `ValueError` if Pinocchio has the joints in another order.
    """
    if scene.srdf is None:
        return float("nan")
    model = pin.buildModelFromXML(scene.urdf)
    if tuple(model.names)[1:] != scene.robot.joint_names:
        raise ValueError(f"the joints are {list(model.names)[1:]}, not {list(scene.robot.joint_names)}")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of an argument that it reads twice
        shapes = pin.buildGeomFromUrdfString(model, scene.urdf, pin.GeometryType.COLLISION, [str(scene.package)])
    for part in shapes.geometryObjects:
        if hasattr(part.geometry, "buildConvexHull"):
            part.geometry.buildConvexHull(True, "Qt")
            part.geometry = part.geometry.convex
    shapes.addAllCollisionPairs()
    pin.removeCollisionPairs(model, shapes, str(scene.srdf))
    data, found = model.createData(), shapes.createData()
    smallest = np.inf
    for each in q:
        pin.computeDistances(model, data, shapes, found, each)
        smallest = min(smallest, *(result.min_distance for result in found.distanceResults))
    return float(smallest)
