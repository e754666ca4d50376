"""The scenes with Mink. Each function is all that a user writes; it returns what is called in every tick.

Settings are those of its own examples where they have the scene: `arm_ur5e.py`, `dual_iiwa.py`,
`arm_ur5e_wrist_cam_lookat.py`.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import combinations
from typing import Any
from xml.etree import ElementTree

import mink
import mujoco
import numpy as np
from mink import CollisionAvoidanceLimit, Configuration, ConfigurationLimit, VelocityLimit, solve_ik

from scenes.problems import CAMERA, Scene


def reach(scene: Scene) -> Callable[[Any], np.ndarray]:
    """A pose and a posture, weighted."""
    model = mujoco_model(scene)
    at = Configuration(model, scene.start)
    pose = mink.FrameTask(scene.tips[0], "body", position_cost=1.0, orientation_cost=1.0, lm_damping=0.1)
    posture = mink.PostureTask(model, cost=1e-3)
    posture.set_target(scene.start)
    limits = [ConfigurationLimit(model), VelocityLimit(model, speeds(scene))]

    def tick(target: Any) -> np.ndarray:
        pose.set_target(target)
        velocity = solve_ik(at, [pose, posture], scene.dt, "daqp", limits=limits)
        at.integrate_inplace(velocity, scene.dt)
        return at.q

    return tick


circle = reach
"""The same tasks; only the targets differ."""


def dual(scene: Scene) -> Callable[[Any], np.ndarray]:
    """Two poses and a posture, weighted."""
    model = mujoco_model(scene)
    at = Configuration(model, scene.start)
    poses = [mink.FrameTask(tip, "body", position_cost=2.0, orientation_cost=1.0, lm_damping=0.1) for tip in scene.tips]
    posture = mink.PostureTask(model, cost=1e-3)
    posture.set_target(scene.start)
    limits = [ConfigurationLimit(model), VelocityLimit(model, speeds(scene))]

    def tick(targets: Any) -> np.ndarray:
        for pose in poses:
            pose.set_target(targets[pose.frame_name])
        velocity = solve_ik(at, [*poses, posture], scene.dt, "daqp", limits=limits)
        at.integrate_inplace(velocity, scene.dt)
        return at.q

    return tick


def collision(scene: Scene) -> Callable[[Any], np.ndarray]:
    """A pose and a posture, weighted, and a limit between the links."""
    model = mujoco_model(scene)
    at = Configuration(model, scene.start)
    pose = mink.FrameTask(scene.tips[0], "body", position_cost=1.0, orientation_cost=1.0, lm_damping=0.1)
    posture = mink.PostureTask(model, cost=1e-3)
    posture.set_target(scene.start)
    apart = CollisionAvoidanceLimit(
        model,
        geom_pairs(scene, model),
        minimum_distance_from_collisions=scene.margin,
        collision_detection_distance=0.1 + scene.margin,
    )
    limits = [ConfigurationLimit(model), VelocityLimit(model, speeds(scene)), apart]

    def tick(target: Any) -> np.ndarray:
        pose.set_target(target)
        velocity = solve_ik(at, [pose, posture], scene.dt, "daqp", limits=limits)
        at.integrate_inplace(velocity, scene.dt)
        return at.q

    return tick


def look(scene: Scene) -> Callable[[Any], np.ndarray]:
    """A point to look at and a posture, weighted."""
    model = mujoco_model(scene)
    at = Configuration(model, scene.start)
    gaze = mink.LookAtTask(scene.tips[0], "body", axis=CAMERA, cost=1.0, lm_damping=1e-3)
    posture = mink.PostureTask(model, cost=1e-2)
    posture.set_target(scene.start)
    limits = [ConfigurationLimit(model), VelocityLimit(model, speeds(scene))]

    def tick(point: Any) -> np.ndarray:
        gaze.set_target(point)
        velocity = solve_ik(at, [gaze, posture], scene.dt, "daqp", damping=1e-3, limits=limits)
        at.integrate_inplace(velocity, scene.dt)
        return at.q

    return tick


def mujoco_model(scene: Scene) -> mujoco.MjModel:
    """The URDF with the masses that MuJoCo insists on, its fixed links kept, and the meshes handed to it."""
    root = ElementTree.fromstring(scene.urdf)
    for link in root.findall("link"):
        for visual in link.findall("visual"):
            link.remove(visual)
    compiler = {"boundmass": "1", "boundinertia": "1", "fusestatic": "false"}
    ElementTree.SubElement(ElementTree.SubElement(root, "mujoco"), "compiler", compiler)
    files = {mesh.attrib["filename"].removeprefix("package://") for mesh in root.iter("mesh")}
    assets = {name.rpartition("/")[2]: (scene.package / name).read_bytes() for name in files if scene.package}
    return mujoco.MjModel.from_xml_string(ElementTree.tostring(root, encoding="unicode"), assets)


def speeds(scene: Scene) -> dict[str, float]:
    """The largest speed of each joint [rad/s], which MuJoCo does not read from a URDF."""
    return dict(zip(scene.robot.joint_names, scene.robot.velocity_limit, strict=True))


def geom_pairs(scene: Scene, model: mujoco.MjModel) -> list[tuple[list[int], list[int]]]:
    """The pairs of links that the SRDF leaves, each as the shapes of the one and those of the other."""
    assert scene.srdf is not None
    left_out = {
        frozenset((pair.attrib["link1"], pair.attrib["link2"]))
        for pair in ElementTree.parse(scene.srdf).getroot().iter("disable_collisions")
    }
    bodies = {model.body(k).name: mink.get_body_geom_ids(model, k) for k in range(1, model.nbody)}
    kept = [pair for pair in combinations(bodies, 2) if frozenset(pair) not in left_out]
    return [(bodies[one], bodies[other]) for one, other in kept if bodies[one] and bodies[other]]


def native(scene: Scene, target: Any) -> Any:
    """A target as a user gives it."""
    if scene.looks:
        return target
    poses = {tip: mink.SE3.from_matrix(pose.homogeneous) for tip, pose in target.items()}
    return poses if len(poses) > 1 else poses[scene.tips[0]]


def pairs(scene: Scene) -> int:
    """How many pairs of shapes the collision scene looks at."""
    model = mujoco_model(scene)
    return len(CollisionAvoidanceLimit(model, geom_pairs(scene, model)).geom_id_pairs)
