"""The scenes with maira_qp. Each function is all that a user writes; it returns what is called in every tick."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

import maira_qp as mq
from scenes.problems import CAMERA, Scene


def reach(scene: Scene, backend: str | None = None) -> Callable[[Any], np.ndarray]:
    """A pose; below it a posture."""
    robot = mq.Robot.from_urdf(scene.urdf, tip=scene.tips)
    pose = mq.PoseTask(position_weight=1.0, orientation_weight=1.0)
    solver = mq.Solver(robot, task=pose, redundancy=mq.Strict(mq.Posture(scene.start)), backend=backend)
    q = scene.start

    def tick(target: Any) -> np.ndarray:
        nonlocal q
        q = solver.step(q, target, scene.dt).q
        return q

    return tick


circle = reach
"""The same tasks; only the targets differ."""


def reach_weighted(scene: Scene, backend: str | None = None) -> Callable[[Any], np.ndarray]:
    """A pose and a posture in one cost, weighted as the peers do."""
    robot = mq.Robot.from_urdf(scene.urdf, tip=scene.tips)
    pose = mq.PoseTask(position_weight=1.0, orientation_weight=1.0)
    posture = mq.Weighted(mq.Posture(scene.start), weight=1e-6)
    solver = mq.Solver(robot, task=pose, redundancy=posture, backend=backend)
    q = scene.start

    def tick(target: Any) -> np.ndarray:
        nonlocal q
        q = solver.step(q, target, scene.dt).q
        return q

    return tick


def dual(scene: Scene, backend: str | None = None) -> Callable[[Any], np.ndarray]:
    """Two poses; below them a posture."""
    robot = mq.Robot.from_urdf(scene.urdf, tip=scene.tips)
    poses = [mq.PoseTask(frame=tip, position_weight=2.0, orientation_weight=1.0) for tip in scene.tips]
    solver = mq.Solver(robot, task=poses, redundancy=mq.Strict(mq.Posture(scene.start)), backend=backend)
    q = scene.start

    def tick(target: Any) -> np.ndarray:
        nonlocal q
        q = solver.step(q, target, scene.dt).q
        return q

    return tick


def dual_weighted(scene: Scene, backend: str | None = None) -> Callable[[Any], np.ndarray]:
    """Two poses and a posture in one cost, weighted as the peers do."""
    robot = mq.Robot.from_urdf(scene.urdf, tip=scene.tips)
    poses = [mq.PoseTask(frame=tip, position_weight=2.0, orientation_weight=1.0) for tip in scene.tips]
    posture = mq.Weighted(mq.Posture(scene.start), weight=1e-6)
    solver = mq.Solver(robot, task=poses, redundancy=posture, backend=backend)
    q = scene.start

    def tick(target: Any) -> np.ndarray:
        nonlocal q
        q = solver.step(q, target, scene.dt).q
        return q

    return tick


def collision(scene: Scene, backend: str | None = None) -> Callable[[Any], np.ndarray]:
    """A pose and a margin between the links; below it a posture."""
    robot = mq.Robot.from_urdf(scene.urdf, tip=scene.tips)
    pose = mq.PoseTask(position_weight=1.0, orientation_weight=1.0)
    apart = mq.CollisionLimit(margin=scene.margin, meshes=[scene.package], allowed=scene.srdf)
    posture = mq.Strict(mq.Posture(scene.start))
    solver = mq.Solver(robot, task=pose, limits=[apart], redundancy=posture, backend=backend)
    q = scene.start

    def tick(target: Any) -> np.ndarray:
        nonlocal q
        q = solver.step(q, target, scene.dt).q
        return q

    return tick


def look(scene: Scene, backend: str | None = None) -> Callable[[Any], np.ndarray]:
    """A point to look at; below it a posture."""
    robot = mq.Robot.from_urdf(scene.urdf, tip=scene.tips)
    gaze = mq.LookAtTask(axis=CAMERA)
    solver = mq.Solver(robot, task=gaze, redundancy=mq.Strict(mq.Posture(scene.start)), backend=backend)
    q = scene.start

    def tick(target: Any) -> np.ndarray:
        nonlocal q
        q = solver.step(q, target, scene.dt).q
        return q

    return tick


def native(scene: Scene, target: Any) -> Any:
    """A target as a user gives it: an array (4, 4), or one for each tip."""
    if scene.looks:
        return mq.pose(target).homogeneous
    poses = {tip: pose.homogeneous for tip, pose in target.items()}
    return poses if len(poses) > 1 else poses[scene.tips[0]]


def pairs(scene: Scene) -> int:
    """How many pairs of shapes the collision scene looks at."""
    limit = mq.CollisionLimit(margin=scene.margin, meshes=[scene.package], allowed=scene.srdf)
    return len(limit.of(scene.robot).scene.pairs)
