"""Arguments of the reference methods, checked once before the first iteration."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from maira_qp.arrays import real_array
from maira_qp.errors import OptionError, PoseError
from maira_qp.orientation import nearest_rotation, orthonormality_deviation

ROTATION_TOLERANCE = 1e-5
"""Largest entry of |R R^T - I| at which a target's rotation part still counts as one, slightly rounded."""


def rigid_target(target: Any) -> np.ndarray:
    """A target pose (4, 4) [m] with its rotation part made exact. Raises `PoseError` if it is not rigid."""
    T = real_array(target, (4, 4), "target", PoseError)
    if not np.array_equal(T[3], (0.0, 0.0, 0.0, 1.0)):
        raise PoseError(f"the last row of a target must be 0, 0, 0, 1, got {T[3].tolist()}")
    deviation = orthonormality_deviation(T[:3, :3])
    if deviation > ROTATION_TOLERANCE:
        raise PoseError(
            f"the target's rotation part is {deviation:.2g} from orthonormal (allowed: {ROTATION_TOLERANCE:g});"
            " for the nearest rotation on purpose use mq.pose(matrix=T, project=True)"
        )
    if np.linalg.det(T[:3, :3]) < 0:
        raise PoseError("the target's rotation part is a reflection (its determinant is negative)")
    T[:3, :3] = nearest_rotation(T[:3, :3])
    return T


def positive(value: Any, name: str, *, infinite: bool = False) -> float:
    """A number > 0, finite unless `infinite`. Raises `OptionError`."""
    if not _is_real(value) or not 0 < value <= math.inf or (math.isinf(value) and not infinite):
        raise OptionError(f"{name} must be a positive number, got {value!r}")
    return float(value)


def not_negative(value: Any, name: str) -> float:
    """A finite number >= 0. Raises `OptionError`."""
    if not _is_real(value) or not 0 <= value < math.inf:
        raise OptionError(f"{name} must be a number that is zero or more, got {value!r}")
    return float(value)


def count(value: Any, name: str) -> int:
    """A whole number >= 0. Raises `OptionError`."""
    if not isinstance(value, (int, np.integer)) or isinstance(value, bool) or value < 0:
        raise OptionError(f"{name} must be a whole number, zero or more, got {value!r}")
    return int(value)


def _is_real(value: Any) -> bool:
    return isinstance(value, (int, float, np.integer, np.floating)) and not isinstance(value, bool)
