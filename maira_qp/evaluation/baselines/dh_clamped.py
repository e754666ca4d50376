r"""Clamped, damped least squares on the DH chain: the plain reference.

    repeat up to max_iterations times
        e     = [p_d - p(q); 2 log(quat(R_d R(q)^T))]            stop if |e| < tolerance
        J^+   = J^T (J J^T + damping I)^-1
        N     = I - J^+ J
        q_sec = -alpha (q - q_mid)
        q     = clip(q + J^+ e + N q_sec, lower, upper)

The clip is made after the step, which knows nothing of it: where a limit is in the way, the other joints do not make
up for it, and the method stalls. That is what the QP does better. The pull to mid-range passes through N, which is not
an exact projector with damping, so near a singularity the two terms settle at a small error that never vanishes.

Sources: Nakamura and Hanafusa, "Inverse kinematic solutions with singularity robustness", 1986; Liegeois, "Automatic
supervisory control of the configuration and behavior of multibody mechanisms", 1977.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from maira_qp.arrays import real_array
from maira_qp.errors import ConfigurationError
from maira_qp.evaluation.baselines.inputs import count, not_negative, positive
from maira_qp.evaluation.baselines.iteration import iterate
from maira_qp.evaluation.baselines.joints import pull_to_middle
from maira_qp.evaluation.baselines.residuals import pose_residual
from maira_qp.evaluation.baselines.result import BaselineResult
from maira_qp.orientation import rigid
from maira_qp.robots.dh.table import DHTable


def dh_clamped(
    table: DHTable,
    target: Any,
    q0: Any,
    *,
    damping: float = 1e-6,
    alpha: float = 0.01,
    tolerance: float = 1e-6,
    max_iterations: int = 500,
) -> BaselineResult:
    """Solve for a target pose (4, 4) [m] from q0 (n,) [rad or m], inside the limits; q0 is clipped to them first.

    `damping` > 0 is added to the diagonal of J J^T; `alpha` >= 0 is the pull to the middle of the ranges (none for a
    joint without limits); converged: |e| < `tolerance`, metres and radians together. A result that has not converged is
    only proximal. Raises `PoseError`, `ConfigurationError`, `OptionError`.
    """
    target = rigid(target, "target")
    q0 = real_array(q0, (table.n,), "q0", ConfigurationError)
    damping, alpha = positive(damping, "damping"), not_negative(alpha, "alpha")
    tolerance, max_iterations = positive(tolerance, "tolerance"), count(max_iterations, "max_iterations")
    regular = damping * np.eye(6)

    def step(q: np.ndarray, e: np.ndarray, J: np.ndarray) -> np.ndarray:
        q_sec = -alpha * pull_to_middle(table, q)
        # J^+ e + (I - J^+ J) q_sec = q_sec + J^+ (e - J q_sec): one solve, and J^+ is never formed
        dq = q_sec + J.T @ np.linalg.solve(J @ J.T + regular, e - J @ q_sec)
        return np.clip(q + dq, table.lower, table.upper)

    start = np.clip(q0, table.lower, table.upper)
    return iterate(
        start, pose_residual(table, target), step, lambda e: bool(np.linalg.norm(e) < tolerance), max_iterations
    )
