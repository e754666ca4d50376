"""Paths that leave the tool free to turn about one of its axes: the arm has a joint more, which turns the tool.

A weld, a drill or a nozzle works however it is turned about its own axis: a task that leaves this rotation free asks an
arm for five numbers. With a joint about that axis behind the tip it is the task of a whole pose again, of an arm with a
redundancy more: six axes become seven, and whoever follows paths needs to know no more.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin
from scipy.spatial.transform import Rotation

from maira_qp.problem.limits.linear import LinearLimit
from maira_qp.problem.problem import Problem
from maira_qp.problem.targets import Targets
from maira_qp.problem.tasks.frame import PoseTask
from maira_qp.robots.model.revolutions import TURN
from maira_qp.robots.model.robot import Robot

TURNING = (pin.JointModelRUBX, pin.JointModelRUBY, pin.JointModelRUBZ)
"""Joints that turn without limits about x, y, z."""
NAME = "tool turned about its free axis"


def free_axis(problem: Problem) -> int | None:
    """Which axis of the tool the only task of a problem leaves free, the rest of the pose counting evenly."""
    task = problem.tasks[0]
    if len(problem.tasks) > 1 or not isinstance(task, PoseTask) or task.axes != "target" or task.target is not None:
        return None
    weights, is_free = task.all_weights, task.all_weights[3:] == 0.0
    turns = weights[3:][~is_free]
    is_even = bool((weights[:3] == weights[0]).all() and weights[0] > 0.0 and (turns == turns[:1]).all())
    is_of_tip = task.frame == problem.robot.tip and task.offset is None and problem.robot.is_chain
    return int(is_free.argmax()) if is_free.sum() == 1 and is_even and is_of_tip else None


def hint(problem: Problem) -> str:
    """What may be meant by a task that leaves the tool free to turn about an axis of the base; empty: no such task."""
    task = problem.tasks[0]
    if not isinstance(task, PoseTask) or task.axes != "base" or (task.all_weights[3:] == 0.0).sum() != 1:
        return ""
    return '; a tool that is free to turn about one of its own axes is PoseTask(orientation_weight=..., axes="target")'


def with_joint(problem: Problem, axis: int) -> Problem:
    """The problem of the arm with a joint more about the axis: its whole pose, and limits of the joints alone."""
    robot, task = problem.robot, problem.tasks[0]
    model, tip = robot.model.copy(), robot.model.frames[robot.frame_id(robot.tip)]
    joint = model.addJoint(tip.parentJoint, TURNING[axis](), tip.placement, NAME)
    model.addFrame(pin.Frame(NAME, joint, 0, pin.SE3.Identity(), pin.FrameType.BODY))
    weights = np.asarray(task.all_weights)  # type: ignore[attr-defined]
    whole = PoseTask(position_weight=float(weights[0]), orientation_weight=float(weights[3:].max()))
    turning = Robot.from_model(model, tip=NAME, name=robot.name)
    linear = [limit for limit in problem.additional_limits if isinstance(limit, LinearLimit)]
    wider = [replace(limit, A=np.pad(limit.A, ((0, 0), (0, 1)))) for limit in linear]
    return Problem.build(turning, task=whole, limits=wider, options=problem.options)


def start_with_joint(robot: Robot, q: np.ndarray, target: pin.SE3, axis: int) -> np.ndarray:
    """The start (n + 1,) whose tool is turned about the axis as the target is, as far as that goes."""
    R = robot.at(q).placement(None).rotation.T @ target.rotation
    i, j = (axis + 1) % 3, (axis + 2) % 3
    return np.append(q, np.arctan2(R[j, i] - R[i, j], R[i, i] + R[j, j]))


def without_turning(targets: Targets, axis: int, loop: bool) -> Targets:
    """The targets, of the frame behind the joint, each turned about the axis so that none turns about it from the last.

    How they are turned about it is of no account, and need not be smooth. Where the end is the beginning, it stays so:
    what is left of a turn between the two is spread over the path.
    """
    rows = targets.rows.copy()
    R = Rotation.from_matrix(rows[:, 0, :9].reshape(-1, 3, 3))
    between = (R[:-1].inv() * R[1:]).as_quat()
    turns = np.concatenate([[0.0], -np.cumsum(2.0 * np.arctan2(between[:, axis], between[:, 3]))])
    if loop and len(turns) > 1:
        last = R[-1].inv() * R[0]
        left = 2.0 * np.arctan2(last.as_quat()[axis], last.as_quat()[3]) - turns[-1]
        turns += np.linspace(0.0, left - TURN * np.round(left / TURN), len(turns))
    R = R * Rotation.from_rotvec(turns[:, None] * np.eye(3)[axis])
    rows[:, 0, :9] = R.as_matrix().reshape(-1, 9)
    return Targets((NAME,), rows, targets.deviations)
