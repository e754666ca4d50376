"""Numbers that look like millimetres or degrees where metres and radians are asked for: a word, never a conversion."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Protocol

import numpy as np

FAR, NEAR = 10.0, 10.0
"""A position farther than so many lengths of the arm is hinted at if, as millimetres, it is within so many."""
TURN = 2 * np.pi
"""Angles up to this [rad] are common in radians."""


class Arm(Protocol):
    """What is asked of a `Robot`, which makes use of this module itself."""

    length: float
    lower: np.ndarray
    upper: np.ndarray
    slides: np.ndarray

    @property
    def joint_names(self) -> Sequence[str]:
        """n names."""
        ...


def millimetres_hint(p: Any, robot: Arm) -> str:
    """A sentence if a position (3,) [m] looks like millimetres to an arm of that length, else nothing."""
    away = float(np.linalg.norm(p))
    if not FAR * robot.length < away <= 1e3 * NEAR * robot.length:
        return ""
    return (
        f"Positions are in metres: the target is {away:.4g} m away, the arm {robot.length:.3g} m long; "
        f"is it in millimetres?"
    )


def millimetres_hint_of_many(p: np.ndarray, robot: Arm) -> str:
    """The sentence for the farthest of positions (N, 3) [m], those aside that are not finite."""
    known = p[np.isfinite(p).all(axis=1)]
    return millimetres_hint(known[np.linalg.norm(known, axis=1).argmax()], robot) if len(known) else ""


def degrees_hint(q: np.ndarray, robot: Arm, what: str) -> str:
    """A sentence if joint values (n,) look like degrees: beyond the limits, a turn and more, but within as degrees."""
    turning = np.flatnonzero(~robot.slides)
    values, lower, upper = q[turning], robot.lower[turning], robot.upper[turning]
    is_out = ((values < lower) | (values > upper) | np.isinf(upper)) & (np.abs(values) > TURN)
    as_degrees = np.radians(values)
    if not is_out.any() or not ((lower <= as_degrees) & (as_degrees <= upper)).all():
        return ""
    worst = turning[np.where(is_out, np.abs(values), 0).argmax()]
    return f"Angles are in radians: {what} has {robot.joint_names[worst]} at {q[worst]:.4g} rad; is it in degrees?"


def degrees_hint_of_angles(angles: Any, what: str) -> str:
    """A sentence if angles [rad] of any kind are beyond a turn, and look like degrees, else nothing."""
    largest = float(np.abs(angles).max(initial=0.0))
    return f"Angles are in radians: {what} holds {largest:.4g} rad; is it in degrees?" if largest > TURN else ""
