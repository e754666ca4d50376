"""A proof that poses of a path cannot be followed within the allowed steps, as data that other code can check."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, eq=False)
class PathProof:
    """Boxes of joint values that hold all configurations in which an arm can be that has followed a path so far.

    It is checked pose by pose, with any other inverse kinematics. At pose `at[0]` each configuration within the limits
    that reaches the pose within the tolerances is in a box of `boxes[0]`, or is the given one. At pose `at[k]` it is in
    a box of `boxes[k]`, or in some joint further than `(at[k] - at[k - 1]) step` from each box of `boxes[k - 1]`. At
    the last of these poses there is no box: whoever is there has made a larger step.
    """

    at: np.ndarray
    """(m,) indices of poses of the path"""
    boxes: tuple[np.ndarray, ...]
    """Lower and upper ends (b, 2, n) [rad] of the boxes of each of them; those of the last are none"""
    step: np.ndarray
    """(n,) the allowed step from pose to pose [rad]"""
    is_start_given: bool
    """It is about one configuration at the first of them, not about all"""

    @property
    def words(self) -> str:
        """For people."""
        begin = "the given configuration" if self.is_start_given else "every configuration"
        return f"from {begin} at pose {self.at[0]}, pose {self.at[-1]} is out of reach of the allowed steps"
