"""roboplan's planner of Cartesian paths: differential IK to convergence along the path, then a timed trajectory.

Settings are in its favour: no task beside the pose, and errors up to what the criterion allows.
"""

from __future__ import annotations

import numpy as np
from peers.arms import Arm

from maira_qp.evaluation.contestant import Contestant
from paths.judging import Criterion

GROUP = "arm"
ACCELERATION, BLEND = 20.0, 1e-5
"""Largest acceleration of a joint [rad/s^2], which a URDF does not give; rounding of corners [rad]."""
CLOSE = 1e-6
"""Errors of its own first solution [m], [rad]."""
LEVER = Criterion().position / Criterion().orientation
"""What a rotation counts beside a distance [m/rad]."""
AHEAD = 0.1
"""How far ahead in the trajectory the next pose is looked for, of all of it."""


def planner(arm: Arm) -> Contestant:
    """`CartesianPathPlanner`; a pose's configuration is that of the trajectory where it comes nearest to the pose."""
    from roboplan.cartesian_planning import CartesianPathPlanner, CartesianPlannerOptions
    from roboplan.core import (
        CartesianConfiguration,
        CartesianPath,
        JointConfiguration,
        Scene,
        SceneContext,
        loadJointLimitsConfig,
        loadUrdfSceneDescriptionFromXml,
    )
    from roboplan.simple_ik import SimpleIk, SimpleIkOptions

    base, tip, names = arm.robot.base, arm.robot.tip, list(arm.robot.joint_names)
    scene = Scene(arm.name, loadUrdfSceneDescriptionFromXml(arm.urdf))
    scene.addGroupFromChain(GROUP, base, tip)
    limits = arm.path.with_suffix(".yaml")
    each = (f"  {name}: {{max_acceleration: [{ACCELERATION}], max_jerk: [{100 * ACCELERATION}]}}\n" for name in names)
    limits.write_text("joint_limits:\n" + "".join(each))
    scene.importJointLimitsFromConfig(loadJointLimitsConfig(str(limits)))
    context = SceneContext(scene)
    solver = SimpleIk(
        scene,
        SimpleIkOptions(
            group_name=GROUP,
            max_iters=200,
            max_time=1.0,
            max_restarts=50,
            step_size=0.5,
            damping=1e-4,
            max_linear_error_norm=CLOSE,
            max_angular_error_norm=CLOSE,
            check_collisions=False,
        ),
    )
    criterion = Criterion()
    options = CartesianPlannerOptions(
        group_name=GROUP,
        max_position_error=criterion.position,
        max_orientation_error=criterion.orientation,
        lm_damping=1e-8,
        config_task_weight=0.0,
        toppra_blend_deviation=BLEND,
    )
    plans = CartesianPathPlanner(scene, options)
    middle = JointConfiguration(names, 0.5 * (arm.lower + arm.upper))

    def follow(poses: np.ndarray, start: np.ndarray | None) -> np.ndarray | None:
        begin = JointConfiguration(names, middle.positions if start is None else start)
        if start is None and not solver.solveIk(CartesianConfiguration(base, tip, poses[0]), middle, begin):
            return None
        trajectory = plans.plan(CartesianPath([base], [tip], [list(poses)]), begin)
        return nearest(arm, np.array(trajectory.positions), poses)

    return Contestant(
        name="roboplan planner",
        settings="CartesianPathPlanner, errors as judged",
        follow=follow,
        forward=lambda q: context.forwardKinematics(q, tip, base),
        limits=scene.getPositionLimitVectors(GROUP),
    )


def nearest(arm: Arm, q: np.ndarray, poses: np.ndarray) -> np.ndarray:
    """For each of the poses (N, 4, 4), in their order, the point of the polyline q (m, n) that comes nearest to it.

    Between two of its configurations the tool is taken to move along a line.
    """
    if len(q) < 2:
        return np.repeat(q, len(poses), axis=0)
    tools, wanted = _features(arm.judge.forward(q)), _features(poses)
    found, first = np.empty((len(poses), q.shape[1])), 0
    ahead = max(1, int(AHEAD * len(q)))
    for k, pose in enumerate(wanted):
        begin, end = tools[first : first + ahead][: len(q) - 1 - first], tools[first + 1 : first + 1 + ahead]
        way = end - begin
        share = ((pose - begin) * way).sum(axis=1) / np.maximum((way**2).sum(axis=1), 1e-30)
        share = np.clip(share, 0.0, 1.0)[:, None]
        i = int(((begin + share * way - pose) ** 2).sum(axis=1).argmin())
        found[k] = q[first + i] + share[i] * (q[first + i + 1] - q[first + i])
        first += i
    return found


def _features(poses: np.ndarray) -> np.ndarray:
    """Points (N, 12) whose distances are those of poses, small angles counted by `LEVER`."""
    return np.hstack([poses[:, :3, 3], LEVER / np.sqrt(2.0) * poses[:, :3, :3].reshape(-1, 9)])
