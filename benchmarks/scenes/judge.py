"""The judge: Pinocchio alone, on a model that it loads itself, and what follows about a run."""

from __future__ import annotations

import warnings
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from scenes.problems import CAMERA, Scene
from scenes.race import Run

SLACK = 1e-9
"""By how much a limit may be exceeded [rad, rad/s]: q + v dt is rounded."""


@dataclass(frozen=True)
class Verdict:
    """What is true of a run of N ticks."""

    too_fast: int
    """Ticks in which a joint was faster than its limit."""
    excess: float
    """By how much at most [rad/s]; 0 where none was."""
    outside: int
    """Ticks at whose end a joint was outside its limits."""
    beyond: float
    """By how much at most [rad]; 0 where none was."""
    failed: int
    """Ticks in which the library raised an error."""
    travel: float
    """How far all joints went together [rad]: a joint that runs to and fro goes far."""
    distance: float
    """The smallest distance between two links [m], over all ticks; NaN where nobody asks."""
    errors: np.ndarray
    """(N, 2) position [m] and angle [rad] of the worst tip after each tick; position NaN where it is free."""
    counted: np.ndarray
    """(N,) of bool, as the scene says"""
    ends: np.ndarray
    """Ticks, as the scene says"""

    def summary(self, kind: int) -> tuple[float, float, float]:
        """Mean and largest error while the target can be reached, and largest at the ends; kind 0: [m], 1: [rad]."""
        counted = self.errors[self.counted, kind]
        return float(counted.mean()), float(counted.max()), float(self.errors[self.ends, kind].max())


def judge(scene: Scene, run: Run) -> Verdict:
    """A run as the judge sees it. Raises `ValueError` if its model has the joints in another order."""
    model = pin.buildModelFromXML(scene.urdf)
    if tuple(model.names)[1:] != scene.robot.joint_names:
        raise ValueError(f"the joints are {list(model.names)[1:]}, not {list(scene.robot.joint_names)}")
    q = run.q[1:]
    speed = (np.abs(np.diff(run.q, axis=0)) / scene.dt - model.velocityLimit).max(axis=1)
    beyond = np.maximum(model.lowerPositionLimit - q, q - model.upperPositionLimit).max(axis=1)
    return Verdict(
        too_fast=int((~(speed <= SLACK)).sum()),  # NaN counts
        excess=float(max(speed.max(), 0.0)),
        outside=int((~(beyond <= SLACK)).sum()),
        beyond=float(max(beyond.max(), 0.0)),
        failed=run.failed,
        travel=float(np.abs(np.diff(run.q, axis=0)).sum()),
        distance=_smallest_distance(scene, model, q),
        errors=_errors(scene, model, q),
        counted=scene.counted,
        ends=scene.ends,
    )


def _errors(scene: Scene, model: pin.Model, q: np.ndarray) -> np.ndarray:
    """Position [m] and angle [rad] (N, 2) of the worst tip."""
    data, errors = model.createData(), np.zeros((len(q), 2))
    frames = [model.getFrameId(tip) for tip in scene.tips]
    for k, target in enumerate(scene.targets):
        pin.framesForwardKinematics(model, data, q[k])
        if scene.looks:
            hand = data.oMf[frames[0]]
            axis, sight = hand.rotation @ CAMERA, target - hand.translation
            errors[k] = np.nan, np.arctan2(np.linalg.norm(np.cross(axis, sight)), axis @ sight)
            continue
        for tip, frame in zip(scene.tips, frames, strict=True):
            off = np.linalg.norm(data.oMf[frame].translation - target[tip].translation)
            chord = np.linalg.norm(data.oMf[frame].rotation - target[tip].rotation)
            angle = 2.0 * np.arcsin(min(chord / np.sqrt(8.0), 1.0))  # |A - B| = 2 sqrt(2) sin(angle / 2)
            errors[k] = np.maximum(errors[k], (off, angle))
    return errors


def _smallest_distance(scene: Scene, model: pin.Model, q: np.ndarray) -> float:
    """Between any two of the links' convex hulls in the pairs that the SRDF leaves [m]; NaN without one."""
    if scene.srdf is None:
        return float("nan")
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
