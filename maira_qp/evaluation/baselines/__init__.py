"""The textbook methods of inverse kinematics, on the plain DH chain: the reference that the solvers are judged against.

They share no kinematics with the solvers (no Pinocchio, no QP), and they do what their texts say, faults included:
only `dh_clamped` respects the joint limits.
"""

from maira_qp.evaluation.baselines.dh_clamped import dh_clamped
from maira_qp.evaluation.baselines.gradient_descent import gradient_descent_pose, gradient_descent_position
from maira_qp.evaluation.baselines.newton_raphson import newton_null_space, newton_pose, newton_position
from maira_qp.evaluation.baselines.objectives import (
    limit_distance,
    limit_distance_gradient,
    manipulability,
    manipulability_gradient,
    obstacle_distance,
    obstacle_distance_gradient,
)
from maira_qp.evaluation.baselines.result import BaselineResult
from maira_qp.evaluation.baselines.targets import sample_target

__all__ = [
    "BaselineResult",
    "dh_clamped",
    "gradient_descent_pose",
    "gradient_descent_position",
    "limit_distance",
    "limit_distance_gradient",
    "manipulability",
    "manipulability_gradient",
    "newton_null_space",
    "newton_pose",
    "newton_position",
    "obstacle_distance",
    "obstacle_distance_gradient",
    "sample_target",
]
