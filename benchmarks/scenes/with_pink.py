"""The scenes with Pink. Each function is all that a user writes; it returns what is called in every tick.

Settings are those of its own examples where they have the scene: `arm_panda.py`, `barriers/kukas_self_collision.py`.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from typing import Any

import numpy as np
import pinocchio as pin
from pink import Configuration, solve_ik
from pink.barriers import SelfCollisionBarrier
from pink.tasks import FrameTask, PostureTask
from pink.utils import process_collision_pairs

from scenes.problems import CAMERA, Scene


def reach(scene: Scene) -> Callable[[Any], np.ndarray]:
    """A pose and a posture, weighted."""
    model = pin.buildModelFromXML(scene.urdf)
    at = Configuration(model, model.createData(), scene.start)
    pose = FrameTask(scene.tips[0], position_cost=1.0, orientation_cost=1.0, lm_damping=0.1)
    posture = PostureTask(cost=1e-3)
    posture.set_target(scene.start)

    def tick(target: Any) -> np.ndarray:
        pose.set_target(target)
        velocity = solve_ik(at, [pose, posture], scene.dt, solver="daqp", safety_break=False)
        at.integrate_inplace(velocity, scene.dt)
        return at.q

    return tick


circle = reach
"""The same tasks; only the targets differ."""


def dual(scene: Scene) -> Callable[[Any], np.ndarray]:
    """Two poses and a posture, weighted."""
    model = pin.buildModelFromXML(scene.urdf)
    at = Configuration(model, model.createData(), scene.start)
    poses = [FrameTask(tip, position_cost=2.0, orientation_cost=1.0, lm_damping=0.1) for tip in scene.tips]
    posture = PostureTask(cost=1e-3)
    posture.set_target(scene.start)

    def tick(targets: Any) -> np.ndarray:
        for pose in poses:
            pose.set_target(targets[pose.frame])
        velocity = solve_ik(at, [*poses, posture], scene.dt, solver="daqp", safety_break=False)
        at.integrate_inplace(velocity, scene.dt)
        return at.q

    return tick


def collision(scene: Scene) -> Callable[[Any], np.ndarray]:
    """A pose and a posture, weighted, and a barrier between the links."""
    model = pin.buildModelFromXML(scene.urdf)
    shapes, data = collision_model(scene, model)
    at = Configuration(model, model.createData(), scene.start, collision_model=shapes, collision_data=data)
    pose = FrameTask(scene.tips[0], position_cost=1.0, orientation_cost=1.0, lm_damping=0.1)
    posture = PostureTask(cost=1e-3)
    posture.set_target(scene.start)
    apart = SelfCollisionBarrier(
        n_collision_pairs=len(shapes.collisionPairs), gain=20.0, safe_displacement_gain=1.0, d_min=scene.margin
    )

    def tick(target: Any) -> np.ndarray:
        pose.set_target(target)
        velocity = solve_ik(at, [pose, posture], scene.dt, solver="daqp", barriers=[apart], safety_break=False)
        at.integrate_inplace(velocity, scene.dt)
        return at.q

    return tick


def look(scene: Scene) -> Callable[[Any], np.ndarray]:
    """An orientation made by hand, since there is no task that looks: the turn about the axis is not free."""
    model = pin.buildModelFromXML(scene.urdf)
    at = Configuration(model, model.createData(), scene.start)
    gaze = FrameTask(scene.tips[0], position_cost=0.0, orientation_cost=1.0, lm_damping=1e-3)
    posture = PostureTask(cost=1e-2)
    posture.set_target(scene.start)

    def tick(point: Any) -> np.ndarray:
        hand = at.get_transform_frame_to_world(gaze.frame)
        axis, sight = hand.rotation @ CAMERA, point - hand.translation
        across, along = np.cross(axis, sight), axis @ sight
        sine = np.linalg.norm(across)
        turn = pin.exp3(across / sine * np.arctan2(sine, along)) if sine > 0 else np.eye(3)
        gaze.set_target(pin.SE3(turn @ hand.rotation, hand.translation))
        velocity = solve_ik(at, [gaze, posture], scene.dt, solver="daqp", safety_break=False)
        at.integrate_inplace(velocity, scene.dt)
        return at.q

    return tick


def collision_model(scene: Scene, model: pin.Model) -> tuple[pin.GeometryModel, pin.GeometryData]:
    """The convex hulls of the links, in the pairs that the SRDF leaves, as the other libraries have them."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of an argument that it reads twice
        shapes = pin.buildGeomFromUrdfString(model, scene.urdf, pin.GeometryType.COLLISION, [str(scene.package)])
    for part in shapes.geometryObjects:
        if hasattr(part.geometry, "buildConvexHull"):
            part.geometry.buildConvexHull(True, "Qt")
            part.geometry = part.geometry.convex
    return shapes, process_collision_pairs(model, shapes, str(scene.srdf))


def native(scene: Scene, target: Any) -> Any:
    """A target as a user gives it."""
    return target if scene.looks or len(scene.tips) > 1 else target[scene.tips[0]]


def pairs(scene: Scene) -> int:
    """How many pairs of shapes the collision scene looks at."""
    return len(collision_model(scene, pin.buildModelFromXML(scene.urdf))[0].collisionPairs)
