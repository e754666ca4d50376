"""Proofs that a pose cannot be reached: what `Status.UNREACHABLE` stands on, and what can be checked of it.

A proof holds for every pose within the tolerances of the target, so that what a solver calls reached is never proved
unreachable. It speaks of the joint limits alone; further tasks and limits make a pose no easier to reach.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin

from maira_qp.analytic.bounding_points import pivots, tool_points
from maira_qp.analytic.joint_axes import screws
from maira_qp.analytic.srs.arrays import srs_array
from maira_qp.analytic.srs.geometry import SRS
from maira_qp.analytic.srs.unreachability import swivel_proof
from maira_qp.kernels.certificates.branch_and_bound import ORIENTATION, exclude
from maira_qp.kernels.layout import Pivot
from maira_qp.kernels.srs.swivel_intervals import INTERVALS, PIECES
from maira_qp.kernels.srs.unreachability import POSSIBLE, verdicts
from maira_qp.problem.problem import Problem
from maira_qp.problem.targets import Poses, row_of
from maira_qp.problem.tasks.frame import FrameTask
from maira_qp.results.certificate import TOO_FAR, TOO_NEAR, TURNED, BoxProof, Proof

MOST_BOXES = 2000
"""Boxes of joint values that a proof may take: a few milliseconds."""

ROUNDING = 1e-12
"""What kinematics may be off by, in lengths of the arm and of its slides, and in rad."""


@dataclass(frozen=True, eq=False)
class Proofs:
    """What can be proved for a task of the tip of a chain, as arrays for the kernels."""

    problem: Problem
    key: str
    """The key of the target"""
    chain: np.ndarray
    points: np.ndarray
    """(k, 4), see `kernels.certificates.branch_and_bound`"""
    pivots: np.ndarray
    """(p, 2)"""
    turn: float
    """How far the orientation may be off [rad]; inf: it is free"""
    srs: np.ndarray | None
    """(3, 80) see `kernels.srs.swivel`, of an S-R-S arm whose whole pose is wanted"""
    span: np.ndarray
    """(2,) the smallest and largest distance [m] of its shoulder and wrist within the limits of the elbow"""

    @staticmethod
    def build(problem: Problem) -> Proofs | None:
        """For the first level's task of the tip; None where there is none of the kind, or the robot is no chain."""
        robot, options = problem.robot, problem.options
        for task in problem.tasks if robot.is_chain else ():
            if not isinstance(task, FrameTask) or task.target is not None or task.offset is not None:
                continue
            if task.frame != robot.tip:
                continue
            placed, turned = task.kept[:3].all(), task.kept[3:].all()
            if placed or turned:
                places = tool_points(robot) if placed and turned else np.zeros((int(placed), 3))
                levers = np.linalg.norm(places, axis=1)
                slid = np.abs([robot.lower[robot.slides], robot.upper[robot.slides]]).max(axis=0).sum()
                rounding = ROUNDING * (robot.length + slid)
                near = options.position_tolerance + levers * options.orientation_tolerance + rounding
                turn = options.orientation_tolerance + ROUNDING if turned else np.inf
                srs = SRS.of(robot) if placed and turned else None
                points = np.column_stack([places, near])
                arm = None if srs is None else srs_array(srs)
                span = np.zeros(2) if srs is None else np.array(srs.span)
                return Proofs(problem, task.key, robot.chain, points, pivots(robot), turn, arm, span)
        return None

    def boxed(self, problem: Problem, chain: np.ndarray) -> Proofs:
        """The same for the arm with tighter limits, and its chain (n + 1, 17)."""
        of_arm = None if self.srs is None else SRS.of(self.problem.robot)
        if of_arm is None:
            return replace(self, problem=problem, chain=chain)
        srs = of_arm.of_boxed(problem.robot)
        return replace(self, problem=problem, chain=chain, srs=srs_array(srs), span=np.array(srs.span))

    def unreachable(self, rows: np.ndarray, most_boxes: int = MOST_BOXES) -> np.ndarray:
        """Which of the poses (N, 12) are proved to be out of reach, (N,) of bool; the others may be.

        A proof by boxes takes at most so many.
        """
        if self.srs is not None:
            return self._verdicts(rows) != POSSIBLE
        return self._excluded(rows, np.empty((0, 2 * self.problem.robot.n + 2)), most_boxes) > 0

    def proof(self, poses: Poses) -> Proof | None:
        """Why the target of the tip cannot be reached, if that can be proved."""
        n, target = self.problem.robot.n, poses[self.key]
        srs = None if self.srs is None else SRS.of(self.problem.robot)
        if srs is not None:
            near, turn = self.problem.options.position_tolerance, self.problem.options.orientation_tolerance
            return swivel_proof(srs, target, position_tolerance=near, orientation_tolerance=turn)
        boxes = np.empty((MOST_BOXES, 2 * n + 2))
        (count,) = self._excluded(row_of(target)[None], boxes)
        if not count:
            return None
        ends, tests = boxes[:count, : 2 * n].reshape(count, 2, n), boxes[:count, 2 * n :].astype(int)
        each = zip(ends, tests.tolist(), strict=True)
        sides = np.array([self._side(box, point, pivot, target) for box, (point, pivot) in each])
        return BoxProof(ends.copy(), tests, sides, self.points[:, :3], self.pivots, self.problem.robot.joint_names)

    def _side(self, box: np.ndarray, point: int, pivot: int, target: pin.SE3) -> int:
        """How a test that rules out a box (2, n) does so.

        The box is farther off as a whole, or nearer: its middle tells which.
        """
        robot, q = self.problem.robot, box.mean(axis=0)
        if point == ORIENTATION or pivot == len(self.pivots):
            return TURNED if point == ORIENTATION else TOO_FAR
        origins, axes = screws(robot, q)
        joint, along = int(self.pivots[pivot, Pivot.JOINT]), self.pivots[pivot, Pivot.ALONG]
        wanted, there = (pose.act(self.points[point, :3]) for pose in (target, robot.forward(q)))
        away = np.linalg.norm([wanted, there] - (origins[joint] + along * axes[joint]), axis=1)
        return TOO_FAR if away[0] > away[1] else TOO_NEAR

    def _verdicts(self, rows: np.ndarray) -> np.ndarray:
        codes, pieces = np.empty(len(rows), np.int64), np.empty((8, PIECES, 3))
        near, turn = self.problem.options.position_tolerance, self.problem.options.orientation_tolerance
        verdicts(self.srs, rows, near, turn, *INTERVALS.empty(), pieces, codes)
        return codes

    def _excluded(self, rows: np.ndarray, boxes: np.ndarray, most_boxes: int = MOST_BOXES) -> np.ndarray:
        excluded = np.empty(len(rows), np.int64)
        exclude(self.chain, self.points, self.pivots, self.turn, rows, most_boxes, boxes, excluded)
        return excluded
