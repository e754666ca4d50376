"""Proofs that a pose cannot be reached, as data that a few lines of other code can check."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from maira_qp.analytic.srs.unreachability import SwivelProof
from maira_qp.kernels.certificates.branch_and_bound import ORIENTATION
from maira_qp.kernels.layout import Pivot

TOO_FAR, TOO_NEAR, TURNED = 1, -1, 0
"""What rules out a box: the pose is farther from a pivot, or nearer, than any configuration of the box has the tool; or
none turns the tool as the pose has it."""


@dataclass(frozen=True, eq=False)
class BoxProof:
    """Boxes of joint values that hold all configurations within the limits, and none that reaches the pose.

    For each of them `tests` says what rules it out, see `kernels.certificates.branch_and_bound`: the distance of a
    point of the tool from a pivot on a joint's axis, or the orientation. Forward kinematics is all that it takes to
    check it.
    """

    boxes: np.ndarray
    """Lower and upper ends (m, 2, n) [rad or m]"""
    tests: np.ndarray
    """(m, 2) of int: the point, -1 for the orientation, and the pivot, past the last for the point itself"""
    sides: np.ndarray
    """(m,) of int: `TOO_FAR`, `TOO_NEAR` or `TURNED`, what the test finds of the pose"""
    points: np.ndarray
    """Points (k, 3) [m] in the axes of the tip"""
    pivots: np.ndarray
    """(p, 2): a joint, and how far along its axis [m] from its origin"""
    joint_names: tuple[str, ...]

    @property
    def words(self) -> str:
        """For people."""
        side = {TOO_FAR: "too far from", TOO_NEAR: "too near to"}
        if len(self.boxes) > 1:
            found = [f"{word} it" for each, word in side.items() if each in self.sides]
            ways = " or ".join(found + ["turned too far away from it"] * (TURNED in self.sides))
            return f"in each of {len(self.boxes)} boxes that together hold all joint values the tool is {ways}"
        point, pivot = self.tests[0]
        if point == ORIENTATION:
            return "no joint values within the limits turn the tool so far"
        if pivot == len(self.pivots):
            return "the tool comes nowhere near it"
        return f"it is {side[int(self.sides[0])]} {self.joint_names[int(self.pivots[pivot, Pivot.JOINT])]}"


Proof = BoxProof | SwivelProof
