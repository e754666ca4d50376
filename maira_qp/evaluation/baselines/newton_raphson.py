r"""Newton-Raphson by the pseudo-inverse: position only, pose, and pose with motion in the null space.

    repeat up to max_iterations times
        e  = x_d - f(q)                                          position only, or
        e  = [p_d - p(q); 1/2 sum_k R(:, k) x R_d(:, k)]         pose
        stop if |e_p| < position tolerance and |e_w| < orientation tolerance
        dq = step J^+ e + (I - J^+ J) alpha grad w(q)            w: an objective to climb, null space only
        q  = q + dq                                              no joint by more than max_step

These methods know no limits. Each angle is brought back into the turn about the middle of its range, which changes no
pose (from a singular start the steps are many turns long). The pose error `axis sin(angle)` is also zero half a turn
away from the target, where the method can stop and call it converged.

Source: Siciliano et al., "Robotics: Modelling, Planning and Control", 2009, sections 3.5 and 3.7.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from maira_qp.arrays import real_array
from maira_qp.errors import ConfigurationError, OptionError, PoseError, shown
from maira_qp.evaluation.baselines.inputs import count, positive
from maira_qp.evaluation.baselines.iteration import capped, iterate
from maira_qp.evaluation.baselines.joints import within_a_turn
from maira_qp.evaluation.baselines.residuals import (
    Residual,
    pose_residual,
    position_residual,
    sine_orientation_error,
    within,
)
from maira_qp.evaluation.baselines.result import BaselineResult
from maira_qp.orientation import rigid
from maira_qp.robots.dh.table import DHTable

RANK_THRESHOLD = 1e-6
"""Singular values of J below this part of the largest one count as zero."""


def newton_position(
    table: DHTable,
    point: Any,
    q0: Any,
    *,
    step: float = 1.0,
    max_step: float = math.inf,
    tolerance: float = 1e-3,
    max_iterations: int = 200,
) -> BaselineResult:
    """Bring the tool to a point (3,) [m] from q0 (n,) [rad or m], its orientation left free.

    `step` > 0 is the learning rate (1: full Newton steps); `max_step` > 0 caps each joint's step [rad or m]; converged:
    |x_d - f(q)| < `tolerance` [m]. Raises `PoseError`, `ConfigurationError`, `OptionError`.
    """
    point = real_array(point, (3,), "point", PoseError)
    tolerance = positive(tolerance, "tolerance")
    met = within(tolerance, tolerance)
    return _newton(table, position_residual(table, point), met, q0, step, max_step, max_iterations)


def newton_pose(
    table: DHTable,
    target: Any,
    q0: Any,
    *,
    step: float = 1.0,
    max_step: float = math.inf,
    position_tolerance: float = 1e-3,
    orientation_tolerance: float = 1e-3,
    max_iterations: int = 200,
) -> BaselineResult:
    """Bring the tool to a target pose (4, 4) [m] from q0 (n,) [rad or m].

    `step` and `max_step` as for `newton_position`; converged: |e_p| < `position_tolerance` [m] and
    |e_w| < `orientation_tolerance` (the sine of the angle). Raises `PoseError`, `ConfigurationError`, `OptionError`.
    """
    residual = pose_residual(table, rigid(target, "target"), sine_orientation_error)
    met = _pose_met(position_tolerance, orientation_tolerance)
    return _newton(table, residual, met, q0, step, max_step, max_iterations)


def newton_null_space(
    table: DHTable,
    target: Any,
    q0: Any,
    gradient: Callable[[np.ndarray], np.ndarray],
    *,
    alpha: float,
    step: float = 1.0,
    max_step: float = math.inf,
    position_tolerance: float = 1e-3,
    orientation_tolerance: float = 1e-3,
    max_iterations: int = 200,
) -> BaselineResult:
    """`newton_pose` that also climbs an objective w in the null space of the pose, until the pose is reached.

    `gradient` maps q (n,) to grad w (n,), see `evaluation.baselines.objectives`; `alpha` > 0 is its gain, which depends
    on the curvature of w (100 suits the distance from the limits of a 7-joint arm, 1 its manipulability). It stops
    where the pose has converged, wherever w stands. Raises `PoseError`, `ConfigurationError`, `OptionError`.
    """
    if not callable(gradient):
        raise OptionError(f"gradient must be a function of q, got {shown(gradient)}")
    alpha = positive(alpha, "alpha")

    def climb(q: np.ndarray) -> np.ndarray:
        return alpha * real_array(gradient(q.copy()), (table.n,), "the gradient", OptionError)

    residual = pose_residual(table, rigid(target, "target"), sine_orientation_error)
    met = _pose_met(position_tolerance, orientation_tolerance)
    return _newton(table, residual, met, q0, step, max_step, max_iterations, climb)


def _pose_met(position_tolerance: float, orientation_tolerance: float) -> Callable[[np.ndarray], bool]:
    return within(
        positive(position_tolerance, "position_tolerance"), positive(orientation_tolerance, "orientation_tolerance")
    )


def _newton(
    table: DHTable,
    residual: Residual,
    met: Callable[[np.ndarray], bool],
    q0: Any,
    step: float,
    max_step: float,
    max_iterations: int,
    climb: Callable[[np.ndarray], np.ndarray] | None = None,
) -> BaselineResult:
    """The loop of all three; `climb` gives alpha grad w (n,)."""
    start = real_array(q0, (table.n,), "q0", ConfigurationError)
    step, max_step = positive(step, "step"), positive(max_step, "max_step", infinite=True)

    def newton_step(q: np.ndarray, e: np.ndarray, J: np.ndarray) -> np.ndarray:
        J_pinv = np.linalg.pinv(J, rcond=RANK_THRESHOLD)
        dq = step * (J_pinv @ e)
        if climb is not None:
            v = climb(q)
            dq += v - J_pinv @ (J @ v)
        return within_a_turn(table, q + capped(dq, max_step))

    return iterate(start, residual, newton_step, met, count(max_iterations, "max_iterations"))
