"""The loop that all reference methods share: evaluate the error, test it, step."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from maira_qp.evaluation.baselines.residuals import Residual
from maira_qp.evaluation.baselines.result import BaselineResult

LARGEST_JOINT = 1e9
"""A joint beyond this [rad or m] has diverged: its angle keeps fewer than seven digits."""


def iterate(
    q0: np.ndarray,
    residual: Residual,
    step: Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray],
    met: Callable[[np.ndarray], bool],
    max_iterations: int,
) -> BaselineResult:
    """Repeat `q <- step(q, e, J)` from q0 (n,) until `met(e)`; the error is tested before each step and after the last.

    It ends early where a step diverges or has no value, at the configuration before that step.
    """
    history = [q0]
    with np.errstate(over="ignore", invalid="ignore"):
        e, J = residual(q0)
        while not met(e) and len(history) <= max_iterations:
            try:
                q = step(history[-1], e, J)
            except np.linalg.LinAlgError:
                break
            if not np.abs(q).max() < LARGEST_JOINT:  # true of NaN as well
                break
            history.append(q)
            e, J = residual(q)
        return BaselineResult(
            q=history[-1].copy(),
            converged=met(e),
            iterations=len(history) - 1,
            error=float(np.linalg.norm(e)),
            history=np.array(history),
        )


def capped(dq: np.ndarray, max_step: float) -> np.ndarray:
    """dq (n,), shortened if need be so that no joint moves by more than max_step [rad or m]; its direction is kept."""
    largest = np.abs(dq).max()
    return dq * (max_step / largest) if largest > max_step else dq
