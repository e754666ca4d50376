"""How the motion of a hand becomes that of a tool."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from maira_qp.arrays import is_number, real_array
from maira_qp.errors import OptionError, PoseError, shown
from maira_qp.orientation import exact_rotation


@dataclass(frozen=True, kw_only=True, eq=False)
class Clutch:
    """The tool moves as the hand does from where both are when the clutch is engaged: `p + scale A dp`."""

    scale: float = 1.0
    """How far the tool moves for a motion of the hand; > 0. Below 1 for fine work"""
    rotation_scale: float = 1.0
    """The same for angles; >= 0, 0 keeps the orientation. Where it is not 1, the orientation depends on the way"""
    alignment: Any = None
    """A (3, 3): rotation from the frame that the hand's poses are given in to the robot's base; None: they agree"""

    def __post_init__(self) -> None:
        for name, is_valid in (("scale", lambda s: s > 0), ("rotation_scale", lambda s: s >= 0)):
            value = getattr(self, name)
            if not (is_number(value) and is_valid(value) and value < math.inf):
                least = "positive" if name == "scale" else "not negative"
                raise OptionError(f"{name} of a Clutch must be a finite number and {least}, got {shown(value)}")
            object.__setattr__(self, name, float(value))
        A = np.eye(3) if self.alignment is None else real_array(self.alignment, (3, 3), "alignment", OptionError)
        try:
            A = exact_rotation(A, "alignment")
        except PoseError as reason:
            raise OptionError(str(reason)) from None
        A.setflags(write=False)
        object.__setattr__(self, "alignment", A)
