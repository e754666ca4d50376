r"""Gradient descent with the Jacobian's transpose: a learning rate, and a cap on the step of a joint.

    minimise 1/2 |e(q)|^2,   e = x_d - f(q)   or   e = [p_d - p(q); 2 log(quat(R_d R(q)^T))]

    repeat up to max_iterations times
        stop if |e_p| < position tolerance and |e_w| < orientation tolerance
        q = q + rate J^T e                                       no joint by more than max_step

J^T e is exactly the negative gradient, for the logarithm too: the map from the rotation vector's rate to the angular
velocity leaves the vector itself unchanged. The step is safe while rate < 2 / sigma_max(J)^2. No limits are respected;
as in `newton_raphson`, each angle is kept in the turn about the middle of its range.

Source: Wolovich and Elliott, "A computational technique for inverse kinematics", 1984.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from maira_qp.arrays import real_array
from maira_qp.errors import ConfigurationError, PoseError
from maira_qp.evaluation.baselines.inputs import count, positive
from maira_qp.evaluation.baselines.iteration import capped, iterate
from maira_qp.evaluation.baselines.joints import within_a_turn
from maira_qp.evaluation.baselines.residuals import Residual, pose_residual, position_residual, within
from maira_qp.evaluation.baselines.result import BaselineResult
from maira_qp.orientation import rigid
from maira_qp.robots.dh.table import DHTable


def gradient_descent_position(
    table: DHTable,
    point: Any,
    q0: Any,
    *,
    rate: float = 0.2,
    max_step: float = math.inf,
    tolerance: float = 1e-3,
    max_iterations: int = 2000,
) -> BaselineResult:
    """Bring the tool to a point (3,) [m] from q0 (n,) [rad or m], its orientation left free.

    `rate` > 0 is the learning rate; `max_step` > 0 caps each joint's step [rad or m]; converged: |x_d - f(q)| <
    `tolerance` [m]. Raises `PoseError`, `ConfigurationError`, `OptionError`.
    """
    residual = position_residual(table, real_array(point, (3,), "point", PoseError))
    tolerance = positive(tolerance, "tolerance")
    return _descend(table, residual, within(tolerance, tolerance), q0, rate, max_step, max_iterations)


def gradient_descent_pose(
    table: DHTable,
    target: Any,
    q0: Any,
    *,
    rate: float = 0.2,
    max_step: float = math.inf,
    position_tolerance: float = 1e-3,
    orientation_tolerance: float = 1e-3,
    max_iterations: int = 2000,
) -> BaselineResult:
    """Bring the tool to a target pose (4, 4) [m] from q0 (n,) [rad or m]; options as for `gradient_descent_position`.

    Converged: |e_p| < `position_tolerance` [m] and |e_w| < `orientation_tolerance` [rad]. Raises `PoseError`,
    `ConfigurationError`, `OptionError`.
    """
    residual = pose_residual(table, rigid(target, "target"))
    met = within(
        positive(position_tolerance, "position_tolerance"), positive(orientation_tolerance, "orientation_tolerance")
    )
    return _descend(table, residual, met, q0, rate, max_step, max_iterations)


def _descend(
    table: DHTable,
    residual: Residual,
    met: Callable[[np.ndarray], bool],
    q0: Any,
    rate: float,
    max_step: float,
    max_iterations: int,
) -> BaselineResult:
    start = real_array(q0, (table.n,), "q0", ConfigurationError)
    rate, max_step = positive(rate, "rate"), positive(max_step, "max_step", infinite=True)

    def descent_step(q: np.ndarray, e: np.ndarray, J: np.ndarray) -> np.ndarray:
        return within_a_turn(table, q + capped(rate * (J.T @ e), max_step))

    return iterate(start, residual, descent_step, met, count(max_iterations, "max_iterations"))
