"""LeRobot's `RobotKinematics`, answered by maira_qp.

`lerobot.model.kinematics.RobotKinematics` takes one step of a QP toward the target per call, in which position and
orientation are weighed against each other. Here control ticks are taken from the given configuration until the arm
stands: position first, and orientation in what the position leaves free, which on an arm of five joints is not all of
it. No tick moves a joint by more than `MAX_TICK`, none leaves the limits, and there are no restarts: the answer is on
the branch on which the arm stands. A target that is far away, or beyond a singularity, is approached by at most
`max_step` per call.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pinocchio as pin

from maira_qp.arrays import is_number, real_array
from maira_qp.errors import ConfigurationError, OptionError, RobotError, listed, shown
from maira_qp.problem.options import Options
from maira_qp.problem.pose import as_pose
from maira_qp.problem.tasks.frame import OrientationTask, PositionTask
from maira_qp.results.status import StepStatus
from maira_qp.robots.model.robot import Robot
from maira_qp.robots.urdf.safe_xml import xml_root
from maira_qp.solvers.solver import Solver

MAX_TICK = 0.1
"""How far a joint moves in one tick at most [rad, or m]."""
MAX_TICKS = 300
"""Ticks per call at most; a call that needs more goes on with the next one."""
LEVELS = Options(level_position_tolerance=1e-6)
"""By how much [m] a tick may leave the position for the orientation."""
_MOVING = ("revolute", "continuous", "prismatic")


class RobotKinematics:
    """Forward and inverse kinematics in degrees, in place of `lerobot.model.kinematics.RobotKinematics`.

    The same constructor, the same two methods. Values that follow those of the joints in `joint_names`, and those of
    joints that do not move the frame, such as a gripper's, are passed on as they are. Prismatic joints are in metres.
    """

    def __init__(
        self,
        urdf_path: str | os.PathLike[str],
        target_frame_name: str = "gripper_frame_link",
        joint_names: Sequence[str] | None = None,
        *,
        max_step: float | None = 30.0,
    ) -> None:
        """Load an arm.

        Args:
            urdf_path: URDF file; meshes are not opened.
            target_frame_name: link that `forward_kinematics` places and `inverse_kinematics` moves.
            joint_names: joints in the order of the configurations, k of them; None: all joints of the file that are not
                mimic joints, in Pinocchio's order. Joints that are left out stand at zero, or at the nearest limit.
            max_step: how far a joint moves per call of `inverse_kinematics` at most [degrees, or m], a way back into
                the limits apart; None: as far as the target asks for.

        Raises `RobotError`, `FrameError`; `OptionError` for names that are no joints of the file.
        """
        root = xml_root(urdf_path)
        joints = [joint.get("name", "") for joint in root.iter("joint") if _moves(joint)]
        self.joint_names = _in_order_of_pinocchio(root, joints) if joint_names is None else list(joint_names)
        for name in self.joint_names:
            if name not in joints:
                raise OptionError(f"joint_names: {shown(name)} is no joint that moves; {listed(joints, name)}")
        if len(set(self.joint_names)) < len(self.joint_names):
            raise OptionError(f"joint_names: a joint is named twice in {', '.join(self.joint_names)}")
        if max_step is not None and not (is_number(max_step) and max_step > 0):
            raise OptionError(f"max_step must be a positive number of degrees, got {shown(max_step)}")
        self.target_frame_name = target_frame_name
        self.max_step = max_step
        whole = Robot.from_urdf(urdf_path, tip=target_frame_name)
        zero = dict(zip(whole.joint_names, whole.clip(np.zeros(whole.n)), strict=True))
        still = {name: value for name, value in zero.items() if name not in self.joint_names}
        self.robot = whole.locked(still) if still else whole
        """The joints that move the frame."""
        self._places = self.robot.order(self.joint_names)
        self._units = np.where(self.robot.slides, 1.0, np.pi / 180)
        slow = self.robot.limited(velocity=MAX_TICK, acceleration=np.inf)
        tasks = PositionTask(), OrientationTask()
        self._solvers = {
            (True, True): Solver(slow, task=tasks[0], tasks=[OrientationTask(priority=2)], options=LEVELS),
            (True, False): Solver(slow, task=tasks[0]),
            (False, True): Solver(slow, task=tasks[1]),
        }

    def forward_kinematics(self, joint_pos_deg: Any) -> np.ndarray:
        """Compute the pose (4, 4) [m] of the target frame in the URDF's root link.

        `joint_pos_deg`: at least k joint values [degrees] in the order of `joint_names`.
        Raises `ConfigurationError`.
        """
        return np.array(self.robot.forward(self._configuration(joint_pos_deg, "joint_pos_deg")).homogeneous)

    def inverse_kinematics(
        self,
        current_joint_pos: Any,
        desired_ee_pose: Any,
        position_weight: float = 1.0,
        orientation_weight: float = 0.01,
    ) -> np.ndarray:
        """Compute joint values that put the target frame at a pose, or as near as the arm comes to it.

        Args:
            current_joint_pos: at least k joint values [degrees], where the arm stands; outside the limits it begins at
                the nearest configuration within.
            desired_ee_pose: (4, 4) [m] in the URDF's root link.
            position_weight: 0: the position does not count. Any other number is the same: it goes before orientation.
            orientation_weight: 0: the orientation does not count. Any other number is the same.

        Returns joint values [degrees], as many as were given, those of the arm within the joint limits.
        Raises `ConfigurationError`, `PoseError`, `OptionError`.
        """
        given = self._checked(current_joint_pos, "current_joint_pos")
        weights = position_weight, orientation_weight
        for name, weight in zip(("position_weight", "orientation_weight"), weights, strict=True):
            if not (is_number(weight) and weight >= 0):
                raise OptionError(f"{name} must be a number >= 0, got {shown(weight)}")
        target = as_pose(desired_ee_pose, "desired_ee_pose")
        start = self.robot.clip(self._configuration(given, "current_joint_pos"))
        solver = self._solvers.get((weights[0] > 0, weights[1] > 0))
        q = start if solver is None else self._followed(solver, start, target)
        result = np.array(given, dtype=float)
        result[self._places] = q / self._units
        is_same_kind = isinstance(current_joint_pos, np.ndarray) and len(given) > len(self.joint_names)
        kind = given.dtype if is_same_kind and np.issubdtype(given.dtype, np.floating) else float
        return result.astype(kind)

    def _followed(self, solver: Solver, start: np.ndarray, target: pin.SE3) -> np.ndarray:
        """Where ticks of one second lead from a configuration (n,) within limits."""
        q = start
        farthest = np.inf if self.max_step is None else self.max_step * self._units
        for _ in range(MAX_TICKS):
            step = solver.step(q, target, 1.0)
            if (np.abs(step.q - start) > farthest).any():
                return _up_to(start, q, step.q, farthest)
            q = step.q
            if step.status != StepStatus.MOVING:
                break
        return q

    def _checked(self, values: Any, name: str) -> np.ndarray:
        """Joint values (m,), m >= k. Raises `ConfigurationError`."""
        values, k = np.asarray(values), len(self.joint_names)
        if values.ndim != 1 or len(values) < k:
            raise ConfigurationError(
                f"{name} must hold at least {k} joint values [degrees], of {', '.join(self.joint_names)}; got an array "
                f"of shape {values.shape}"
            )
        return values

    def _configuration(self, values: Any, name: str) -> np.ndarray:
        """The robot's configuration (n,) [rad, or m]. Raises `ConfigurationError`."""
        own = real_array(self._checked(values, name)[self._places], (len(self._places),), name, ConfigurationError)
        return own * self._units


def _moves(joint: ElementTree.Element) -> bool:
    return joint.get("type") in _MOVING and joint.find("mimic") is None


def _in_order_of_pinocchio(root: ElementTree.Element, joints: list[str]) -> list[str]:
    """The names of joints as Pinocchio, and so PlaCo, orders them. Raises `RobotError`."""
    try:
        names = pin.buildModelFromXML(ElementTree.tostring(root, encoding="unicode")).names
    except (ValueError, RuntimeError, IndexError) as reason:
        raise RobotError(f"Pinocchio cannot read the URDF: {reason}; give joint_names") from None
    return [name for name in names if name in joints]


def _up_to(start: np.ndarray, here: np.ndarray, ahead: np.ndarray, farthest: np.ndarray | float) -> np.ndarray:
    """The last configuration on the way from here to ahead that is within `farthest` of the start, each joint."""
    way = ahead - here
    room = np.where(way > 0, start + farthest - here, here - start + farthest)
    share = np.min(np.divide(room, np.abs(way), out=np.ones_like(way), where=way != 0))
    return here + np.clip(share, 0.0, 1.0) * way
